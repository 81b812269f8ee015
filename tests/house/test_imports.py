"""Arrows point one way: a room imports rooms of the floors below, and groups have an order too."""

import ast
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FLOORS = (
    ("framework",),
    ("draw", "people", "metrics"),
    ("predictors", "regions", "robots", "routes", "solvers", "controllers"),
    ("simulation",),
    ("experiments",),
)
"""Rooms from bottom to top: a room imports rooms of the floors below its own."""
CORE = {
    room: {name for below in FLOORS[:floor] for name in below}
    for floor, rooms in enumerate(FLOORS)
    for room in rooms
}
BESIDE: dict[str, tuple[str, ...]] = {
    "arenas": (), "embedded": (), "nav2": (), "perception": (), "ros": ("nav2", "perception"),
}  # fmt: skip
"""Package beside the core, packages/NAME -> the packages that it may import."""
PACKAGES = {
    f"wideberth_{name}": {*CORE, *(f"wideberth_{other}" for other in others)}
    for name, others in BESIDE.items()
}
ROOMS = CORE | PACKAGES
"""Room of the core, or package beside it -> what its files may import."""
HEAVY = {
    "statsmodels", "filterpy", "jax", "cvxpy", "matplotlib", "pandas", "pydantic",
    "numba", "mujoco", "rosbags", "rclpy", "scipy", "shapely", "loky", "cloudpickle", "jinja2",
    "platformdirs", "pyarrow", "pyrvo",
}  # fmt: skip


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


@cache
def imported(path: Path) -> set[str]:
    """Return every module that a file imports anywhere, relative ones made absolute."""
    package = full_name(path).split(".")
    package = package if path.name == "__init__.py" else package[:-1]
    found = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else ()
            module = ".".join([*base, *((node.module or "").split("."))]).strip(".")
            found |= {module, *(f"{module}.{alias.name}" for alias in node.names)}
    return found


INTERFACES, FACE = "framework", "framework/__init__"
"""The files beside the groups: a room's own, and the names that the framework offers."""
ARROWS: dict[str, set[str]] = {
    "framework/values": set(),
    "framework/numerics": {"framework/values"},
    "framework/plugins": {"framework/values"},
    INTERFACES: {"framework/numerics", "framework/values"},
    "framework/risk": {
        INTERFACES, "framework/numerics", "framework/plugins", "framework/values",
    },
    "framework/tracking": {INTERFACES, "framework/plugins", "framework/values"},
    "framework/control": {
        INTERFACES, "framework/numerics", "framework/tracking", "framework/values",
    },
    "framework/programs": {"framework/numerics", "framework/values"},
    FACE: {
        INTERFACES, "framework/mpc/planner", "framework/plugins", "framework/tracking",
        "framework/values",
    },
    "wideberth_arenas": set(),
    "wideberth_arenas/controllers": set(),
    "wideberth_arenas/crowds": set(),
    "wideberth_arenas/scenarios": {"wideberth_arenas/crowds"},
    "wideberth_arenas/studies": {"wideberth_arenas/controllers"},
    "wideberth_embedded": set(),
    "wideberth_nav2": set(),
    "wideberth_nav2/costmap": {"wideberth_nav2"},
    "wideberth_nav2/controllers": {"wideberth_nav2", "wideberth_nav2/costmap"},
    "wideberth_nav2/server": {
        "wideberth_nav2", "wideberth_nav2/controllers", "wideberth_nav2/costmap",
    },
    "wideberth_nav2/studies": {
        "wideberth_nav2", "wideberth_nav2/controllers", "wideberth_nav2/costmap",
        "wideberth_nav2/server",
    },
    "wideberth_nav2/cli": {"wideberth_nav2/server"},
    "controllers": {"controllers/costs"},
    "controllers/costs": set(),
    "controllers/diagnosis": {"controllers/slots"},
    "controllers/judging": set(),
    "controllers/levels": set(),
    "controllers/slots": set(),
    "solvers": set(),
    "solvers/riccati": {"solvers"},
    "solvers/export": {"solvers", "solvers/riccati"},
    "wideberth_perception": set(),
    "wideberth_perception/detection": {"wideberth_perception"},
    "wideberth_perception/state": {"wideberth_perception"},
    "wideberth_perception/tracking": {"wideberth_perception"},
    "wideberth_perception/testing": {"wideberth_perception"},
    "wideberth_perception/physics": {"wideberth_perception"},
    "wideberth_perception/cascade": {"wideberth_perception", "wideberth_perception/physics"},
    "wideberth_perception/studies": {
        "wideberth_perception/cascade", "wideberth_perception/physics",
    },
    "predictors": {"predictors/calibrations", "predictors/core", "predictors/data"},
    "predictors/calibrations": {"predictors/core"},
    "predictors/core": {"predictors/data"},
    "predictors/data": set(),
    "regions": set(),
    "regions/static": {"regions"},
    "routes": set(),
    "wideberth_ros": set(),
    "wideberth_ros/cli": {"wideberth_ros"},
    "simulation/drawing": set(),
    "simulation/log": {"simulation/drawing", "simulation/sensing"},
    "simulation/sensing": set(),
    "simulation/engine": {"simulation/log", "simulation/sensing"},
    "simulation/measures": {"simulation/engine", "simulation/log"},
    "simulation/crowds": {"simulation/engine"},
    "simulation/scenarios": {
        "simulation/crowds", "simulation/engine", "simulation/log", "simulation/measures",
        "simulation/sensing",
    },
    "simulation/gym": {
        "simulation/engine", "simulation/log", "simulation/measures", "simulation/scenarios",
    },
    "experiments/engine": set(),
    "experiments/drawing": {"experiments/engine"},
    "experiments/studies": {"experiments/drawing", "experiments/engine"},
    "experiments/report": {"experiments/drawing", "experiments/engine"},
    "experiments/cli": {"experiments/engine", "experiments/report", "experiments/studies"},
}  # fmt: skip
"""Group -> the groups of the same room that its files may import."""
LAYERS = [
    *(
        "values",
        "numerics",
        "plugins",
        "",
        "risk",
        "tracking",
        "control",
        "programs",
    ),
    *("mpc/ocp", "mpc/costs", "mpc/levels", "mpc/slots", "mpc"),
    *("mpc/planner", "testing", "__init__"),
]
"""Groups of the framework from bottom to top; those that `ARROWS` lacks import from below."""
KNOWN_ARROWS: set[tuple[str, str]] = set()
"""Arrows between groups that still point upwards; whoever cuts one takes it from here."""


