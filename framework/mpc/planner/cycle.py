"""One planning cycle: from an observation to a command, as a function of settings and state.

`step` is the cycle from top to bottom: perceive, lay the reference, forecast, fill the problem,
solve from several starts, take the best rung, command. Settings and state are values that it does
not change; what it may share between calls (compiled problems, the solver's watchdog) are
`Services`.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ...control.command_limits import broken_limit, within_bounds, within_reach
from ...control.end_of_path import LEFT, EndLimits, goal_taken
from ...control.velocity_smoother import VelocitySmoother
from ...controller import checked_ready, checked_use
from ...robot import Robot, start_state
from ...tracking.history import viewpoint
from ...tracking.perception import FORGET, Perception, scene_of
from ...tracking.stand_ins import sound
from ...values.arrays import Array, altered
from ...values.failures import caught
from ...values.forecast import Forecast
from ...values.motion import Command, Detection, Observation, Twist, checked_numbers
from ...values.path import Path
from ...values.path_progress import PATIENCE as WAITED
from ...values.path_progress import ReferenceProgress
from ...values.plan import Plan, Situation
from ...values.polygon import Polygon
from ...values.tracks import Tracks
from ..assembly import assemble
from ..ocp.command_robot import CommandRobot
from ..ocp.problem import Parameters, Problem
from ..ocp.progress_robot import ProgressRobot, without_progress
from ..ocp.reference import Reference
from ..ocp.transcription import Guess
from ..problem_robot import robot_of_problem, with_carried
from ..slots.base import (
    CAPACITIES,
    ActiveObstacles,
    PlanningContext,
    SlotAssignment,
    SlotSizes,
    farthest,
)
from ..slots.reachability import Travel
from ..solver import SizelessSolver
from .emergency import command_of_plan, emergency
from .in_contact import InContact, expected_now
from .instance import Instance
from .judge import Judge
from .multistart import MultiStart, MultiStartResult
from .own_uncertainty import OwnUncertainty, carried
from .retreat import Retreat, retreat
from .rollout import RobotMotion, carry, follow
from .rungs import LadderInput, choose
from .settings import PlannerSettings, changed
from .standing import Standing
from .starts import (
    OTHERS,
    WARM_WITHIN,
    KeptMultipliers,
    first_trajectory,
    remaining_inputs,
    suited_each,
)
from .stopping import stops
from .watchdog import COMPILING, PATIENCE, Budget, WatchedSolver


@final
@dataclass(frozen=True, eq=False)
class PlannerState:
    """All that changes from one planning cycle to the next.

    Attributes
    ----------
    perception : remembered detections, and the predictor with what it has learnt.
    progress : the path and how far along it the robot has come; None before a path is set.
    plan : the last one.
    multipliers : of the last plan; None where it was not the solver's.
    smoother : of the last command; None after an emergency.
    obstacle_in_way : whether something was in the way of the reference, see `MultiStart`.
    hold : its last point is where the robot rests while a body stands on its goal.
    retreat : the last way back that a car has begun, to turn towards its goal.
    standing : where and since when the robot has not moved; None before the first call.
    """

    perception: Perception
    progress: ReferenceProgress | None = None
    plan: Plan | None = None
    multipliers: KeptMultipliers | None = None
    smoother: VelocitySmoother | None = None
    obstacle_in_way: bool = False
    hold: Path | None = None
    retreat: Retreat | None = None
    standing: Standing | None = None

    @classmethod
    def initial(cls, settings: PlannerSettings, path: Path | None = None) -> "PlannerState":
        """Return the state before the first observation."""
        perception = Perception.initial(
            settings.predictor,
            settings.robot.dimension,
            settings.track_dt,
            settings.history,
            settings.period,
            FORGET,
            settings.obstacle_speed,
        )
        return cls(perception, None if path is None else ReferenceProgress(path))


class ProblemCache:
    """Assembles the problem of each size once.

    Parameters
    ----------
    settings : the plug-ins and numbers of the problems.
    """

    def __init__(self, settings: PlannerSettings) -> None:
        self._settings = settings
        self._made: dict[tuple[SlotSizes, ...], Problem] = {}

    def __bool__(self) -> bool:
        """Whether any has been made."""
        return bool(self._made)

    def of(self, rooms: tuple[SlotSizes, ...]) -> Problem:
        """Return the problem with room for so many things of each kind."""
        if rooms not in self._made:
            own = self._settings
            self._made[rooms] = assemble(
                own.robot,
                own.kinds,
                own.level,
                horizon=own.horizon,
                dt=own.dt,
                rooms=rooms,
                cost=own.cost,
                penalty=own.penalty,
                stop_at_end=own.fallback.stop_at_end,
            )
        return self._made[rooms]


@final
@dataclass(frozen=True, eq=False)
class Services:
    """What cycles of the same settings share; it changes no result.

    Attributes
    ----------
    problems : compiled once for each size.
    watch : calls the solver in a thread that can be left behind.
    own : compiled growth of the robot's own uncertainty.
    motion : compiled trajectories of the robot.
    model : the robot as the problem states it, with the states that the cost adds.
    travel : how far the robot can get.
    grid : (N + M,), s, times of the plan's steps 1..N after its first state, and of those at which
        it is to rest, see `Fallback`.
    end : what the robot can do at the end of its path; None for one that moves in space.
    """

    problems: ProblemCache
    watch: WatchedSolver
    own: OwnUncertainty
    motion: RobotMotion
    model: Robot
    travel: Travel
    grid: Array
    end: EndLimits | None

    @classmethod
    def of(cls, settings: PlannerSettings) -> "Services":
        """Make those of some settings."""
        robot, steps, dt = settings.robot, settings.horizon, settings.dt
        reach = farthest(body for kind in settings.kinds for body in kind.bodies(robot))
        return cls(
            problems=ProblemCache(settings),
            watch=WatchedSolver(settings.solver),
            own=OwnUncertainty(robot, dt, settings.own_uncertainty, reach),
            motion=RobotMotion(robot, steps, dt),
            model=robot_of_problem(robot, settings.cost, dt),
            travel=Travel.of(robot, steps, dt),
            grid=settings.dt * np.arange(1, steps + settings.fallback.steps_at_rest + 1.0),
            end=EndLimits.of(robot) if robot.dimension == 2 else None,
        )

    def for_all(self) -> "Services":
        """Return the same, but for obstacles that take part wherever they are."""
        return replace(self, travel=replace(self.travel, speed=np.inf))


@final
@dataclass(frozen=True, eq=False)
class Solved:
    """The problem of one cycle, and the plan that came of it.

    Attributes
    ----------
    instance : the problem with its numbers. guesses : starting points of the solver.
    point : the plan taken, as the problem states it. plan : the same, with its reasons.
    seconds : of the cycle.
    ends : how the solve from each starting point ended, in words.
    """

    instance: Instance
    guesses: tuple[Guess, ...]
    point: Guess
    plan: Plan
    seconds: float
    ends: tuple[str, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class Decision:
    """What one planning cycle decided.

    Attributes
    ----------
    command : within the robot's limits.
    plan : behind it.
    notes : what was refused of the observation, and of the command, and which other solver
        answered than the planner's own.
    solved : the problem that was solved; None where the cycle did not get that far.
    frame : what the robot perceived; None where the cycle did not get that far.
    path : that it follows; None likewise.
    """

    command: Command
    plan: Plan
    notes: tuple[str, ...]
    solved: Solved | None
    frame: "PerceptionFrame | None" = None
    path: Path | None = None


@final
@dataclass(frozen=True, eq=False)
class PerceptionFrame:
    """An observation, with tracks and forecast of its obstacles; None where none is known.

    ``beyond`` is the forecast after the plan's end; None where it is not asked for.
    """

    observation: Observation
    tracks: Tracks | None
    forecast: Forecast | None
    beyond: Forecast | None = None


def remember(
    settings: PlannerSettings, state: PlannerState, observation: Observation
) -> PlannerState:
    """Take note of what is seen without planning."""
    return _remembered(settings, state, checked_use(settings.robot, observation))


def _remembered(
    settings: PlannerSettings, state: PlannerState, observation: Observation
) -> PlannerState:
    here = viewpoint(settings.robot, observation)
    return altered(state, perception=state.perception.take(observation, here))


def step(
    settings: PlannerSettings, state: PlannerState, observation: Observation, services: Services
) -> tuple[PlannerState, Decision]:
    """Plan from an observation; raises nothing but what wrong use deserves.

    Whatever a plug-in throws ends in a braking plan whose reason names it, and where even braking
    cannot be planned, in the command to stand still.

    Raises
    ------
    WideberthError : no path is set, or something else than an observation of this robot.
    """
    checked_ready(state.progress)
    checked_use(settings.robot, observation)
    budget = Budget.start(settings.deadline)
    try:
        state = _remembered(settings, state, observation)
        checked_numbers(observation)
        state, course = _on_course(settings, state, observation, services.end)
        state, frame = _perceived(settings, state, services, observation, course)
        state, decision = _planned(settings, state, services, course, frame, budget)
    except Exception as error:
        state, decision = _braked(settings, state, observation, error)
    perception, notes = state.perception.drained()
    if notes:
        state = replace(state, perception=perception)
        decision = replace(decision, notes=(*decision.notes, *notes))
    return state, decision


@final
@dataclass(frozen=True, eq=False)
class Course:
    """Where the robot is when the command takes effect, and what it follows from there.

    Attributes
    ----------
    stamp : s, when the command takes effect.
    start : (n,), state at that time. place : (D,), m, where it is then.
    path : that it follows. arc : m, arc length along it at ``place``.
    reference : laid along the path from there.
    """

    stamp: float
    start: Array
    place: Array
    path: Path
    arc: float
    reference: Reference


def _on_course(
    settings: PlannerSettings, state: PlannerState, observation: Observation, end: EndLimits | None
) -> tuple[PlannerState, Course]:
    """Find the robot on its path, and lay the reference."""
    robot, stamp = settings.robot, observation.stamp + settings.latency
    start = _delayed(settings, state, observation.stamp, observation.state)
    start = within_bounds(robot, start)
    place = _place(robot, start)
    ahead = settings.reference_speed * settings.horizon * settings.dt
    progress, arc = checked_ready(state.progress).advanced(place, ahead)
    path, hold = progress.path, None
    if arc >= path.length - LEFT and progress.waited >= WAITED:
        hold = _held(settings, state, path, observation, place)
    standing = (state.standing or Standing(stamp, place)).at(stamp, place)
    way, backwards = state.retreat, False
    if hold is not None:
        path, arc = hold, hold.length
    elif end is not None:
        way = retreat(way, end, standing, stamp, robot.pose(tuple(start.tolist())), path, arc)
        if way is not None and way.driving:
            path, arc, backwards = way.path, way.path.project(place), True
    reference = settings.cost.lay(
        path, arc, settings.reference_speed, settings.horizon, settings.dt
    )
    if backwards:
        reference = replace(reference, speed=-reference.speed)
    state = altered(state, progress=progress, hold=hold, standing=standing, retreat=way)
    return state, Course(stamp, start, place, path, arc, reference)


def _held(
    settings: PlannerSettings, state: PlannerState, path: Path, observation: Observation, at: Array
) -> Path | None:
    """Return where to rest, as the end of a path, while a body stands on the goal; else None."""
    bodies = sound(observation, len(at), here=at).detections
    if not goal_taken(path.goal, bodies, settings.robot.radius + settings.margin):
        return None
    return state.hold or Path(np.stack([at - path.direction(np.array(path.length)), at]))


def _perceived(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    observation: Observation,
    course: Course,
) -> tuple[PlannerState, PerceptionFrame]:
    """Let the predictor learn, and forecast what plans are verified against."""
    scene = scene_of(observation, state.plan, settings.robot.radius)
    perception = state.perception
    tracks = perception.history.tracks()
    learnt = perception.learnt(tracks, scene)
    forecast = learnt.forecast(tracks, course.stamp, services.grid, scene)
    if learnt is not perception:
        state = replace(state, perception=learnt)
    if forecast is None or not settings.fallback.steps_at_rest:
        return state, PerceptionFrame(observation, tracks, forecast)
    parts = forecast.cut(settings.horizon)
    return state, PerceptionFrame(observation, tracks, *parts)


def _planned(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    course: Course,
    frame: PerceptionFrame,
    budget: Budget,
) -> tuple[PlannerState, Decision]:
    """Fill the problem, solve it from several starts, take the best rung, and command."""
    robot = settings.robot
    instance, first = _filled(settings, state, services, course, frame)
    judge = _judge(settings, course, frame)
    starts = MultiStart(services.watch, judge.starts(settings.starts), budget)
    outcome = starts.run(instance, judge.first(instance, first), state.obstacle_in_way)
    trial = LadderInput(instance, judge.judged(instance, outcome), judge)
    plan, point = choose(settings.fallback.ladder, trial, course.stamp)
    plan = altered(
        without_progress(robot, plan),
        reason=joined(
            _blocked(settings, state, services, course, frame),
            plan.reason,
            outcome.note,
            instance.note,
        ),
        forecast=frame.forecast,
        tracked=() if frame.tracks is None else frame.tracks.ids,
    )
    ends = tuple(one.message for one in outcome.solutions)
    solved = Solved(instance, outcome.guesses, point, plan, budget.spent(), ends)
    command, note = _limited(robot, command_of_plan(robot, plan))
    command = _resting(services.end, course, command)
    state = altered(
        state,
        plan=plan,
        multipliers=KeptMultipliers.of(point, instance.around.chosen),
        smoother=_smoothed(state.smoother, command, course.stamp),
        obstacle_in_way=outcome.obstacle_in_way,
    )
    notes = tuple(filter(None, (note, _stand_in(outcome))))
    path = checked_ready(state.progress).path
    return state, Decision(command, plan, notes, solved, frame, path)


def _blocked(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    course: Course,
    frame: PerceptionFrame,
) -> str:
    """Return the reason of plans of a robot that stands before its goal, or backs off."""
    progress, end = checked_ready(state.progress), services.end
    standing, back = checked_ready(state.standing), state.retreat
    arc = 0.0 if progress.last is None else progress.last[0]
    words = standing.blocked(
        course.stamp,
        progress.path,
        arc,
        frame.observation,
        settings.robot.radius,
        settings.room_at_walls,
    )
    if words and end is not None and end.circle and not end.reverses:
        words += f"; it does not drive backwards, and its turning circle is {end.circle:.1f} m"
    return joined(words, "" if back is None else back.words)


def _resting(end: EndLimits | None, course: Course, command: Command) -> Command:
    """Return a command with which the robot turns no more than it has to at its path's end."""
    if end is None or course.path.length - course.arc > LEFT:
        return command
    away = float(np.linalg.norm(course.path.goal - course.place))
    speed = float(np.linalg.norm(command.linear))
    return replace(command, omega=end.turning(away, speed, command.omega))


