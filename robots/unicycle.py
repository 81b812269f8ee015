"""The paper's robot: a unicycle driven by its two accelerations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.clipping import between, within
from ..framework.robot import Bounds, Quantity, SymbolicDrive, checked_limits, least_speed
from ..framework.values.arrays import Scalar
from ..framework.values.footprint import Footprint
from ..framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class Unicycle(SymbolicDrive):
    """Skid-steered robot seen as a unicycle.

    State (x, y, phi, v, omega), input (a, alpha)::

        x' = v cos(phi)    y' = v sin(phi)    phi' = omega    v' = a    omega' = alpha

    Parameters
    ----------
    radius : m, of the disc that encloses the robot.
    max_speed : m/s, |v|.
    max_yaw_rate : rad/s, |omega|.
    max_acceleration : m/s^2, |a|.
    max_yaw_acceleration : rad/s^2, |alpha|.
    footprint : several discs or a convex outline, within ``radius``; None for the disc itself.
    max_reverse_speed : m/s, -v at most; 0 never backwards, None as fast as forwards.

    Raises
    ------
    WideberthError : a parameter that is not above 0, or a speed backwards beyond ``max_speed``.

    Notes
    -----
    Limits and radius are the paper's (section IV; r + r_d = 2 r = 1.5 m in section V), and
    symmetric as there: the robot may drive backwards, unless ``max_reverse_speed`` is 0.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("phi", "rad"),
        Quantity("v", "m/s"),
        Quantity("omega", "rad/s"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (Quantity("a", "m/s^2"), Quantity("alpha", "rad/s^2"))
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    radius: float = 0.75
    max_speed: float = 0.7
    max_yaw_rate: float = 0.3
    max_acceleration: float = 0.7
    max_yaw_acceleration: float = 0.1
    footprint: Footprint | None = None
    max_reverse_speed: float | None = None

    def __post_init__(self) -> None:
        checked_limits("unicycle", self)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        _, _, phi, v, omega = state
        return v * np.cos(phi), v * np.sin(phi), omega, control[0], control[1]

    def state_bounds(self) -> Bounds:
        """Position and heading are free; v and omega are limited."""
        symmetric = Bounds.symmetric(np.inf, np.inf, np.inf, self.max_speed, self.max_yaw_rate)
        return symmetric.with_lower(3, self._least)

    def input_bounds(self) -> Bounds:
        """Limits of the two accelerations."""
        return Bounds.symmetric(self.max_acceleration, self.max_yaw_acceleration)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position of the axle's middle, and heading."""
        return Pose((state[0], state[1]), state[2])

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward speed and yaw rate; a unicycle does not slip sideways."""
        return Twist((state[3], 0.0), state[4])

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Return the input itself."""
        return Twist((control[0], 0.0), control[1])

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this pose with this twist; a lateral speed is dropped."""
        return (*pose.position, pose.heading, twist.linear[0], twist.angular)

    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Bring v and omega to the wanted twist, each as fast as its limit allows."""
        v = between(twist.linear[0], self._least, self.max_speed)
        omega = within(twist.angular, self.max_yaw_rate)
        return (
            within((v - state[3]) / duration, self.max_acceleration),
            within((omega - state[4]) / duration, self.max_yaw_acceleration),
        )

    @property
    def _least(self) -> float:
        return least_speed(self.max_speed, self.max_reverse_speed)
