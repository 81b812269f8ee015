"""From a config to the planner's problem as C, with an instance that the planner itself made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from ...framework.controller import WrapsController
from ...framework.mpc.ocp.problem import Parameters, Problem, Slots
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.planner.cycle import PlannerState, Services, remember, step
from ...framework.mpc.planner.planner import Planner, planner_behind
from ...framework.mpc.planner.settings import changed
from ...framework.mpc.problem_robot import robot_of_problem
from ...framework.mpc.slots.base import CAPACITIES, LevelledKind, SlotKind
from ...framework.mpc.slots.static_polygons import CORNERS
from ...framework.mpc.solver import Solution, Solver
from ...framework.plugins.config import describe
from ...framework.plugins.extensions import function
from ...framework.plugins.registry import unknown
from ...framework.robot import start_state
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Detection, Observation
from ...framework.values.path import Path as Way
from ...framework.values.polygon import Polygon
from ...solvers.export.bundle import bundle, check_target, write_folder
from ...solvers.export.solver.exported import ExportedSolver as ExportedSolver
from ...solvers.export.solver.files import bundle as solver_bundle
from ...solvers.export.subject import Subject
from ...solvers.riccati.solver import Riccati
from ..engine.base import Experiment
from ..engine.closed_loop import controllers_of
from ..engine.shipped_configs import config_path, read_experiment

RADIUS = 0.3
"""m, of the example's obstacles and polygons."""
POLYGONS = 5
"""Slots for polygons where the planner keeps clear of any and no number is given."""


class _Taken(Exception):
    """The planner has handed its problem to the solver."""


@dataclass(eq=False)
class _Taker(Solver):
    """Keeps what it is asked to solve and stops the planner there."""

    taken: list[tuple[Problem, Parameters, Guess]] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.taken.append((problem, parameters, guesses[0]))
        raise _Taken


def export(
    config: str,
    overrides: list[str],
    out: Path,
    *,
    planner: str | None = None,
    obstacles: int = 5,
    polygons: int | None = None,
    corners: int = CORNERS[0],
    solver: bool = False,
    whole: bool = False,
    package: str | None = None,
    force: bool = False,
) -> str:
    """Write the problem of a config's planner as C and return what it is the problem of.

    Parameters
    ----------
    config, overrides : as `wideberth run` takes them.
    out : folder, see `write_folder`.
    planner : name of one of the config's planners; the first by default.
    obstacles, polygons, corners : slots, and vertices of a polygon, at least; the planner's
        problems have room for some sizes alone, of which the next is taken.
    solver : whether the solver is written, not the problem's functions alone.
    whole : whether the planner around the solver is written too, with as many slots as it uses.
    package : name of the ROS 2 package around a whole planner; None for the usual one.
    force : whether an older export is replaced.

    Raises
    ------
    WideberthError : no planner, a plug-in that fails, a size out of range, an existing folder.
    """
    check_target(out, force=force)
    experiment, _ = read_experiment(config, overrides)
    known = planners(experiment)
    name = next(iter(known), "") if planner is None else planner
    if not known:
        raise WideberthError(
            f"{config} has no planner of `type: mpc`, so there is no problem to export; a config "
            "with one is crossing"
        )
    if name not in known:
        raise WideberthError(unknown("planner", name, known))
    chosen = known[name]
    if polygons is None:
        polygons = 0 if chosen.static_region is None else POLYGONS
    source = f"{config_path(config).stem}, {name}"
    if whole:
        path = dotted_path(experiment, name)
        in_c = function("planner_in_c", "--planner")
        write_folder(out, in_c(chosen, source, corners, package, path), force=force)
        return source
    sizes = slots_for("obstacles", obstacles), slots_for("polygons", polygons), _room(corners)
    if solver:
        files = solver_bundle(exported_solver(chosen, sizes, source))
    else:
        files = bundle(subject(chosen, sizes, source))
    write_folder(out, files, force=force)
    return source


def exported_solver(planner: Planner, sizes: tuple[int, int, int], source: str) -> ExportedSolver:
    """Gather what is written of a planner's solver; arguments and errors as of `subject`.

    The solver is `riccati`, with the planner's settings where it is the planner's own.
    """
    exported = subject(planner, sizes, source)
    settings = planner.solver if isinstance(planner.solver, Riccati) else Riccati()
    aims = tuple(_aim(planner, kind, slots) for kind, slots in zip(
        planner.kinds, exported.problem.slots, strict=True
    ))  # fmt: skip
    return ExportedSolver(exported, settings, planner.margin, planner.reference_speed, aims)


def _aim(planner: Planner, kind: SlotKind, slots: Slots) -> Array | None:
    """Level that the planner aims at for each step, all slots in use; None without levels."""
    if not (slots.count and isinstance(kind, LevelledKind)):
        return None
    size = planner.robot.dimension
    return kind.levels(planner.level, planner.horizon, slots.count, size)[:, 0]