def _judge(settings: PlannerSettings, course: Course, frame: PerceptionFrame) -> Judge:
    """Return what plans are judged by."""
    seen = None
    if frame.forecast is not None and frame.tracks is not None:
        seen = frame.forecast, frame.tracks
    return settings.judging.judge(
        settings.robot,
        settings.dt,
        (course.path, course.arc, settings.reference_speed),
        seen,
        frame.observation.polygons,
        (settings.margin, settings.margin_at_walls),
    )


def _braked(
    settings: PlannerSettings, state: PlannerState, observation: Observation, error: Exception
) -> tuple[PlannerState, Decision]:
    """Brake, since something raised; the next cycle begins without the last one's numbers."""
    words = caught(error)
    plan, command = emergency(settings.robot, observation, words, settings.horizon, settings.dt)
    state = replace(state, plan=plan, multipliers=None, smoother=None)
    return state, Decision(command, plan, (), None)


def situation_of(settings: PlannerSettings, decision: Decision) -> Situation | None:
    """Return what a picture of a decision shows beside its plan; None after an emergency."""
    frame = decision.frame
    if frame is None or decision.solved is None or decision.path is None:
        return None
    robot = settings.robot
    start = decision.solved.instance.parameters.initial[: len(robot.states)]
    heading = robot.pose(tuple(start)).heading
    return Situation(
        region=settings.region,
        room=settings.kinds[0].bodies(robot)[0].radius + settings.margin,
        radii=np.zeros(0) if frame.tracks is None else frame.tracks.radius,
        radius=robot.radius,
        heading=float("nan") if heading is None else float(heading),
        footprint=robot.footprint,
        path=decision.path,
        polygons=frame.observation.polygons,
    )


