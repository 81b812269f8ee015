"""Walls and velocities of the social force models."""

from collections.abc import Callable, Sequence

import numpy as np

from ..framework.mpc.slots.static_polygons import padded
from ..framework.robot import Robot
from ..framework.values.arrays import Array
from ..framework.values.polygon import MOST_CORNERS, Polygon, separation
from .steering import top_speed, velocity_of

LARGEST_EXPONENT = 50.0
"""Exponents are held below this: the speed is at its limit long before, and exp stays finite."""


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


def away_from_walls(place: Array, polygons: Sequence[Polygon]) -> tuple[Array, Array]:
    """Signed distance of a point from each polygon, (W,), m, and unit vectors away, (W, 2).

    The distance is negative inside. Inside a polygon that is not convex both belong to the convex
    part that holds the point.
    """
    distance, away = np.zeros(len(polygons)), np.zeros((len(polygons), 2))
    for i, polygon in enumerate(polygons):
        parts = np.stack([padded(part, MOST_CORNERS) for part in polygon.parts])
        gaps, normals = separation(place[None], parts)
        nearest = int(gaps.argmin())
        distance[i], away[i] = gaps[nearest], normals[nearest]
    return distance, away


def exponential(values: Array) -> Array:
    """Return exp of exponents, which are clipped at `LARGEST_EXPONENT`."""
    return np.asarray(np.exp(np.minimum(values, LARGEST_EXPONENT)))
