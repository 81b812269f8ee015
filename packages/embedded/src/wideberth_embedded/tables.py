"""The tables of an exported planner: the numbers of its settings and plug-ins as C."""

import re
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from wideberth.framework.control.end_of_path import EndLimits
from wideberth.framework.mpc.levels.base import SharedLevel
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.starts import NAMES
from wideberth.framework.mpc.slots.reachability import leaves_out
from wideberth.framework.robot import SpeedLimited
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.export.constants import planner_constants
from wideberth.solvers.export.solver.exported import ExportedSolver

from .supported import CORNERS, RUNG_NAMES

Define = tuple[str, Any, str]
"""Name after the prefix, value, and what it is."""
WALLS, DETECTIONS, PATH_POINTS, NAME = 256, 500, 4096, 48
"""Most walls and detections of an observation, points of a path, and bytes of an identity."""
NAV2 = "wideberth_nav2"
"""Name of the ROS 2 package around a planner, unless another one is given."""
_PACKAGE = re.compile(r"[a-z](_?[a-z0-9])+")
"""Names of ROS 2 packages that are also names of namespaces in C++."""


_CONSTANTS = planner_constants()
_APART = ("CORNERS", "FORGET", "TOLERANCE", "END_SHARE", "MOST", "MOST_PLANS")
"""Constants that do not stand among the numbers under their own name."""


@dataclass(frozen=True, eq=False)
class ExportedPlanner:
    """What is exported.

    Attributes
    ----------
    planner : its settings. solver : its solver, which hands multipliers back.
    package : name of the ROS 2 package, its library and the namespace of its controller.

    Raises
    ------
    WideberthError : a name that no package can have.
    """

    planner: Planner
    solver: ExportedSolver
    package: str = NAV2

    def __post_init__(self) -> None:
        if not _PACKAGE.fullmatch(self.package) or self.package == "package":
            raise WideberthError(
                f"name is {self.package!r}; wanted a name of a ROS 2 package, as in hall_planner: "
                "lower-case letters, digits and single underscores, a letter first"
            )


def constants(one: ExportedPlanner) -> list[Define]:
    """Whole numbers of the tables."""
    planner, solver, problem = one.planner, one.solver, one.solver.subject.problem
    return [
        ("MOST", _CONSTANTS["MOST"], "obstacles that are remembered"),
        ("MULTIPLIERS", solver.width, "of a step, all but those of slots"),
        *((f"{slots.name.upper()}_MULTIPLIERS",
           int(kind.inequalities + kind.equalities + 2 * kind.own), "of a slot and step")
          for slots, kind in zip(problem.slots, solver.kinds, strict=True)),
        ("MOST_PLANS", _CONSTANTS["MOST_PLANS"], "from other starts"),
        ("STARTS_AUTO", int(planner.starts == "auto"), ""),
        ("STARTS_COUNT", 0 if planner.starts == "auto" else len(planner.starts), ""),
        ("RUNGS_COUNT", len(planner.fallback.rungs), ""),
        ("LIMITS", solver.rows("plan_limits"), "of the robot beside its bounds"),
        ("SLOT0_ROWS", solver.rows("check0"), "constraints of an obstacle"),
        ("SLOT1_ROWS", solver.rows("check1"), "constraints of a polygon"),
        ("OBSTACLES_USED", planner.most_obstacles, "of each kind, at most"),
        ("LEAVES_OUT", int(leaves_out(planner.level)), "whether what is out of reach has no slot"),
    ]  # fmt: skip