def _stand_in(outcome: MultiStartResult) -> str:
    """Say which other solver answered in the planner's own one's place, and why."""
    solved = (one.solution for one in outcome.candidates if one.solution is not None)
    found = next((one.stand_in for one in solved if one.stand_in), "")
    return f"solved by {found}" if found else ""


def _delayed(settings: PlannerSettings, state: PlannerState, stamp: float, now: Array) -> Array:
    """State in which the command takes effect, of a robot that was observed at ``stamp``."""
    if not settings.latency:
        return now
    return carry(settings.robot, now, state.smoother, stamp, settings.latency)


def _filled(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    course: Course,
    frame: PerceptionFrame,
) -> tuple[Instance, Guess]:
    """Fill the problem with all that is there; return it with the first starting point."""
    body, start, reference = settings.robot, course.start, course.reference
    first, inputs = _resumed(settings, state, services, course)
    view = _context(settings, state, services, course, frame, first)
    chosen = tuple(kind.choose(body, view) for kind in settings.kinds)
    start = np.append(start, _carried(services.model, state, course))
    parameters = Parameters(
        start,
        reference.position,
        reference.direction,
        reference.speed,
        tuple(one.numbers for one in chosen),
        reference.curve,
    )
    body = services.model
    first = with_carried(body, first, parameters, settings.dt)
    instance = Instance(
        services.problems.of(tuple(one.room for one in chosen)),
        parameters,
        ActiveObstacles(body, settings.kinds, chosen),
        settings.level,
        None if inputs is None else first.inputs,
        _in_contact(settings, state, frame, body, start),
        _posed(parameters, chosen),
    )
    warm = _warm(settings, state, course.stamp, parameters, chosen, first)
    (first,) = suited_each(instance, [warm])
    if not instance.problem.no_auxiliaries:
        pulled = first.pull(parameters)
        instance = replace(instance, parameters=pulled, posed=_posed(pulled, chosen))
    return instance, first


