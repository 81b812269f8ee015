"""All robots see what a local costmap shows: a world, and a controller that is watched."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from time import process_time
from typing import final

import numpy as np

from wideberth.framework import (
    Command,
    Controller,
    Detection,
    Observation,
    Path,
    Plan,
    Polygon,
    Predictor,
)
from wideberth.framework.tracking.perception import Perception, scene_of
from wideberth.framework.values.arrays import Array
from wideberth.simulation.engine.agents import Bystander, RobotAgent
from wideberth.simulation.engine.driver import Driver
from wideberth.simulation.engine.exchanged_positions import ExchangedPositions
from wideberth.simulation.engine.plant import Plant
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.engine.world import Around, World

from ..costmap.local_costmap import CostmapView, discs_of
from ..costmap.rays import Rays
from ..server.navigator import Nav2
from .looks import CostmapLook

_TRACK_DT, _TRACK_SAMPLES, _FORGET = 0.1, 40, 1.0
"""s between samples of a track; their number; s after which an unseen person is forgotten."""
_TOUCH = 1e-6
"""m by which the end of a ray may miss the disc that it met."""
MOST_SAMPLED = 80
"""Sampled trajectories that are kept of each tick, for a picture."""


@final
class SameView(World):
    """Robots exchange positions, but each learns only of whom its local costmap would show.

    A disc is seen where a ray of the view's LiDAR meets it, within the range at which it is
    marked and within the costmap's window; an exact view shows all. What stands still is a
    known map for all.

    Parameters
    ----------
    settings : channel and localisation.
    view : of the costmap.
    tracker : forecasts from which the velocities of those who are seen are taken, as a tracker
        reports them; None for positions alone. People never have one.
    """

    def __init__(
        self, settings: Settings, view: CostmapView, tracker: Predictor | None = None
    ) -> None:
        self._positions = ExchangedPositions(settings)
        self._view, self._tracker = view, tracker
        self._known: dict[str, Perception] = {}

    def plants(
        self,
        agents: Sequence[RobotAgent],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        seed: int,
    ) -> list[Plant]:
        """Return the bodies of `ExchangedPositions`."""
        return self._positions.plants(agents, others, polygons, seed)

    def newcomer(self, agent: RobotAgent) -> Plant:
        """Return the body of `ExchangedPositions`."""
        return self._positions.newcomer(agent)

    def observe(
        self, driver: Driver, time: float, tick: int, state: Array, around: Around
    ) -> Observation:
        """Return what is in sight; people see all."""
        seen = self._positions.observe(driver, time, tick, state, around)
        if driver.agent.person:
            return seen
        pose = driver.agent.robot.pose(tuple(float(value) for value in state))
        here = np.array(pose.position, dtype=np.float64)
        if not self._view.exact:
            seen = replace(seen, detections=in_sight(seen, here, self._view))
        return seen if self._tracker is None else self._with_velocities(driver, seen, here)

    def _with_velocities(self, driver: Driver, seen: Observation, here: Array) -> Observation:
        """Return the observation with the velocities of a filter over what was seen so far."""
        assert self._tracker is not None
        known = self._known.get(driver.name) or Perception.initial(
            self._tracker, 2, _TRACK_DT, _TRACK_SAMPLES, driver.agent.controller.period, _FORGET
        )
        known, _ = known.take(seen, here).drained()
        self._known[driver.name] = known
        tracks = known.history.tracks()
        grid = _TRACK_DT * np.array([1.0, 2.0])
        forecast = known.forecast(tracks, seen.stamp, grid, scene_of(seen, None, driver.radius))
        if tracks is None or forecast is None:
            return seen
        speeds = (forecast.mean[:, 0, 1] - forecast.mean[:, 0, 0]) / _TRACK_DT
        spreads = forecast.covariance[:, 0].sum(axis=1) / _TRACK_DT**2  # at most, of both ends
        found = dict(zip(tracks.ids, zip(speeds, spreads, strict=True), strict=True))
        return replace(seen, detections=tuple(_moving(one, found) for one in seen.detections))


def _moving(one: Detection, found: dict[str, tuple[Array, Array]]) -> Detection:
    """Return a detection with its velocity, where one is known."""
    if one.ident not in found or one.covariance is None:
        return one
    velocity, spread = found[one.ident]
    joint = np.zeros((4, 4))
    joint[:2, :2], joint[2:, 2:] = one.covariance, spread
    return replace(one, velocity=velocity, state_covariance=joint)


def in_sight(seen: Observation, here: Array, view: CostmapView) -> tuple[Detection, ...]:
    """Return the detections of discs that a costmap of this view would show from a place (2,)."""
    ones = seen.detections
    centres, radii = discs_of(ones)
    rays = Rays.cast(here, centres, radii, seen.polygons, view.laser_range)
    half = 0.5 * np.array([view.width, view.height])
    marks = rays.met & (rays.ranges <= view.obstacle_max_range)
    steps = rays.directions[marks] * rays.ranges[marks, None]
    ends = here + steps[(np.abs(steps) <= half).all(axis=1)]
    apart = np.linalg.norm(ends[None] - centres[:, None], axis=2) - radii[:, None]
    met = (np.abs(apart) <= _TOUCH).any(axis=1)
    return tuple(one for one, known in zip(ones, met, strict=True) if known)


@final
@dataclass(eq=False)
class Watched(Controller):
    """Does what another controller does; notes the processor time and, if asked, what it saw.

    Parameters
    ----------
    controller : is watched.
    every : s between two looks that are kept; 0 keeps none.
    """

    controller: Controller
    every: float = 0.0
    seconds: list[float] = field(default_factory=list, init=False)
    looks: list[CostmapLook] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.period: float = self.controller.period

    def reset(self) -> None:
        """As the controller; what was noted stays."""
        self.controller.reset()

    def set_path(self, path: Path) -> None:
        """As the controller, which compiles and warms up here."""
        self.controller.set_path(path)

    def remember(self, observation: Observation) -> None:
        """As the controller."""
        self.controller.remember(observation)

    @property
    def last_plan(self) -> Plan | None:
        """The controller's."""
        return self.controller.last_plan

    def command(self, observation: Observation) -> Command:
        """As the controller; its processor time is noted."""
        begin = process_time()
        command = self.controller.command(observation)
        self.seconds.append(process_time() - begin)
        last = self.looks[-1].time if self.looks else -np.inf
        if self.every and observation.stamp >= last + self.every - 1e-9:
            self._keep(observation.stamp)
        return command

    def _keep(self, time: float) -> None:
        if not isinstance(self.controller, Nav2) or self.controller.costmap is None:
            return
        answer = self.controller.answer
        expected, sampled = np.zeros((0, 3)), np.zeros((0, 0, 3))
        if answer is not None and answer.expected is not None:
            expected = np.asarray(answer.expected, np.float64)
        if answer is not None and answer.sampled:
            sampled = _padded(answer.sampled)
        self.looks.append(CostmapLook(time, self.controller.costmap, expected, sampled))


def _padded(ways: Sequence[Array]) -> Array:
    """Return at most `MOST_SAMPLED` trajectories (T, 3), evenly chosen, as one array."""
    chosen = [ways[i] for i in range(0, len(ways), -(-len(ways) // MOST_SAMPLED))]
    found = np.full((len(chosen), max(map(len, chosen)), 3), np.nan)
    for row, way in zip(found, chosen, strict=True):
        row[: len(way)] = way
    return found
