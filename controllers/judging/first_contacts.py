"""The first contact that a trajectory is to expect among many futures, written for Numba.

Numba compiles these functions, see `compiled`; called as they are they give the same numbers, only
slowly.
"""

from collections.abc import Callable
from functools import cache
from math import sqrt
from typing import Any

from ...framework.plugins.njit import cached_njit
from ...framework.values.arrays import Array


def expected(
    centres: Array, rooms: Array, futures: Array, weights: Array, room: float, lasting: Array,
    risk: Array, near: Array,
) -> None:  # fmt: skip
    """Fill in what each trajectory is to expect of people, see `ExpectedContact`.

    Parameters
    ----------
    centres : (C, B, N + 1, D), m, of the robot's discs on C trajectories, from now on.
    rooms : (B, O), m, between the centres of disc and person at which they touch.
    futures : (O, M, N + 1, D), m. weights : (O, M).
    room : m, below which a gap counts.
    lasting : (N,), weight of a contact on the way to each step.
    risk, near : (C,), filled in.
    """
    count, parts = centres.shape[:2]
    people, modes = weights.shape
    for c in range(count):
        spared, touched = 1.0, 0.0
        for o in range(people):
            met, close = 0.0, 0.0
            for m in range(modes):
                if weights[o, m] <= 0.0:
                    continue
                first, gap = 0.0, 0.0
                for b in range(parts):
                    hit, some = passing(centres[c, b], futures[o, m], rooms[b, o], room, lasting)
                    first, gap = max(first, hit), max(gap, some)
                met += weights[o, m] * first
                close += weights[o, m] * gap
            spared *= 1.0 - min(met, 1.0)
            touched += close
        risk[c], near[c] = 1.0 - spared, touched


def passing(
    body: Array, other: Array, apart: float, room: float, lasting: Array
) -> tuple[float, float]:
    """Return the weight of the first contact of two discs, and the largest share of a gap lost.

    Both move in a straight line from step to step, (N + 1, D), m. They touch where their centres
    are ``apart``, m; a gap loses (1 - gap / room), times the weight of that step.
    """
    steps, size = body.shape
    lost = 0.0
    for n in range(1, steps):
        along, length, before = 0.0, 0.0, 0.0
        for d in range(size):
            here = body[n - 1, d] - other[n - 1, d]
            step = body[n, d] - other[n, d] - here
            along -= here * step
            length += step * step
            before += here * here
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        least = before - share * (2.0 * along - share * length)
        if least < (apart + room) ** 2:
            gap = sqrt(max(least, 0.0)) - apart
            if gap <= 0.0:
                return lasting[n - 1], max(lost, lasting[n - 1])
            lost = max(lost, lasting[n - 1] * (1.0 - gap / room))
    return 0.0, lost


def walled(centres: Array, radii: Array, walls: Array, risk: Array) -> None:
    """Raise the risk of trajectories on which a disc comes into a wall to 1.

    Parameters
    ----------
    centres : (C, B, N + 1, D) as in `expected`. radii : (B,), m, with what walls are to be away.
    walls : (W, V, 2), m, corners of convex polygons, counter-clockwise; a corner may be repeated.
    risk : (C,), as in `expected`.
    """
    count, parts, steps, _ = centres.shape
    for c in range(count):
        for n in range(1, steps):
            if risk[c] == 1.0:
                break
            for b in range(parts):
                for w in range(len(walls)):
                    if within(centres[c, b, n], walls[w], radii[b]):
                        risk[c] = 1.0


def within(point: Array, corners: Array, distance: float) -> bool:
    """Tell whether a point is inside of a convex polygon or this near to it."""
    inside, count = True, len(corners)
    for k in range(count):
        ax, ay = corners[k, 0], corners[k, 1]
        ex, ey = corners[(k + 1) % count, 0] - ax, corners[(k + 1) % count, 1] - ay
        px, py = point[0] - ax, point[1] - ay
        length = ex * ex + ey * ey
        share = min(max((px * ex + py * ey) / length, 0.0), 1.0) if length > 0.0 else 0.0
        dx, dy = px - share * ex, py - share * ey
        if dx * dx + dy * dy < distance * distance:
            return True
        inside = inside and ex * py - ey * px >= 0.0
    return inside


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `expected` and `walled`, compiled."""
    return cached_njit([expected, walled], [passing, within])