def numbers(one: ExportedPlanner) -> list[Define]:
    """Other numbers of the tables."""
    planner, robot = one.planner, one.planner.robot
    kalman: Any = planner.predictor
    shared = planner.level if isinstance(planner.level, SharedLevel) else None
    (body,), end = planner.kinds[0].bodies(robot), EndLimits.of(robot)
    polygons = one.solver.subject.problem.slots[1]
    return [
        ("TRACK_DT", planner.track_dt, "s"),
        ("ACCELERATION_DENSITY", kalman.acceleration_density, "m^2/s^3"),
        ("NOISE_FLOOR", kalman.noise_floor, "m"),
        ("SPEED_VARIANCE", kalman.speed**2, "m^2/s^2"),
        ("SPEED", planner.reference_speed, "m/s"),
        ("OBSTACLE_SPEED", planner.obstacle_speed, "m/s that no obstacle exceeds"),
        ("RADIUS", body.radius, "m"),
        ("ROOM", body.radius + planner.margin, "m"),
        ("WALL_ROOM", body.radius + planner.margin_at_walls, "m"),
        ("FASTEST", _fastest(planner), "m/s"),
        ("END_BRAKING", _CONSTANTS["END_SHARE"] * end.braking, "m/s^2"),
        ("END_TURNING", _CONSTANTS["END_SHARE"] * end.yaw_rate, "rad/s"),
        ("END_YAW_RATE", end.yaw_rate, "rad/s, on the spot"),
        ("END_YAW_ACCELERATION", end.yaw_acceleration, "rad/s^2, on the spot"),
        ("MINIMUM", -inf if shared is None else shared.minimum, "of a shared level"),
        ("LEVEL_WEIGHT", 0.0 if shared is None else shared.weight, ""),
        ("REGULARISATION", polygons.auxiliary.regularisation, ""),
        *((name, value, "") for name, value in _CONSTANTS.items() if name not in _APART),
    ]


def arrays(one: ExportedPlanner) -> list[tuple[str, str, Any]]:
    """Return the arrays of numbers: name, sizes and nested values of each."""
    problem = one.solver.subject.problem
    state, control = problem.state_bounds, problem.input_bounds
    (levels, *_) = one.solver.aims
    assert levels is not None
    return [
        _array("LEVELS", levels),
        _array("LOWER", (*state.lower, *control.lower)),
        _array("UPPER", (*state.upper, *control.upper)),
    ]


def choices(one: ExportedPlanner) -> list[tuple[str, list[str]]]:
    """Return the arrays of names: that of each, and the names in it."""
    planner = one.planner
    names = [_start(name) for name in (() if planner.starts == "auto" else planner.starts)]
    rungs = [f"WIDEBERTH_{RUNG_NAMES[name]}" for name in planner.fallback.rungs]
    return [("STARTS", names), ("RUNGS", rungs)]


def starts() -> list[str]:
    """Names of all starting points in C."""
    return [_start(name) for name in NAMES]


def public(one: ExportedPlanner) -> tuple[list[Define], list[Define]]:
    """Sizes and numbers of the header."""
    planner, problem = one.planner, one.solver.subject.problem
    sizes: list[Define] = [
        ("PLAN_HORIZON", problem.horizon, "N, steps"),
        ("PLAN_STATES", problem.states, "n"),
        ("PLAN_INPUTS", problem.inputs, "m"),
        ("CORNERS", CORNERS, "of a wall, at most"),
        ("WALLS", WALLS if problem.slots[1].count else 0, "of an observation, at most"),
        ("DETECTIONS", DETECTIONS, "of an observation, at most"),
        ("PATH_POINTS", PATH_POINTS, "of a path, at most"),
        ("NAME", NAME, "bytes of an identity, its closing zero included"),
        ("PLAN_BUILD", f"UINT64_C({one.solver.build})", "the same in all files"),
    ]
    numbers: list[Define] = [
        ("PLAN_DT", problem.dt, "s per step"),
        ("PLAN_PERIOD", planner.period, "s between two decisions"),
        ("PLAN_MAX_SPEED", _fastest(planner), "m/s, of the robot"),
        (
            "PLAN_FORGET",
            _CONSTANTS["FORGET"],
            "s after which an obstacle that is not seen is forgotten",
        ),
        ("PLAN_TOLERANCE", _CONSTANTS["TOLERANCE"], "of the verification"),
    ]  # fmt: skip
    return sizes, numbers


def _fastest(planner: Planner) -> float:
    return planner.robot.max_speed if isinstance(planner.robot, SpeedLimited) else inf


def _start(name: str) -> str:
    return "PLAN_" + name.upper().replace("-", "_")


def _array(name: str, values: Any) -> tuple[str, str, Any]:
    """Return name, sizes and nested values of an array of any number of dimensions."""
    found = np.asarray(values, dtype=np.float64)
    return name, "".join(f"[{size}]" for size in found.shape), found.tolist()
