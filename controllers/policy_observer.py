"""What a policy sees: an observation as arrays of fixed sizes, with finite bounds."""

from dataclasses import dataclass
from functools import partial
from typing import TypeAlias, final

import numpy as np

from ..framework.controller import checked_use
from ..framework.predictor import Predictor
from ..framework.robot import Robot
from ..framework.tracking.history import History, admitted, viewpoint
from ..framework.tracking.perception import Perception, scene_of
from ..framework.values.arrays import Array, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.motion import Command, Observation
from ..framework.values.path import Path
from ..framework.values.polygon import separation
from .velocity_box import VelocityBox

SEEN = 4
"""Periods for which an obstacle that is no longer reported is carried on in a straight line."""
FASTEST = 10.0
"""m/s, bound on shown velocities; a difference of two noisy positions may be anything."""
WIDEST = 100.0
"""m^2, bound on the entries of shown covariances."""

Shown: TypeAlias = dict[str, Array]
"""Name -> array, as `ObservationSpec` describes them."""
HISTORY = 40
"""Samples, one control period apart, that the predictor is given."""


@final
@dataclass(frozen=True)
class ObservationSpec:
    """How much of an observation a policy sees. World axes, relative to the robot, in SI units.

    ===================  =============  ====================================================
    name                 shape          what
    ===================  =============  ====================================================
    goal                 (D,)           way to the goal, m; a goal beyond ``reach`` is shown
                                        in its direction at that distance
    heading              (2,)           cosine and sine; missing for a robot without one
    velocity             (A,)           own velocity as an action, see `VelocityBox`; of a
                                        robot whose input it is, the one commanded last
    positions            (K, D)         centres of the nearest K obstacles, m, nearest first
    velocities           (K, D)         by the difference of the last two positions, m/s
    radii                (K,)           m
    present              (K,)           1 where there is such an obstacle, else 0 and zeros
    walls                (W, 2)         nearest points of the nearest W polygons, m
    walls_present        (W,)           as above
    forecast_mean        (K, N, D)      of the same obstacles, m; of a mixture the heaviest mode
    forecast_covariance  (K, N, D, D)   m^2
    ===================  =============  ====================================================

    Obstacles and walls further than ``reach`` are not shown, and nothing else of the state:
    a policy that is to know where it is in the world needs a wrapper.

    Parameters
    ----------
    obstacles : K.
    walls : W; 0 leaves both arrays out.
    reach : m.
    predictor : whose forecasts are shown; None leaves both arrays out.
    steps : N, steps ahead of one control period each.

    Raises
    ------
    WideberthError : a number out of range.
    """

    obstacles: int = 5
    walls: int = 0
    reach: float = 20.0
    predictor: Predictor | None = None
    steps: int = 8

    def __post_init__(self) -> None:
        whole("sight.obstacles", self.obstacles)
        whole("sight.walls", self.walls, least=0)
        positive("sight.reach", self.reach)
        whole("sight.steps", self.steps)


