"""Differential drive: wheel speeds as states, wheel accelerations as inputs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.clipping import between, within
from ..framework.robot import Bounds, Quantity, Robot, checked_limits, least_speed
from ..framework.values.arrays import Scalar
from ..framework.values.footprint import Footprint
from ..framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class DifferentialDrive(Robot):
    """Two driven wheels on one axle of length b (``track_width``).

    State (x, y, phi, l, r), input (l', r'); l and r are the speeds of the wheels' rims over
    ground, m/s (wheel rate times wheel radius, so that the radius need not be known)::

        v = (r + l) / 2              omega = (r - l) / b
        x' = v cos(phi)    y' = v sin(phi)    phi' = omega

    The wheel limits are boxes on l, r, l' and r'. They couple v and omega: at full speed
    straight on, turning is only possible by slowing the inner wheel. The body limits
    |v| <= max_speed and so on are `constraints`: a wheel may turn backwards where the body may
    not drive backwards.

    Parameters
    ----------
    radius : m, of the disc that encloses the robot.
    track_width : m, between the wheels.
    max_wheel_speed, max_wheel_acceleration : m/s, m/s^2, at the rim.
    max_speed, max_yaw_rate, max_acceleration, max_yaw_acceleration : m/s, rad/s, m/s^2,
        rad/s^2, of the body.
    footprint : several discs or a convex outline, within ``radius``; None for the disc itself.
    max_reverse_speed : m/s, -v at most, of the body; 0 never backwards, None as fast as forwards.

    Raises
    ------
    WideberthError : a parameter that is not above 0, or a speed backwards beyond ``max_speed``.

    Notes
    -----
    With the defaults the wheels just reach every corner of the paper's box of v and omega
    (0.7 + 0.3 * 1.0 / 2 = 0.85 m/s) and of its accelerations (0.7 + 0.1 / 2 = 0.75
    m/s^2), so that the robot can do what the paper's unicycle can, and nothing more.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("phi", "rad"),
        Quantity("left", "m/s"),
        Quantity("right", "m/s"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (
        Quantity("left_acceleration", "m/s^2"),
        Quantity("right_acceleration", "m/s^2"),
    )

    radius: float = 0.75
    track_width: float = 1.0
    max_wheel_speed: float = 0.85
    max_wheel_acceleration: float = 0.75
    max_speed: float = 0.7
    max_yaw_rate: float = 0.3
    max_acceleration: float = 0.7
    max_yaw_acceleration: float = 0.1
    footprint: Footprint | None = None
    max_reverse_speed: float | None = None

    def __post_init__(self) -> None:
        checked_limits("differential_drive", self)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        v, omega = self._body(state[3], state[4])
        phi = state[2]
        return v * np.cos(phi), v * np.sin(phi), omega, control[0], control[1]

    def state_bounds(self) -> Bounds:
        """Position and heading are free; the wheel speeds are limited."""
        return Bounds.symmetric(np.inf, np.inf, np.inf, self.max_wheel_speed, self.max_wheel_speed)

    def input_bounds(self) -> Bounds:
        """Limits of the wheel accelerations."""
        return Bounds.symmetric(self.max_wheel_acceleration, self.max_wheel_acceleration)

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Limits of the body: speed, yaw rate and their rates, each from both sides."""
        v, omega = self._body(state[3], state[4])
        a, alpha = self._body(control[0], control[1])
        sides = (
            (v, -self._least, self.max_speed),
            (omega, self.max_yaw_rate, self.max_yaw_rate),
            (a, self.max_acceleration, self.max_acceleration),
            (alpha, self.max_yaw_acceleration, self.max_yaw_acceleration),
        )
        return tuple(
            limit + sign * value
            for value, below, above in sides
            for sign, limit in ((-1.0, above), (1.0, below))
        )

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position of the axle's middle, and heading."""
        return Pose((state[0], state[1]), state[2])

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward speed and yaw rate of the axle's middle."""
        v, omega = self._body(state[3], state[4])
        return Twist((v, 0.0), omega)

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward and yaw acceleration."""
        a, alpha = self._body(control[0], control[1])
        return Twist((a, 0.0), alpha)

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this pose with this twist; a lateral speed is dropped."""
        return (*pose.position, pose.heading, *self._wheels(twist.linear[0], twist.angular))

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Bring v and omega to the wanted twist, each as fast as the limits allow.

        A twist that the wheels cannot reach is scaled down, which keeps its curvature.
        Where moving v and omega independently would break a wheel limit on the way, both
        change in proportion: a straight line between two points of a convex set.
        """
        v, omega = self._body(state[3], state[4])
        wanted_v = between(twist.linear[0], self._least, self.max_speed)
        wanted_omega = within(twist.angular, self.max_yaw_rate)
        fastest = max(abs(w) for w in self._wheels(wanted_v, wanted_omega))
        scale = min(1.0, self.max_wheel_speed / fastest) if fastest else 1.0
        a = (scale * wanted_v - v) / duration
        alpha = (scale * wanted_omega - omega) / duration
        limited = (
            within(a, self.max_acceleration),
            within(alpha, self.max_yaw_acceleration),
        )
        wheels = self._wheels(*limited)
        if self._allowed(state, wheels, duration):
            return wheels
        ratios = (
            (abs(a), self.max_acceleration),
            (abs(alpha), self.max_yaw_acceleration),
            *((abs(w), self.max_wheel_acceleration) for w in self._wheels(a, alpha)),
        )
        share = min(1.0, *(limit / value for value, limit in ratios if value > limit), 1.0)
        return self._wheels(share * a, share * alpha)

    @property
    def _least(self) -> float:
        return least_speed(self.max_speed, self.max_reverse_speed)

    def _allowed(self, state: Sequence[float], wheels: tuple[float, ...], duration: float) -> bool:
        after = (state[3] + duration * wheels[0], state[4] + duration * wheels[1])
        return max(map(abs, wheels)) <= self.max_wheel_acceleration * (1 + 1e-12) and max(
            map(abs, after)
        ) <= self.max_wheel_speed * (1 + 1e-12)

    def _body(self, left: Scalar, right: Scalar) -> tuple[Scalar, Scalar]:
        return 0.5 * (left + right), (right - left) / self.track_width

    def _wheels(self, v: Scalar, omega: Scalar) -> tuple[Scalar, Scalar]:
        half = 0.5 * self.track_width * omega
        return v - half, v + half