def _carried(model: Robot, state: PlannerState, course: Course) -> Sequence[float]:
    """Return the first values of the states that the cost adds."""
    if isinstance(model, ProgressRobot):
        return (course.arc,)
    if not isinstance(model, CommandRobot):
        return ()
    still = Twist((0.0,) * model.dimension)
    last = still if state.smoother is None else state.smoother.at(course.stamp)
    return model.robot.drive(tuple(course.start.tolist()), last, model.dt)


def _posed(parameters: Parameters, chosen: tuple[SlotAssignment, ...]) -> Parameters | None:
    """Return what the solver is given where that is more than plans are verified against."""
    if all(one.at_end is None for one in chosen):
        return None
    pairs = zip(parameters.slots, chosen, strict=True)
    return replace(parameters, slots=tuple(one.ending_in(own.at_end) for one, own in pairs))


def _context(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    course: Course,
    frame: PerceptionFrame,
    first: Guess,
) -> PlanningContext:
    """Gather from what the kinds choose what to keep clear of."""
    observation, position = frame.observation, course.reference.position
    route = np.empty((2, *position.shape))
    route[0], route[1] = position, course.place
    own = own_on_map = _own(settings, state, services, observation, first, observation.covariance)
    if observation.map_covariance is not None and observation.polygons:
        known = observation.map_covariance
        own_on_map = _own(settings, state, services, observation, first, known)
    return PlanningContext(
        observation=observation,
        tracks=frame.tracks,
        forecast=_held_clear(settings, frame.forecast),
        times=course.stamp + services.grid[: settings.horizon],
        dt=settings.dt,
        reference=course.reference,
        route=route,
        planned=settings.robot.pose(tuple(first.states[1:].T)).points(),
        own=own,
        own_on_map=own_on_map,
        travel=services.travel.bounds(course.start),
        level=settings.level,
        margin=settings.margin,
        wall_margin=settings.margin_at_walls,
        aside=0.5 * settings.reference_speed * settings.horizon * settings.dt,
        most=settings.most_obstacles,
        beyond=_held_clear(settings, frame.beyond),
    )


