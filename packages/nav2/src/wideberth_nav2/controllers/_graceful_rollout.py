"""What the graceful controller simulates, written for Numba.

Poses are in the robot's frame. `rolled_out` follows the control law to a target, after a turn on
the spot if need be, and looks at each pose whether it hits something.
"""

from math import atan2, cos, hypot, sin
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array

from ..costmap.footprint import outline_cost
from ..costs import INSCRIBED, LETHAL, NO_INFORMATION
from .smooth_control_law import LawParameters, Pose, next_pose, regular_velocity, wound

Number = TypeVar("Number", float, Array)


class Ground(NamedTuple):
    """A costmap, where the robot stands on it, and what it covers."""

    cells: NDArray[np.uint8]
    left: float
    low: float
    resolution: float
    pose: Pose
    vertices: Array
    use_radius: bool
    track_unknown: bool


class Turning(NamedTuple):
    """How it turns on the spot: gain, rad/s at most in the gain, rad/s at least, rad tolerance."""

    factor: float
    most: float
    least: float
    tolerance: float


class RolloutGrowth(NamedTuple):
    """How the outline grows with the speed: from which one (m/s), how much, at which one (m/s)."""

    begin: float
    factor: float
    fastest: float


def cell_cost(ground: Ground, x: float, y: float) -> int:
    """Return the cost at a point of the costmap's frame; -1 off the map."""
    if not (x >= ground.left and y >= ground.low):
        return -1
    mx = int((x - ground.left) / ground.resolution)
    my = int((y - ground.low) / ground.resolution)
    high, wide = ground.cells.shape
    return int(ground.cells[my, mx]) if mx < wide and my < high else -1


def placed(ground: Ground, pose: tuple[Number, Number, Number]) -> tuple[Number, Number, Number]:
    """Return a pose of the robot's frame, or many, in that of the costmap."""
    x, y, yaw = ground.pose
    cosine, sine = cos(yaw), sin(yaw)
    return (
        x + cosine * pose[0] - sine * pose[1],
        y + sine * pose[0] + cosine * pose[1],
        yaw + pose[2],
    )


def hits(ground: Ground, pose: Pose, scale: float) -> bool:
    """Return whether the robot at a pose of its own frame hits something; not off the map.

    A round robot is judged by the cost at its centre, another by its outline times ``scale``; a
    triangle does not grow.
    """
    x, y, yaw = placed(ground, pose)
    cost = cell_cost(ground, x, y)
    if cost < 0:
        return False
    if not ground.use_radius:
        outline = ground.vertices * (scale if len(ground.vertices) > 3 else 1.0)
        cost = outline_cost(
            ground.cells, ground.left, ground.low, ground.resolution, outline, x, y, yaw
        )  # fmt: skip
    if cost == NO_INFORMATION:
        return not ground.track_unknown
    return cost == LETHAL or (cost == INSCRIBED and ground.use_radius)


def turning_rate(turning: Turning, angle: float) -> float:
    """Yaw rate of a turn by an angle on the spot, rad/s; it has no upper bound."""
    wanted = turning.factor * angle * turning.most
    size = max(abs(wanted), turning.least)
    return size if np.copysign(1.0, wanted) > 0.0 else -size


def rolled_out(
    ground: Ground, law: LawParameters, turning: Turning, growth: RolloutGrowth, target: Pose,
    backward: bool, turn_first: bool, tested: bool,
) -> tuple[bool, Array, float, float]:  # fmt: skip
    """Follow the law to a target.

    Parameters
    ----------
    ground, law, turning, growth, target : see the classes.
    backward : drive backwards.
    turn_first : turn towards the target on the spot.
    tested : look for collisions.

    Returns
    -------
    free : whether it hits nothing.
    poses : (T, 3), the last one is where it hits, if so.
    v, w : first velocity, m/s and rad/s.
    """
    period = ground.resolution / growth.fastest
    most = max(int(3.0 * hypot(target[0], target[1]) / ground.resolution), 1)
    poses = np.empty((most, 3))
    bearing, pose = atan2(target[1], target[0]), (0.0, 0.0, 0.0)
    v, w, free, count = 0.0, 0.0, True, 0
    while count < most:
        if turn_first:
            off = bearing - pose[2]
            if count == 0:
                w = turning_rate(turning, off)
            turn_first = not abs(off) < turning.tolerance
            pose = (pose[0], pose[1], pose[2] + w * period)
        else:
            if count == 0:
                v, w = regular_velocity(law, target, pose, backward)
            pose = next_pose(law, period, target, pose, backward)
        pose = (pose[0], pose[1], wound(pose[2]))
        poses[count, 0], poses[count, 1], poses[count, 2] = pose
        count += 1
        if tested:
            scale = 1.0
            if v > growth.begin:
                scale += growth.factor * (v - growth.begin) / (growth.fastest - growth.begin)
            if hits(ground, pose, scale):
                free = False
                break
        if not hypot(target[0] - pose[0], target[1] - pose[1]) > ground.resolution:
            break
    return free, poses[:count], v, w


def highest_cost(ground: Ground, poses: Array) -> int:
    """Return the highest cost at the places of poses (T, 3); 0 off the map."""
    highest = 0
    for i in range(len(poses)):
        x, y, _ = placed(ground, (poses[i, 0], poses[i, 1], poses[i, 2]))
        highest = max(highest, cell_cost(ground, x, y))
    return highest


def duration(law: LawParameters, target: Pose, backward: bool, poses: Array) -> float:
    """Return how long the trajectory along poses (T, 3) takes at the velocities of the law, s."""
    total = 0.0
    for i in range(1, len(poses)):
        before = (poses[i - 1, 0], poses[i - 1, 1], poses[i - 1, 2])
        step = hypot(poses[i, 0] - before[0], poses[i, 1] - before[1])
        v, _ = regular_velocity(law, target, before, backward)
        total += step / max(abs(v), 1e-3)
    return total
