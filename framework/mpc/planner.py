"""The planner: predictor, region, robot and MPC behind the Controller interface."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from ..arrays import Array
from ..controller import Controller
from ..errors import WideberthError
from ..forecast import Forecast, Scene
from ..motion import Command, Observation
from ..path import Path
from ..plan import Plan
from ..predictor import Predictor
from ..region import Region
from ..robot import Robot
from ..smoother import VelocitySmoother
from ..static_region import StaticRegion
from .assembly import Weights, assemble
from .contact import Surroundings
from .ego import Growth, OwnUncertainty, carried
from .emergency import aim, emergency
from .instance import Obstacles, choose_obstacles
from .ladder import Case, Ladder
from .levels.base import LevelPolicy
from .perception import Perception
from .problem import Parameters, Problem
from .reference import Progress, lay_reference
from .rollout import carry, shift
from .settings import check_settings
from .situation import Situation, reach_of_bodies, widest
from .solvers.base import Solver
from .walls import Walls, choose_walls
from .warm_up import warm_up


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
    deadline : s for the solves of one call; None leaves the limit to iteration counts, which is
        reproducible. The paper's is 0.45.
    latency : s between observation and the moment the command takes effect; the plan
        starts where the robot will be by then. 0 is the paper's.
    track_dt : s between the samples that the predictor sees.
    history : how many of those samples are kept.
    forget : s after which an obstacle that is no longer reported is dropped.
    most_obstacles : capacity; the nearest are kept, the others named in the plan.
    margin : m, added to r + r_d; 0 is the paper's. The regions hold at the steps alone:
        between two of them, a straight pass at relative speed w comes closer by up to
        (w dt)^2 / (8 (r + r_d)), 0.02 m at the paper's numbers.
    starts : starting points of the solver beside the shifted last plan: ``coast`` (hold
        the present twist), ``left``, ``right`` (turn or side-step as fast as allowed),
        ``wait`` (brake).
    static_region : what keeps clear of the observation's polygons; needed where there are any.
    own_uncertainty : how the covariance of the observed state grows over the horizon, see
        `OwnUncertainty`; without one in the observation the state is taken as exact.

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
    forget: float = 3.0
    most_obstacles: int = 20
    margin: float = 0.0
    starts: tuple[str, ...] = ()
    static_region: StaticRegion | None = None
    own_uncertainty: Growth = "open-loop"

    def __post_init__(self) -> None:
        check_settings(self)
        self._progress: Progress | None = None
        self._problems: dict[tuple[int, int, int], Problem] = {}
        reach = reach_of_bodies(self.robot, self.region, self.static_region)
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
        self._smoother: VelocitySmoother | None = None
        if self._progress is not None:
            self._progress = Progress(self._progress.path)

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        path = path if isinstance(path, Path) else Path(path)
        if path.points.shape[1] != self.robot.dimension:
            raise WideberthError(
                f"the path has {path.points.shape[1]} columns; the robot moves in "
                f"{self.robot.dimension} dimensions"
            )
        self._progress = Progress(path)
        if not self._problems:
            twin = replace(self)  # shares the compiled problems
            twin._progress, twin._problems = Progress(path), self._problems
            warm_up(twin, self.robot, path, self.reference_speed, self.history)

    @property
    def plan(self) -> Plan | None:
        """The plan behind the last command."""
        return self._plan

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without planning."""
        self._perception.take(observation)

    def command(self, observation: Observation) -> Command:
        """Plan from this observation; never raises.

        Whatever a plug-in throws ends in a braking plan whose reason names it, and where
        even braking cannot be planned, in the command to stand still.
        """
        try:
            self.remember(observation)
            self._plan = self._decide(observation)
            command = aim(self.robot, self._plan)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            self._plan, command = emergency(self.robot, observation, reason, self.horizon, self.dt)
        reasons = (self._plan.reason, *self._perception.drain())
        self._plan = replace(self._plan, reason="; ".join(filter(None, reasons)))
        since = observation.stamp + self.latency
        before = self._smoother or VelocitySmoother.at_rest(command.twist, since)
        self._smoother = before.aim(command, since)
        return command

    def _decide(self, observation: Observation) -> Plan:
        """Forecast, build the instance, solve, and choose a rung."""
        if self._progress is None:
            raise WideberthError("no path is set: call set_path before command")
        ladder = self._ladder(observation)
        arc = self._progress.update(self._place(ladder.start))
        reference = lay_reference(
            self._progress.path, arc, self.reference_speed, self.horizon, self.dt
        )
        here = self._place(ladder.start)
        route = np.stack([reference.position, np.broadcast_to(here, reference.position.shape)])
        obstacles, forecast = self._forecast(observation, ladder, route)
        bare = ladder.guesses(self.starts, self.reference_speed)
        known = observation.covariance
        if known is not None and self.latency:
            known = carried(known, lambda x: self._start(x, observation.stamp), observation.state)
        own = self._own.spread(known, bare[0].states, bare[0].inputs)
        walls = choose_walls(
            observation.polygons,
            self.static_region,
            np.concatenate([*route, self._place(bare[0].states[1:].T).T]),
            self._near(own),
            self.most_obstacles,
        )
        parameters = Situation(ladder.start, reference, obstacles, walls, own).parameters(
            self.robot, self.region, self.level, self.margin, self.static_region
        )
        problem = self._problem(parameters, walls)
        guesses = [ladder.suited(parameters, guess) for guess in bare]
        pull = guesses[0].pull(parameters)
        around = Surroundings(
            self.robot, self.region, self.static_region, obstacles, walls, self.margin
        )
        cap = None if self.deadline is None else self.deadline / len(guesses)
        solutions = self.solver.solve(problem, pull, guesses, cap)
        return ladder.choose(Case(problem, pull, around), solutions, forecast)

    def _near(self, own: Array) -> float:
        """How near a polygon has to be to the route to come into the problem, m.

        Bodies, margin and own uncertainty, and as much as a plan may turn aside: half of what
        the reference covers. A plan that goes farther is still held against all polygons.
        """
        aside = 0.5 * self.reference_speed * self.horizon * self.dt
        return self.robot.radius + self.margin + aside + widest(own, self.level)

    def _ladder(self, observation: Observation) -> Ladder:
        """Where the plan starts, and what is left of the last one.

        A state slightly beyond its limits (noise, a push) is taken as on them: otherwise no
        plan would be feasible, and the robot would stop for it.
        """
        if len(observation.state) != len(self.robot.states):
            raise WideberthError(
                f"the state has {len(observation.state)} entries; this robot has "
                f"{[quantity.name for quantity in self.robot.states]}"
            )
        stamp = observation.stamp + self.latency
        bounds = self.robot.state_bounds()
        start = self._start(observation.state, observation.stamp)
        start = np.clip(start, np.asarray(bounds.lower), np.asarray(bounds.upper))
        inputs = None
        if self._plan is not None and stamp >= self._plan.stamp:
            inputs = shift(self._plan.inputs, (stamp - self._plan.stamp) / self._plan.dt)
        return Ladder(
            self.robot,
            self.region,
            self.level,
            stamp,
            self.dt,
            self.horizon,
            start,
            inputs,
            self.static_region,
        )

    def _start(self, state: Array, stamp: float) -> Array:
        """State in which the command takes effect, of a robot observed at ``stamp``."""
        if not self.latency:
            return state
        return carry(self.robot, state, self._smoother, stamp, self.latency)

    def _place(self, state: Array) -> Array:
        return np.array(self.robot.pose(tuple(state)).position, dtype=np.float64)

    def _forecast(
        self, observation: Observation, ladder: Ladder, route: Array
    ) -> tuple[Obstacles, Forecast | None]:
        """Ask for a forecast on the plan's grid and choose the obstacles that fit."""
        grid = self.dt * np.arange(1, self.horizon + 1, dtype=np.float64)
        found = self._perception.forecast(ladder.stamp, grid, self._scene(observation))
        if found is None:
            return Obstacles.none(self.horizon, self.robot.dimension), None
        tracks, forecast = found
        most = self.most_obstacles
        return choose_obstacles(forecast, tracks.ids, tracks.radius, route, most), forecast

    def _scene(self, observation: Observation) -> Scene:
        """Tell predictors of the robot itself and its last plan."""
        plan, times = None, None
        if self._plan is not None:
            plan = self._plan.positions
            times = self._plan.stamp + self._plan.dt * np.arange(len(plan), dtype=np.float64)
        return Scene(
            ego=observation.state,
            plan=plan,
            truth=observation.truth,
            plan_times=times,
            radius=self.robot.radius,
        )

    def _problem(self, parameters: Parameters, walls: Walls) -> Problem:
        key = len(parameters.active), len(parameters.static_active), walls.parts.shape[1]
        capacity, statics, corners = key
        if key not in self._problems:
            self._problems[key] = assemble(
                self.robot,
                self.region,
                self.level,
                horizon=self.horizon,
                dt=self.dt,
                capacity=capacity,
                weights=self.weights,
                penalty=self.penalty,
                static_region=self.static_region,
                statics=statics,
                corners=corners,
            )
        return self._problems[key]