def _held_clear(settings: PlannerSettings, forecast: Forecast | None) -> Forecast | None:
    """Return the forecast whose regions the problem holds."""
    return None if forecast is None else settings.judging.held_clear(forecast)


def _resumed(
    settings: PlannerSettings, state: PlannerState, services: Services, course: Course
) -> tuple[Guess, Array | None]:
    """Return the first starting point, and the inputs (N, m) that are left of the last plan."""
    robot, inputs = settings.robot, None
    if state.plan is not None:
        standing = settings.fallback.stop_at_end
        inputs = remaining_inputs(robot, state.plan, course.stamp, course.start, standing=standing)
    trajectory = first_trajectory(services.motion, course.start, inputs)
    return Guess.bare(*trajectory, settings.target), inputs


def _in_contact(
    settings: PlannerSettings,
    state: PlannerState,
    frame: PerceptionFrame,
    robot: Robot,
    start: Array,
) -> InContact | None:
    """Return who is in contact as the plan begins at ``start``, and who was seen nowhere."""
    stamp, tracks = frame.observation.stamp + settings.latency, frame.tracks
    lag = 0.0 if tracks is None else stamp - tracks.stamp
    others = expected_now(tracks, frame.forecast, lag, robot.dimension)
    placeless, steps = state.perception.placeless, settings.horizon
    return InContact.of(robot, start, others, placeless, steps, settings.dt)


