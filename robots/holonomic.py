"""Holonomic robot with acceleration as input: a double integrator in the plane."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, final

import numpy as np

from ..framework.arrays import Scalar, positive
from ..framework.limits import within_norm
from ..framework.motion import Pose, Twist
from ..framework.robot import Bounds, Quantity, Robot


@final
@dataclass(frozen=True)
class Holonomic(Robot):
    """A disc that accelerates in any direction; it has no heading.

    State (x, y, vx, vy), input (ax, ay), all in the world frame::

        p' = v    v' = a    with    |v| <= max_speed    |a| <= max_acceleration

    Both limits are on the Euclidean norm. They are stated as max_speed^2 - v.v >= 0 (smooth
    where v = 0), with the enclosing box as bounds.

    Parameters
    ----------
    radius : m, of the disc.
    max_speed : m/s.
    max_acceleration : m/s^2.

    Raises
    ------
    WideberthError : a parameter that is not above 0.
    """

    states: ClassVar[tuple[Quantity, ...]] = (
        Quantity("x", "m"),
        Quantity("y", "m"),
        Quantity("vx", "m/s"),
        Quantity("vy", "m/s"),
    )
    inputs: ClassVar[tuple[Quantity, ...]] = (Quantity("ax", "m/s^2"), Quantity("ay", "m/s^2"))

    radius: float = 0.75
    max_speed: float = 0.7
    max_acceleration: float = 0.7

    def __post_init__(self) -> None:
        for entry in fields(self):
            positive(f"holonomic.{entry.name}", getattr(self, entry.name))

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return state[2], state[3], control[0], control[1]

    def state_bounds(self) -> Bounds:
        """Give the box around the disc of allowed velocities."""
        upper = (np.inf, np.inf, self.max_speed, self.max_speed)
        return Bounds(tuple(-u for u in upper), upper)

    def input_bounds(self) -> Bounds:
        """Give the box around the disc of allowed accelerations."""
        upper = (self.max_acceleration, self.max_acceleration)
        return Bounds(tuple(-u for u in upper), upper)

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Norms of velocity and acceleration, m^2/s^2 and m^2/s^4."""
        _, _, vx, vy = state
        ax, ay = control
        return (
            self.max_speed**2 - vx * vx - vy * vy,
            self.max_acceleration**2 - ax * ax - ay * ay,
        )

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position; no heading."""
        return Pose((state[0], state[1]))

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Velocity in the world frame."""
        return Twist((state[2], state[3]))

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Return the input itself."""
        return Twist((control[0], control[1]))

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this position with this velocity."""
        return (*pose.position, *twist.linear)

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Accelerate straight towards the wanted velocity."""
        vx, vy = within_norm(twist.linear[0], twist.linear[1], self.max_speed)
        return within_norm(
            (vx - state[2]) / duration, (vy - state[3]) / duration, self.max_acceleration
        )
