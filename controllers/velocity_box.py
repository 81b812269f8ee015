"""A robot's reachable velocities as a box of plain numbers."""

from dataclasses import dataclass
from itertools import product
from math import frexp
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from ..framework.robot import Robot
from ..framework.values.arrays import Array, checked
from ..framework.values.errors import WideberthError
from ..framework.values.motion import Command, Twist

UNLIMITED = 1e9
"""Stands for an endless bound; a velocity beyond `SENSIBLE` comes from one."""
SENSIBLE = 1e6
"""m/s and rad/s."""


@final
@dataclass(frozen=True)
class VelocityBox:
    """Actions of a policy: the components of a robot's velocity that it can change at all.

    action_i = velocity_i / unit_i,    lower_i / unit_i <= action_i <= upper_i / unit_i <= 1

    The unit is the smallest power of two that is not below the larger limit (1 m/s for 0.7 m/s,
    2 m/s for 1.2 m/s), so that actions are of the order of one and dividing and multiplying
    changes no digit: a command goes through an action unharmed. The box holds what bounds of
    state and input allow; what couples components (a norm, wheel speeds) is left to the
    robot's ``drive``.

    Attributes
    ----------
    dimension : D of the robot.
    components : which of (D linear components, yaw rate) an action has, in this order.
    lower, upper : of each of them, m/s or rad/s.
    """

    dimension: int
    components: tuple[int, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, robot: Robot) -> "VelocityBox":
        """Find the box of a robot, from its twist at every corner of its bounds.

        Raises
        ------
        WideberthError : a velocity that nothing limits.
        """
        states, inputs = robot.state_bounds(), robot.input_bounds()
        lower = np.clip((*states.lower, *inputs.lower), -UNLIMITED, UNLIMITED)
        upper = np.clip((*states.upper, *inputs.upper), -UNLIMITED, UNLIMITED)
        corners = tuple(np.array(list(product(*zip(lower, upper, strict=True)))).T)
        count = len(robot.states)
        twist = robot.twist(corners[:count], corners[count:])
        reached = [np.asarray(value) for value in (*twist.linear, twist.angular)]
        limits = [(float(value.min()), float(value.max())) for value in reached]
        if max(max(-low, high) for low, high in limits) > SENSIBLE:
            raise WideberthError(
                f"{type(robot).__name__} has a velocity without limit; actions need bounds on "
                "every component of the twist: give the robot finite state or input bounds"
            )
        moving = tuple(i for i, pair in enumerate(limits) if any(pair))
        lowest, highest = (tuple(limits[i][k] for i in moving) for k in (0, 1))
        return cls(robot.dimension, moving, lowest, highest)

    @property
    def limits(self) -> tuple[float, ...]:
        """Of each component on the absolute value, m/s or rad/s."""
        return tuple(max(-low, high) for low, high in zip(self.lower, self.upper, strict=True))

    @property
    def units(self) -> Array:
        """Velocity of an action of one, (A,), m/s or rad/s."""
        return np.array([_power_of_two(limit) for limit in self.limits])

    @property
    def high(self) -> Array:
        """Largest actions, (A,)."""
        return np.asarray(np.array(self.upper) / self.units)

    @property
    def low(self) -> Array:
        """Smallest actions, (A,)."""
        return np.asarray(np.array(self.lower) / self.units)

    def command(self, action: ArrayLike) -> Command:
        """Return the velocity of an action, to be taken up at once, within the limits.

        Raises
        ------
        WideberthError : not A finite numbers.
        """
        asked = checked("action", action, (len(self.components),))
        values = np.zeros(self.dimension + 1)
        values[list(self.components)] = np.clip(asked * self.units, self.lower, self.upper)
        return Command(tuple(float(value) for value in values[:-1]), float(values[-1]))

    def action(self, twist: Twist | Command) -> Array:
        """Return the action of a velocity, cut off at the limits, (A,)."""
        angular = twist.omega if isinstance(twist, Command) else twist.angular
        values = np.array([*twist.linear, angular], dtype=np.float64)[list(self.components)]
        return np.asarray(np.clip(values, self.lower, self.upper) / self.units)


def _power_of_two(limit: float) -> float:
    """Return the smallest power of two that is not below ``limit``."""
    mantissa, exponent = frexp(limit)
    return float(2.0 ** (exponent - (mantissa == 0.5)))
