"""The planner: predictor, region, robot and MPC behind the Controller interface."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import final

import numpy as np

from ...control.command_limits import broken_limit, within_bounds, within_reach
from ...control.notices import NOTICES
from ...control.velocity_smoother import VelocitySmoother
from ...controller import Controller, checked_ready, checked_use
from ...predictor import Predictor
from ...region import Region
from ...robot import Robot
from ...static_region import StaticRegion
from ...tracking.history import viewpoint
from ...tracking.perception import Perception, scene_of
from ...values.arrays import Array
from ...values.errors import WideberthError
from ...values.forecast import Forecast
from ...values.motion import Command, Observation, checked_numbers
from ...values.path import Path
from ...values.plan import Plan, Rung
from ...values.tracks import Tracks
from ..costs.base import Cost, ProgressCost
from ..costs.tracking import Tracking
from ..diagnosis.explain import Decision, Solve
from ..diagnosis.solve_record import Record
from ..fallback.emergency import command_of_plan, emergency
from ..fallback.instance_check import InstanceCheck
from ..fallback.ladder import Ladder
from ..fallback.rollout import carry
from ..instance.own_uncertainty import Growth, OwnUncertainty, carried
from ..levels.base import LevelPolicy
from ..ocp.problem import Parameters
from ..ocp.reference import Progress
from ..ocp.transcription import Guess
from ..slots.base import CAPACITIES, Room, SlotKind, Surroundings, View, reach_of_bodies
from ..slots.built_in import built_in
from ..solvers.base import Solver
from .multistart import COMPILING, PATIENCE, Budget, MultiStart, Watch
from .problem_cache import ProblemCache
from .settings import check_settings, checked_path
from .starting_points import Starts, augment_with_progress, strip_progress
from .warm_up import warm_up


@final
@dataclass(eq=False)
class Planner(Controller):
    """Plans by MPC and commands the velocity of the plan's next step.

    Each call forecasts the obstacles, lays the reference along the path, solves the MPC
    from the shifted last plan and hands out the twist of step k + 1, to be reached over
    one MPC step: the paper's velocity smoother. When a solve fails, the rungs of
    `wideberth.framework.mpc.fallback.ladder` are tried in order; the command is always safe to
    execute, and the plan says why it is not the optimal one.

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
    patience : s that one solve may take where there is no deadline. A solver that has not
        returned by then is left behind, and the plan comes from the next rung. The first use of
        a problem, which compiles it, may take ten times as long. Far more than solvers need:
        it changes nothing but what would hold the loop.
    latency : s between observation and the moment the command takes effect; the plan
        starts where the robot will be by then. 0 is the paper's.
    track_dt : s between the samples that the predictor sees.
    history : how many of those samples are kept.
    forget : s after which an obstacle that is no longer reported is dropped.
    most_obstacles : capacity; the nearest are kept, the others named in the plan.
    margin : m, added to r + r_d; 0 is the paper's. The regions hold at the steps alone:
        between two of them, a straight pass at relative speed w comes closer by up to
        (w dt)^2 / (8 (r + r_d)), 0.02 m at the paper's numbers.
    starts : starting points of the solver beside the shifted last plan, always tried, or
        ``auto``: where something is in the way, see `wideberth.framework.mpc.planner.multistart`.
    static_region : what keeps clear of the observation's polygons; needed where there are any.
    further_kinds : of things to keep clear of, besides the forecast's obstacles and polygons.
    own_uncertainty : how the covariance of the observed state grows over the horizon, see
        `OwnUncertainty`; without one in the observation the state is taken as exact.
    stop_at_end : whether every plan ends at rest. Then the last one, continued by standing,
        is there to fall back on for as long as the forecast it was made for comes true.
    record : where solves that failed or took long are kept for `wideberth explain`.

    Raises
    ------
    WideberthError : a value out of range, or robot and region of different dimensions.
    """

    robot: Robot
    region: Region
    predictor: Predictor
    level: LevelPolicy
    solver: Solver
    horizon: int = 15
    dt: float = 0.5
    period: float = 0.5
    reference_speed: float = 0.5
    cost: Cost = field(default_factory=Tracking)
    penalty: float | None = None
    deadline: float | None = None
    patience: float = PATIENCE
    latency: float = 0.0
    track_dt: float = 0.5
    history: int = 80
    forget: float = 3.0
    most_obstacles: int = 20
    margin: float = 0.0
    starts: Starts = "auto"
    static_region: StaticRegion | None = None
    further_kinds: tuple[SlotKind, ...] = ()
    own_uncertainty: Growth = "open-loop"
    stop_at_end: bool = False
    record: Record | None = None

    def __post_init__(self) -> None:
        check_settings(self)
        self._progress: Progress | None = None
        self.warns = True
        """Whether it warns, see `framework.notices`; False where nobody drives its plans."""
        self._problems = ProblemCache(self)
        self._watch = Watch(self.solver, self.patience)
        reach = reach_of_bodies(self.robot, self.kinds)
        self._own = OwnUncertainty(self.robot, self.dt, self.own_uncertainty, reach)
        self.reset()

    def reset(self) -> None:
        """Forget obstacles, plan and progress; the path stays."""
        self._perception = Perception(
            self.predictor,
            self.robot.dimension,
            self.track_dt,
            self.history,
            self.period,
            self.forget,
        )
        self._plan: Plan | None = None
        self._obstacle_in_way = False
        self._decision: Decision | None = None
        self._smoother: VelocitySmoother | None = None
        if self._progress is not None:
            self._progress = Progress(self._progress.path)

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self._progress = Progress(checked_path(self.robot, path))
        if not self._problems:
            timed = None if self.deadline is None else COMPILING * self.patience
            twin = replace(self, record=None, deadline=timed)  # shares the compiled problems
            twin._progress, twin._problems = Progress(path), self._problems
            twin._watch, twin.warns = self._watch, False
            crowds = [1] if timed is None else [n for n in CAPACITIES if n <= self.most_obstacles]
            warm_up(twin, self.robot, path, self.reference_speed, self.history, crowds)

    @cached_property
    def kinds(self) -> tuple[SlotKind, ...]:
        """Kinds of things that plans keep clear of, in the order of the problem's slots."""
        return (*built_in(self.region, self.static_region), *self.further_kinds)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last command."""
        return self._plan

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without planning."""
        checked_use(self.robot, observation)
        self._perception.take(observation, viewpoint(self.robot, observation))

    def command(self, observation: Observation) -> Command:
        """Plan from this observation; raises nothing but what wrong use deserves.

        Whatever a plug-in throws ends in a braking plan whose reason names it, and where
        even braking cannot be planned, in the command to stand still.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        checked_ready(self._progress)
        checked_use(self.robot, observation)
        budget, self._decision = Budget.start(self.deadline), None
        try:
            self.remember(observation)
            checked_numbers(observation)
            self._plan = self._decide(observation, budget)
            command, note = self._limited(command_of_plan(self.robot, self._plan))
            self._smooth(command, observation.stamp + self.latency)
        except Exception as error:
            note, self._smoother = f"{type(error).__name__}: {error}", None
            self._plan, command = emergency(self.robot, observation, note, self.horizon, self.dt)
            note = ""
        notes = [*filter(None, (note,)), *self._perception.drain()]
        if self.warns:
            _warn(type(self).__name__, self._plan, notes)
        reasons = filter(None, (self._plan.reason, *notes))
        self._plan = replace(self._plan, reason="; ".join(reasons))
        return command

    def _limited(self, command: Command) -> tuple[Command, str]:
        """Return the command as the robot can follow it, and what was wrong with it."""
        wrong = broken_limit(self.robot, command)
        return (within_reach(self.robot, command), f"command: {wrong}") if wrong else (command, "")

    def _smooth(self, command: Command, since: float) -> None:
        """Follow what the smoother puts out: the latency is driven with it."""
        before = self._smoother or VelocitySmoother.at_rest(command.twist, since)
        self._smoother = before.aim(command, since)

    def explain(self) -> Solve:
        """Return what the last call solved: to be read, saved, and solved again.

        Raises
        ------
        WideberthError : it solved nothing.
        """
        if self._decision is None:
            raise WideberthError(
                "the last call solved no problem, so that there is none to explain; its plan's "
                "reason says why"
            )
        return self._decision.solve(self)

    def _decide(self, observation: Observation, budget: Budget) -> Plan:
        """Solve, choose a rung, and keep what is to be explained."""
        ladder, check, first, rooms, view = self._situate(observation)
        attempts = MultiStart(self._watch, self.starts, budget)
        outcome = attempts.run(ladder, check, first, self._obstacle_in_way)
        self._obstacle_in_way = outcome.obstacle_in_way
        plan, point = ladder.choose(check, outcome)
        reason = "; ".join(filter(None, (plan.reason, outcome.note)))
        tracked = () if view.tracks is None else view.tracks.ids
        plan = strip_progress(self.robot, plan)
        plan = replace(plan, forecast=view.forecast, tracked=tracked, reason=reason)
        spent = budget.spent()
        self._decision = Decision(check, rooms, outcome.guesses, point, plan, spent)
        if self.record is not None and self.record.wants(self._decision):
            note = self.record.keep(self._decision, self)
            plan = replace(plan, reason="; ".join(filter(None, (plan.reason, note))))
        return plan

    def _situate(
        self, observation: Observation
    ) -> tuple[Ladder, InstanceCheck, Guess, tuple[Room, ...], View]:
        """Forecast, lay the reference, and fill the problem with all that is there."""
        assert self._progress is not None  # seen to by `command`
        ladder = self._ladder(observation)
        here = self._place(ladder.start)
        arc = self._progress.update(here)
        reference = self.cost.lay(
            self._progress.path, arc, self.reference_speed, self.horizon, self.dt
        )
        tracks, forecast = self._forecast(observation, ladder)
        bare = ladder.first()
        view = View(
            observation=observation,
            tracks=tracks,
            forecast=forecast,
            reference=reference,
            route=np.stack([reference.position, np.broadcast_to(here, reference.position.shape)]),
            planned=self._place(bare.states[1:].T).T,
            own=self._own.spread(self._known(observation), bare.states, bare.inputs),
            level=self.level,
            margin=self.margin,
            aside=0.5 * self.reference_speed * self.horizon * self.dt,
            most=self.most_obstacles,
        )
        chosen = tuple(kind.choose(self.robot, view) for kind in self.kinds)
        if isinstance(self.cost, ProgressCost):
            ladder, (bare,) = augment_with_progress(ladder, [bare], reference, arc)
        parameters = Parameters(
            ladder.start,
            reference.position,
            reference.direction,
            reference.speed,
            tuple(one.numbers for one in chosen),
            reference.curve,
        )
        first = ladder.suited(parameters, bare)
        rooms = tuple(one.room for one in chosen)
        around = Surroundings(ladder.robot, self.kinds, chosen)
        check = InstanceCheck(self._problems.of(rooms), first.pull(parameters), around)
        return ladder, check, first, rooms, view

    def _known(self, observation: Observation) -> Array | None:
        """Covariance of the plan's first state."""
        known = observation.covariance
        if known is None or not self.latency:
            return known
        return carried(known, lambda x: self._start(x, observation.stamp), observation.state)

    def _ladder(self, observation: Observation) -> Ladder:
        """Where the plan starts, and what is left of the last one."""
        start = within_bounds(self.robot, self._start(observation.state, observation.stamp))
        stamp = observation.stamp + self.latency
        ladder = Ladder(
            self.robot,
            self.kinds,
            self.level,
            stamp,
            self.dt,
            self.horizon,
            start,
        )
        if self._plan is None:
            return ladder
        return ladder.shifted(self._plan, standing=self.stop_at_end)

    def _start(self, state: Array, stamp: float) -> Array:
        """State in which the command takes effect, of a robot observed at ``stamp``."""
        if not self.latency:
            return state
        return carry(self.robot, state, self._smoother, stamp, self.latency)

    def _place(self, state: Array) -> Array:
        return np.array(self.robot.pose(tuple(state)).position, dtype=np.float64)

    def _forecast(
        self, observation: Observation, ladder: Ladder
    ) -> tuple[Tracks | None, Forecast | None]:
        """Ask for a forecast of all obstacles on the plan's grid."""
        grid = self.dt * np.arange(1, self.horizon + 1, dtype=np.float64)
        found = self._perception.forecast(
            ladder.stamp, grid, scene_of(observation, self._plan, self.robot.radius)
        )
        return found or (None, None)


def _warn(name: str, plan: Plan, notes: Sequence[str]) -> None:
    """Warn of a plan that is not the one that was asked for, and of what was refused."""
    if plan.rung is not Rung.OPTIMAL:
        NOTICES.warn(name, str(plan.rung), plan.reason)
    elif plan.given_way is not None:
        NOTICES.warn(name, "gave way", str(plan.given_way))
    if plan.left_out:
        NOTICES.warn(name, "no room in the problem", ", ".join(plan.left_out))
    for note in notes:
        NOTICES.warn(name, note.split()[0].rstrip(":"), note)  # its first word is its kind
