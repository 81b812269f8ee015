"""Whether a robot that keeps its velocity runs into something, as pure pursuits of Nav2 ask."""

from math import cos, hypot, inf, pi, sin

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.costmap import LETHAL, NO_INFORMATION
from .local_controller import Tick

_SLOW, _TURNING = 0.01, 0.01
"""m/s and rad/s: a robot slower than the one and quicker than the other turns on the spot."""
_TURN = 2.0 * pi
"""rad: after a whole turn the poses come again."""


def in_collision(tick: Tick, pose: Array) -> bool:
    """Tell whether the robot's outline meets an obstacle at a pose (3,); off the map it does not.

    Unknown cells are obstacles unless the costmap tracks them.
    """
    if not tick.costmap.inside(pose[:2]):
        return False
    cost = tick.footprint.cost(tick.costmap, pose)
    if cost == NO_INFORMATION and tick.track_unknown:
        return False
    return cost >= LETHAL


def collision_arc(
    tick: Tick, speed: float, turning: float, time: float, reach: float
) -> tuple[Array, bool]:
    """Follow an arc at steps of about a cell until it hits something or ends.

    It ends after a whole turn, too: the original goes round until the time is over, at the same
    poses but for a part of a step.

    Parameters
    ----------
    tick : where the robot is, and its costmap.
    speed, turning : m/s and rad/s.
    time : s, after which it ends.
    reach : m, distance from the robot beyond which it ends.

    Returns
    -------
    poses : (T, 3), those that were tried; the first is the robot's own.
    hit : whether the last of them is in collision.
    """
    step = _step_time(tick, speed, turning)
    x, y, yaw = (float(value) for value in tick.pose)
    tried = [tick.pose]
    if in_collision(tick, tick.pose):
        return np.array(tried), True
    count = 1
    while count * step < time and (count - 1) * step * abs(turning) <= _TURN:
        count += 1
        x, y = x + step * (speed * cos(yaw)), y + step * (speed * sin(yaw))
        yaw += step * turning
        if hypot(x - tick.pose[0], y - tick.pose[1]) > reach:
            break
        tried.append(np.array([x, y, yaw]))
        if in_collision(tick, tried[-1]):
            return np.array(tried), True
    return np.array(tried), False


def _step_time(tick: Tick, speed: float, turning: float) -> float:
    """Time in which the robot moves by about a cell, s."""
    resolution = tick.costmap.resolution
    if abs(speed) < _SLOW and abs(turning) > _TURNING:
        half = 0.5 * resolution / tick.footprint.circumscribed
        return 2.0 * sin(half) / abs(turning)
    return resolution / abs(speed) if speed else inf
