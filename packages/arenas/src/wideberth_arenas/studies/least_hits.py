"""The fewest hits that any robot of a speed could have had, by a dynamic programme."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wideberth.framework.values.arrays import Array, BoolArray

from .conformal_protocol import NEAR, REACH, ROBOT, RecordedCourse

CELL = 0.08
"""m, side of a cell: a quarter of the way of one row."""
ROOM = 3.0
"""m around start and goal in which the robot may evade."""


@dataclass(frozen=True)
class LeastHits:
    """Bounds of the fewest rows with someone too near, of a point that may move any way.

    Attributes
    ----------
    low : no robot of this speed has fewer, whether or not it arrives.
    high : one has so few and arrives; infinite where none does within the grid.
    """

    low: float
    high: float


def least_hits(course: RecordedCourse, rows: Sequence[int]) -> LeastHits:
    """Return bounds of the fewest hits of an episode whose people are all known beforehand.

    With h_t(x) = 1 where a person is within `REACH` of x at row t, and from the last row back::

        V_t(x) = 0 at the goal,   else   h_t(x) + min over |y - x| <= d of V_{t+1}(y)

    d is the robot's largest way in a row, in any direction: a bound for a unicycle too. On cells
    of side `CELL`, V is a lower bound where a cell counts as hit only if all of it is, and as
    reached if any of it can be, from any of another; and attained where it counts as hit if any
    of it is, and as reached if the centres are within d.

    Parameters
    ----------
    course : start, goal and people. rows : those that count, at the first of which the robot is
        at its start.
    """
    corners = np.array([course.start[:2], course.goal])
    lower, upper = corners.min(axis=0) - ROOM, corners.max(axis=0) + ROOM
    axes = [np.arange(lower[i], upper[i] + CELL, CELL) for i in range(2)]
    start = tuple(int(np.argmin(np.abs(axes[i] - course.start[i]))) for i in range(2))
    half, way = CELL / np.sqrt(2.0), ROBOT.max_speed * course.recording.dt
    away = np.hypot(axes[0][:, None] - course.goal[0], axes[1][None, :] - course.goal[1])
    outside = np.ones_like(away, dtype=np.bool_)
    outside[1:-1, 1:-1] = False
    values = []
    for slack, end in ((half, 0.0), (-half, np.inf)):
        goal: BoolArray = away <= NEAR + slack
        reach = _disc(way + max(2.0 * slack, 0.0))
        value = np.where(goal, 0.0, end)
        for k, row in enumerate(reversed(rows)):
            hit = _hit(course, row, axes, REACH - slack)
            if slack > 0.0:  # a robot that leaves the grid is hit by no one
                hit[outside] = 0.0
            value = np.where(goal, 0.0, hit + (_least(value, reach) if k else value))
        values.append(float(value[start]))
    return LeastHits(*values)


def _hit(course: RecordedCourse, row: int, axes: list[Array], radius: float) -> Array:
    """Return 1 at the centres within ``radius``, m, of someone at a row, else 0."""
    found = np.zeros((len(axes[0]), len(axes[1])), dtype=np.bool_)
    for x, y in course.people(row)[1]:
        found |= (axes[0][:, None] - x) ** 2 + (axes[1][None, :] - y) ** 2 < radius**2
    return found.astype(np.float64)


def _disc(radius: float) -> BoolArray:
    """Return the cells whose centres are within ``radius``, m, of one."""
    size = int(np.floor(radius / CELL + 1e-9))
    steps = CELL * np.arange(-size, size + 1)
    return np.asarray(np.hypot(steps[:, None], steps[None, :]) <= radius + 1e-9)


def _least(value: Array, reach: BoolArray) -> Array:
    """Return the least value within reach of each cell."""
    from scipy.ndimage import minimum_filter

    return np.asarray(minimum_filter(value, footprint=reach, mode="constant", cval=np.inf))
