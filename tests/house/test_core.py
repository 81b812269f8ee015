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


TRIED = """
import importlib, json, sys
from wideberth.experiments.engine.shipped_configs import read_experiment, shipped
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import ROOMS, names
from wideberth.framework.values.errors import WideberthError
found = {"modules": {}, "plug-ins": {}, "configs": {}}
def tried(kind, name, call, *given):
    try:
        call(*given)
    except Exception as error:
        own = "WideberthError" if isinstance(error, WideberthError) else type(error).__name__
        found[kind][name] = f"{own}: {error}"
for name in shipped():
    tried("configs", name, read_experiment, name, [])
for room in ROOMS:
    for name in names(room):
        given = {"type": name, "robot": "unicycle"} if room == "controllers" else name
        tried("plug-ins", f"{room}.{name}", build, room, given)
for name in sys.argv[1].split():
    tried("modules", name, importlib.import_module, name)
print(json.dumps(found))
"""
NEEDED = re.compile(r"needs (?:the library )?(\w+), .*pip install 'wideberth\[(\w+)\]'")
BEYOND = {"controllers.orca", "experiments.convex_certificates"}
"""Built-in plug-ins that need an extra."""
LIBRARIES = {("CVXPY", "certificates"), ("pyrvo", "arenas")}
"""Library that configs of the core need, and the extra that brings it."""


def test_what_needs_an_extra_names_it(tmp_path: Path) -> None:
    """Modules and configs name it; plug-ins that do not lack a setting, or are built."""
    names = [
        ".".join(("wideberth", *path.relative_to(ROOT).with_suffix("").parts))
        for room in CORE
        for path in files_of(room)
        if not {"data", "files"} & {*path.relative_to(ROOT).parts} and path.stem != "__init__"
    ]
    done = python(tmp_path, TRIED, " ".join(names))
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    modules, plug_ins, configs = found["modules"], found["plug-ins"], found["configs"]
    assert len(names) > 300 > 5 > len(modules), modules
    assert all(LINE.search(text) for text in modules.values()), modules
    assert all(text.startswith("WideberthError: ") for text in plug_ins.values()), plug_ins
    assert {name for name, text in plug_ins.items() if LINE.search(text)} == BEYOND
    assert not [text for name, text in plug_ins.items()
                if name not in BEYOND and "No module named" in text]  # fmt: skip
    needed = [NEEDED.search(text) for text in configs.values()]
    assert all(needed), configs
    assert {match.groups() for match in needed if match} == LIBRARIES


def test_studies_episodes_figures_and_pages(tmp_path: Path) -> None:
    for words in (
        ("run", "approximation_error", "--quick", "--workers", "2"),
        ("figures", "results/approximation_error-quick"),
        ("run", "crossing", "--quick", "--no-figures"),
        ("play", "results/crossing-quick", "--out", "page.html", "--no-open"),
        ("show", "results/crossing-quick"),
        ("report", "results/crossing-quick", "--out", "report.md"),
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
