"""The bodies that stand for a robot before a region, and the auxiliaries that suit them."""

from dataclasses import dataclass, replace

import numpy as np

from ...region import Auxiliary, Polygonal, Region
from ...robot import Robot
from ...static_region import StaticRegion
from ...values.arrays import Array
from ...values.footprint import Discs, Outline, Place
from ...values.motion import Pose
from .problem import Parameters
from .transcription import Guess


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


def bodies(robot: Robot, region: Region | StaticRegion) -> tuple[Body, ...]:
    """Bodies that a region has to keep out of for this robot, all of one radius.

    Each disc of a robot of discs; the outline of a polygonal robot where the region knows
    corners; else the disc that encloses the robot.
    """
    footprint = robot.footprint
    if isinstance(footprint, Discs):
        return tuple(Body(footprint.radius, place) for place in footprint.centres)
    if isinstance(footprint, Outline) and isinstance(region, Polygonal | StaticRegion):
        return (Body(0.0, outline=footprint.vertices),)
    return (Body(robot.radius),)


def repeated(auxiliary: Auxiliary, times: int) -> Auxiliary:
    """Return the extra variables of several bodies, one after the other."""
    return Auxiliary(
        auxiliary.lower * times,
        auxiliary.upper * times,
        auxiliary.start * times,
        auxiliary.regularisation,
    )


def with_auxiliaries(
    robot: Robot,
    region: Region,
    parameters: Parameters,
    guess: Guess,
    static_region: StaticRegion | None = None,
) -> Guess:
    """Fill in the auxiliaries that suit the guess's poses best."""
    level = parameters.level
    if not np.isnan(guess.level):
        level = np.full_like(level, guess.level)
    pose = robot.pose(tuple(guess.states[1:, None].T))  # (1, N): every slot sees each step
    pose = Pose(
        tuple(entry.T for entry in pose.position), None if pose.heading is None else pose.heading.T
    )
    steps, slots = level.shape
    moving = still = np.zeros((steps, 0, 0))
    if slots:
        found = [
            region.auxiliary_start(_spread(one.at(pose), slots), parameters.regions, level)
            for one in bodies(robot, region)
        ]
        moving = np.concatenate(found, axis=-1)
    walls = parameters.statics.shape[1]
    if static_region is not None and walls:
        starts = [
            static_region.auxiliary_start(_spread(one.at(pose), walls), parameters.statics)
            for one in bodies(robot, static_region)
        ]
        still = np.concatenate(starts, axis=-1)
    return replace(guess, auxiliaries=np.array(moving), static_auxiliaries=np.array(still))


def _spread(pose: Pose, slots: int) -> Pose:
    """Repeat poses (N, 1) for each slot, (N, K)."""
    shape = (len(pose.position[0]), slots)
    place: tuple[Array, ...] = tuple(np.broadcast_to(entry, shape) for entry in pose.position)
    heading = None if pose.heading is None else np.broadcast_to(pose.heading, shape)
    return Pose(place, heading, pose.outline)
