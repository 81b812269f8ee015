"""The wave of NavFn and the way down its gradient, written for Numba.

Numba compiles these functions, see `compiled`; called as they are they give the same bits, only
slowly. Each operation has the width (float32 or float64) that the original's has, so that
potentials are equal bit by bit: a product of two float32 stays one, and whatever meets a constant
becomes a float64.
"""

from collections.abc import Callable
from functools import cache
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..framework.plugins.njit import cached_njit

NEUTRAL, OBSTACLE, UNREACHED = 50, 254, 1e10
"""Cost of a free cell and of an obstacle; potential of a cell that the wave has not reached."""
BUFFER = 10_000
"""Cells that a priority buffer holds; what finds no room is dropped, as in the original."""

Costs = NDArray[np.uint8]
Potentials = NDArray[np.float32]


def candidate(p: Potentials, cost: Costs, n: int, wide: int) -> np.float32:
    """Return the potential that the neighbours of a cell give to it.

    With the lowest neighbours t_a <= t_b, one of each axis, and the cell's cost h:

        t_a + h                                               t_b - t_a >= h
        t_a + h (-0.2301 q^2 + 0.5307 q + 0.7040)   q = (t_b - t_a) / h
    """
    left, right, up, down = p[n - 1], p[n + 1], p[n - wide], p[n + wide]
    tc = left if left < right else right
    ta = up if up < down else down
    h = np.float32(cost[n])
    apart = np.float32(tc - ta)
    if apart < 0.0:
        apart = np.float32(-apart)
        ta = tc
    if apart >= h:
        return np.float32(ta + h)
    q = np.float64(np.float32(apart / h))
    v = np.float32(-0.2301 * q * q + 0.5307 * q + 0.7040)
    return np.float32(ta + np.float32(h * v))


