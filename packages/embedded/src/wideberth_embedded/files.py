"""The files of an exported planner."""

from importlib.resources import files as resources
from pathlib import Path

from wideberth.solvers.export.rendering import rendered
from wideberth.solvers.export.solver.files import SOURCES as SOLVER_SOURCES
from wideberth.solvers.export.solver.files import solver_files, with_manifest

from .supported import SUPPORTED
from .tables import NAV2, ExportedPlanner, arrays, choices, constants, numbers, public, starts

TEMPLATES = Path(__file__).with_name("templates")
SOURCES = (
    *SOLVER_SOURCES, "wideberth_planner.c", "planner_tracks.c", "planner_forecast.c",
    "planner_motion.c", "planner_walls.c", "planner_scene.c", "planner_verify.c",
    "planner_ladder.c", "planner_end.c",
)  # fmt: skip
PACKAGE = (
    "package.xml", "CMakeLists.txt", "wideberth_nav2.cpp", "wideberth_nav2.xml",
    "wideberth_nav2.yaml",
)  # fmt: skip
"""What makes the folder a ROS 2 package with a controller for Nav2."""
STATUSES = (
    ("PLANNED", "a plan was made"),
    ("PLAN_NULL", "an argument is NULL"),
    ("PLAN_OTHER_BUILD", "files of different exports"),
    ("PLAN_MEMORY", "too few bytes, or not aligned"),
    ("PLAN_NO_PATH", "no path is set"),
    ("PLAN_PATH", "a path that is none"),
    ("PLAN_NUMBERS", "stamp or state of no use"),
    ("PLAN_DETECTIONS", "too many detections"),
    ("PLAN_WALLS", "too many walls"),
    ("PLAN_POLYGON", "a wall that is no convex polygon of few corners"),
    ("PLAN_NO_RUNG", "no rung of the ladder holds"),
)
RUNGS = (
    ("OPTIMAL", "the solver converged and the plan keeps every constraint"),
    ("FEASIBLE", "an iterate that keeps every constraint"),
    ("SHIFTED", "the last plan, which still keeps every constraint"),
    ("LEAST", "a drivable solution that enters regions less than any way to stop"),
    ("BRAKE", "the way to stop that enters regions least"),
    ("EMERGENCY", "braking without looking, see the status"),
)


def bundle(one: ExportedPlanner) -> dict[str, str]:
    """Return the files of an exported planner by name; the same planner gives the same bytes.

    Raises
    ------
    WideberthError : a function that no C can be made of, or an extension module that was not
        built.
    """
    files = {
        "README.md": _readme(one),
        "wideberth_planner.h": _header(one),
        "wideberth_planner_tables.h": _tables(one),
        "planner_parts.h": _code("planner_parts.h"),
        **{name: _code(name) for name in SOURCES if name not in SOLVER_SOURCES},
        **solver_files(one.solver),
        "loop.c": _code("loop.c"),
        **{
            name.replace(NAV2, one.package): _code(name, "nav2").replace(NAV2, one.package)
            for name in PACKAGE
        },
        "Makefile": rendered("planner/Makefile", templates=TEMPLATES, sources=SOURCES),
    }
    return with_manifest(one.solver, files)


def _code(name: str, folder: str = "c") -> str:
    place = resources(__name__.rpartition(".")[0]).joinpath(folder, name)
    return place.read_text(encoding="utf-8")


def _header(one: ExportedPlanner) -> str:
    sizes, some = public(one)
    return rendered(
        "planner/wideberth_planner.h",
        templates=TEMPLATES,
        source=one.solver.subject.source.replace("*/", ""),
        sizes=sizes,
        entries=one.solver.subject.entries,
        numbers=some,
        statuses=STATUSES,
        rungs=RUNGS,
    )


def _tables(one: ExportedPlanner) -> str:
    return rendered(
        "planner/wideberth_planner_tables.h",
        templates=TEMPLATES,
        constants=constants(one),
        numbers=numbers(one),
        starts=starts(),
        arrays=arrays(one),
        choices=choices(one),
    )


def _readme(one: ExportedPlanner) -> str:
    return rendered(
        "planner/README.md",
        templates=TEMPLATES,
        source=one.solver.subject.source,
        stack=one.solver.stack,
        iterations=one.solver.settings.iterations,
        supported=SUPPORTED,
        period=f"{one.planner.period:g}",
        package=one.package,
        walls=bool(one.solver.subject.problem.slots[1].count),
    )
