"""Each agent plans: iterated best responses of planners that forecast each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, final

import numpy as np

from ..framework.mpc.planner.planner import Planner
from ..framework.plugins.config import build, describe
from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import both_reasons, refuse_adaptive
from .core.best_response import BestResponsePlanner, Player, state_of
from .core.history import gather
from .core.social_rollout import RobotCourse, course_of


@dataclass(frozen=True, eq=False)
class PlayedGame:
    """Result of the game, per agent.

    Attributes
    ----------
    bent : (A, N, 2), m, how much the others change each agent's way.
    unsettled : (A, N, 2), m, half of what the last round would still have changed.
    failures : index of the agent -> why no plan was found for it.
    """

    bent: Array
    unsettled: Array
    failures: dict[int, str]


@dataclass(frozen=True, eq=False)
class Table:
    """Agents of the game; the robot is agent 0, agent i is the obstacle in row ``rows[i - 1]``.

    Attributes
    ----------
    responder : plans for each of them.
    agents : (A,).
    rows : (A - 1,), where the obstacles stand in ``straight``.
    straight : forecast of all obstacles alone.
    grid : (N,), s, its steps.
    """

    responder: BestResponsePlanner
    agents: tuple[Player, ...]
    rows: tuple[int, ...]
    straight: Forecast
    grid: Array

    def play(self, iterations: int) -> PlayedGame:
        """Compute all best responses to the last round at once, and move half the way to them.

        An agent for which no plan is found keeps its way, and is still seen by the others;
        nothing bends the forecast of one that found none in the last round, nor any without the
        robot's plan there.
        """
        count, steps = len(self.agents), len(self.grid)
        bent, step = np.zeros((2, count, steps, 2))
        alone = [self._plan(agent, None, ()) for agent in self.agents]
        failures = {i: found for i, found in enumerate(alone) if isinstance(found, str)}
        if 0 in failures:
            return PlayedGame(bent, step, failures)
        for _ in range(iterations):
            for i, base in enumerate(alone):
                if isinstance(base, str):
                    continue
                found = self._answer(i, np.asarray(alone[0]) + bent[0], bent)
                if isinstance(found, str):
                    failures[i], step[i] = found, 0.0
                else:
                    failures.pop(i, None)
                    step[i] = found - base - bent[i]
            bent = bent + 0.5 * step
        without = list(range(count)) if 0 in failures else list(failures)
        bent[without], step[without] = 0.0, 0.0
        return PlayedGame(bent, 0.5 * step, failures)

    def _answer(self, index: int, robot: Array, bent: Array) -> Array | str:
        """Best response of one agent to the others, on the time grid.

        To an obstacle the robot is as uncertain as the obstacle is to the robot.
        """
        others = [i for i in range(1, len(self.agents)) if i != index]
        rows = [self.rows[i - 1] for i in others]
        straight = self.straight
        mean = straight.mean[rows] + bent[others][:, None]
        covariance, weight = straight.covariance[rows], straight.weight[rows]
        if index:
            own = self.rows[index - 1]
            mean = np.concatenate([np.broadcast_to(robot, (1, *mean.shape[1:])), mean])
            covariance = np.concatenate([straight.covariance[[own]], covariance])
            weight = np.concatenate([straight.weight[[own]], weight])
            others = [0, *others]
        expected = Forecast(mean, covariance, weight, straight.dt, (None,) * len(others))
        radii = tuple(self.agents[i].radius for i in others)
        return self._plan(self.agents[index], expected, radii)

    def _plan(
        self, agent: Player, others: Forecast | None, radii: tuple[float, ...]
    ) -> Array | str:
        found = self.responder.respond(agent, others, radii)
        return found if isinstance(found, str) else RobotCourse(*found, 0.0).at(self.grid)[0]


STANDING = 0.05
"""m/s; who was slower than this on average is taken to stay."""
FASTEST = 100.0
"""m/s; who was faster than this on average is no planner's robot."""
MOST_STEPS = 1000
"""Steps of a forecast over the planner's horizon; of microseconds there would be millions."""
NEAR = 0.5
"""m; a plan that ends nearer than this (a stop) does not tell where the robot wants to go."""


def _recommended() -> Planner:
    """Return the recommended planner of a unicycle, with Kalman forecasts: robots are known."""
    kalman = {"type": "kalman", "acceleration_density": 0.01}
    planner = build(
        "controllers", {"type": "recommended", "robot": "unicycle", "predictor": kalman}
    )
    assert isinstance(planner, Planner)
    return planner


MEMORY = 8.0
"""s of an agent's past that its goal is read from."""


