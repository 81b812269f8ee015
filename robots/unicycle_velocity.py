"""Unicycle with its velocities as input: the robot of many published comparisons."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.clipping import between, within
from ..framework.robot import Bounds, Quantity, SymbolicDrive, checked_limits, least_speed
from ..framework.values.arrays import Scalar
from ..framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class UnicycleVelocity(SymbolicDrive):
    """A disc with a heading whose speed and yaw rate are its input; it has no inertia.

    State (x, y, phi), input (v, omega)::

        x' = v cos(phi)    y' = v sin(phi)    phi' = omega

    The input is constant over a step, so `acceleration` is zero within it; that the velocities
    jump between steps is what this model leaves out, and where they do jump it is exact. Use
    `unicycle` where accelerations matter.

    Parameters
    ----------
    radius : m, of the disc.
    max_speed : m/s, |v|.
    max_yaw_rate : rad/s, |omega|.
    max_reverse_speed : m/s, -v at most; 0 never backwards, None as fast as forwards.

    Raises
    ------
    WideberthError : a parameter that is not above 0, or a speed backwards beyond ``max_speed``.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("phi", "rad"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (Quantity("v", "m/s"), Quantity("omega", "rad/s"))

    radius: float = 0.4
    max_speed: float = 0.8
    max_yaw_rate: float = 0.7
    max_reverse_speed: float | None = None

    def __post_init__(self) -> None:
        checked_limits("unicycle_velocity", self)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return control[0] * np.cos(state[2]), control[0] * np.sin(state[2]), control[1]

    def state_bounds(self) -> Bounds:
        """Free."""
        return Bounds.symmetric(np.inf, np.inf, np.inf)

    def input_bounds(self) -> Bounds:
        """Limits of the two velocities."""
        return Bounds.symmetric(self.max_speed, self.max_yaw_rate).with_lower(0, self._least)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position of the axle's middle, and heading."""
        return Pose((state[0], state[1]), state[2])

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Return the input itself."""
        return Twist((control[0], 0.0), control[1])

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Zero: the velocities are constant while the input is."""
        return Twist((0.0, 0.0))

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this pose; the velocities are not part of it."""
        return (*pose.position, pose.heading)

    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Return the wanted velocities within their limits; a lateral speed is dropped."""
        return (
            between(twist.linear[0], self._least, self.max_speed),
            within(twist.angular, self.max_yaw_rate),
        )

    @property
    def _least(self) -> float:
        return least_speed(self.max_speed, self.max_reverse_speed)
