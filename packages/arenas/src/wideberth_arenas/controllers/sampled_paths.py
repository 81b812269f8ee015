"""The base of published planners that sample paths and drive the cheapest that they allow."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from wideberth.controllers.velocity_box import VelocityBox
from wideberth.framework.control.command_limits import turns_on_the_spot, within_reach
from wideberth.framework.control.rate_limited_warnings import WARNINGS
from wideberth.framework.controller import Controller, checked_path, checked_ready, checked_use
from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Predictor
from wideberth.framework.robot import Robot
from wideberth.framework.tracking.history import viewpoint
from wideberth.framework.tracking.stand_ins import checked_places
from wideberth.framework.values.arrays import Array, positive, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.failures import caught
from wideberth.framework.values.motion import Command, Observation, Pose, Twist, checked_numbers
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.predictors.core.forecaster import Forecaster

Singles: TypeAlias = np.ndarray[Any, np.dtype[np.float32]]
"""Numbers of single precision, as the published codes have them."""

SAMPLES = 20
"""Of the tracks that a predictor is given, one period apart."""
HOLD = 2
"""Steps that a drawn velocity lasts."""
CONTROL, TERMINAL = 1e-3, 10.0
"""Weights of the squared velocities and of the last squared distance to the goal."""


@dataclass(frozen=True, eq=False)
class SampledPaths:
    """Control sequences, and where they lead.

    Attributes
    ----------
    points : (P, N + 1, 2), m, the first is where the robot is.
    velocities : (P, N, 2), m/s and rad/s.
    """

    points: Singles
    velocities: Singles

    @classmethod
    def rolled_out(cls, pose: Array, velocities: Singles, dt: float) -> "SampledPaths":
        """Integrate a unicycle by Euler's rule, in single precision.

        p_{k+1} = p_k + dt v_k (cos th_k, sin th_k),   th_{k+1} = th_k + dt w_k

        Parameters
        ----------
        pose : x, y, m, and heading, rad.
        velocities : (P, N, 2). dt : s.
        """
        count, steps, _ = velocities.shape
        points = np.empty((count, steps + 1, 2), dtype=np.float32)
        points[:, 0] = pose[:2]
        heading = np.full(count, pose[2], dtype=np.float32)
        for k in range(steps):
            way = dt * velocities[:, k, 0]
            points[:, k + 1, 0] = points[:, k, 0] + way * np.cos(heading)
            points[:, k + 1, 1] = points[:, k, 1] + way * np.sin(heading)
            heading = heading + dt * velocities[:, k, 1]
        return cls(points, velocities)

    def goal_cost(self, goal: Array) -> Array:
        """Return what a path costs without people, (P,).

        sum_{k<N} |p_k - g|^2 + `TERMINAL` |p_N - g|^2 + `CONTROL` sum_k (v_k^2 + w_k^2)

        Parameters
        ----------
        goal : g, (2,), m.
        """
        square = np.sum((self.points - goal) ** 2, axis=-1)
        effort = np.sum(self.velocities**2, axis=(-2, -1))
        return np.asarray(
            square[:, :-1].sum(axis=-1) + CONTROL * effort + TERMINAL * square[:, -1]
        )


@dataclass(frozen=True, eq=False)
class SeenPeople:
    """Who is seen at one instant, and forecast.

    Attributes
    ----------
    row : number of the instant; those one period apart differ by one.
    names : O identities.
    radius : (O,), m.
    now : (O, 2), m, NaN where the last measurement is older.
    ahead : (O, N, 2), m, the most likely mode of the forecast.
    """

    row: int
    names: tuple[str, ...]
    radius: Array
    now: Array
    ahead: Array

    def with_past(self, past: "SeenPeople", step: int) -> tuple[Array, Array, Array]:
        """Return where those are now who were forecast earlier, and what was forecast of them.

        Parameters
        ----------
        past : what was seen earlier. step : of its forecast, counted from 1, that is due now.

        Returns
        -------
        now, forecast : (K, 2), m. radius : (K,), m.
        """
        place = {name: i for i, name in enumerate(past.names)}
        rows = [
            i
            for i, name in enumerate(self.names)
            if name in place and np.isfinite(self.now[i]).all()
        ]
        before = [place[self.names[i]] for i in rows]
        return self.now[rows], past.ahead[before, step - 1], self.radius[rows]


def clearance(points: Array | Singles, people: Array, radius: Array) -> Array:
    """Return the distance from points to the nearest of some discs, (P, N), m.

    Parameters
    ----------
    points : (P, N, 2), m. people : (O, N, 2), m, centres. radius : (O,), m.
    """
    nearest = np.full(points.shape[:2], np.inf)
    for place, own in zip(people, radius, strict=True):
        away = points - place
        np.minimum(nearest, np.sqrt(np.sum(away**2, axis=-1)) - own, out=nearest)
    return nearest


@dataclass(eq=False)
class SampledController(Controller, ABC):
    """Draws control sequences anew at every decision, and drives the cheapest one it allows.

    P sequences are drawn evenly from the robot's speeds and yaw rates, each velocity kept for
    `HOLD` steps, and the last decision's sequence is tried again. What they cost without
    people is `SampledPaths.goal_cost`; a subclass adds what people cost, or forbids paths
    (`cost`), and learns from what it sees (`learn`). Where every path is forbidden the robot
    stands still, and `reason` says so. People who are not seen now do not count.

    One fault is common to the published codes: the last sequence, of N steps, is taken for the
    velocities of the N / `HOLD` blocks, so that it is driven `HOLD` times as slowly. Here
    its steps are shifted by one.

    Parameters
    ----------
    robot : to be driven; it turns on the spot.
    predictor : of the people.
    period : s between calls, and between the steps of a path.
    steps : N.
    paths : P.
    seed : of the draws.
    as_published : whether the faults of the published code are kept.

    Raises
    ------
    WideberthError : a number out of range, or a robot that cannot turn on the spot.
    """

    robot: Robot
    predictor: Predictor = field(
        default_factory=partial(build, "predictors", {"type": "constant_velocity", "window": 1})
    )
    period: float = 0.4
    steps: int = 12
    paths: int = 1200
    seed: int = 0
    as_published: bool = False

    def __post_init__(self) -> None:
        name = type(self).__name__
        positive(f"{name}.period", self.period)
        for entry in ("steps", "paths"):
            whole(f"{name}.{entry}", getattr(self, entry))
        whole(f"{name}.seed", self.seed, least=0)
        still = self.robot.state_at(Pose((0.0,) * self.robot.dimension, 0.0), Twist((0.0, 0.0)))
        if self.robot.dimension != 2 or not turns_on_the_spot(self.robot, np.array(still)):
            raise WideberthError(
                f"{name} drives robots that turn on the spot, in the plane; "
                f"{type(self.robot).__name__} does not: take unicycle or differential_drive"
            )
        box = VelocityBox.of(self.robot)
        self._limits, self._least = box.limits, box.lower[0]
        self._path: Path | None = None
        self.reset()

    def reset(self) -> None:
        """Forget people, the last decision and all that was learnt; keep the path."""
        self._rng = np.random.default_rng(self.seed)
        self._forecaster = Forecaster(self.predictor, self.period, self.period, SAMPLES)
        self._last: Singles | None = None
        self._stamp, self._row, self._reason = -np.inf, -1, ""
        self.forget()

    def set_path(self, path: Path) -> None:
        """Take the end of this path as the goal."""
        self._path = checked_path(self.robot, path)

    @property
    def last_plan(self) -> Plan | None:
        """None: the paths hold no obstacles."""
        return None

    @property
    def reason(self) -> str:
        """Why the last command was to stand still instead of a path; empty if it was one."""
        return self._reason

    def remember(self, observation: Observation) -> None:
        """Take note of the people and learn from them."""
        self._take(checked_use(self.robot, observation))

    def command(self, observation: Observation) -> Command:
        """Decide; raises for wrong use alone, see `reason` for other failures.

        Raises
        ------
        WideberthError : no path is set, or something else than an observation of this robot.
        """
        goal = checked_ready(self._path).goal
        checked_use(self.robot, observation)
        self._reason = ""
        try:
            seen = self._take(observation)
            checked_numbers(observation)
            checked_places(self._forecaster.placeless)
            command = within_reach(self.robot, self._decided(observation, goal, seen))
        except Exception as error:  # whatever a predictor throws
            self._reason = caught(error)
            command = Command((0.0, 0.0))
        if self._reason:
            WARNINGS.warn(type(self).__name__, "stands still", self._reason)
        return command

    def _decided(self, observation: Observation, goal: Array, seen: SeenPeople) -> Command:
        pose = self.robot.pose(tuple(observation.state))
        paths = self._drawn(np.array([*pose.position, pose.heading], dtype=np.float64))
        cost = self.cost(paths, paths.goal_cost(goal), seen)
        best = int(np.argmin(cost))
        if not np.isfinite(cost[best]):
            self._reason = f"none of {self.paths} paths is allowed"
            return Command((0.0, 0.0))
        chosen = paths.velocities[best]
        self._last = chosen
        speed, turning = (float(value) for value in chosen[0])
        return Command((speed, 0.0), turning)

    def _drawn(self, pose: Array) -> SampledPaths:
        """Sample paths from a pose, the last decision's first."""
        rng, (fast, turn) = self._rng, self._limits
        blocks, slow = -(-self.steps // HOLD), max(self.slowest(fast), self._least)
        drawn = np.empty((self.paths, blocks, 2), dtype=np.float32)
        drawn[..., 0] = rng.uniform(slow, fast, size=(self.paths, blocks))
        drawn[..., 1] = rng.uniform(-turn, turn, size=(self.paths, blocks))
        if self._last is not None and self.as_published:
            more = [rng.uniform(slow, fast), rng.uniform(-turn, turn)]
            drawn[0] = np.vstack([self._last[1:], more])[:blocks]
        velocities = np.repeat(drawn, HOLD, axis=1)[:, : self.steps]
        if self._last is not None and not self.as_published:
            velocities[0] = np.vstack([self._last[1:], self._last[-1:]])
        return SampledPaths.rolled_out(pose, velocities, self.period)

    def _take(self, observation: Observation) -> SeenPeople:
        """Remember people, learn from them once per instant, and return them."""
        here, stamp = viewpoint(self.robot, observation), observation.stamp
        place = np.zeros(2) if here is None else here
        for words in self._forecaster.take(observation, place, self.robot.radius):
            WARNINGS.warn(type(self).__name__, "detection", words)
        if stamp < self._stamp:
            self.forget()
        new = here is not None and np.isfinite(stamp / self.period) and stamp != self._stamp
        if new:
            self._row = self._row + 1 if self.as_published else round(stamp / self.period)
        seen = self._people(observation)
        if new:
            self._stamp = stamp
            self.learn(seen, place)
        return seen

    def _people(self, observation: Observation) -> SeenPeople:
        """Forecast those who are seen now."""
        times = self.period * np.arange(1.0, self.steps + 1.0)
        found = self._forecaster.at(observation.stamp, times) if self._row >= 0 else None
        names = self._forecaster.seen
        if found is None or not names:
            empty = np.zeros((0, self.steps, 2))
            return SeenPeople(self._row, (), np.zeros(0), empty[:, 0], empty)
        tracks, forecast = found
        rows = [i for i, name in enumerate(tracks.ids) if name in names]
        likeliest = forecast.weight[rows].argmax(axis=1)
        return SeenPeople(
            self._row,
            tuple(tracks.ids[i] for i in rows),
            tracks.radius[rows],
            tracks.positions[rows, -1],
            forecast.mean[rows, likeliest],
        )

    @abstractmethod
    def slowest(self, fastest: float) -> float:
        """Return the lowest speed that is drawn, m/s, of a robot with this highest one.

        One that may not drive backwards as fast has its own lowest speed.
        """

    @abstractmethod
    def forget(self) -> None:
        """Drop all that was learnt."""

    @abstractmethod
    def learn(self, seen: SeenPeople, place: Array) -> None:
        """Learn from what is seen at one instant; called once for each, before `cost`.

        Parameters
        ----------
        seen : the people. place : (2,), m, of the robot.
        """

    @abstractmethod
    def cost(self, paths: SampledPaths, goal_cost: Array, seen: SeenPeople) -> Array:
        """Return what each path costs, (P,); infinite where it is forbidden.

        Parameters
        ----------
        paths : P of them. goal_cost : (P,), without people. seen : the people.
        """