@final
@dataclass(frozen=True, eq=False)
class Game(Predictor):
    """Each obstacle, and the robot itself, plans as the robot does, forecasting the others' plans.

    The paper's outlook: "a dynamic game theory approach", symmetric and without communication.
    Agents i are the robot and the obstacles nearest to it. With s_i straight motion (what
    ``planner.predictor`` forecasts of i alone) and R_i(x) the plan of i towards its goal among
    others that move along x,

        b_i = s_i + R_i(x^{n-1}) - R_i(none),    x^n = (x^{n-1} + b(x^{n-1})) / 2,    x^0 = s

    for n = 1 to ``iterations``; all respond at once, so that no agent goes first. Half steps,
    because full ones go to and fro: both give way, then, seeing that, neither does. What the
    others change in a plan is added to the straight motion, so that an agent whom the
    planner's robot model fits badly (a person faster than the robot) is forecast no worse
    than by the predictor alone; one without others in its way is forecast exactly as by it.

    Goals are extrapolated: in the direction and at the speed of the mean velocity over the last
    `MEMORY` s; for the robot, where its current plan ends (``scene.plan``; else straight
    ahead), at the planner's reference speed. Each agent knows of the others as much as the
    robot does: their covariance is the predictor's; that of the robot, of which the predictor
    says nothing, is taken to be that of the agent who looks at it. Walls are not seen.

    Covariance: the predictor's around the new mean, since planners do not say how wrong they
    are; and (d/2)(d/2)' with d = b - x of the last round: where responses have not settled,
    both ends are held for possible.

    Budget: (agents + 1) (iterations + 1) solves per forecast, without regard to a deadline.
    Left to ``planner.predictor``, with the reason: obstacles beyond the nearest ``agents``,
    which the game does not see either; who stands (was slower than 0.05 m/s) or is no robot
    (100 m/s); whose inner plan fails; and all where the robot's state is not given, tracks are
    not in the plane, or more than 1000 of their steps make the planner's horizon.

    Parameters
    ----------
    planner : what each agent is taken to run. Its predictor must be no game.
    iterations : rounds of responses.
    agents : most obstacles that take part.

    Raises
    ------
    WideberthError : a number out of range, a planner in three dimensions, or a game inside.
    """

    planner: Planner = field(default_factory=_recommended)
    iterations: int = 3
    agents: int = 3

    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def __post_init__(self) -> None:
        whole("game.iterations", self.iterations)
        whole("game.agents", self.agents)
        refuse_adaptive("game.planner.predictor", self.planner.predictor)
        if self.planner.robot.dimension != 2:
            raise WideberthError(
                f"game.planner moves in {self.planner.robot.dimension} dimensions; wanted 2"
            )
        if _holds_game(self.planner.predictor):
            raise WideberthError(
                "game.planner.predictor is, or holds, a game: players that play games about "
                "players have no end; give it another predictor, for example kalman"
            )

    def __eq__(self, other: object) -> bool:
        """Tell whether the settings are the same (planners themselves go by identity)."""
        return isinstance(other, Game) and describe(self) == describe(other)

    def __hash__(self) -> int:
        """Return a number that equal games share."""
        return hash((self.iterations, self.agents, MEMORY))

    @cached_property
    def _responder(self) -> BestResponsePlanner:
        return BestResponsePlanner(self.planner)

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings alone: compiled problems are made anew where they are needed."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        robot = self._robot(tracks, scene)
        if isinstance(robot, str):
            straight = self.planner.predictor.predict(tracks, steps, scene)
            still = np.zeros((2, len(tracks), steps, tracks.dimension))
            return _bent(straight, steps, [robot] * len(tracks), still)
        ahead = max(steps, self._responder.steps(tracks.dt), 2)
        straight = self.planner.predictor.predict(tracks, ahead, scene)
        agents, reasons = self._agents(tracks, straight, robot)
        rows = tuple(agents)
        grid = tracks.dt * np.arange(1, ahead + 1, dtype=np.float64)
        table = Table(self._responder, (robot, *agents.values()), rows, straight, grid)
        played = table.play(self.iterations)
        changes = np.zeros((2, len(tracks), ahead, 2))
        if 0 in played.failures:
            robotless = f"no plan for the robot: {played.failures[0]}"
            reasons = [reason or robotless for reason in reasons]
        for index, row in enumerate(rows, start=1):
            changes[:, row] = played.bent[index], played.unsettled[index]
            if index in played.failures and 0 not in played.failures:
                reasons[row] = f"no plan for it: {played.failures[index]}"
        return _bent(straight, steps, reasons, changes)

    def _robot(self, tracks: Tracks, scene: Scene | None) -> Player | str:
        """Return the robot itself as an agent, or why it cannot take part."""
        model = self.planner.robot
        if tracks.dimension != 2:
            return f"{tracks.dimension} coordinates, made for 2"
        if scene is None or scene.ego is None:
            return "the robot's state is not given"
        if len(scene.ego) != len(model.states):
            return f"the robot's state has {len(scene.ego)} entries, needs {len(model.states)}"
        if not np.isfinite(scene.ego).all():
            return "the robot's state is not finite"
        if (needed := self._responder.steps(tracks.dt)) > MOST_STEPS:
            return f"the planner's horizon is {needed} steps, at most {MOST_STEPS}"
        pose = model.pose(tuple(scene.ego))
        course = course_of(scene, tracks.dt, tracks.stamp)
        way = np.zeros(2) if course is None else course.positions[-1] - pose.points()
        if np.linalg.norm(way) < NEAR:
            if pose.heading is None:
                return "the robot has no heading, and no plan that leads on"
            way = np.array([np.cos(pose.heading), np.sin(pose.heading)])
        direction = way / np.linalg.norm(way)
        return Player(scene.ego, direction, self.planner.reference_speed, model.radius)

    def _agents(
        self, tracks: Tracks, straight: Forecast, robot: Player
    ) -> tuple[dict[int, Player], list[str | None]]:
        """Choose the obstacles that take part, by row; and say why each other one does not."""
        model = self.planner.robot
        means = np.einsum("om,omnd->ond", straight.weight, straight.mean)
        velocity = (means[:, 1] - means[:, 0]) / tracks.dt
        place = means[:, 0] - tracks.dt * velocity
        past = gather(tracks, length=int(np.ceil(MEMORY / tracks.dt)) + 1)
        gone = np.maximum(past.length - 1, 1) * tracks.dt
        oldest = past.positions[:, 0]  # of a shorter history its first position
        mean_speed = np.linalg.norm(oldest, axis=1) / gone
        away = np.linalg.norm(place - model.pose(tuple(robot.state)).points(), axis=1)
        agents: dict[int, Player] = {}
        reasons: list[str | None] = [None] * len(tracks)
        for row in sorted(range(len(tracks)), key=lambda o: (away[o], tracks.ids[o])):
            if past.samples[row] < 2:
                reasons[row] = f"{past.samples[row]} samples, needs 2"
            elif mean_speed[row] < STANDING:
                reasons[row] = f"stands ({mean_speed[row]:.2f} m/s)"
            elif mean_speed[row] > FASTEST:
                reasons[row] = f"too fast ({mean_speed[row]:.3g} m/s)"
            elif len(agents) == self.agents:
                reasons[row] = f"not among the nearest {self.agents}"
            else:
                direction = -oldest[row] / np.linalg.norm(oldest[row])
                state = state_of(model, place[row], velocity[row], direction)
                speed, radius = float(mean_speed[row]), float(tracks.radius[row])
                agents[row] = Player(state, direction, speed, radius)
        return agents, reasons


