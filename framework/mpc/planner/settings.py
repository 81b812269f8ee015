"""Settings of the planner, and their validation."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from ...plugins.config import ADVICE, IMPLEMENTED, describe
from ...predictor import Predictor
from ...region import Region
from ...robot import Robot, SpeedLimited
from ...static_region import StaticRegion
from ...tracking.names import FASTEST
from ...tracking.perception import FORGET
from ...values.arrays import Array, positive, whole
from ...values.errors import WideberthError
from ..costs.base import Cost
from ..costs.tracking import Tracking
from ..levels.base import LevelPolicy, mixed_up
from ..slots.base import CAPACITIES, SelectiveKind, SlotKind, shared_target
from ..slots.gaussian_discs import GaussianDiscs, OfDiscs
from ..slots.static_polygons import StaticPolygons
from ..solver import Solver
from .judge import EXPECTED_CONTACT, ByCost, Judging
from .own_uncertainty import Growth
from .rungs import Fallback
from .starts import Starts, checked_starts

MOST_STEPS, MOST_SAMPLES = 1000, 10_000
"""Of a plan, and of a track or a forecast: more means that a unit is wrong."""
LONG_STEP = 2.0
"""s; a longer step of a plan is more likely a number of ms."""
DOUBTFUL = 5.0
"""m/s; a reference speed beyond it, ten times the paper's, may be in km/h."""
ABOVE = 2.0
"""Largest reference speed over that which the robot can drive, beyond which something is wrong."""
_WHOLE_PLANNER = (
    "write `<<: recommended` beside `robot: unicycle` in a config, which sets all of region, "
    "predictor, level and solver, or call wideberth.recommended('unicycle') in Python"
)