def _warm(
    settings: PlannerSettings,
    state: PlannerState,
    stamp: float,
    parameters: Parameters,
    chosen: tuple[SlotAssignment, ...],
    first: Guess,
) -> Guess:
    """Add level and multipliers of the last plan to a start soon after it."""
    plan, kept = state.plan, state.multipliers
    if plan is None or kept is None:
        return first
    share = (stamp - plan.stamp) / settings.dt
    if not 0.0 <= share <= WARM_WITHIN:
        return first
    return altered(first, level=kept.level, multipliers=kept.at(share, parameters, chosen))


def _own(
    settings: PlannerSettings,
    state: PlannerState,
    services: Services,
    observation: Observation,
    first: Guess,
    known: Array | None,
) -> Array:
    """Covariances of the own position, (N, D, D), from one of the observed state."""
    start = _spread(settings, state, observation, known)
    return services.own.spread(start, first.states, first.inputs)


def _spread(
    settings: PlannerSettings, state: PlannerState, observation: Observation, known: Array | None
) -> Array | None:
    """Covariance of the plan's first state, from one of the observation's."""
    if known is None or not settings.latency:
        return known
    stamp = observation.stamp
    return carried(known, lambda x: _delayed(settings, state, stamp, x), observation.state)


def _place(robot: Robot, state: Array) -> Array:
    return np.array(robot.pose(tuple(state.tolist())).position, dtype=np.float64)


