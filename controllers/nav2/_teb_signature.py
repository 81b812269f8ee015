"""At which side a trajectory passes each obstacle, and paths that pass otherwise; for Numba.

Numba compiles these functions, see `compiled`; called as they are they compute the same, only
slowly.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...framework.jit.late import late
from ...framework.values.arrays import Array

AHEAD, STEP = 120.0, 0.1
"""s that an obstacle's line is long; length of an integration step in x, y (m) and t (s)."""


def field_along(dx: float, dy: float, dt: float, p: Array, velocity: Array) -> float:
    """Return Biot and Savart's field of an obstacle's line, times a step (dx, dy, dt).

    The line runs from the obstacle's place now, seen at ``p`` = (x, y, t) from the trajectory, to
    its place in 120 s. With p_1 and p_2 its ends as seen from the trajectory and d the
    perpendicular on it:

        (d x p_2 / |p_2| - d x p_1 / |p_1|) / |d|^2 . step
    """
    lx, ly, lt = AHEAD * velocity[0], AHEAD * velocity[1], AHEAD
    qx, qy, qt = p[0] + lx, p[1] + ly, p[2] + lt
    cx, cy, ct = p[1] * qt - p[2] * qy, p[2] * qx - p[0] * qt, p[0] * qy - p[1] * qx
    square = lx * lx + ly * ly + lt * lt
    ex, ey, et = (
        (ly * ct - lt * cy) / square, (lt * cx - lx * ct) / square, (lx * cy - ly * cx) / square
    )  # fmt: skip
    near = ex * ex + ey * ey + et * et
    if near == 0.0:
        return 0.0
    a = 1.0 / np.sqrt(qx * qx + qy * qy + qt * qt)
    b = 1.0 / np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    rx, ry, rt = qx * a - p[0] * b, qy * a - p[1] * b, qt * a - p[2] * b
    fx, fy, ft = ey * rt - et * ry, et * rx - ex * rt, ex * ry - ey * rx
    along: float = (fx * dx + fy * dy + ft * dt) / near
    return along


def add_segment(
    begin: Array, end: Array, places: Array, velocities: Array, moving: bool, signature: Array
) -> None:
    """Add what a straight segment contributes to the signature (M,).

    Parameters
    ----------
    begin, end : (3,), x, y (m) and t (s).
    places, velocities : (M, 2), of the obstacles.
    moving : add the field along the segment over 4 pi; else the angle that it turns about each
        obstacle, rad.
    """
    span = end - begin
    length = np.sqrt(np.sum(span * span))
    if length == 0.0:
        return
    p = np.empty(3)
    for m in range(len(places)):
        if not moving:
            ax, ay = begin[0] - places[m, 0], begin[1] - places[m, 1]
            bx, by = end[0] - places[m, 0], end[1] - places[m, 1]
            signature[m] += np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
            continue
        done, total = 0.0, 0.0
        while done < length:
            step = min(STEP, length - done)
            share, part = done / length, step / length
            p[0] = places[m, 0] - begin[0] - share * span[0]
            p[1] = places[m, 1] - begin[1] - share * span[1]
            p[2] = -begin[2] - share * span[2]
            total += field_along(part * span[0], part * span[1], part * span[2], p, velocities[m])
            done += STEP
        signature[m] += total / (4.0 * np.pi)


def signature_of(points: Array, places: Array, velocities: Array, moving: bool) -> Array:
    """Return the signature (M,) of a trajectory (n, 3) in x, y (m) and t (s)."""
    signature = np.zeros(len(places))
    for i in range(len(points) - 1):
        add_segment(points[i], points[i + 1], places, velocities, moving, signature)
    return signature


def alike(first: Array, second: Array, moving: bool, threshold: float) -> bool:
    """Tell whether two signatures pass every obstacle at the same side.

    With moving obstacles: no sign differs where both are at least ``threshold``. Else: no angle
    differs by half a turn.
    """
    for m in range(len(first)):
        a, b = first[m], second[m]
        if moving:
            if abs(a) >= threshold and abs(b) >= threshold and (a > 0.0) != (b > 0.0):
                return False
        elif abs(a - b) > np.pi:
            return False
    return True