@dataclass(frozen=True, eq=False)
class PlannerSettings:
    """Settings of a planning cycle; a `Planner` takes the same.

    Parameters
    ----------
    robot, region, predictor, level, solver : the plug-ins.
    horizon : N, steps; the paper's 15.
    dt : s per MPC step; the paper's 0.5.
    period : s between calls; the paper's 0.5.
    reference_speed : m/s along the path; the paper's 0.5.
    cost : of each stage of a plan; the paper's tracking of a timed reference by default.
    penalty : price of one unit of slack on soft regions; None for hard ones, the paper's.
    deadline : s by the clock for one call, forecast and checks included; None leaves the limit to
        iteration counts, which is reproducible. The paper has none for the call: its 0.45 s are
        `Ipopt.max_cpu_time`.
    latency : s between observation and the moment the command takes effect; the plan
        starts where the robot will be by then. 0 is the paper's.
    track_dt : s between the samples that the predictor sees.
    history : how many of those samples are kept, at least 3 s of them.
    obstacle_speed : m/s that no obstacle exceeds; one that is reported farther away than it can
        have moved counts as another one, and the one known before stays remembered. The default
        is for people.
    most_obstacles : capacity; the nearest are kept, the others named in the plan.
    margin : m, added to r + r_d; 0 is the paper's. The regions hold at the steps alone:
        between two of them, a straight pass at relative speed w comes closer by up to
        (w dt)^2 / (8 (r + r_d)), 0.02 m at the paper's numbers. The slot kind ``between_steps``
        adds a bound of it, so that plans keep their regions there too.
    wall_margin : m, added to r before static polygons, which stand still and are known exactly
        where the map is; None for ``margin``.
    starts : starting points of the solver beside the shifted last plan, always tried, or
        ``auto``: where something is in the way, see `wideberth.framework.mpc.planner.multistart`.
    expected_contact : how plans are judged where people may turn; None for the cost of the problem
        alone. With it the problem holds the likeliest mode of each person's forecast, manoeuvres
        take the place of ``starts``, and a plan's cost is in s, see
        `wideberth.controllers.judging.expected_contact`.
    static_region : what keeps clear of the observation's polygons; needed where there are any.
    further_kinds : of things to keep clear of, besides the forecast's obstacles and polygons. One
        with the name of either takes its place, as ``ways`` does, see
        `wideberth.controllers.slots.ways`.
    own_uncertainty : how the covariance of the observed state grows over the horizon, see
        `OwnUncertainty`; without one in the observation the state is taken as exact.
    fallback : what is driven where a solve fails: the rungs, and whether every plan ends at rest,
        see `wideberth.framework.mpc.planner.rungs`.

    Raises
    ------
    WideberthError : a value out of range, or robot and region of different dimensions.
    """

    robot: Robot = field(metadata={ADVICE: _WHOLE_PLANNER})
    region: Region = field(metadata={ADVICE: _WHOLE_PLANNER})
    predictor: Predictor = field(metadata={ADVICE: _WHOLE_PLANNER})
    level: LevelPolicy = field(metadata={ADVICE: _WHOLE_PLANNER})
    solver: Solver = field(metadata={ADVICE: _WHOLE_PLANNER})
    horizon: int = 15
    dt: float = 0.5
    period: float = 0.5
    reference_speed: float = 0.5
    cost: Cost = field(default_factory=Tracking)
    penalty: float | None = None
    deadline: float | None = None
    latency: float = 0.0
    track_dt: float = 0.5
    history: int = 80
    obstacle_speed: float = FASTEST
    most_obstacles: int = 20
    margin: float = 0.0
    wall_margin: float | None = None
    starts: Starts = "auto"
    expected_contact: Judging | None = field(
        default=None, metadata={IMPLEMENTED: EXPECTED_CONTACT}
    )
    static_region: StaticRegion | None = None
    further_kinds: tuple[SlotKind, ...] = ()
    own_uncertainty: Growth = "open-loop"
    fallback: Fallback = field(default_factory=Fallback)

    def __post_init__(self) -> None:
        check_settings(self)

    @cached_property
    def kinds(self) -> tuple[SlotKind, ...]:
        """Kinds of things that plans keep clear of, in the order of the problem's slots."""
        first = GaussianDiscs(self.region), StaticPolygons(self.static_region)
        return tuple({kind.name: kind for kind in (*first, *self.further_kinds)}.values())

    @cached_property
    def judging(self) -> Judging:
        """How plans are judged."""
        return self.expected_contact or ByCost()

    @cached_property
    def target(self) -> float:
        """s_ref, the level that a shared level is drawn to; nan where none is shared."""
        return shared_target(self.kinds, self.level, self.robot.dimension)

    @property
    def margin_at_walls(self) -> float:
        """Added to the radius of the robot's bodies before static polygons, m."""
        return self.margin if self.wall_margin is None else self.wall_margin

    @cached_property
    def room_at_walls(self) -> float:
        """Radius of the robot's largest disc and the margin at walls, m."""
        widest = max(body.radius for body in self.kinds[0].bodies(self.robot))
        return widest + self.margin_at_walls

    @property
    def grid(self) -> Array:
        """Times of the plan's steps 1..N after its first state, s."""
        return self.dt * np.arange(1, self.horizon + 1, dtype=np.float64)


def changed(settings: PlannerSettings, **changes: Any) -> PlannerSettings:
    """Return a copy of some settings, also of a planner's, with changes."""
    kept = {entry.name: getattr(settings, entry.name) for entry in fields(PlannerSettings)}
    return PlannerSettings(**{**kept, **changes})