def planners(experiment: Experiment) -> dict[str, Planner]:
    """Return the planners of a config by name: the key in a mapping, else the field's name."""
    known = controllers_of(experiment)
    return {key: own for key, one in known.items() if (own := planner_behind(one))}


def dotted_path(experiment: Experiment, name: str) -> str:
    """Return where the planner with this name stands in the config of an experiment."""
    path, controller = name, controllers_of(experiment)[name]
    for entry in fields(experiment):  # type: ignore[arg-type]  # every plug-in is a dataclass
        value = getattr(experiment, entry.name)
        if isinstance(value, Mapping) and value.get(name) is controller:
            path = f"{entry.name}.{name}"
    while isinstance(controller, WrapsController):
        path, controller = f"{path}.controller", controller.controller
    return path


def subject(planner: Planner, sizes: tuple[int, int, int], source: str) -> Subject:
    """Let the planner itself make an instance, in a small scene with slots for ``sizes``.

    Parameters
    ----------
    planner : as configured.
    sizes : slots for obstacles, slots for polygons, vertices of a polygon.
    source : what the export is called.

    Raises
    ------
    WideberthError : the planner does not get as far as its solver, and why.
    """
    moving, still, corners = sizes
    taker = _Taker()
    settings = changed(planner, solver=taker, most_obstacles=max(moving, still), deadline=None)
    size, services = planner.robot.dimension, Services.of(settings).for_all()
    way = Way(np.array([np.zeros(size), 100.0 * np.eye(size)[0]]))
    state = PlannerState.initial(settings, way)
    seen = scene(planner, moving, _walls(planner, still, corners))
    for one in seen[:-1]:
        state = remember(settings, state, one)
    _, decision = step(settings, state, seen[-1], services)
    if not taker.taken:
        reason = decision.plan.reason
        raise WideberthError(f"{source}: the planner makes no problem to export: {reason}")
    problem, parameters, guess = taker.taken[0]
    robot = robot_of_problem(planner.robot, planner.cost, planner.dt)
    return Subject(
        problem, parameters, guess, robot, planner.kinds, planner.cost,
        describe(planner), source,
    )  # fmt: skip


def scene(planner: Planner, slots: int, polygons: tuple[Polygon, ...]) -> list[Observation]:
    """Obstacles cross the robot's straight way; one slot of three or more stays empty.

    Returns
    -------
    Observations up to time 0, long enough for the predictor's history.
    """
    robot, size = planner.robot, planner.robot.dimension
    along = np.eye(size)[0]
    begin = 0.02 * np.arange(size)  # beside the way, so that no number is zero by chance
    speed = 0.9 * planner.reference_speed
    start, _ = start_state(robot, begin.tolist(), along.tolist(), speed)
    bounds = robot.state_bounds()
    state = np.clip(np.array(start) + 0.01, bounds.lower, bounds.upper)
    count = slots - 1 if slots > 2 else slots
    rng = np.random.default_rng(0)
    ticks = int(np.ceil(planner.history * planner.track_dt / planner.period)) + 1
    return [
        Observation(
            planner.period * tick,
            state,
            tuple(
                Detection(
                    f"obstacle {k}",
                    _place(robot.radius, size, k, planner.period * tick)
                    + 0.01 * rng.standard_normal(size),
                    1e-4 * np.eye(size),
                    RADIUS,
                )
                for k in range(count)
            ),
            polygons=polygons,
        )
        for tick in range(1 - ticks, 1)
    ]


def _place(radius: float, size: int, k: int, time: float) -> Array:
    """Where obstacle k is: it comes from either side, slower the farther ahead it is."""
    side = 1.0 if k % 2 else -1.0
    place = np.zeros(size)
    place[0] = radius + 1.5 + 0.7 * k
    place[1] = side * (radius + 1.0 - 0.3 * time / (1.0 + 0.2 * k))
    place[2:] = 0.1 * (k + 1)
    return place


def _walls(planner: Planner, count: int, corners: int) -> tuple[Polygon, ...]:
    """Stand regular polygons beside the way, as near as the planner looks at them."""
    used = count - 1 if count > 2 else count
    angles = 2.0 * np.pi * (np.arange(corners) + 0.1) / corners
    ring = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    aside = planner.robot.radius + planner.margin + RADIUS + 0.1
    places = [(0.2 * k, aside if k % 2 else -aside) for k in range(used)]
    return tuple(
        Polygon(tuple((float(x), float(y)) for x, y in ring + place), f"polygon {k}")
        for k, place in enumerate(np.array(places).reshape(-1, 2))
    )


def slots_for(name: str, wanted: int) -> int:
    """Return the next number of slots that the planner's problems have room for."""
    if not 0 <= wanted <= CAPACITIES[-1]:
        raise WideberthError(f"{name} is {wanted}; wanted 0 to {CAPACITIES[-1]}")
    return next(size for size in CAPACITIES if size >= wanted)


def _room(corners: int) -> int:
    if not 3 <= corners <= CORNERS[-1]:
        raise WideberthError(f"corners is {corners}; wanted 3 to {CORNERS[-1]}")
    return next(size for size in CORNERS if size >= corners)
