"""The tables of an exported planner: the numbers of its settings and plug-ins as C."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, inf
from typing import Any

import numpy as np

from ....framework.control.command_limits import FOREVER
from ....framework.control.end_of_path import LEFT, SHARE, SHIFT, EndLimits
from ....framework.mpc.levels.base import SharedLevel
from ....framework.mpc.planner.rungs import RUNGS
from ....framework.mpc.planner.settings import PlannerSettings
from ....framework.mpc.planner.starts import NAMES
from ....framework.mpc.slots.reachability import leaves_out
from ....framework.mpc.slots.static_polygons import CORNERS
from ....framework.plugins.config import describe
from ....framework.robot import SpeedLimited
from ....framework.tracking.history import MOST
from ....framework.tracking.perception import FORGET
from ....framework.values.errors import WideberthError
from ....framework.values.plan import TOLERANCE
from ....metrics.episode import SMALLEST
from ..layout import Define, number
from ..solver.needs import ExportedSolver
from .supported import base_of

FILTERED = 40
"""Newest samples that `imm` goes through; `kalman` states its own number."""
WALLS, DETECTIONS, PATH_POINTS, NAME = 256, 500, 4096, 48
"""Most walls and detections of an observation, points of a path, and bytes of an identity."""
RUNG_NAMES = ("OPTIMAL", "FEASIBLE", "SHIFTED", "LEAST", "BRAKE")
"""In C, in the order of `RUNGS`."""
NAV2 = "wideberth_nav2"
"""Name of the ROS 2 package around a planner, unless another one is given."""
_PACKAGE = re.compile(r"[a-z](_?[a-z0-9])+")
"""Names of ROS 2 packages that are also names of namespaces in C++."""


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

    planner: PlannerSettings
    solver: ExportedSolver
    package: str = NAV2

    def __post_init__(self) -> None:
        if not _PACKAGE.fullmatch(self.package) or self.package == "package":
            raise WideberthError(
                f"name is {self.package!r}; wanted a name of a ROS 2 package, as in hall_planner: "
                "lower-case letters, digits and single underscores, a letter first"
            )

    @property
    def history(self) -> int:
        """Samples of a track, as `Perception.initial` sets them."""
        return max(self.planner.history, ceil(FORGET / self.planner.track_dt) + 2)

    @property
    def samples(self) -> int:
        """Samples of the tracks that any of the predictors looks at."""
        late = ceil(2.0 * FORGET / self.planner.track_dt) + 1
        return min(self.history, self.filtered + late + 2)

    @property
    def filtered(self) -> int:
        """Newest samples that the filter goes through."""
        known = describe(base_of(self.planner.predictor))
        return min(int(known.get("history", FILTERED)), self.history)

    @property
    def gap(self) -> float:
        """Longest bridged time between two measurements, s, as `Perception.initial` sets it."""
        return 2.5 * max(self.planner.track_dt, self.planner.period)

    @property
    def conformal(self) -> Any:
        """The calibration around the filter; None without one."""
        known: Any = self.planner.predictor
        return known if describe(known)["type"] == "adaptive_conformal" else None


def constants(one: ExportedPlanner) -> list[Define]:
    """Whole numbers of the tables."""
    planner, problem = one.planner, one.solver.native.subject.problem
    exact, conformal = one.solver.native.exact, one.conformal
    rate = max(1, ceil(planner.track_dt / planner.period))
    ahead = ceil((planner.horizon * planner.dt + 2.0 * FORGET) / planner.track_dt) + 2
    found: list[Define] = [
        ("MOST", MOST, "obstacles that are remembered"),
        ("SAMPLES", one.samples, "of a track"),
        ("LOG", 2 * rate * (one.samples + ceil(one.gap / planner.track_dt) + 2), "measurements"),
        ("FILTERED", one.filtered, "samples that a filter goes through"),
        ("AHEAD", max(ahead, 12 if conformal is None else conformal.steps), "of a forecast"),
        ("MODELS", len(_matrices(one)[0]), "filters of an obstacle"),
        ("STARTS_AUTO", int(planner.starts == "auto"), ""),
        ("STARTS_COUNT", 0 if planner.starts == "auto" else len(planner.starts), ""),
        ("RUNGS_COUNT", len(planner.fallback.rungs), ""),
        ("LIMITS", _results(exact, "plan_limits"), "of the robot beside its bounds"),
        ("SLOT0_ROWS", _results(exact, "plan_slot0"), "constraints of an obstacle"),
        ("SLOT1_ROWS", _results(exact, "plan_slot1"), "constraints of a polygon"),
        ("MOTION_ROWS", _results(exact, "plan_motion"), ""),
        ("MOST_NUMBERS", max(slots.size for slots in problem.slots), ""),
        ("MOST_ROWS", max(_results(exact, f"plan_slot{k}") for k in (0, 1)), ""),
        ("OBSTACLES_USED", planner.most_obstacles, "of each kind, at most"),
        ("LEAVES_OUT", int(leaves_out(planner.level)), "whether what is out of reach has no slot"),
        ("CONFORMAL", int(conformal is not None), ""),
    ]  # fmt: skip
    if conformal is not None:
        found += [
            ("CONFORMAL_STEPS", conformal.steps, ""),
            ("CONFORMAL_CLASSES", conformal.classes, ""),
            ("CONFORMAL_PENDING", ceil(conformal.steps / 0.9), ""),
            ("CONFORMAL_OBSERVED", conformal.observed, ""),
        ]
    return found


def numbers(one: ExportedPlanner) -> list[Define]:
    """Other numbers of the tables."""
    planner, robot, conformal = one.planner, one.planner.robot, one.conformal
    base: Any = base_of(planner.predictor)
    shared = planner.level if isinstance(planner.level, SharedLevel) else None
    (body,), end = planner.kinds[0].bodies(robot), EndLimits.of(robot)
    polygons = one.solver.native.subject.problem.slots[1]
    found: list[Define] = [
        ("TRACK_DT", planner.track_dt, "s"),
        ("GAP", one.gap, "s"),
        ("KEEP", one.history * planner.track_dt + one.gap, "s"),
        ("NOISE_FLOOR", base.noise_floor, "m"),
        ("SPEED_VARIANCE", base.speed**2, "m^2/s^2"),
        ("SPEED", planner.reference_speed, "m/s"),
        ("OBSTACLE_SPEED", planner.obstacle_speed, "m/s that no obstacle exceeds"),
        ("RADIUS", body.radius, "m"),
        ("ROOM", body.radius + planner.margin, "m"),
        ("WALL_ROOM", body.radius + planner.margin_at_walls, "m"),
        ("FASTEST", _fastest(planner), "m/s"),
        ("FOREVER", FOREVER, "s"),
        ("END_LEFT", LEFT, "m"),
        ("END_SHIFT", SHIFT, "m"),
        ("END_BRAKING", SHARE * end.braking, "m/s^2"),
        ("END_TURNING", SHARE * end.yaw_rate, "rad/s"),
        ("END_YAW_RATE", end.yaw_rate, "rad/s, on the spot"),
        ("END_YAW_ACCELERATION", end.yaw_acceleration, "rad/s^2, on the spot"),
        ("MINIMUM", -inf if shared is None else shared.minimum, "of a shared level"),
        ("LEVEL_WEIGHT", 0.0 if shared is None else shared.weight, ""),
        ("REGULARISATION", polygons.auxiliary.regularisation, ""),
    ]
    if conformal is not None:
        found += [("CONFORMAL_TAIL", conformal.tail, ""), ("CONFORMAL_RATE", conformal.rate, "")]
    return found


def arrays(one: ExportedPlanner) -> list[str]:
    """Arrays of the tables, as definitions in C."""
    planner, limits = one.planner, one.solver.native.kernels.limits()
    names = [_start(name) for name in (() if planner.starts == "auto" else planner.starts)]
    rungs = [f"WIDEBERTH_{RUNG_NAMES[list(RUNGS).index(name)]}" for name in planner.fallback.rungs]
    (levels, *_) = one.solver.aims
    assert levels is not None
    return [
        _array("LEVELS", levels),
        _array("LOWER", limits[0]),
        _array("UPPER", limits[1]),
        _words("STARTS", names),
        _words("RUNGS", rungs),
        *_of_models(one),
        *_of_conformal(one),
    ]


def starts() -> list[str]:
    """Names of all starting points in C."""
    return [_start(name) for name in NAMES]


def public(one: ExportedPlanner) -> tuple[list[Define], list[Define]]:
    """Sizes and numbers of the header."""
    planner, problem = one.planner, one.solver.native.subject.problem
    sizes: list[Define] = [
        ("PLAN_HORIZON", problem.horizon, "N, steps"),
        ("PLAN_STATES", problem.states, "n"),
        ("PLAN_INPUTS", problem.inputs, "m"),
        ("CORNERS", CORNERS[0], "of a wall, at most"),
        ("WALLS", WALLS if problem.slots[1].count else 0, "of an observation, at most"),
        ("DETECTIONS", DETECTIONS, "of an observation, at most"),
        ("PATH_POINTS", PATH_POINTS, "of a path, at most"),
        ("NAME", NAME, "bytes of an identity, its closing zero included"),
        ("PLAN_BUILD", f"UINT64_C({one.solver.native.build})", "the same in all files"),
    ]
    numbers: list[Define] = [
        ("PLAN_DT", problem.dt, "s per step"),
        ("PLAN_PERIOD", planner.period, "s between two decisions"),
        ("PLAN_MAX_SPEED", _fastest(planner), "m/s, of the robot"),
        ("PLAN_FORGET", FORGET, "s after which an obstacle that is not seen is forgotten"),
        ("PLAN_TOLERANCE", TOLERANCE, "of the verification"),
        ("PLAN_SMALLEST", SMALLEST, "m^2, least eigenvalue of a covariance that is judged"),
    ]
    return sizes, numbers


def _matrices(one: ExportedPlanner) -> tuple[Any, ...]:
    """Transitions, process covariances, switching and start of the models; of a Kalman's axis."""
    planner, base = one.planner, base_of(one.planner.predictor)
    known: Any = base
    if describe(base)["type"] == "kalman":
        model = known.model(planner.track_dt)
        return [model.transition], [model.process], np.ones((1, 1)), np.ones(1)
    bank = known.bank(planner.track_dt, planner.robot.dimension)
    return bank.transition, bank.process, bank.switching, bank.usual


