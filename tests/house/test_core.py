"""The core alone: it runs, and a library of an extra that is missing is named in one line."""

import json
import re
from pathlib import Path

import pytest

from wideberth.tests.helpers.core_only import python, wideberth
from wideberth.tests.house.test_imports import CORE, ROOT, files_of

LINE = re.compile(r"pip install 'wideberth\[[\w,-]+\]'")


IMPORTED = """
print(json.dumps(sorted({name.partition(".")[0] for name in sys.modules}
                        - set(sys.stdlib_module_names) - before)))
"""


@pytest.mark.parametrize(
    ("statement", "most"),
    [
        ("import wideberth", {"wideberth"}),
        (
            "from wideberth.experiments.cli.app import app\n"
            "from typer.main import get_command\n"
            "get_command(app).get_help",
            {"wideberth", "annotated_doc", "click", "rich", "shellingham", "typer",
             "typing_extensions"},
        ),
    ],
)  # fmt: skip
def test_what_an_import_brings(statement: str, most: set[str], tmp_path: Path) -> None:
    begin = 'import json, sys\nbefore = {name.partition(".")[0] for name in sys.modules}\n'
    done = python(tmp_path, begin + statement + IMPORTED)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "wideberth" in json.loads(done.stdout) and set(json.loads(done.stdout)) <= most


WALK = """
import importlib, json
found = {}
for name in sys.argv[1].split():
    try:
        importlib.import_module(name)
    except Exception as error:
        found[name] = f"{type(error).__name__}: {error}"
print(json.dumps(found))
"""


def test_every_module_can_be_imported_or_names_its_extra(tmp_path: Path) -> None:
    names = [
        ".".join(("wideberth", *path.relative_to(ROOT).with_suffix("").parts))
        for room in CORE
        for path in files_of(room)
        if not {"data", "files"} & {*path.relative_to(ROOT).parts} and path.stem != "__init__"
    ]
    done = python(tmp_path, WALK, " ".join(names))
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert len(names) > 300 and all(LINE.search(text) for text in found.values()), found
    assert len(found) < 5, found


BUILT = """
import json
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import ROOMS, names
from wideberth.framework.values.errors import WideberthError
found = {}
for room in ROOMS:
    for name in names(room):
        try:
            build(room, {"type": name, "robot": "unicycle"} if room == "controllers" else name)
        except Exception as error:
            own = isinstance(error, WideberthError)
            kind = "WideberthError" if own else type(error).__name__
            found[f"{room}.{name}"] = f"{kind}: {error}"
print(json.dumps(found))
"""
BEYOND = {
    "controllers.orca",
}
"""Built-in plug-ins that need an extra."""


def test_a_plug_in_that_cannot_be_built_names_its_extra(tmp_path: Path) -> None:
    """Others lack a setting, or are built."""
    done = python(tmp_path, BUILT)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    assert all(text.startswith("WideberthError: ") for text in found.values()), found
    asked = {name for name, text in found.items() if LINE.search(text)}
    rest = {name: text for name, text in found.items() if name not in asked}
    assert not [text for text in rest.values() if "No module named" in text], rest
    assert asked == BEYOND


CONFIGS = """
import json
from wideberth.experiments.engine.shipped_configs import read_experiment, shipped
from wideberth.framework.values.errors import WideberthError
errors = {}
for name in shipped():
    try:
        read_experiment(name, [])
    except WideberthError as error:
        errors[name] = str(error)
print(json.dumps([shipped(), errors]))
"""
NEEDED = re.compile(r"needs (?:the library )?(\w+), .*pip install 'wideberth\[(\w+)\]'")
LIBRARIES = {("pyrvo", "arenas")}
"""Library that configs of the core need, and the extra that brings it."""


def test_configs_of_the_core_name_no_plug_in_of_another_package(tmp_path: Path) -> None:
    done = python(tmp_path, CONFIGS)
    assert done.returncode == 0, done.stderr[-2000:]
    names, errors = json.loads(done.stdout)
    assert names == sorted(path.stem for path in (ROOT / "experiments/configs").glob("*.yaml"))
    found = [NEEDED.search(text) for text in errors.values()]
    assert all(found), errors
    assert {match.groups() for match in found if match} == LIBRARIES


def test_the_first_script_runs(tmp_path: Path) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    done = python(tmp_path, script)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Command(" in done.stdout and (tmp_path / "plan.png").stat().st_size > 10_000


def test_studies_episodes_figures_and_pages(tmp_path: Path) -> None:
    for words in (
        ("run", "approximation_error", "--quick", "--workers", "2"),
        ("figures", "results/approximation_error-quick"),
        ("run", "crossing", "--quick", "--no-figures"),
        ("play", "results/crossing-quick", "--out", "page.html", "--no-open"),
        ("show", "results/crossing-quick"),
        ("report", "results/crossing-quick", "--out", "report.html"),
        ("describe", "mahalanobis_ellipse"),
        ("list",),
    ):
        done = wideberth(tmp_path, *words)
        assert done.returncode == 0, f"{words}: {done.stderr[-2000:]}"
    assert list((tmp_path / "results" / "approximation_error-quick" / "figures").glob("*.png"))
    assert (tmp_path / "page.html").stat().st_size > 100_000


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (("run", "crowd_agility"), "arenas"),
        (("check", "controller", "orca", "--set", "robot=unicycle"), "arenas"),
        (("run", "cascade_chicken_game"), "perception"),
        (("run", "warehouse"), "perception"),
        (("run", "nav2_rivals"), "nav2"),
        (("check", "controller", "nav2"), "nav2"),
        (("nav2", "params.yaml"), "nav2"),
        (("check", "detector", "chords"), "perception"),
        (("node", "node.yaml"), "ros"),
        (("bag", "crossing-quick"), "ros"),
        (("show", "ros", "node.rviz"), "ros"),
        (("export", "crossing", "--planner", "--out", "c"), "embedded"),
        (("run", "prediction_benchmark", "--set", "chosen=[mixture_density]"), "learning"),
        (("fit", "mixture_density", "none.txt", "--dt", "0.4", "--out", "a.json"), "learning"),
    ],
)
def test_what_needs_more_ends_in_one_line(
    words: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    done = wideberth(tmp_path, *words)
    assert done.returncode == 2, done.stderr[-2000:]
    lines = [line for line in done.stderr.splitlines() if "..." not in line]
    assert len(lines) == 1 and f"pip install 'wideberth[{extra}]'" in lines[0], done.stderr
    assert not list(tmp_path.iterdir()), "nothing was begun"
