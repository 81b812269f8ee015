"""The dynamics of robots without heading whose input is an acceleration."""

from collections.abc import Sequence

import numpy as np

from ..framework.numerics.clipping import within_norm
from ..framework.robot import Bounds, Robot
from ..framework.values.arrays import Scalar
from ..framework.values.motion import Pose, Twist


class DoubleIntegrator(Robot):
    """A disc or ball that accelerates in any direction; it has no heading.

    State (p, v), input a, D entries each, all in the world frame::

        p' = v    v' = a    with    |v| <= max_speed    |a| <= max_acceleration

    Both limits are on the Euclidean norm. They are stated as max_speed^2 - v.v >= 0 (smooth
    where v = 0), with the enclosing box as bounds. A subclass names the components and gives
    derivative and pose.
    """

    max_speed: float
    """m/s."""

    max_acceleration: float
    """m/s^2."""

    def state_bounds(self) -> Bounds:
        """Give the box around the allowed velocities."""
        upper = (np.inf,) * self.dimension + (self.max_speed,) * self.dimension
        return Bounds.symmetric(*upper)

    def input_bounds(self) -> Bounds:
        """Give the box around the allowed accelerations."""
        upper = (self.max_acceleration,) * self.dimension
        return Bounds.symmetric(*upper)

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Norms of velocity and acceleration, m^2/s^2 and m^2/s^4."""
        velocity = state[self.dimension :]
        return (
            self.max_speed**2 - sum(v * v for v in velocity),
            self.max_acceleration**2 - sum(a * a for a in control),
        )

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Velocity in the world frame."""
        return Twist(tuple(state[self.dimension :]))

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Return the input itself."""
        return Twist(tuple(control))

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this position with this velocity."""
        return (*pose.position, *twist.linear)

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Accelerate straight towards the wanted velocity."""
        wanted = within_norm(twist.linear, self.max_speed)
        change = zip(wanted, state[self.dimension :], strict=True)
        return within_norm([(w - v) / duration for w, v in change], self.max_acceleration)
