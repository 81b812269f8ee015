"""What import-linter and ruff cannot say of the rooms' imports and functions, and who reads files.

The order of rooms and groups stands in pyproject.toml, under `tool.importlinter`.
"""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CORE = (
    "framework", "draw", "people", "metrics", "predictors", "regions", "robots", "routes",
    "solvers", "controllers", "simulation", "experiments",
)  # fmt: skip
"""Rooms of the core."""
BESIDE: dict[str, tuple[str, ...]] = {
    "arenas": (), "embedded": (), "nav2": (), "perception": (), "ros": ("nav2", "perception"),
}  # fmt: skip
"""Package beside the core, packages/NAME -> the packages that it may import."""
PACKAGES = tuple(f"wideberth_{name}" for name in BESIDE)
ROOMS = CORE + PACKAGES
"""Rooms of the core, and packages beside it."""


def files_of(room: str) -> list[Path]:
    """Return the files of a room."""
    return sorted(folder_of(room).rglob("*.py"))


def folder_of(room: str) -> Path:
    """Return the folder of a room, or of a package beside the core."""
    name = room.removeprefix("wideberth_")
    return ROOT / "packages" / name / "src" / room if room in PACKAGES else ROOT / room


@cache
def parsed(path: Path) -> ast.Module:
    """Return what a file says; four rules read it."""
    return ast.parse(path.read_text(encoding="utf-8"))


def test_rooms_groups_and_packages_import_what_they_may() -> None:
    """Their order, and that neither files nor folders stand in a circle."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_every_room_has_a_place_in_the_order() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    floors = " ".join(settings["tool"]["importlinter"]["contracts"][0]["layers"])
    assert {*re.findall(r"wideberth\.(\w+)", floors)} == {*CORE}
    assert {*settings["tool"]["importlinter"]["root_packages"]} == {"wideberth", *PACKAGES}


def test_benchmarks_import_nothing_of_tests() -> None:
    """Tests may import benchmarks."""
    files = sorted((ROOT / "benchmarks").glob("*.py"))
    found = [path.name for path in files if "wideberth.tests" in path.read_text("utf-8")]
    assert files and not found


def test_the_core_names_no_package_beside_it() -> None:
    """Neither in a table of plug-ins nor in a config; one file of data lists all."""
    wrong = []
    for room in CORE:
        for path in sorted(folder_of(room).rglob("*")):
            if path.suffix in (".py", ".pyi", ".yaml") and path.name != "known_packages.yaml":
                text = path.read_text(encoding="utf-8")
                found = {*re.findall(rf"\b(?:{'|'.join(PACKAGES)})[.:]\w", text)}
                wrong += [str(path.relative_to(ROOT))] if found else []
    assert wrong == []


@pytest.mark.parametrize("room", ROOMS)
def test_imports_inside_a_room_are_relative(room: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in files_of(room)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ImportFrom)
        and not node.level
        and (node.module or "").partition(".")[0] == (room if room in PACKAGES else "wideberth")
    ]
    assert not wrong, "import it relatively"


@pytest.mark.parametrize("room", ROOMS)
def test_functions_are_short(room: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: {node.name} has {lines_below_docstring(node)}"
        for path in files_of(room)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef) and lines_below_docstring(node) > 40
    ]
    assert not wrong, "lines below the docstring; wanted at most 40"


def lines_below_docstring(node: ast.FunctionDef) -> int:
    """Return the number of lines of a function's body."""
    first = node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
    return (node.end_lineno or 0) - first.lineno + 1
