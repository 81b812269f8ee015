"""ORCA's half-planes and the velocity nearest to the wanted one, written for Numba.

After the algorithm of van den Berg et al. (2011): a linear programme in the plane, one line after
the other. Numba compiles these functions, see `compiled`; called as they are they give the same
numbers to rounding, only slowly. A half-plane is (px, py, dx, dy): a point of its line and the
unit vector along it; velocities to the left of the line are allowed.
"""

from collections.abc import Callable
from functools import cache
from math import sqrt
from typing import Any, TypeAlias

import numpy as np

from ..framework.plugins.njit import cached_njit
from ..framework.values.arrays import Array, BoolArray

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

PARALLEL = 1e-5
"""Sine of the angle below which two lines have no point in common; RVO2's."""
HEAD_ON = 1e-9
"""Sine of the angle below which an encounter is head-on, and passed with the other on the left."""
NOWHERE = 1e-6
"""m/s, of a relative velocity that has no direction: two in one place that move alike."""
MOST = 64
"""Half-planes of walls that count at most, the first ones."""


def neighbour_line(
    line: Array, apart: Array, relative: Array, own: Array, room: float, horizon: float, dt: float
) -> bool:
    """Write the half-plane of one neighbour; there is none of who stands in the same place.

    Parameters
    ----------
    line : (4,), is written.
    apart : (2,), m, position of the neighbour minus the own.
    relative : (2,), m/s, own velocity minus the neighbour's.
    own : (2,), m/s.
    room : m, sum of the radii.
    horizon, dt : s; who overlaps already is to be apart after ``dt``.
    """
    square = apart[0] * apart[0] + apart[1] * apart[1]
    overlap = square <= room * room
    inverse = 1.0 / dt if overlap else 1.0 / horizon
    wx, wy = relative[0] - inverse * apart[0], relative[1] - inverse * apart[1]
    length = wx * wx + wy * wy
    inward = wx * apart[0] + wy * apart[1]
    if overlap or (inward < 0.0 and inward * inward > room * room * length):
        size = sqrt(length)
        if size < NOWHERE:
            return False
        nx, ny = wx / size, wy / size
        line[2], line[3] = ny, -nx
        ux, uy = (room * inverse - size) * nx, (room * inverse - size) * ny
    else:  # a leg of the cone
        leg = sqrt(square - room * room)
        if apart[0] * wy - apart[1] * wx > HEAD_ON * sqrt(square * length):
            line[2] = (apart[0] * leg - apart[1] * room) / square
            line[3] = (apart[0] * room + apart[1] * leg) / square
        else:
            line[2] = -(apart[0] * leg + apart[1] * room) / square
            line[3] = -(-apart[0] * room + apart[1] * leg) / square
        along = relative[0] * line[2] + relative[1] * line[3]
        ux, uy = along * line[2] - relative[0], along * line[3] - relative[1]
    line[0], line[1] = own[0] + 0.5 * ux, own[1] + 0.5 * uy
    return True


def on_line(
    lines: Array, row: int, fastest: float, goal: Array, ahead: bool, found: Array
) -> bool:
    """Write the best velocity on a line among those that the lines before it allow.

    Returns
    -------
    There is one; ``found`` stays as it was where there is none.
    """
    px, py, dx, dy = lines[row, 0], lines[row, 1], lines[row, 2], lines[row, 3]
    middle = px * dx + py * dy
    square = middle * middle + fastest * fastest - (px * px + py * py)
    if square < 0.0:
        return False
    root = sqrt(square)
    low, high = -middle - root, -middle + root
    for k in range(row):
        cross = dx * lines[k, 3] - dy * lines[k, 2]
        side = lines[k, 2] * (py - lines[k, 1]) - lines[k, 3] * (px - lines[k, 0])
        if abs(cross) <= PARALLEL:
            if side < 0.0:
                return False
            continue
        t = side / cross
        if cross >= 0.0:
            high = min(high, t)
        else:
            low = max(low, t)
        if low > high:
            return False
    if ahead:
        t = high if goal[0] * dx + goal[1] * dy > 0.0 else low
    else:
        t = min(max(dx * (goal[0] - px) + dy * (goal[1] - py), low), high)
    found[0], found[1] = px + t * dx, py + t * dy
    return True


def in_disc(
    lines: Array, count: int, fastest: float, goal: Array, ahead: bool, found: Array
) -> int:
    """Write the velocity nearest to a goal, or farthest along it, that all lines allow.

    Returns
    -------
    ``count``; where no velocity is allowed, the number of the line at which that was found.
    """
    square = goal[0] * goal[0] + goal[1] * goal[1]
    scale = fastest if ahead else 1.0
    if not ahead and square > fastest * fastest:
        scale = fastest / sqrt(square)
    found[0], found[1] = scale * goal[0], scale * goal[1]
    before = np.empty(2)
    for row in range(count):
        line = lines[row]
        if line[2] * (line[1] - found[1]) - line[3] * (line[0] - found[0]) > 0.0:
            before[0], before[1] = found[0], found[1]
            if not on_line(lines, row, fastest, goal, ahead, found):
                found[0], found[1] = before[0], before[1]
                return row
    return count