class PolicyObserver:
    """Turns the observations of one robot, one after the other, into arrays.

    Parameters
    ----------
    robot : who sees.
    period : s between observations.
    sight : how much of them.
    """

    def __init__(self, robot: Robot, period: float, sight: ObservationSpec) -> None:
        self._robot, self._period, self._sight = robot, period, sight
        self.box: VelocityBox = VelocityBox.of(robot)
        self.goal: Array | None = None
        self.reset()

    def reset(self) -> None:
        """Forget what was seen and commanded; the goal stays."""
        period, sight = self._period, self._sight
        self._sights = History(period, SEEN + 2, SEEN * period, 2.5 * period)
        self._perception: Perception | None = None
        if sight.predictor is not None:
            size, forget = self._robot.dimension, SEEN * period
            self._perception = Perception.initial(
                sight.predictor, size, period, HISTORY, period, forget
            )
        self._stamp = -np.inf
        self.placeless: tuple[str, ...] = ()
        self._last = Command((0.0,) * self._robot.dimension)

    def follow(self, path: Path) -> None:
        """Take the end of this path as the goal."""
        self.goal = path.goal

    def take(self, observation: Observation) -> list[str]:
        """Take note of who is seen; return who is left out, and why.

        A clock that goes back starts anew.
        """
        if not np.isfinite(observation.stamp):
            return []
        if observation.stamp < self._stamp:
            self.reset()
        self._stamp = observation.stamp
        here = viewpoint(self._robot, observation)
        asked = observation, self._robot.dimension, SEEN * self._period, here
        sighting = admitted(*asked, partial(self._sights.known, observation.stamp))
        self.placeless = sighting.placeless
        self._sights = self._sights.add(observation.stamp, sighting.detections)
        if self._perception is not None:
            self._perception = self._perception.take(observation, here).drained()[0]
        return [*sighting.notes, *self._sights.notes]

    def commanded(self, command: Command) -> None:
        """Take note of the command that the robot was given."""
        self._last = command

    def show(self, observation: Observation) -> Shown:
        """Return the arrays of an observation that has been taken note of.

        Raises
        ------
        WideberthError : no path was followed, or what the predictor throws.
        """
        if self.goal is None:
            raise WideberthError("no path is set: call follow before show")
        checked_use(self._robot, observation)
        state = tuple(float(value) for value in observation.state)
        pose = self._robot.pose(state)
        here = pose.points()
        shown: Shown = {"goal": self._shortened(self.goal - here)}
        if pose.heading is not None:
            shown["heading"] = np.array([np.cos(pose.heading), np.sin(pose.heading)])
        control = self._robot.drive(state, self._last.twist, self._period)
        shown["velocity"] = self.box.action(self._robot.twist(state, control))
        ids, obstacles = self._obstacles(here)
        shown |= obstacles
        if self._sight.walls:
            shown |= self._walls(observation, here)
        if self._perception is not None:
            shown |= self._forecast(self._perception, observation, here, ids)
        return {name: np.clip(shown[name], *bounds) for name, bounds in self.bounds().items()}

    def bounds(self) -> dict[str, tuple[Array, Array]]:
        """Least and largest values of everything shown, in the shapes of the arrays."""
        least: dict[str, float] = dict.fromkeys(("radii", "present", "walls_present"), 0.0)
        return {name: (least.get(name, -1.0) * high, high) for name, high in self._high().items()}

    def _high(self) -> Shown:
        """Largest absolute values."""
        size, sight = self._robot.dimension, self._sight
        count, reach = sight.obstacles, sight.reach
        high = {"goal": np.full(size, reach)}
        if self._robot.pose((0.0,) * len(self._robot.states)).heading is not None:
            high["heading"] = np.ones(2)
        high |= {
            "velocity": self.box.high,
            "positions": np.full((count, size), reach),
            "velocities": np.full((count, size), FASTEST),
            "radii": np.full(count, reach),
            "present": np.ones(count),
        }
        if sight.walls:
            high["walls"] = np.full((sight.walls, 2), reach)
            high["walls_present"] = np.ones(sight.walls)
        if sight.predictor is not None:
            shape = (count, sight.steps, size)
            high["forecast_mean"] = np.full(shape, reach)
            high["forecast_covariance"] = np.full((*shape, size), WIDEST)
        return high

    def _shortened(self, way: Array) -> Array:
        length = float(np.linalg.norm(way))
        return np.asarray(way if length <= self._sight.reach else way * self._sight.reach / length)

    def _obstacles(self, here: Array) -> tuple[list[str], Shown]:
        """Identities of those shown, nearest first, and their arrays."""
        count, size = self._sight.obstacles, self._robot.dimension
        shown = {"positions": np.zeros((count, size)), "velocities": np.zeros((count, size)),
                 "radii": np.zeros(count), "present": np.zeros(count)}  # fmt: skip
        tracks = self._sights.tracks()
        if tracks is None:
            return [], shown
        late = self._stamp - tracks.stamp
        moving = [_moving(track, self._period, late) for track in tracks.positions]
        away = np.array([float(np.linalg.norm(place - here)) for place, _ in moving])
        nearest = np.argsort(away - tracks.radius, kind="stable")
        order = [i for i in nearest if away[i] <= self._sight.reach]  # false for NaN
        for k, i in enumerate(order[:count]):
            shown["positions"][k], shown["velocities"][k] = moving[i][0] - here, moving[i][1]
            shown["radii"][k], shown["present"][k] = tracks.radius[i], 1.0
        return [tracks.ids[i] for i in order[:count]], shown

    def _walls(self, observation: Observation, here: Array) -> Shown:
        """Nearest point of each polygon, the nearest ones first."""
        found = []
        for polygon in observation.polygons:
            pairs = [separation(here[None], part) for part in polygon.parts]
            distance, normal = min(pairs, key=lambda pair: float(pair[0]))
            found.append((float(distance), -float(distance) * normal))
        count = self._sight.walls
        shown = {"walls": np.zeros((count, 2)), "walls_present": np.zeros(count)}
        near = [way for away, way in sorted(found, key=_first) if away <= self._sight.reach]
        for k, way in enumerate(near[:count]):
            shown["walls"][k], shown["walls_present"][k] = way, 1.0
        return shown

    def _forecast(
        self, perception: Perception, observation: Observation, here: Array, ids: list[str]
    ) -> Shown:
        """Heaviest mode of each shown obstacle's forecast, relative to the robot."""
        size, steps, count = self._robot.dimension, self._sight.steps, self._sight.obstacles
        mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
        grid = self._period * np.arange(1.0, steps + 1.0)
        around = scene_of(observation, None, self._robot.radius)
        tracks = perception.history.tracks()
        self._perception = perception = perception.learnt(tracks, around)
        forecast = perception.forecast(tracks, observation.stamp, grid, around)
        if tracks is not None and forecast is not None:
            for k, name in enumerate(ids):
                o = tracks.ids.index(name)
                heaviest = int(np.argmax(forecast.weight[o]))
                mean[k] = forecast.mean[o, heaviest] - here
                covariance[k] = forecast.covariance[o, heaviest]
        return {"forecast_mean": mean, "forecast_covariance": covariance}


def _moving(track: Array, dt: float, late: float) -> tuple[Array, Array]:
    """Position and velocity ``late`` s after the end of one track (T, D), (D,) each.

    NaN where no sample is known: what was measured once, between two instants of the grid.
    """
    known = np.flatnonzero(np.isfinite(track).all(axis=1))
    if not known.size:
        return track[-1], track[-1]
    last = int(known[-1])
    velocity = np.zeros(track.shape[1])
    if len(known) > 1:
        velocity = (track[last] - track[known[-2]]) / (dt * (last - int(known[-2])))
    return track[last] + (late + dt * (len(track) - 1 - last)) * velocity, velocity


def _first(pair: tuple[float, Array]) -> float:
    return pair[0]
