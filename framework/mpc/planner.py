"""The planner: predictor, region, robot and MPC behind the Controller interface."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from ..arrays import Array, positive, whole
from ..controller import Controller
from ..errors import WideberthError
from ..forecast import Forecast, Scene, resample
from ..history import History
from ..motion import Command, Detection, Observation
from ..path import Path
from ..plan import Plan
from ..predictor import Adaptive, Predictor
from ..region import Region
from ..robot import Robot, start_state
from ..tracks import Tracks
from .assembly import Weights, assemble
from .instance import (
    CAPACITIES,
    Obstacles,
    Reference,
    choose_obstacles,
    fill,
    lay_reference,
)
from .ladder import Ladder, with_auxiliaries
from .levels.base import LevelPolicy
from .problem import Problem
from .rollout import SWEEPS, follow, shift, steer, sweep
from .solvers.base import Solver
from .transcription import Guess


@final
@dataclass(eq=False)
class Planner(Controller):
    """Plans by MPC and commands the velocity of the plan's next step.

    Each call forecasts the obstacles, lays the reference along the path, solves the MPC
    from the shifted last plan and hands out the twist of step k + 1, to be reached over
    one MPC step: the paper's velocity smoother. When a solve fails, the rungs of
    `wideberth.framework.mpc.ladder` are tried in order; the command is always safe to
    execute, and the plan says why it is not the optimal one.

    Parameters
    ----------
    robot, region, predictor, level, solver : the plug-ins.
    horizon : N, steps; the paper's 15.
    dt : s per MPC step; the paper's 0.5.
    period : s between calls; the paper's 0.5.
    reference_speed : m/s along the path; the paper's 0.5.
    weights : of the cost; the paper's.
    penalty : price of one unit of slack on soft regions; None for hard ones, the paper's.
    deadline : s for one solve; None leaves the limit to iteration counts, which is
        reproducible. The paper's is 0.45.
    latency : s between observation and the moment the command takes effect; the plan
        starts where the robot will be by then. 0 is the paper's.
    track_dt : s between the samples that the predictor sees.
    history : how many of those samples are kept.
    most_obstacles : capacity; the nearest are kept, the others named in the plan.
    margin : m, added to r + r_d; 0 is the paper's. The regions hold at the steps alone:
        between two of them, a straight pass at relative speed w comes closer by up to
        (w dt)^2 / (8 (r + r_d)), 0.02 m at the paper's numbers.
    starts : starting points of the solver beside the shifted last plan: ``coast`` (hold
        the present twist), ``left``, ``right`` (turn or side-step as fast as allowed),
        ``wait`` (brake).

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
    weights: Weights = field(default_factory=Weights)
    penalty: float | None = None
    deadline: float | None = None
    latency: float = 0.0
    track_dt: float = 0.5
    history: int = 80
    most_obstacles: int = 20
    margin: float = 0.0
    starts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        whole("planner.horizon", self.horizon)
        whole("planner.history", self.history, least=2)
        whole("planner.most_obstacles", self.most_obstacles, least=0)
        if self.most_obstacles > CAPACITIES[-1]:
            raise WideberthError(
                f"planner.most_obstacles is {self.most_obstacles}; wanted at most {CAPACITIES[-1]}"
            )
        for name in ("dt", "period", "reference_speed", "track_dt"):
            positive(f"planner.{name}", getattr(self, name))
        for name in ("latency", "margin"):
            positive(f"planner.{name}", getattr(self, name), zero=True)
        for name in ("deadline", "penalty"):
            if getattr(self, name) is not None:
                positive(f"planner.{name}", getattr(self, name))
        unknown = sorted(set(self.starts) - set(SWEEPS))
        if unknown:
            raise WideberthError(f"planner.starts holds {unknown}; wanted some of {SWEEPS}")
        if self.robot.dimension not in self.region.dimensions:
            raise WideberthError(
                f"the robot moves in {self.robot.dimension} dimensions; the region "
                f"{type(self.region).__name__} is made for {self.region.dimensions}"
            )
        self._path: Path | None = None
        self._problems: dict[int, Problem] = {}
        self.reset()

    def reset(self) -> None:
        """Forget obstacles, plan and progress; the path stays."""
        self._history = History(
            self.track_dt, self.history, forget=4 * self.track_dt, gap=2.5 * self.track_dt
        )
        self._seen: Predictor = self.predictor
        self._plan: Plan | None = None
        self._progress = 0.0

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        if path.points.shape[1] != self.robot.dimension:
            raise WideberthError(
                f"the path has {path.points.shape[1]} columns; the robot moves in "
                f"{self.robot.dimension} dimensions"
            )
        self._path, self._progress = path, 0.0
        if not self._problems:
            self._warm_up(path)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last command."""
        return self._plan

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without planning."""
        self._history.add(observation.stamp, observation.detections)

    def command(self, observation: Observation) -> Command:
        """Plan from this observation; never raises.

        Whatever a plug-in throws ends in a braking plan whose reason names it.
        """
        try:
            self.remember(observation)
            self._plan = self._decide(observation)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            self._plan = self._ladder(observation).stop(reason)
        return self._aim(self._plan)

    def _warm_up(self, path: Path) -> None:
        """Import and compile everything before the first decision, which has to be quick.

        One obstacle stands far beside the start. What goes wrong here goes wrong again in
        `command`, which turns it into a reason.
        """
        direction = path.direction(np.zeros(1))[0]
        state = start_state(self.robot, path.points[0], direction, self.reference_speed)
        beside = path.points[0] + 100.0 * np.roll(direction, 1)
        size = self.robot.dimension
        detection = Detection("warm-up", beside, 1e-4 * np.eye(size), 0.5)
        for tick in range(2):
            stamp = self.period * tick
            self.command(Observation(stamp, np.array(state[0], dtype=float), (detection,)))
        self.reset()

    def _decide(self, observation: Observation) -> Plan:
        """Forecast, build the instance, solve, and choose a rung."""
        if self._path is None:
            raise WideberthError("no path is set: call set_path before command")
        ladder = self._ladder(observation)
        reference = self._reference(self._path, ladder.start)
        tracks = self._history.tracks()
        obstacles, forecast = self._forecast(observation, tracks, reference)
        capacity = next(size for size in CAPACITIES if size >= len(obstacles))
        radius = self.robot.radius + self.margin
        parameters = fill(
            ladder.start, reference, obstacles, self.region, self.level, radius, capacity
        )
        problem = self._problem(capacity)
        guesses = [
            with_auxiliaries(self.robot, self.region, parameters, guess)
            for guess in self._guesses(ladder)
        ]
        pull = replace(parameters, auxiliaries=guesses[0].auxiliaries)
        solutions = self.solver.solve(problem, pull, guesses, self.deadline)
        return ladder.choose(problem, pull, solutions, obstacles, forecast)

    def _ladder(self, observation: Observation) -> Ladder:
        """Where the plan starts, and what is left of the last one."""
        start = observation.state
        last = self._plan
        if self.latency and last is not None:
            held = self._aim(last).twist
            start = steer(self.robot, start, held, 1, self.latency)[0][-1]
        stamp = observation.stamp + self.latency
        inputs = None
        if last is not None:
            inputs = shift(last.inputs, (stamp - last.stamp) / last.dt)
        return Ladder(
            self.robot, self.region, self.level, stamp, self.dt, self.horizon, start, inputs
        )

    def _reference(self, path: Path, start: Array) -> Reference:
        """Lay the reference from the path's nearest point, searched near the last one."""
        place = np.array(self.robot.pose(tuple(start)).position, dtype=np.float64)
        reach = self.reference_speed * self.dt * self.horizon
        window = np.inf if self._plan is None else 2 * reach
        begin = max(self._progress - 0.25 * reach, 0.0)
        self._progress = path.project(place, start=begin, window=window)
        return lay_reference(path, self._progress, self.reference_speed, self.horizon, self.dt)

    def _forecast(
        self, observation: Observation, tracks: Tracks | None, reference: Reference
    ) -> tuple[Obstacles, Forecast | None]:
        """Ask the predictor, and carry its forecast onto the plan's grid."""
        size = self.robot.dimension
        if tracks is None:
            none = np.zeros((self.horizon, 0, size))
            return Obstacles(none, none[..., None] * np.ones(size), np.zeros(0), ()), None
        if isinstance(self._seen, Adaptive):
            self._seen = self._seen.update(tracks)
        lead = observation.stamp + self.latency - tracks.stamp
        times = lead + self.dt * np.arange(1, self.horizon + 1, dtype=np.float64)
        steps = max(int(np.ceil(times[-1] / self.track_dt - 1e-9)), 1)
        plan = None if self._plan is None else self._plan.positions[1:]
        scene = Scene(observation.state, plan, None, observation.truth)
        forecast = self._seen.predict(tracks, steps, scene)
        newest = tracks.positions[:, -1]
        newest = np.where(np.isnan(newest), forecast.mean[:, 0, 0], newest)
        forecast = resample(forecast, newest, tracks.noise, times)
        route = reference.position
        most = self.most_obstacles
        return choose_obstacles(forecast, tracks.ids, tracks.radius, route, most), forecast

    def _problem(self, capacity: int) -> Problem:
        if capacity not in self._problems:
            self._problems[capacity] = assemble(
                self.robot,
                self.region,
                self.level,
                horizon=self.horizon,
                dt=self.dt,
                capacity=capacity,
                weights=self.weights,
                penalty=self.penalty,
            )
        return self._problems[capacity]

    def _guesses(self, ladder: Ladder) -> list[Guess]:
        """Return the starting points: the shifted last plan, or coasting, and ``starts``."""
        start, names = ladder.start, self.starts
        points = []
        if ladder.inputs is not None:
            points = [(follow(self.robot, start, ladder.inputs, self.dt), ladder.inputs)]
        else:
            names = ("coast", *names)
        for name in dict.fromkeys(names):
            twist = sweep(self.robot, start, name, self.reference_speed)
            points.append(steer(self.robot, start, twist, self.horizon, self.dt))
        return [ladder.guess(states, inputs) for states, inputs in points]

    def _aim(self, plan: Plan) -> Command:
        """Aim at the twist of step k + 1, over one MPC step, for the paper's smoother.

        A robot whose input is the velocity itself takes it at once.
        """
        state, control = tuple(plan.states[1]), tuple(plan.inputs[0])
        twist = self.robot.twist(state, control)
        other = self.robot.twist(state, tuple(value + 1.0 for value in control))
        direct = twist.linear != other.linear or twist.angular != other.angular
        linear = tuple(float(value) for value in twist.linear)
        return Command(linear, float(twist.angular), 0.0 if direct else plan.dt)
