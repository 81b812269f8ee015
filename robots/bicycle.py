"""Kinematic bicycle: steering angle and steering rate are limited."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, pi
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.clipping import between, within
from ..framework.robot import Bounds, Quantity, Robot, checked_limits, least_speed
from ..framework.values.arrays import Scalar
from ..framework.values.errors import WideberthError
from ..framework.values.footprint import Footprint
from ..framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class Bicycle(Robot):
    """Car-like robot, seen from the middle of its rear axle.

    State (x, y, phi, v, delta), input (a, rate), with the wheelbase L::

        x' = v cos(phi)    y' = v sin(phi)    phi' = omega = v tan(delta) / L
        v' = a             delta' = rate
        omega' = (a tan(delta) + v (1 + tan(delta)^2) rate) / L

    Parameters
    ----------
    radius : m, of the disc around the rear axle's middle that encloses the robot.
    wheelbase : m.
    max_speed : m/s, |v|.
    max_steering : rad, |delta|, below pi/2.
    max_acceleration : m/s^2, |a|.
    max_steering_rate : rad/s, |rate|.
    footprint : several discs or a convex outline, within ``radius``; None for the disc itself.
    max_reverse_speed : m/s, -v at most; 0 never backwards, None as fast as forwards.

    Raises
    ------
    WideberthError : a parameter that is not above 0, a speed backwards beyond ``max_speed``, or
        max_steering of pi/2 or more.

    Notes
    -----
    The paper has no such robot. With the defaults |omega| stays below 0.7 tan(0.4) = 0.296
    rad/s, about the paper's 0.3; unlike its robots this one cannot turn on the spot.

    References
    ----------
    R. Rajamani, Vehicle Dynamics and Control (2012), section 2.2, with the reference point on the
    rear axle (slip angle zero).
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("phi", "rad"),
        Quantity("v", "m/s"),
        Quantity("delta", "rad"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (
        Quantity("a", "m/s^2"),
        Quantity("steering_rate", "rad/s"),
    )
    reference: ClassVar[str] = "rajamani2012vehicle"

    radius: float = 0.75
    wheelbase: float = 1.0
    max_speed: float = 0.7
    max_steering: float = 0.4
    max_acceleration: float = 0.7
    max_steering_rate: float = 0.3
    footprint: Footprint | None = None
    max_reverse_speed: float | None = None

    def __post_init__(self) -> None:
        checked_limits("bicycle", self)
        if self.max_steering >= 0.5 * pi:
            raise WideberthError(
                f"bicycle.max_steering is {self.max_steering:g} rad; wanted less than pi/2 "
                "(give radians, not degrees)"
            )

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        _, _, phi, v, delta = state
        omega = v * np.tan(delta) / self.wheelbase
        return v * np.cos(phi), v * np.sin(phi), omega, control[0], control[1]

    def state_bounds(self) -> Bounds:
        """Position and heading are free; speed and steering angle are limited."""
        symmetric = Bounds.symmetric(np.inf, np.inf, np.inf, self.max_speed, self.max_steering)
        return symmetric.with_lower(3, self._least)

    def input_bounds(self) -> Bounds:
        """Limits of acceleration and steering rate."""
        return Bounds.symmetric(self.max_acceleration, self.max_steering_rate)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position of the rear axle's middle, and heading."""
        return Pose((state[0], state[1]), state[2])

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward speed and yaw rate of the rear axle."""
        return Twist((state[3], 0.0), state[3] * np.tan(state[4]) / self.wheelbase)

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward and yaw acceleration."""
        slope = np.tan(state[4])
        alpha = control[0] * slope + state[3] * (1.0 + slope * slope) * control[1]
        return Twist((control[0], 0.0), alpha / self.wheelbase)

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this pose with this twist; standing, the wheels point straight on."""
        v = twist.linear[0]
        # atan(L omega / v) written so that v = 0 gives 0 rather than a division by it.
        delta = np.arctan2(self.wheelbase * twist.angular * np.sign(v), np.abs(v))
        return (*pose.position, pose.heading, v, delta)

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Bring speed and curvature to the wanted ones, each as fast as its limit allows.

        The curvature wanted is omega / v of the twist; a yaw rate without speed is beyond
        this robot, and leaves the steering where it is when asked for standing still.
        """
        v, omega = between(twist.linear[0], self._least, self.max_speed), twist.angular
        if v:  # atan(L omega / v), written so that a v next to 0 does not overflow
            delta = atan2(self.wheelbase * omega * copysign(1.0, v), abs(v))
        elif omega:
            delta = copysign(self.max_steering, omega)
        else:
            delta = state[4]
        delta = within(delta, self.max_steering)
        return (
            within((v - state[3]) / duration, self.max_acceleration),
            within((delta - state[4]) / duration, self.max_steering_rate),
        )

    @property
    def _least(self) -> float:
        return least_speed(self.max_speed, self.max_reverse_speed)
