"""Bands that pass the obstacles at other sides: TEB's homotopy classes, and which is driven."""

from dataclasses import dataclass
from math import atan2, hypot, inf
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array

from . import _teb_signature as kernel
from ._teb_kernel import wrapped
from .teb_band import Band, TebParameters
from .teb_edges import Optimum, Pull, TebObstacles, optimised


@final
@dataclass(eq=False)
class BandCandidate:
    """One band among several; it changes from tick to tick.

    Attributes
    ----------
    band : the trajectory.
    signature : (M,), at which side it passes each obstacle; see `signature_of`.
    optimum : of its last optimisation; None before the first.
    """

    band: Band
    signature: Array
    optimum: Optimum | None = None

    def cost(self, settings: TebParameters) -> float:
        """Return what candidates are compared by: nearness of obstacles counts more, here."""
        if self.optimum is None:
            return inf
        extra = settings.selection_obst_cost_scale - 1.0
        return self.optimum.cost + extra * self.optimum.obstacle_cost


@final
class BandCandidates:
    """The bands that compete: of each class one.

    Attributes
    ----------
    bands : at most `max_number_classes`; the best of the last tick first.
    best : the one that is driven; None without any.
    """

    def __init__(self) -> None:
        self.bands: list[BandCandidate] = []
        self.best: BandCandidate | None = None
        self._last: BandCandidate | None = None
        self._wanted = np.zeros(0)

    def update(
        self, plan: Array, pull: Pull, settings: TebParameters, reached: float,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        """Go on from the last tick's bands, look for others, optimise all, and choose one.

        Parameters
        ----------
        plan : (N, 3), from the robot's pose to the local goal.
        pull : what the bands are drawn by.
        reached : m; so near a goal no other classes are looked for.
        rng : draws the vertices of the graph.
        """
        start, goal = plan[0], plan[-1]
        self._renew(start, goal, pull.obstacles, settings)
        self._drop_detours(settings)
        first = Band.from_plan(plan, settings)
        self._wanted = signature_of(first, pull.obstacles, settings)
        self._add(BandCandidate(first, self._wanted), settings)
        if _apart(start, goal) >= reached and len(pull.obstacles.places):
            self._explore(start, goal, pull.obstacles, settings, rng)
        for one in self.bands:
            one.optimum = optimised(one.band, pull, settings)
            one.band = one.band if one.optimum is None else one.optimum.band
        self.bands = [one for one in self.bands if one.optimum is not None]
        self.choose(settings)

    def choose(self, settings: TebParameters) -> None:
        """Take the band of least cost; the last one and the plan's own have an advantage."""
        self._last = self.best if self.best in self.bands else None
        same = (one for one in self.bands if _alike(one.signature, self._wanted, settings))
        own, self.best, least = next(same, None), None, inf
        for one in self.bands:
            cost = one.cost(settings)
            if one is self._last:
                cost *= settings.selection_cost_hysteresis
            elif one is own:
                cost *= settings.selection_prefer_initial_plan
            if cost < least:
                self.best, least = one, cost

    def reject_best(self, settings: TebParameters) -> None:
        """Drop the best, which cannot be driven, for the next.

        Where it was the best of the last tick, too, there is no next one: to change the side at
        once would end in swaying.
        """
        dropped, again = self.best, self.best is self._last
        self.bands = [one for one in self.bands if one is not dropped]
        self.best = None
        if not again:
            self.choose(settings)

    def _renew(
        self, start: Array, goal: Array, obstacles: TebObstacles, settings: TebParameters
    ) -> None:
        """Move the bands to the new start and goal, and keep one of each class."""
        old = sorted(self.bands, key=lambda one: one is not self.best)
        self.bands = []
        if old and _apart(goal, old[0].band.poses[-1]) >= settings.force_reinit_new_goal_dist:
            old = []
        for one in old:
            one.band = one.band.moved(start, goal, settings)
            one.signature = signature_of(one.band, obstacles, settings)
            self._add(one, settings)
        if self.best not in self.bands:
            self.best = None

    def _add(self, candidate: BandCandidate, settings: TebParameters) -> None:
        """Add a band if its class is new and there is room."""
        room = len(self.bands) < settings.max_number_classes
        if (
            room
            and np.isfinite(candidate.signature).all()
            and not any(_alike(one.signature, candidate.signature, settings) for one in self.bands)
        ):
            self.bands.append(candidate)

    def _drop_detours(self, settings: TebParameters) -> None:
        """Drop bands that begin backwards or last much longer, compared with the best."""
        if len(self.bands) < 2 or self.best is None:
            return
        shortest = settings.length_start_orientation_vector
        ahead = _first_direction(self.best.band, shortest)
        if ahead is None:
            return
        longest = settings.max_ratio_detours_duration_best_duration * max(
            self.best.band.duration, 1.0
        )
        kept = []
        for one in self.bands:
            direction = _first_direction(one.band, shortest)
            if one is self.best or (
                direction is not None
                and abs(wrapped(direction - ahead)) <= settings.detours_orientation_tolerance
                and one.band.duration <= longest
            ):
                kept.append(one)
        self.bands = kept

    def _explore(
        self, start: Array, goal: Array, obstacles: TebObstacles, settings: TebParameters,
        rng: np.random.Generator,
    ) -> None:  # fmt: skip
        """Add a band for each path of a random graph whose class is new.

        The vertices lie in a box between start and goal, `roadmap_graph_area_width` wide.
        """
        most = settings.max_number_classes
        if len(self.bands) >= most:
            return
        step = goal[:2] - start[:2]
        length = hypot(*step)
        ahead = step / length
        drawn = rng.random((settings.roadmap_graph_samples, 2))
        along = drawn[:, 0] * length
        aside = (drawn[:, 1] - 0.5) * settings.roadmap_graph_area_width
        normal = np.array([-ahead[1], ahead[0]])
        inner = start[:2] + along[:, None] * ahead + aside[:, None] * normal
        vertices = np.concatenate([start[None, :2], inner, goal[None, :2]])
        _, _, connections, new_paths = kernel.compiled()
        joined = connections(
            vertices, ahead, settings.obstacle_heading_threshold, obstacles.places,
            obstacles.radii + settings.min_obstacle_dist,
        )  # fmt: skip
        known = np.zeros((most, len(obstacles.places)))
        for k, one in enumerate(self.bands):
            known[k] = one.signature
        begun = len(self.bands)
        paths, count = new_paths(
            vertices, joined, settings.max_vel_x, obstacles.places, obstacles.velocities,
            settings.include_dynamic_obstacles, settings.h_signature_threshold, known, begun,
        )  # fmt: skip
        for k in range(begun, count):
            corners = vertices[paths[k][paths[k] >= 0]]
            band = _band_along(corners, float(start[2]), float(goal[2]), settings)
            self.bands.append(BandCandidate(band, known[k]))


def signature_of(band: Band, obstacles: TebObstacles, settings: TebParameters) -> Array:
    """Return at which side a band passes each obstacle, (M,).

    With `include_dynamic_obstacles` it is the magnetic field of the obstacles' lines in x, y, t
    along the band (positive: the band turns to the left about it); else the angle, rad, that
    the band turns about each. The original takes for the latter the real and imaginary part of a
    sum over the obstacles, which separates the same classes.

    References
    ----------
    S. Bhattacharya, M. Likhachev, V. Kumar, Identification and representation of homotopy
    classes of trajectories for search-based path planning in 3D, Robotics: Science and Systems
    (2011).
    """
    times = np.concatenate([[0.0], np.cumsum(band.intervals)])
    points = np.column_stack([band.poses[:, :2], times])
    moving = settings.include_dynamic_obstacles
    signature: Array = kernel.compiled()[0](points, obstacles.places, obstacles.velocities, moving)
    return signature


def _alike(first: Array, second: Array, settings: TebParameters) -> bool:
    """Return whether bands of two signatures are of one class."""
    same = kernel.compiled()[1]
    moving, threshold = settings.include_dynamic_obstacles, settings.h_signature_threshold
    return bool(same(first, second, moving, threshold))


def _apart(first: Array, second: Array) -> float:
    return hypot(float(first[0] - second[0]), float(first[1] - second[1]))


def _first_direction(band: Band, length: float) -> float | None:
    """Return the direction to the first pose that is far enough away; None without one."""
    step = band.poses[:, :2] - band.poses[0, :2]
    far = np.flatnonzero(np.hypot(step[:, 0], step[:, 1]) > length)
    return atan2(step[far[0], 1], step[far[0], 0]) if len(far) else None


def _band_along(corners: Array, first: float, last: float, settings: TebParameters) -> Band:
    """Return the band along corners (K, 2) with the yaw of both ends; between, it faces ahead."""
    step = np.diff(corners, axis=0)
    yaws = np.append(np.arctan2(step[:, 1], step[:, 0]), last)
    yaws[0] = first
    return Band.from_plan(np.column_stack([corners, yaws]), settings)