def _limited(robot: Robot, command: Command) -> tuple[Command, str]:
    """Return the command as the robot can follow it, and what was wrong with it."""
    wrong = broken_limit(robot, command)
    return (within_reach(robot, command), f"command: {wrong}") if wrong else (command, "")


def _smoothed(before: VelocitySmoother | None, command: Command, since: float) -> VelocitySmoother:
    """Follow what the smoother puts out: the robot drives with it until the next command."""
    return (before or VelocitySmoother.at_rest(command.twist, since)).aim(command, since)


def joined(*words: str) -> str:
    """Join reasons; empty ones are left out."""
    return "; ".join(filter(None, words))


def warm_up(settings: PlannerSettings, services: Services, path: Path) -> None:
    """Import and compile before the first decision: decide with obstacles far behind the robot.

    What goes wrong here goes wrong again in `step`, which turns it into a reason. With a deadline
    the first decision of every number of obstacles has to be quick, and may be where the solver
    is a `SizelessSolver`.
    """
    timed = None if settings.deadline is None else COMPILING * PATIENCE
    every = timed is not None or isinstance(settings.solver, SizelessSolver)
    crowds = [n for n in CAPACITIES if 0 < n <= settings.most_obstacles] if every else [1]
    settings, services = changed(settings, deadline=timed), services.for_all()
    with suppress(Exception):  # a plug-in that raises here is named by `step`
        state = PlannerState.initial(settings, path)
        direction = path.direction(np.zeros(1))[0]
        ego, _ = start_state(settings.robot, path.points[0], direction, settings.reference_speed)
        start = np.array(ego, float)
        body, steps = services.model, settings.horizon
        begin = np.append(start, np.zeros(len(body.states) - len(start)))
        follow(body, begin, np.zeros((steps, len(body.inputs))), settings.dt)
        list(stops(body, begin, steps, settings.dt))
        if every:
            from_all = changed(settings, starts=OTHERS)
            step(from_all, state, Observation(0.0, start), services)
        seen = Observation(0.0, start)
        for tick, seen in enumerate(_far_behind(settings, path, start, crowds, walls=every)):
            if tick < settings.history:
                state = remember(settings, state, seen)
            else:
                state, _ = step(settings, state, seen, services)


def _far_behind(
    settings: PlannerSettings, path: Path, start: Array, crowds: list[int], *, walls: bool
) -> Iterator[Observation]:
    """Return observations to warm up with: a history, then two of each number of obstacles.

    Parameters
    ----------
    settings, path, start : of the robot.
    crowds : numbers of obstacles, far behind it.
    walls : whether two more show a polygon beside it, where the planner may meet polygons.
    """
    size, rng = settings.robot.dimension, np.random.default_rng(0)
    origin, direction = path.points[0], path.direction(np.zeros(1))[0]
    beside: list[tuple[Polygon, ...]] = [()] * (settings.history + 2 * len(crowds))
    if walls and settings.static_region is not None:
        way = settings.reference_speed * settings.horizon * settings.dt
        aside = settings.robot.radius + settings.margin_at_walls + 0.25 * way
        middle = origin + aside * np.array([-direction[1], direction[0]])
        corners = middle + 0.05 * np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
        beside += 2 * [(Polygon(tuple(map(tuple, corners.tolist())), "warm-up"),)]
    counts = [1] * settings.history + [count for count in crowds for _ in range(2)] + [1, 1]
    for tick, polygons in enumerate(beside):
        far = []
        for index in range(counts[tick]):
            away = 100.0 + 0.3 * settings.period * tick + 10.0 * index
            place = origin - away * direction + 0.01 * rng.standard_normal(size)
            far.append(Detection(f"warm-up {index}", place, 1e-4 * np.eye(size), 0.5))
        yield Observation(settings.period * tick, start, tuple(far), polygons=polygons)