def _holds_game(value: Any) -> bool:
    """Whether this is a game, or has one anywhere among its settings."""
    if isinstance(value, Game):
        return True
    if is_dataclass(value):
        return any(_holds_game(getattr(value, entry.name)) for entry in fields(value))
    if isinstance(value, Mapping):
        return any(map(_holds_game, value.values()))
    return isinstance(value, list | tuple) and any(map(_holds_game, value))


def _bent(
    straight: Forecast, steps: int, reasons: Sequence[str | None], changes: Array
) -> Forecast:
    """Move the straight forecast's means, and widen it, by ``changes`` (2, O, >= N, D)."""
    bent, unsettled = changes[:, :, :steps]
    spread = np.einsum("oni,onj->onij", unsettled, unsettled)
    said = [
        deeper if own is None else both_reasons(f"game: {own}", deeper)
        for own, deeper in zip(reasons, straight.fallback, strict=True)
    ]
    known = straight.joint_source is not None
    return Forecast(
        straight.mean[:, :, :steps] + bent[:, None],
        straight.covariance[:, :, :steps] + spread[:, None],
        straight.weight,
        straight.dt,
        tuple(said),
        partial(_joint, straight, unsettled) if known else None,
    )


def _joint(straight: Forecast, unsettled: Array) -> Array:
    """Joint covariance (O, M, N*D, N*D), of the straight forecast and of what is unsettled."""
    known, flat = straight.joint, unsettled.reshape(len(unsettled), -1)
    assert known is not None
    size = flat.shape[1]
    return np.asarray(known[:, :, :size, :size] + np.einsum("oi,oj->oij", flat, flat)[:, None])