def keeps_clear(begin: Array, end: Array, places: Array, reach: Array) -> bool:
    """Tell whether a straight step keeps away from discs: centres (M, 2), radii (M,)."""
    dx, dy = end[0] - begin[0], end[1] - begin[1]
    square = dx * dx + dy * dy
    for m in range(len(places)):
        ax, ay = places[m, 0] - begin[0], places[m, 1] - begin[1]
        share = 0.0
        if square > 0.0:
            share = min(max((ax * dx + ay * dy) / square, 0.0), 1.0)
        bx, by = ax - share * dx, ay - share * dy
        if bx * bx + by * by < reach[m] * reach[m]:
            return False
    return True


def connections(
    vertices: Array, ahead: Array, least: float, places: Array, reach: Array
) -> NDArray[np.bool_]:
    """Tell which vertex is joined to which, (V, V): by a step that leads ahead and keeps clear.

    Parameters
    ----------
    vertices : (V, 2), the start first and the goal last.
    ahead : (2,), unit vector from start to goal.
    least : cosine of the largest angle between a step and that vector.
    places, reach : of the obstacles, see `keeps_clear`.
    """
    count = len(vertices)
    joined = np.zeros((count, count), np.bool_)
    for i in range(count - 1):
        for j in range(count):
            dx, dy = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1]
            length = np.sqrt(dx * dx + dy * dy)
            if i == j or length == 0.0 or dx * ahead[0] + dy * ahead[1] <= least * length:
                continue
            joined[i, j] = keeps_clear(vertices[i], vertices[j], places, reach)
    return joined


def new_paths(
    vertices: Array, joined: NDArray[np.bool_], speed: float, places: Array, velocities: Array,
    moving: bool, threshold: float, known: Array, count: int,
) -> tuple[NDArray[np.int64], int]:  # fmt: skip
    """Find paths to the goal whose signatures are new, depth first.

    Parameters
    ----------
    vertices, joined : the graph, see `connections`.
    speed : m/s, at which a path is thought to be followed.
    known : (K, M), signatures; the first ``count`` are given, the rest is room for new ones.

    Returns
    -------
    paths : (K, V), numbers of the vertices, -1 behind the end; row k belongs to known[k].
    count : signatures that are known now.
    """
    size, goal = len(vertices), len(vertices) - 1
    paths = np.full((len(known), size), -1, np.int64)
    node, following = np.zeros(size, np.int64), np.zeros(size, np.int64)
    signature, points = np.zeros((size + 1, len(places))), np.zeros((size + 1, 3))
    points[0, :2] = vertices[0]
    used = np.zeros(size, np.bool_)
    used[0] = True
    depth, arrived = 0, True
    while depth >= 0 and count < len(known):
        if arrived and joined[node[depth], goal]:
            step_to(points, depth, vertices[goal], speed)
            signature[depth + 1] = signature[depth]
            add_segment(
                points[depth], points[depth + 1], places, velocities, moving, signature[depth + 1]
            )
            fresh = True
            for k in range(count):
                fresh = fresh and not alike(signature[depth + 1], known[k], moving, threshold)
            if fresh:
                known[count] = signature[depth + 1]
                paths[count, : depth + 1] = node[: depth + 1]
                paths[count, depth + 1] = goal
                count += 1
        arrived = False
        j = following[depth]
        if j >= goal:
            used[node[depth]] = False
            depth -= 1
            continue
        following[depth] = j + 1
        if used[j] or not joined[node[depth], j]:
            continue
        step_to(points, depth, vertices[j], speed)
        signature[depth + 1] = signature[depth]
        add_segment(
            points[depth], points[depth + 1], places, velocities, moving, signature[depth + 1]
        )
        depth += 1
        node[depth], following[depth], used[j], arrived = j, 0, True, True
    return paths, count


def step_to(points: Array, depth: int, place: Array, speed: float) -> None:
    """Write the next point of a path, x, y and t, behind the one at ``depth``."""
    dx, dy = place[0] - points[depth, 0], place[1] - points[depth, 1]
    points[depth + 1, 0], points[depth + 1, 1] = place[0], place[1]
    points[depth + 1, 2] = points[depth, 2] + np.sqrt(dx * dx + dy * dy) / speed


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `signature_of`, `alike`, `connections` and `new_paths` as Numba compiles them."""
    inner = field_along, add_segment, alike, keeps_clear, step_to
    return late((signature_of, alike, connections, new_paths), inner)
