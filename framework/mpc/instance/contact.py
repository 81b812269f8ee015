"""What the bodies would touch, by geometry alone: also between steps, and all that is known."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...region import Region
from ...robot import Robot
from ...static_region import StaticRegion
from ...values.arrays import Array
from ...values.motion import Pose
from ...values.polygon import edge_normals, separation
from ..ocp.bodies import Body, bodies
from .obstacles import Obstacles
from .polygons import Walls

_MOST = 32
"""Looks between two steps: enough for steps of sixteen body widths."""


@dataclass(frozen=True, eq=False)
class Touch:
    """How deep the bodies are in polygons on the way to each step, see `Surroundings`.

    Attributes
    ----------
    depth : (N,), m; 0 where nothing is touched.
    names : of the polygon that each is about.
    """

    depth: Array
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """All that the robot could touch, whether or not the problem had room for it.

    The problem holds its constraints at the steps alone, against the nearest parts. Here the
    way between two steps is looked at in pieces of at most half a body's width, in which the
    pose changes linearly, so that no wall is thin enough to be passed unseen.

    A plan that keeps every constraint at its steps may cut a corner between two of them: a body
    of half-width h that moves L does so by up to h - sqrt(h^2 - L^2 / 4), about L^2 / (8 h). That
    is what the planner's ``margin`` is for, and it does not count here (at most h / 2 of it).

    Parameters
    ----------
    robot : whose bodies move.
    region, static_region : which bodies count before obstacles and before polygons.
    obstacles, walls : what is there.
    margin : m, kept from obstacles besides the radii.
    """

    robot: Robot
    region: Region
    static_region: StaticRegion | None
    obstacles: Obstacles
    walls: Walls
    margin: float

    def touched(self, states: Array) -> Touch:
        """Hold a plan's states (N + 1, n) against every polygon."""
        steps = len(states) - 1
        depth, names = np.zeros(steps), [""] * steps
        if not len(self.walls.known) or not np.isfinite(states).all():
            return Touch(depth, tuple(names))  # what is no number breaks the dynamics already
        pose = self.robot.pose(tuple(states.T))
        place = pose.points()
        near = self._near(place)
        length = np.linalg.norm(np.diff(place, axis=0), axis=1)
        for body in self._at_walls() if near.size else ():
            half = _half_width(body)
            cut = half - np.sqrt(np.maximum(half**2 - 0.25 * length**2, 0.25 * half**2))
            looked = _between(pose, place, half)
            corners = body.at(looked).corner_points()  # (N, L, W, 2)
            parts = self.walls.known[near]
            gaps = separation(corners[:, :, None], parts)[0].min(axis=1) - body.radius
            for i in np.flatnonzero(gaps.min(axis=1) < -np.maximum(depth, cut)):
                worst = int(gaps[i].argmin())
                depth[i], names[i] = -gaps[i, worst], self.walls.known_names[near[worst]]
        return Touch(depth, tuple(names))

    def overlap(self, states: Array) -> Array:
        """How deep the bodies are in the obstacles' discs around their means, (N,), m."""
        pose = self.robot.pose(tuple(states[1:].T))
        means = self.obstacles.mean
        depth = np.zeros(len(means))
        for body in bodies(self.robot, self.region) if means.shape[1] else ():
            room = body.radius + self.margin + self.obstacles.radius
            at = body.at(pose)
            if not body.outline:
                apart = np.linalg.norm(means - at.points()[:, None], axis=2)
            else:
                apart = separation(at.corner_points()[:, None], means[:, :, None])[0]
            depth = np.maximum(depth, (room - apart).max(axis=1))
        return depth

    def _at_walls(self) -> tuple[Body, ...]:
        if self.static_region is None:
            return (Body(self.robot.radius),)
        return bodies(self.robot, self.static_region)

    def _near(self, place: Array) -> NDArray[np.intp]:
        """Parts whose enclosing circle comes near the plan's, as indices."""
        middle = place.mean(axis=0)
        reach = np.linalg.norm(place - middle, axis=1).max() + self.robot.radius
        centre = self.walls.known.mean(axis=1)
        size = np.linalg.norm(self.walls.known - centre[:, None], axis=2).max(axis=1)
        return np.flatnonzero(np.linalg.norm(centre - middle, axis=1) < reach + size)


def _half_width(body: Body) -> float:
    """Half of the least width of a body, m."""
    if not body.outline:
        return body.radius
    corners = np.asarray(body.outline)
    heights = corners @ edge_normals(corners).T
    return 0.5 * float(np.ptp(heights, axis=0).min())


def _between(pose: Pose, place: Array, piece: float) -> Pose:
    """Poses on the way to each step, its end among them, (N, L)."""
    longest = float(np.linalg.norm(np.diff(place, axis=0), axis=1).max())
    looks = int(np.clip(np.ceil(longest / piece), 1, _MOST))
    share = np.arange(1, looks + 1) / looks

    def along(values: Array) -> Array:
        return np.asarray(values[:-1, None] + share * np.diff(values)[:, None])

    heading = None if pose.heading is None else along(np.asarray(pose.heading))
    return Pose(tuple(along(column) for column in place.T), heading)