def check_settings(planner: PlannerSettings) -> None:
    """Refuse settings out of range, and plug-ins that do not fit together.

    Raises
    ------
    WideberthError : a value out of range, or robot and regions of different dimensions.
    """
    whole("planner.horizon", planner.horizon)
    whole("planner.history", planner.history, least=2)
    whole("planner.most_obstacles", planner.most_obstacles, least=0)
    if planner.most_obstacles > CAPACITIES[-1]:
        raise WideberthError(
            f"planner.most_obstacles is {planner.most_obstacles}; wanted at most {CAPACITIES[-1]}"
        )
    for name in ("dt", "period", "reference_speed", "track_dt", "obstacle_speed"):
        positive(f"planner.{name}", getattr(planner, name))
    for name in ("latency", "margin"):
        positive(f"planner.{name}", getattr(planner, name), zero=True)
    for name in ("deadline", "penalty", "wall_margin"):
        if getattr(planner, name) is not None:
            positive(f"planner.{name}", getattr(planner, name), zero=name == "wall_margin")
    _check_sizes(planner)
    checked_starts(planner.starts)
    if planner.robot.dimension not in planner.region.dimensions:
        raise WideberthError(
            f"the robot moves in {planner.robot.dimension} dimensions; the region "
            f"{type(planner.region).__name__} is made for {planner.region.dimensions}"
        )
    _check_kinds(planner)
    planner.level.levels(planner.region, 1, 1, planner.robot.dimension)
    if planner.static_region is not None and planner.robot.dimension != 2:
        raise WideberthError(
            f"planner.static_region is {type(planner.static_region).__name__}, and the robot "
            f"moves in {planner.robot.dimension} dimensions; polygons lie in the plane: leave it "
            "out"
        )


def doubts(settings: PlannerSettings) -> tuple[str, ...]:
    """Say what of some settings is allowed and looks like a slip, beginning with its name.

    A reference speed in km/h, one that the robot cannot drive, a step in ms, or a level's content
    as its tail.
    """
    speed, robot, found = settings.reference_speed, settings.robot, []
    if settings.dt > LONG_STEP:
        found.append(
            f"dt is {settings.dt:g} s, {speed * settings.dt:.3g} m a step, between which regions "
            f"are not checked; {settings.dt:g} ms are {settings.dt / 1000.0:.3g} s"
        )
    if speed > DOUBTFUL:
        found.append(
            f"reference_speed is {speed:g} m/s, {speed * settings.dt:.3g} m a step; {speed:g} "
            f"km/h are {speed / 3.6:.3g} m/s"
        )
    elif isinstance(robot, SpeedLimited) and speed > ABOVE * robot.max_speed:
        found.append(
            f"reference_speed is {speed:g} m/s, and the robot drives at most "
            f"{robot.max_speed:g} m/s: the reference runs away from it"
        )
    if words := mixed_up(describe(settings.level).get("tail", 0.0)):
        found.append(f"level.{words}")
    return tuple(found)


def _check_kinds(planner: PlannerSettings) -> None:
    """Refuse settings that the kinds of things to keep clear of do not go with.

    Raises
    ------
    WideberthError : as the kind says, or steps at rest that none of them knows.
    """
    for kind in planner.further_kinds:
        if isinstance(kind, SelectiveKind):
            kind.refuse(planner.level, planner.penalty, planner.most_obstacles)
    if planner.fallback.steps_at_rest and not any(
        isinstance(kind, GaussianDiscs | OfDiscs) for kind in planner.kinds
    ):
        raise WideberthError(
            f"fallback.steps_at_rest is {planner.fallback.steps_at_rest}, and none of the kinds "
            f"{[type(kind).__name__ for kind in planner.kinds]} knows regions after a plan's end; "
            "set it to 0"
        )


def _check_sizes(planner: PlannerSettings) -> None:
    """Refuse settings that ask for tracks, forecasts or plans of absurd length.

    Raises
    ------
    WideberthError : more steps than `MOST_STEPS`, or more samples than `MOST_SAMPLES`.
    """
    reach = 2 * FORGET + planner.latency + planner.horizon * planner.dt
    counts = {
        "planner.horizon": (planner.horizon, MOST_STEPS),
        "planner.latency / 0.05 s": (planner.latency / 0.05, MOST_SAMPLES),
        "planner.history": (planner.history, MOST_SAMPLES),
        f"steps of the forecast, (2 * {FORGET:g} s + latency + horizon dt) / track_dt,": (
            reach / planner.track_dt,
            MOST_SAMPLES,
        ),
    }
    for name, (count, most) in counts.items():
        if count > most:
            raise WideberthError(f"{name} is {count:.6g}; wanted at most {most}")
