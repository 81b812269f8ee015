"""Angles, poses and plans as Nav2 computes with them. A pose is x, y (m) and yaw (rad)."""

from math import atan2, cos, fmod, hypot, pi, sin, sqrt

import numpy as np

from wideberth.framework.values.arrays import Array


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
    seen[:, 2] = wrapped(poses[:, 2] - yaw)
    return seen


def wrapped(angles: Array) -> Array:
    """Return angles in (-pi, pi], rad; those that lie there stay as they are, bit by bit."""
    return np.where(np.abs(angles) <= pi, angles, np.arctan2(np.sin(angles), np.cos(angles)))


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


def look_ahead(poses: Array, reach: float, beyond: bool = False) -> tuple[Array, float]:
    """Return the point of a plan (N, 3) at an arc length from its first pose.

    Parameters
    ----------
    poses : (N, 3), N >= 1.
    reach : m.
    beyond : go on straight past the end of a plan that is too short; else its last pose is it.

    Returns
    -------
    point : (3,), the yaw is that of its step; of the last pose, its own.
    arc : m, its arc length.
    """
    passed = 0.0
    for i, step in enumerate(lengths(poses).tolist(), start=1):
        if passed + step >= reach:
            return _along(poses[i - 1], poses[i], poses[i - 1], reach - passed), reach
        passed += step
    if beyond and len(poses) > 1:
        return _along(poses[-2], poses[-1], poses[-1], reach - passed), reach
    return poses[-1].copy(), passed


def _along(begin: Array, end: Array, start: Array, reach: float) -> Array:
    """Return the pose ``reach`` (m) from ``start`` in the direction of a step."""
    yaw = atan2(float(end[1] - begin[1]), float(end[0] - begin[0]))
    return np.array([start[0] + reach * cos(yaw), start[1] + reach * sin(yaw), yaw])


def rotation_rate(
    angle: float, turning: float, fastest: float, accel: float, period: float
) -> float:
    """Return the yaw rate of a turn on the spot that can stop in time, rad/s.

    Parameters
    ----------
    angle : rad, to turn by.
    turning : rad/s, present yaw rate.
    fastest : rad/s.
    accel : rad/s^2.
    period : s, until the next command.
    """
    sign = 1.0 if angle > 0.0 else -1.0
    change = accel * period
    found = min(max(sign * fastest, turning - change), turning + change)
    stopping = sqrt(2.0 * accel * abs(angle))
    return sign * stopping if abs(found) > stopping else found