def spread(cost: Costs, robot: int, goal: int, wide: int, astar: bool) -> tuple[Potentials, int]:
    """Let the wave run from the robot's cell until it reaches the goal's.

    Cells wait in three buffers: those of this cycle, of the next one, and those whose potential is
    beyond the threshold, which rises once the other two are empty.

    Parameters
    ----------
    cost : (cells,), `OBSTACLE` on the border of the map.
    robot, goal : cells.
    wide : number of columns.
    astar : order the cells by potential plus 50 times the distance from the goal.

    Returns
    -------
    potential : (cells,).
    cycles : that were left when it ended; 0 where the limit ended it.
    """
    count = len(cost)
    p = np.full(count, UNREACHED, np.float32)
    p[robot] = np.float32(0.0)
    pending = np.zeros(count, np.bool_)
    buffers = np.empty((3, BUFFER), np.int64)
    now, soon, later = 0, 1, 2
    held = np.zeros(3, np.int64)
    gx, gy = goal % wide, goal // wide
    threshold = np.float32(OBSTACLE)
    if astar:
        across, along = robot % wide - gx, robot // wide - gy
        ahead = np.float32(np.sqrt(np.float64(across * across + along * along)) * 50.0)
        threshold = np.float32(ahead + threshold)
    for n in (robot + 1, robot - 1, robot - wide, robot + wide):
        push(buffers, held, now, n, pending, cost)
    cycles = max(count // 20, wide + count // wide)
    while cycles > 0 and (held[now] > 0 or held[soon] > 0):
        for i in range(held[now]):
            pending[buffers[now, i]] = False
        for i in range(held[now]):
            n = buffers[now, i]
            update(p, cost, n, wide, threshold, astar, gx, gy, buffers, held, soon, later, pending)
        held[now] = 0
        now, soon = soon, now
        if held[now] == 0:
            threshold = np.float32(threshold + np.float32(2 * NEUTRAL))
            now, later = later, now
        if p[goal] < UNREACHED:
            break
        cycles -= 1
    return p, cycles


def update(
    p: Potentials, cost: Costs, n: int, wide: int, threshold: np.float32, astar: bool,
    gx: int, gy: int, buffers: NDArray[np.int64], held: NDArray[np.int64], soon: int, later: int,
    pending: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Lower the potential of a cell if its neighbours allow it, and let those wait that gain."""
    if cost[n] >= OBSTACLE:
        return
    value = candidate(p, cost, n, wide)
    if not value < p[n]:
        return
    p[n] = value
    if astar:
        across, along = n % wide - gx, n // wide - gy
        ahead = np.float32(np.sqrt(np.float64(across * across + along * along)) * 50.0)
        value = np.float32(value + ahead)
    into = soon if value < threshold else later
    for m in (n - 1, n + 1, n - wide, n + wide):
        step = np.float32(0.707106781 * np.float64(cost[m]))
        if p[m] > np.float32(value + step):
            push(buffers, held, into, m, pending, cost)


def push(
    buffers: NDArray[np.int64], held: NDArray[np.int64], into: int, n: int,
    pending: NDArray[np.bool_], cost: Costs,
) -> None:  # fmt: skip
    """Put a cell into a buffer unless it waits already, is an obstacle or finds no room."""
    if 0 <= n < len(cost) and not pending[n] and cost[n] < OBSTACLE and held[into] < BUFFER:
        buffers[into, held[into]] = n
        held[into] += 1
        pending[n] = True


def descend(
    p: Potentials, robot: int, goal: int, wide: int, most: int
) -> tuple[NDArray[np.float32], bool]:
    """Go down the gradient of the potential from the goal's cell to the robot's.

    Parameters
    ----------
    p : potentials, (cells,).
    robot, goal : cells.
    wide : number of columns.
    most : points of the longest way.

    Returns
    -------
    points : (K, 2), columns and rows, from the goal on.
    arrived : whether the last one is the robot's cell.
    """
    count, st, arrived = len(p), goal, False
    dx, dy = np.float32(0.0), np.float32(0.0)
    way = np.empty((most, 2), np.float32)
    slopes = np.zeros((count, 2), np.float32)
    k = 0
    while k < most:
        near = st + int(rounded(dx)) + wide * int(rounded(dy))
        if p[max(0, min(count - 1, near))] < NEUTRAL:
            way[k, 0], way[k, 1] = np.float32(robot % wide), np.float32(robot // wide)
            k += 1
            arrived = True
            break
        if st < wide or st > count - wide:
            break
        way[k, 0], way[k, 1] = np.float32(st % wide) + dx, np.float32(st // wide) + dy
        k += 1
        again = k > 2 and way[k - 1, 0] == way[k - 3, 0] and way[k - 1, 1] == way[k - 3, 1]
        if again or beside_unreached(p, st, wide):
            st = lowest_around(p, st, wide)
            dx, dy = np.float32(0.0), np.float32(0.0)
            if p[st] >= UNREACHED:
                break
        else:
            x, y = slope_at(p, slopes, st, wide, dx, dy)
            if x == 0.0 and y == 0.0:
                break
            length = np.float32(np.sqrt(np.float64(x) * x + np.float64(y) * y))
            size = np.float32(0.5 / np.float64(length))
            dx, dy = np.float32(dx + np.float32(x * size)), np.float32(dy + np.float32(y * size))
            st, dx = carried(st, dx, 1)
            st, dy = carried(st, dy, wide)
    return way[:k], arrived


def rounded(value: np.float32) -> float:
    """Round half away from zero."""
    return floor(value + 0.5) if value >= 0.0 else -floor(0.5 - value)


def carried(st: int, offset: np.float32, step: int) -> tuple[int, np.float32]:
    """Move on by a cell where the offset within the cell exceeds 1."""
    if offset > 1.0:
        return st + step, np.float32(offset - np.float32(1.0))
    if offset < -1.0:
        return st - step, np.float32(offset + np.float32(1.0))
    return st, offset


def beside_unreached(p: Potentials, st: int, wide: int) -> bool:
    """Tell whether the wave has not reached one of the nine cells about this one."""
    for row in (st - wide, st, st + wide):
        for n in (row - 1, row, row + 1):
            if p[n] >= UNREACHED:
                return True
    return False


def lowest_around(p: Potentials, st: int, wide: int) -> int:
    """Return the first cell about this one that lies below it and all before by a whole number."""
    best, least = st, int(p[st])
    for n in (
        st - wide - 1, st - wide, st - wide + 1, st - 1, st + 1, st + wide - 1, st + wide,
        st + wide + 1,
    ):  # fmt: skip
        if p[n] < least:
            best, least = n, int(p[n])
    return best


def slope_at(
    p: Potentials, slopes: NDArray[np.float32], st: int, wide: int, dx: np.float32, dy: np.float32
) -> tuple[np.float32, np.float32]:
    """Interpolate the slopes of four cells."""
    for n in (st, st + 1, st + wide, st + wide + 1):
        find_slope(p, slopes, n, wide)
    x, y = np.float32(0.0), np.float32(0.0)
    for axis in range(2):
        low = mixed(slopes[st, axis], slopes[st + 1, axis], dx)
        high = mixed(slopes[st + wide, axis], slopes[st + wide + 1, axis], dx)
        if axis == 0:
            x = mixed(low, high, dy)
        else:
            y = mixed(low, high, dy)
    return x, y


def mixed(first: np.float32, second: np.float32, share: np.float32) -> np.float32:
    """Return (1 - share) first + share second."""
    return np.float32((1.0 - np.float64(share)) * first + np.float32(share * second))


def find_slope(p: Potentials, slopes: NDArray[np.float32], n: int, wide: int) -> None:
    """Store the unit vector that leads down from a cell, unless it is known."""
    if slopes[n, 0] + slopes[n, 1] > 0.0:
        return
    if n < wide or n > len(p) - wide:
        return
    dx, dy = fall(p, n, 1), fall(p, n, wide)
    norm = np.float32(np.sqrt(np.float64(dx) * dx + np.float64(dy) * dy))
    if norm > 0.0:
        inverse = np.float32(1.0 / np.float64(norm))
        slopes[n, 0], slopes[n, 1] = np.float32(inverse * dx), np.float32(inverse * dy)


def fall(p: Potentials, n: int, step: int) -> np.float32:
    """Return how much the potential falls along an axis; out of an obstacle, the way to leave."""
    before, here, after = p[n - step], p[n], p[n + step]
    found = np.float32(0.0)
    if here >= UNREACHED:
        if before < UNREACHED:
            found = np.float32(-OBSTACLE)
        elif after < UNREACHED:
            found = np.float32(OBSTACLE)
        return found
    if before < UNREACHED:
        found = np.float32(before - here)
    if after < UNREACHED:
        found = np.float32(found + np.float32(here - after))
    return found


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `spread` and `descend` as Numba compiles them."""
    inner = (
        candidate, push, update, rounded, carried, beside_unreached, lowest_around, mixed, fall,
        find_slope, slope_at,
    )  # fmt: skip
    return cached_njit((spread, descend), inner)