def module_name(path: Path) -> str:
    """Return the module of a file, of the core without the package in front."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[3:] if parts[:1] == ("packages",) and "src" in parts else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def full_name(path: Path) -> str:
    """Return the module of a file, with the package in front."""
    name = module_name(path)
    return name if name.partition(".")[0] in PACKAGES else f"wideberth.{name}".rstrip(".")


@cache
def import_graph() -> dict[str, set[str]]:
    """Return module -> the modules of the rooms that its file imports anywhere."""
    files = {module_name(path): path for room in ROOMS for path in files_of(room)}
    return {
        name: {
            found for full in imported(path) if (found := full.removeprefix("wideberth.")) in files
        }
        - {name, *packages_of(name)}
        for name, path in files.items()
    }


def packages_of(name: str) -> set[str]:
    """Return the packages that hold a module: `from . import sibling` names them as well."""
    parts = name.split(".")
    return {".".join(parts[:i]) for i in range(1, len(parts))}


def circles(graph: Mapping[str, set[str]]) -> list[set[str]]:
    """Return the sets of modules of which each imports all others, directly or not."""
    reach: dict[str, set[str]] = {}
    for start in graph:
        found, ahead = set[str](), [start]
        while ahead:
            fresh = graph[ahead.pop()] - found
            found |= fresh
            ahead += fresh
        reach[start] = found
    rings = {
        frozenset(other for other in reach[one] if one in reach[other])
        for one in graph
        if one in reach[one]
    }
    return [set(ring) for ring in rings]


def group_of(name: str) -> str:
    """Return the group of a module: its folder, of the framework's mpc/ one level deeper."""
    if name == "framework":
        return FACE
    room, *inner = name.split(".")
    folder = folder_of(room).joinpath(*inner)
    inner = inner if (folder / "__init__.py").is_file() else inner[:-1]
    return "/".join([room, *inner[: 2 if inner[:1] == ["mpc"] else 1]])


def test_no_file_stands_in_a_circle_of_imports() -> None:
    found = [sorted(ring) for ring in circles(import_graph())]
    assert not found, f"these files import each other: {found}"


def test_benchmarks_import_nothing_of_tests() -> None:
    """Tests may import benchmarks."""
    files = sorted((ROOT / "benchmarks").glob("*.py"))
    found = {
        path.name
        for path in files
        if any(name.startswith("wideberth.tests") for name in imported(path))
    }
    assert files and found == set()


def test_circles_are_found() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": {"f"}, "f": {"e"}}
    assert sorted(map(sorted, circles(graph))) == [["a", "b", "c"], ["e", "f"]]


def test_groups_of_a_room_import_only_what_is_listed() -> None:
    order = [f"framework/{layer}".rstrip("/") for layer in LAYERS]
    wrong, known = {}, set()
    for name, others in import_graph().items():
        group = group_of(name)
        for other in others:
            wanted = group_of(other)
            if wanted == group or wanted.split("/")[0] != group.split("/")[0]:
                continue
            if (group, wanted) in KNOWN_ARROWS:
                known.add((group, wanted))
                continue
            below = order[: order.index(group)] if group in order else []
            if wanted not in ARROWS.get(group, below):
                wrong[name] = other
    assert not wrong, f"list the arrow in ARROWS or remove the import: {wrong}"
    assert known == KNOWN_ARROWS, f"take these from KNOWN_ARROWS: {KNOWN_ARROWS - known}"


@pytest.mark.parametrize("room", ROOMS)
def test_arrows_point_one_way(room: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in files_of(room)
        for module in imported(path)
        if not may_import(room, module)
    ]
    assert not wrong, "a room imports rooms of the floors below, as wideberth.ROOM"


def may_import(room: str, module: str) -> bool:
    """Return whether a file of a room may import a module."""
    top, _, inner = module.partition(".")
    wanted = top if top in PACKAGES else inner.partition(".")[0]
    if wanted not in ROOMS or top not in {"wideberth", *PACKAGES}:
        return top not in ROOMS
    return wanted == room or wanted in ROOMS[room]


def test_an_arrow_that_points_up_is_found() -> None:
    assert may_import("regions", "wideberth.framework.region") and may_import("regions", "numpy")
    assert not may_import("regions", "wideberth.robots.unicycle")
    assert not may_import("regions", "framework.region")
    assert not may_import("regions", "wideberth_nav2.poses")
    assert may_import("wideberth_nav2", "wideberth.experiments.engine.base")


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
def test_heavy_libraries_are_imported_late(room: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {module}"
        for path in files_of(room)
        for module in imported_at_once(path)
        if module in HEAVY
    ]
    assert not wrong, "import it inside the function"


def imported_at_once(path: Path) -> set[str]:
    """Return the packages that a file imports as soon as it is imported itself."""
    found = set[str]()
    for node in parsed(path).body:
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").partition(".")[0])
    return found


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