def least_entered(
    lines: Array, count: int, walls: int, first: int, fastest: float, found: Array
) -> None:
    """Write the velocity that enters the forbidden sides least; those of walls not at all.

    Parameters
    ----------
    lines : (count, 4); the first ``walls`` are those of walls.
    first : line at which `in_disc` has failed.
    found : (2,), what it has found up to there.
    """
    entered = 0.0
    other, goal, before = np.empty((count, 4)), np.empty(2), np.empty(2)
    for row in range(first, count):
        px, py, dx, dy = lines[row, 0], lines[row, 1], lines[row, 2], lines[row, 3]
        if dx * (py - found[1]) - dy * (px - found[0]) <= entered:
            continue
        other[:walls] = lines[:walls]
        used = walls
        for k in range(walls, row):
            cross = dx * lines[k, 3] - dy * lines[k, 2]
            if abs(cross) <= PARALLEL:
                if dx * lines[k, 2] + dy * lines[k, 3] > 0.0:
                    continue
                other[used, 0], other[used, 1] = 0.5 * (px + lines[k, 0]), 0.5 * (py + lines[k, 1])
            else:
                t = (lines[k, 2] * (py - lines[k, 1]) - lines[k, 3] * (px - lines[k, 0])) / cross
                other[used, 0], other[used, 1] = px + t * dx, py + t * dy
            ex, ey = lines[k, 2] - dx, lines[k, 3] - dy
            size = sqrt(ex * ex + ey * ey)
            if size == 0.0:
                continue
            other[used, 2], other[used, 3] = ex / size, ey / size
            used += 1
        goal[0], goal[1] = -dy, dx
        before[0], before[1] = found[0], found[1]
        if in_disc(other, used, fastest, goal, True, found) < used:
            found[0], found[1] = before[0], before[1]
        entered = dx * (py - found[1]) - dy * (px - found[0])


def nearest(
    place: Array, others: Array, seen: BoolArray, reach: float, near: IntArray, away: Array
) -> int:
    """Write the nearest others within reach, nearest first; return how many there are.

    Parameters
    ----------
    place : (2,), m.
    others : (Q, 5): x, y, vx, vy and radius.
    seen : (Q,).
    reach : m.
    near, away : (most,), are written: row of each, and its squared distance, m^2.
    """
    kept, most = 0, len(near)
    for q in range(len(others)):
        if not seen[q]:
            continue
        dx, dy = others[q, 0] - place[0], others[q, 1] - place[1]
        square = dx * dx + dy * dy
        if square >= reach * reach or (kept == most and square >= away[kept - 1]):
            continue
        spot = kept if kept < most else kept - 1
        kept = min(kept + 1, most)
        while spot > 0 and away[spot - 1] > square:
            away[spot], near[spot] = away[spot - 1], near[spot - 1]
            spot -= 1
        away[spot], near[spot] = square, q
    return kept


def wall_lines(lines: Array, walls: Array, fastest: float, horizon: float) -> int:
    """Write the half-planes of walls (W, 3) that could be reached; return how many there are."""
    count = 0
    for w in range(len(walls)):
        gap, nx, ny = walls[w, 0], walls[w, 1], walls[w, 2]
        if gap <= fastest * horizon and count < MOST:
            lines[count, 0], lines[count, 1] = -gap / horizon * nx, -gap / horizon * ny
            lines[count, 2], lines[count, 3] = ny, -nx
            count += 1
    return count


def velocities(
    place: Array,
    velocity: Array,
    wanted: Array,
    fastest: Array,
    radius: Array,
    others: Array,
    seen: BoolArray,
    walls: Array,
    settings: Array,
) -> Array:
    """Return the next velocity of each walker, (B, 2), m/s.

    Parameters
    ----------
    place, velocity, wanted : (B, 2), m and m/s.
    fastest, radius : (B,), m/s and m.
    others : (Q, 5): x, y, vx, vy and radius.
    seen : (B, Q), whom each of them sees.
    walls : (B, W, 3): gap, m, and unit vector away from each wall.
    settings : neighbour distance, m; most neighbours; horizon, s, of others and of walls; dt, s.
    """
    most = int(settings[1])
    found = np.empty((len(place), 2))
    near, away = np.empty(most, dtype=np.int64), np.empty(most)
    lines, apart, relative = np.empty((most + MOST, 4)), np.empty(2), np.empty(2)
    for b in range(len(place)):
        kept = nearest(place[b], others, seen[b], settings[0], near, away)
        fixed = wall_lines(lines, walls[b], fastest[b], settings[3])
        count = fixed
        for k in range(kept):
            other = others[near[k]]
            apart[0], apart[1] = other[0] - place[b, 0], other[1] - place[b, 1]
            relative[0], relative[1] = velocity[b, 0] - other[2], velocity[b, 1] - other[3]
            room, line = radius[b] + other[4], lines[count]
            if neighbour_line(line, apart, relative, velocity[b], room, settings[2], settings[4]):
                count += 1
        first = in_disc(lines, count, fastest[b], wanted[b], False, found[b])
        if first < count:
            least_entered(lines, count, fixed, first, fastest[b], found[b])
    return found


@cache
def compiled() -> Callable[..., Any]:
    """Return `velocities` as Numba compiles it."""
    inner = (neighbour_line, on_line, in_disc, least_entered, nearest, wall_lines)
    return cached_njit([velocities], inner)[0]
