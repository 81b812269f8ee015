"""Angles, poses and plans as Nav2 computes with them. A pose is x, y (m) and yaw (rad)."""

from math import cos, fmod, hypot, pi, sin

import numpy as np

from ...framework.values.arrays import Array


def normalized(angle: float) -> float:
    """Return an angle in (-pi, pi], rad."""
    rest = fmod(angle + pi, 2.0 * pi)
    return rest + pi if rest <= 0.0 else rest - pi


def normalized_positive(angle: float) -> float:
    """Return an angle in [0, 2 pi), rad."""
    return fmod(fmod(angle, 2.0 * pi) + 2.0 * pi, 2.0 * pi)


def shortest_angle(begin: float, end: float) -> float:
    """Return the shortest turn from one angle to another, in (-pi, pi], rad."""
    return normalized(end - begin)


def in_base_frame(poses: Array, pose: Array) -> Array:
    """Return poses (N, 3) as seen from the robot's own pose (3,)."""
    x, y, yaw = (float(value) for value in pose)
    dx, dy = poses[:, 0] - x, poses[:, 1] - y
    cosine, sine = cos(yaw), sin(yaw)
    seen = np.empty((len(poses), 3))
    seen[:, 0] = cosine * dx + sine * dy
    seen[:, 1] = cosine * dy - sine * dx
    seen[:, 2] = poses[:, 2] - yaw
    return seen


def lengths(poses: Array) -> Array:
    """Return the lengths of the N - 1 steps of a plan (N, 3), m."""
    return np.hypot(np.diff(poses[:, 0]), np.diff(poses[:, 1]))


def length(poses: Array) -> float:
    """Return the length of a plan (N, 3), m: its steps added up in order."""
    total = 0.0
    for step in lengths(poses).tolist():
        total += step
    return total


def distance(first: Array, second: Array) -> float:
    """Return the distance of two poses or points in the plane, m."""
    return hypot(float(first[0] - second[0]), float(first[1] - second[1]))