def _of_models(one: ExportedPlanner) -> list[str]:
    transition, process, switching, usual = _matrices(one)
    if len(transition) == 1:
        ((first, both), (_, second)) = process[0]
        return [_array("PROCESS", [first, both, second])]
    return [
        _array("TRANSITION", transition),
        _array("PROCESS", process),
        _array("SWITCHING", switching),
        _array("USUAL", usual),
    ]


def _of_conformal(one: ExportedPlanner) -> list[str]:
    conformal = one.conformal
    if conformal is None:
        return []
    start = np.reshape(conformal.first(one.planner.track_dt), (-1, conformal.steps))
    return [
        _array("CONFORMAL_SPEEDS", conformal.speeds or [inf]),
        _array("CONFORMAL_START", start),
    ]


def _fastest(planner: PlannerSettings) -> float:
    return planner.robot.max_speed if isinstance(planner.robot, SpeedLimited) else inf


def _results(exact: Any, name: str) -> int:
    return int(exact[name].numel_out(0)) if name in exact else 0


def _start(name: str) -> str:
    return "PLAN_" + name.upper().replace("-", "_")


def _array(name: str, values: Any) -> str:
    """Define an array of any number of dimensions."""
    found = np.asarray(values, dtype=np.float64)
    shape = "".join(f"[{size}]" for size in found.shape)
    return f"static const double PLAN_{name}{shape} PLAN_UNUSED = {_nested(found.tolist())};"


def _nested(values: Any) -> str:
    if not isinstance(values, list):
        return number(values)
    return f"{{{', '.join(map(_nested, values))}}}"


def _words(name: str, words: Sequence[str]) -> str:
    return f"static const int PLAN_{name}[] PLAN_UNUSED = {{{_joined(words) or '0'}}};"


def _joined(words: Iterable[str]) -> str:
    return ", ".join(words)
