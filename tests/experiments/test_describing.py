"""Names are found: listed with a line each, described, offered by the tab key, spelt right."""

import dataclasses
import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

import wideberth
from wideberth.experiments.cli import describing
from wideberth.experiments.cli.app import app
from wideberth.experiments.cli.describing import described, listed, split, summary
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import ROOMS, load, names
from wideberth.framework.values.errors import WideberthError


def printed(*arguments: str) -> str:
    done = CliRunner().invoke(app, list(arguments))
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("room", ROOMS)
def test_every_plug_in_is_described(room: str) -> None:
    for name in registry._built_in(room):
        is_described(room, name)


def is_described(room: str, name: str) -> None:
    text, found = described([room, name]), load(room, name)
    assert text.startswith(f"{name} ({room}): wideberth.") and listed(room)[name] in text
    for field in dataclasses.fields(found):
        if field.init:
            (line,) = [line for line in text.splitlines() if line.startswith(f"  {field.name} : ")]
            after = text.partition(line)[2].splitlines()[1]
            assert after.startswith("      "), f"{name}.{field.name} has no sentence"
    if found.__dict__.get("reference"):
        assert f"BibTeX: {found.reference.split(',')[0]}" in text
    config = yaml.safe_load(text.partition("In a config\n")[2].partition("\n\n")[0])
    config = config.get(room.removesuffix("s"), config)
    assert config["type"] == name
    if "..." not in config.values() and room != "experiments":
        build(room, config)
    line = text.partition("In Python\n")[2].splitlines()[0].strip()
    place: dict[str, object] = {}
    exec(line, place)
    assert place[found.__name__] is found


def test_a_region_says_what_it_promises() -> None:
    text = described(["minkowski_sum"])
    assert "plus disc: exact\nGuarantee on the collision risk" in text


def test_a_name_in_several_rooms_and_a_room() -> None:
    both = described(["separating_line"])
    assert "separating_line (regions)" in both and "separating_line (static_regions)" in both
    assert "square" not in described(["robot"]) and "unicycle  " in described(["robot"])
    assert described(["wideberth.robots.unicycle:Unicycle"]).count("Skid-steered") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["kalmann"], "did you mean 'kalman'"),
        (["robotz"], "did you mean 'robots'"),
        (["predictors", "kalmann"], "did you mean 'kalman'"),
        (["predictorz", "kalman"], "did you mean 'predictors'"),
        (["os:PathLike"], "is in no room"),
        (["a", "b", "c"], "a name, or a room and a name"),
    ],
)
def test_words_that_name_nothing(words: list[str], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        described(words)


def test_everything_is_listed_with_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = printed("list")
    for room in ROOMS:
        for name, line in listed(room).items():
            assert line and f"{name} " in text and line in text
    assert "\nconfigs\n" in text and "The paper's second scenario" in text
    (tmp_path / "other.py").write_text('class Mine:\n    """A third one.\n\n    More."""\n')
    monkeypatch.syspath_prepend(tmp_path)
    assert summary("other:Mine") == "A third one." and "other" not in sys.modules
    assert summary("other:Yours") == summary("nowhere.at_all:Mine") == ""


def test_the_list_of_robots_states_their_radii() -> None:
    rows = dict(line.split(maxsplit=1) for line in describing.room_lines("robot"))
    for name in names("robots"):
        assert rows[name].endswith(f"Radius {build('robots', name).radius:g} m unless stated.")
    assert "Radius 0.75 m" in rows["unicycle"] and "Radius 0.75 m" in printed("list")


@pytest.mark.parametrize(
    ("comment", "claim"),
    [
        ("# Men (Schoeller et al.\n# 2020: 0.39 m) walk.", "Men (Schoeller et al. 2020)"),
        ("# As in Schoeller et al. 2020. More.", "As in Schoeller et al. 2020."),
        ("# Some, e.g. one, i.e. few vs. many, cf. all: more.",
         "Some, e.g. one, i.e. few vs. many, cf. all"),
        ("# Walls (of 2 m): people. More.", "Walls (of 2 m)"),
        ("# What it took: al. More.", "What it took"),
        ("# In total. More.", "In total."),
    ],
)  # fmt: skip
def test_an_abbreviation_is_no_end_of_a_sentence(
    comment: str, claim: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(describing, "shipped", lambda: ["mine"])
    monkeypatch.setattr(describing, "shipped_text", lambda name: f"{comment}\ntype: tuning\n")
    assert listed("configs") == {"mine": claim}


def test_the_summaries_of_the_shipped_configs_are_whole() -> None:
    for name, claim in listed("configs").items():
        assert not claim.endswith("al.") and claim.count("(") == claim.count(")"), name


def test_a_name_that_cannot_be_imported_is_listed_as_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name whose docstring stands in another file is imported to be described."""
    folder = tmp_path / "third_party_package"
    folder.mkdir()
    (folder / "__init__.py").write_text("from ._made import Elsewhere\n")
    (folder / "_made.py").write_text(
        "from wideberth.controllers import PurePursuit\n"
        'class Elsewhere(PurePursuit):\n    """From another file."""\n'
        'class Here(Elsewhere):\n    """From here."""\n'
    )
    (folder / "unsound.py").write_text("class Broken(:\n")
    monkeypatch.syspath_prepend(tmp_path)
    targets = {
        "absent_module": "third_party_package.absent:Mine",
        "absent_class": "third_party_package._made:Mine",
        "unsound": "third_party_package.unsound:Broken",
        "elsewhere": "third_party_package:Elsewhere",
        "here": "third_party_package._made:Here",
    }
    points = [EntryPoint(name, at, "wideberth.controllers") for name, at in targets.items()]
    monkeypatch.setattr(registry, "_installed", registry._installed.__wrapped__)
    monkeypatch.setattr(registry, "entry_points", lambda group: points)
    found = listed("controllers")
    for name in ("absent_module", "absent_class", "unsound"):
        assert found[name] == (
            f"cannot be imported; `wideberth describe controllers {name}` says why"
        )
    assert found["elsewhere"] == "From another file." and found["here"] == "From here."


def test_sections_of_a_docstring() -> None:
    assert split("A.\n\nb\n\nRaises\n------\nE : f.\n")["Raises"] == "E : f."


def test_version_and_commands_without_arguments() -> None:
    assert printed("--version") == f"wideberth {wideberth.__version__}\n"
    for name in ("run", "check", "describe", "fit", "show", "explain", "cite", "export", "play"):
        done = CliRunner().invoke(app, [name])
        assert done.exit_code == 2 and "Usage:" in done.output and "--help" in done.output, name
    assert "Did you mean 'describe'?" in CliRunner().invoke(app, ["descibe"]).output
    assert "--quick" in CliRunner().invoke(app, ["run", "crossing", "--quik"]).output


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("run cros", ["crossing"]),
        ("list pre", ["predictors"]),
        ("check region mini", ["minimum_area", "minimum_trace"]),
        ("describe robots b", ["bicycle"]),
        ("describe kal", ["kalman"]),
        ("describe configs fault", ["fault_sweep"]),
        ("show config fault", ["fault_sweep"]),
    ],
)
def test_the_tab_key(line: str, offered: list[str]) -> None:
    words = f"wideberth {line}"
    place = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    script = (
        "import sys; from wideberth.experiments.cli.app import app\n"
        "try: app(prog_name='wideberth')\n"
        "except SystemExit: pass\n"
        "print([name for name in ('numpy', 'casadi') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True,
        env={**os.environ, "_WIDEBERTH_COMPLETE": "complete_bash", **place},
    )  # fmt: skip
    assert done.stdout.splitlines() == [*offered, "[]"], done.stderr
