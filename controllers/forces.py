"""Velocities of the social force models."""

from collections.abc import Callable

import numpy as np

from ..framework.robot import Robot
from ..framework.values.arrays import Array
from .steering import top_speed, velocity_of


def pushed(
    robot: Robot,
    state: Array,
    last: Array | None,
    force: Callable[[Array], Array],
    period: float,
    fastest: float,
) -> Array:
    """Return the velocity of a walker one period later, v <- v + period a, (2,), m/s.

    A robot that takes any velocity at once moves exactly so. Another one is steered along it, and
    its lag does not act on the forces.

    Parameters
    ----------
    robot, state : the walker, and its state now, (n,).
    last : v, (2,), m/s, the result of the period before; None for the robot's own velocity.
    force : v -> a, the sum of the forces on a unit of mass, (2,), m/s^2.
    period : s.
    fastest : m/s, to which the velocity is shortened; the robot's top speed limits it too.
    """
    if last is None:
        known = velocity_of(robot, state)
        last = np.zeros(2) if known is None else known
    later = last + period * force(last)
    fastest = min(fastest, top_speed(robot, state))
    speed = float(np.hypot(*later))
    return np.asarray(later * (fastest / speed if speed > fastest else 1.0))
