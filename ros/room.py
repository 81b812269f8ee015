"""Whether a robot has room to turn on the spot."""

import numpy as np

from ..framework.robot import Robot
from ..framework.tracking.stand_ins import sound
from ..framework.values.motion import Observation
from ..framework.values.polygon import separation


def beside_robot(robot: Robot, observation: Observation) -> str:
    """Say what reaches into the disc that a robot sweeps as it turns on the spot; "" if nothing.

    The disc has the robot's ``radius``, which holds its footprint in all headings. Obstacles are
    discs where they were seen, walls are exact.

    Parameters
    ----------
    robot : in the plane. observation : of the robot, and of what is around it.
    """
    place = np.array(robot.pose(tuple(observation.state)).position, dtype=np.float64)
    sighting = sound(observation, 2)
    if sighting.placeless:
        return f"{sighting.placeless[0]!r} is seen without a place"
    for one in sighting.detections:
        if np.linalg.norm(one.position - place) < robot.radius + one.radius:
            return f"{one.ident!r} is beside the robot"
    for wall in observation.polygons:
        away = np.maximum(wall.points.min(axis=0) - place, place - wall.points.max(axis=0))
        if (away < robot.radius).all():
            if any(separation(place[None], part)[0] < robot.radius for part in wall.parts):
                return f"{wall.name or 'a wall'} is beside the robot"
    return ""
