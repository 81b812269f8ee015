"""The control law behind the graceful controller: an egocentric feedback on pose.

Numba compiles these functions, see `graceful`. Then they equal Nav2's within rounding; called as
they are, an arc tangent in single precision differs by its last bit.
"""

from math import atan, atan2, cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np


class LawParameters(NamedTuple):
    """Gains and limits of the law, by Nav2's names; rad, m, s."""

    k_phi: float
    k_delta: float
    beta: float
    exponent: float
    slowdown_radius: float
    deceleration_max: float
    v_linear_min: float
    v_linear_max: float
    v_angular_max: float


Pose = tuple[float, float, float]
"""x, y, m, and yaw, rad."""


def wound(angle: float) -> float:
    """Return an angle in (-pi, pi], as `poses.normalized`, here for Numba."""
    rest: float = np.fmod(angle + pi, 2.0 * pi)
    if rest <= 0.0:
        return rest + pi
    return rest - pi


def egocentric(target: Pose, current: Pose, backward: bool) -> tuple[float, float, float]:
    """Return r (m), phi and delta (rad): how far the target is, and both headings to that line.

    All are rounded to single precision, as in Nav2.
    """
    dx, dy = np.float32(target[0] - current[0]), np.float32(target[1] - current[1])
    sight = np.float32(atan2(-dy, dx))
    if backward:
        sight = np.float32(np.float64(sight) + pi)
    r = np.float32(sqrt(np.float32(np.float32(dx * dx) + np.float32(dy * dy))))
    phi = np.float32(wound(target[2] + np.float64(sight)))
    delta = np.float32(wound(current[2] + np.float64(sight)))
    return np.float64(r), np.float64(phi), np.float64(delta)


def regular_velocity(
    law: LawParameters, target: Pose, current: Pose, backward: bool
) -> tuple[float, float]:
    """Return the speed and yaw rate towards a pose, m/s and rad/s.

        kappa = -1/r (k_delta (delta - atan(-k_phi phi))
                      + (1 + k_phi / (1 + (k_phi phi)^2)) sin delta)
        v = v_max / (1 + beta |kappa|^lambda),    omega = kappa v

    v is less near the target, and follows from omega where that reaches its limit.
    """
    r, phi, delta = egocentric(target, current, backward)
    turn = law.k_delta * (delta - atan(-law.k_phi * phi))
    bend = (1.0 + law.k_phi / (1.0 + (law.k_phi * phi) * (law.k_phi * phi))) * sin(delta)
    kappa = -1.0 / r * (turn + bend)
    if backward:
        kappa = -kappa
    v = law.v_linear_max / (1.0 + law.beta * abs(kappa) ** law.exponent)
    v = min(law.v_linear_max * (r / law.slowdown_radius), v)
    v = min(sqrt(2.0 * r * law.deceleration_max), v)
    v = min(max(v, law.v_linear_min), law.v_linear_max)
    if backward:
        v = -v
    w = min(max(kappa * v, -law.v_angular_max), law.v_angular_max)
    if kappa != 0.0:
        v = w / kappa
    return v, w


def next_pose(
    law: LawParameters, period: float, target: Pose, current: Pose, backward: bool
) -> Pose:
    """Return the pose after a period (s) at the velocity of the law, along the old yaw."""
    v, w = regular_velocity(law, target, current, backward)
    x, y, yaw = current
    return (x + v * period * cos(yaw), y + v * period * sin(yaw), yaw + w * period)
