"""Holonomic robot with velocity as input: the particle of many benchmarks."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.clipping import within_norm
from ..framework.robot import Bounds, Quantity, Robot
from ..framework.values.arrays import Scalar, positive
from ..framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class HolonomicVelocity(Robot):
    """A disc whose velocity is its input; it has neither heading nor inertia.

    State (x, y), input (vx, vy) in the world frame::

        p' = v    with    |v| <= max_speed

    The input is constant over a step, so `acceleration` is zero within it; that the
    velocity jumps between steps is what this model leaves out. A weight on acceleration
    therefore has no effect on it: use `holonomic` where accelerations matter.

    Parameters
    ----------
    radius : m, of the disc.
    max_speed : m/s, on the Euclidean norm.

    Raises
    ------
    WideberthError : a parameter that is not above 0.
    """

    states: ClassVar[tuple[Quantity, ...]] = (Quantity("x", "m"), Quantity("y", "m"))
    inputs: ClassVar[tuple[Quantity, ...]] = (Quantity("vx", "m/s"), Quantity("vy", "m/s"))

    radius: float = 0.75
    max_speed: float = 0.7

    def __post_init__(self) -> None:
        for entry in fields(self):
            positive(f"holonomic_velocity.{entry.name}", getattr(self, entry.name))

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return control[0], control[1]

    def state_bounds(self) -> Bounds:
        """Free."""
        return Bounds((-np.inf, -np.inf), (np.inf, np.inf))

    def input_bounds(self) -> Bounds:
        """Give the box around the disc of allowed velocities."""
        return Bounds.symmetric(self.max_speed, self.max_speed)

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Norm of the velocity, m^2/s^2."""
        vx, vy = control
        return (self.max_speed**2 - vx * vx - vy * vy,)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position; no heading."""
        return Pose((state[0], state[1]))

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Return the input itself."""
        return Twist((control[0], control[1]))

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Zero: the velocity is constant while the input is."""
        return Twist((0.0, 0.0))

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this position; the velocity is not part of it."""
        return tuple(pose.position)

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Return the wanted velocity, shortened to the limit."""
        return within_norm(twist.linear, self.max_speed)
