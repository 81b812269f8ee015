"""The bodies that stand for a robot before the things that it keeps clear of."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...region import Auxiliary
from ...robot import Robot
from ...values.arrays import Array
from ...values.footprint import Discs, Outline, Place
from ...values.motion import Pose


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
