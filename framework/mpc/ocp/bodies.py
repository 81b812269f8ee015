"""The bodies that stand for a robot, and the paths that they sweep between steps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...region import Auxiliary
from ...robot import Robot
from ...values.arrays import Array
from ...values.footprint import Discs, Outline, Place
from ...values.motion import Pose
from ...values.polygon import edge_normals, separation

MOST_LOOKS = 32
"""Looks between two steps: enough for steps of sixteen body widths."""


@dataclass(frozen=True)
class Body:
    """A disc, or a polygon, that moves with the robot.

    Attributes
    ----------
    radius : m, of a disc; 0 for a polygon.
    centre : of the disc in the robot's frame, m.
    outline : corners of the polygon in the robot's frame, m; () for a disc.
    """

    radius: float
    centre: Place = (0.0, 0.0)
    outline: tuple[Place, ...] = ()

    def at(self, pose: Pose) -> Pose:
        """Pose of the body where the robot is at ``pose``."""
        return Pose(pose.offset(self.centre), pose.heading, self.outline)


def bodies(robot: Robot) -> tuple[Body, ...]:
    """Bodies of a robot, all of one radius: discs, its outline, or the disc around it."""
    if isinstance(robot.footprint, Outline):
        return (Body(0.0, outline=robot.footprint.vertices),)
    return discs(robot)


def discs(robot: Robot) -> tuple[Body, ...]:
    """Bodies without corners: each disc of a robot of discs, else the disc that encloses it."""
    if isinstance(robot.footprint, Discs):
        return tuple(Body(robot.footprint.radius, place) for place in robot.footprint.centres)
    return (Body(robot.radius),)


def repeated(auxiliary: Auxiliary, times: int) -> Auxiliary:
    """Return the extra variables of several bodies, one after the other."""
    return Auxiliary(
        auxiliary.lower * times,
        auxiliary.upper * times,
        auxiliary.start * times,
        auxiliary.regularisation,
    )


def body_starts(
    parts: Sequence[Body], pose: Pose, count: int, start: Callable[[Pose], Array]
) -> Array:
    """Return starting values of the auxiliaries of ``count`` slots, body by body, (N, K, A).

    Parameters
    ----------
    parts : bodies of the robot.
    pose : of the robot at each step, (N, 1).
    count : K.
    start : poses (N, K) of one body -> its auxiliaries (N, K, a).
    """
    return np.concatenate([start(_spread(one.at(pose), count)) for one in parts], axis=-1)


def _spread(pose: Pose, slots: int) -> Pose:
    """Repeat poses (N, 1) for each slot, (N, K)."""
    shape = (len(pose.position[0]), slots)
    place: tuple[Array, ...] = tuple(np.broadcast_to(entry, shape) for entry in pose.position)
    heading = None if pose.heading is None else np.broadcast_to(pose.heading, shape)
    return Pose(place, heading, pose.outline)


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
        looks = int(np.clip(np.ceil(float(length.max()) / half), 1, MOST_LOOKS))
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
