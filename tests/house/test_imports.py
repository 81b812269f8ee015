"""Arrows point one way: experiments -> the other rooms -> framework."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {
    "framework": set(),
    "predictors": {"framework"},
    "regions": {"framework"},
    "robots": {"framework"},
    "controllers": {"framework"},
    "simulation": {"framework"},
    "experiments": {
        "framework", "predictors", "regions", "robots", "controllers", "simulation",
    },
}  # fmt: skip
HEAVY = {"statsmodels", "filterpy", "jax", "cvxpy", "matplotlib", "pandas", "pydantic", "numba"}
COMPILED = ROOT / "framework" / "mpc" / "solvers" / "riccati"
"""Files for Numba, which are imported only to be compiled. Their functions are longer: whatever a
function calls is compiled into it once more, so that a tree of small ones takes minutes."""
MODULES = [
    pytest.param(room, path, id=str(path.relative_to(ROOT)))
    for room in ROOMS
    for path in sorted((ROOT / room).rglob("*.py"))
]


def imported(path: Path) -> set[str]:
    """Return every module that a file imports anywhere, relative ones made absolute."""
    package = ("wideberth", *path.relative_to(ROOT).parent.parts)
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else ()
            module = ".".join([*base, *((node.module or "").split("."))]).strip(".")
            found |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
    return found


@pytest.mark.parametrize(("room", "path"), MODULES)
def test_arrows_point_one_way(room: str, path: Path) -> None:
    for module in imported(path):
        parts = module.split(".")
        assert parts[0] not in ROOMS, f"{module}: a room is wideberth.{parts[0]}"
        if parts[0] == "wideberth" and len(parts) > 1 and parts[1] in ROOMS:
            assert parts[1] == room or parts[1] in ROOMS[room], f"{room} must not import {module}"


@pytest.mark.parametrize(("room", "path"), MODULES)
def test_heavy_libraries_are_imported_late(room: str, path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in tree.body:
        modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for module in modules:
            if path.parent == COMPILED and module == "numba":
                continue
            assert module.partition(".")[0] not in HEAVY, f"import {module} inside the function"


@pytest.mark.parametrize(("room", "path"), MODULES)
def test_imports_inside_a_room_are_relative(room: str, path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and not node.level:
            assert (node.module or "").partition(".")[0] != "wideberth", "import it relatively"


@pytest.mark.parametrize(("room", "path"), MODULES)
def test_functions_are_short(room: str, path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            first = (
                node.body[1] if ast.get_docstring(node) and len(node.body) > 1 else node.body[0]
            )
            length = (node.end_lineno or 0) - first.lineno + 1
            assert length <= (120 if path.parent == COMPILED else 40), (
                f"{node.name} has {length} lines below its docstring"
            )
