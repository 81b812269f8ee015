"""Contact between the robot's bodies and things, by geometry alone, also between two steps."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.motion import Pose
from ...values.polygon import edge_normals, separation
from ..ocp.bodies import Body

_MOST = 32
"""Looks between two steps: enough for steps of sixteen body widths."""


@dataclass(frozen=True, eq=False)
class Touch:
    """How deep the bodies are in things on the way to each step.

    Attributes
    ----------
    depth : (N,), m; 0 where nothing is touched.
    names : of the thing that each is about.
    """

    depth: Array
    names: tuple[str, ...]

    @staticmethod
    def none(steps: int) -> "Touch":
        """Nothing is touched."""
        return _nothing(steps)

    def deeper(self, other: "Touch") -> "Touch":
        """Return the deeper of two contacts at each step."""
        if other is self or not (more := other.depth > self.depth).any():
            return self
        pairs = zip(self.names, other.names, more, strict=True)
        names = tuple(second if deep else first for first, second, deep in pairs)
        return Touch(np.where(more, other.depth, self.depth), names)


@lru_cache(maxsize=16)
def _nothing(steps: int) -> Touch:
    """Return the same contact for the same number of steps: most plans touch nothing."""
    depth = np.zeros(steps)
    depth.setflags(write=False)
    return Touch(depth, ("",) * steps)


@dataclass(frozen=True, eq=False)
class BodyPath:
    """Corners of a body at several looks between each two steps.

    The way between two steps is looked at in pieces of at most half a body's width, in which the
    pose changes linearly, so that nothing is thin enough to be passed unseen.

    A plan that keeps every constraint at its steps may cut a corner between two of them: a body
    of half-width h that moves L does so by up to h - sqrt(h^2 - L^2 / 4), about L^2 / (8 h). That
    is what the planner's ``margin`` is for, and it does not count (at most h / 2 of it).

    Attributes
    ----------
    corners : (N, L, W, 2), m, the last look at the step itself.
    share : (L,), of the step that each look stands for.
    cut : (N,), m, by how much the body may cut a corner.
    """

    corners: Array
    share: Array
    cut: Array

    @classmethod
    def of(cls, robot: Robot, body: Body, states: Array) -> "BodyPath":
        """Look at a body on its way along states (N + 1, n)."""
        pose = robot.pose(tuple(states.T))
        place = pose.points()
        length = np.linalg.norm(np.diff(place, axis=0), axis=1)
        half = _half_width(body)
        cut = half - np.sqrt(np.maximum(half**2 - 0.25 * length**2, 0.25 * half**2))
        looks = int(np.clip(np.ceil(float(length.max()) / half), 1, _MOST))
        share = np.arange(1, looks + 1) / looks
        return cls(body.at(_between(pose, place, share)).corner_points(), share, cut)


def apart(body: Body, pose: Pose, places: Array) -> Array:
    """Distance of a body's centre or corners from places at K poses, (K, O), m.

    ``places`` are (K, O, D) or (1, O, D), m. A body with corners has distance 0 or less from what
    is inside.
    """
    at = body.at(pose)
    if body.outline:
        return np.asarray(separation(at.corner_points()[:, None], places[:, :, None])[0])
    away = [places[..., k] - place[:, None] for k, place in enumerate(at.position)]
    return np.asarray(np.sqrt(sum(one * one for one in away)))


def along(values: Array, share: Array) -> Array:
    """Interpolate values (N + 1,) at each look on the way to a step, (N, L)."""
    return np.asarray(values[:-1, None] + share * np.diff(values)[:, None])


def _half_width(body: Body) -> float:
    """Half of the least width of a body, m."""
    if not body.outline:
        return body.radius
    corners = np.asarray(body.outline)
    heights = corners @ edge_normals(corners).T
    return 0.5 * float(np.ptp(heights, axis=0).min())


def _between(pose: Pose, place: Array, share: Array) -> Pose:
    """Poses on the way to each step, its end among them, (N, L)."""
    heading = None if pose.heading is None else along(np.asarray(pose.heading), share)
    return Pose(tuple(along(column, share) for column in place.T), heading)
