"""The files of an exported planner."""

from importlib.resources import files as resources

from ...riccati.workspace import MOST_PLANS
from ..bundle import MANIFEST
from ..header import entries
from ..readme import wrapped
from ..rendering import rendered
from ..solver.files import ARCHIVE, manifest, source
from ..solver.header import header
from ..solver.needs import stack
from ..solver.tables import tables, width_of_slots, width_of_steps
from .supported import SUPPORTED
from .tables import NAV2, ExportedPlanner, arrays, constants, numbers, public, starts

SOURCES = (
    "wideberth_planner.c", "planner_tracks.c", "planner_forecast.c", "planner_motion.c",
    "planner_walls.c", "planner_scene.c", "planner_verify.c", "planner_ladder.c", "planner_end.c",
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
    ("PLAN_OTHER_PROCESSOR", "the processor lacks instructions that the code was made with"),
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


def bundle(one: ExportedPlanner) -> dict[str, str | bytes]:
    """Return the files of an exported planner by name; the same planner gives the same bytes.

    Raises
    ------
    WideberthError : a kernel that cannot be compiled, or more kinds of slots than the core has.
    """
    found: dict[str, str | bytes] = {
        "README.md": _readme(one),
        "wideberth_planner.h": _header(one),
        "wideberth_planner_tables.h": _tables(one),
        "planner_parts.h": _code("planner_parts.h"),
        **{name: _code(name) for name in SOURCES},
        "wideberth_solver.h": header(one.solver),
        "wideberth_more.h": _more(one),
        "wideberth_tables.h": tables(one.solver),
        "wideberth_solver.c": source("wideberth_solver.c"),
        ARCHIVE: one.solver.native.archive(),
        "loop.c": _code("loop.c"),
        **{
            name.replace(NAV2, one.package): _code(name, "nav2").replace(NAV2, one.package)
            for name in PACKAGE
        },
        "Makefile": rendered("planner/Makefile", sources=SOURCES),
    }
    return {**found, MANIFEST: manifest(one.solver, [*found], {})}


def _code(name: str, folder: str = "c") -> str:
    place = resources(__name__.rpartition(".")[0]).joinpath(folder, name)
    return place.read_text(encoding="utf-8")


def _header(one: ExportedPlanner) -> str:
    native = one.solver.native
    sizes, some = public(one)
    return rendered(
        "planner/wideberth_planner.h",
        source=native.subject.source.replace("*/", ""),
        machine=native.machine.name,
        sizes=sizes,
        entries=entries(native.subject),
        numbers=some,
        statuses=STATUSES,
        rungs=RUNGS,
    )


def _tables(one: ExportedPlanner) -> str:
    return rendered(
        "planner/wideberth_planner_tables.h",
        constants=constants(one),
        numbers=numbers(one),
        starts=starts(),
        kernels=list(one.solver.native.exact),
        arrays=arrays(one),
    )


def _more(one: ExportedPlanner) -> str:
    slots = one.solver.native.subject.problem.slots
    sizes = [
        ("MULTIPLIERS", width_of_steps(one.solver), "of a step, all but those of slots"),
        ("MOST_PLANS", MOST_PLANS, "from other starts"),
        *((f"{kind.name.upper()}_MULTIPLIERS", width_of_slots(one.solver, k), "of a slot and step")
          for k, kind in enumerate(slots) if kind.count),
    ]  # fmt: skip
    return rendered(
        "planner/wideberth_more.h", sizes=sizes, slots=[kind for kind in slots if kind.count]
    )


def _readme(one: ExportedPlanner) -> str:
    native = one.solver.native
    return wrapped(
        "planner/README.md",
        source=native.subject.source,
        machine=native.machine.name,
        stack=stack(one.solver),
        iterations=one.solver.settings.iterations,
        supported=SUPPORTED,
        period=f"{one.planner.period:g}",
        package=one.package,
        walls=bool(native.subject.problem.slots[1].count),
    )
