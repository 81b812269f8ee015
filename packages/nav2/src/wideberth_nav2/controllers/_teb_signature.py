"""At which side a trajectory passes each obstacle, and paths that pass otherwise; for Numba.

Numba compiles these functions, see `compiled`; called as they are they compute the same, only
slowly.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.plugins.njit import cached_njit
from wideberth.framework.values.arrays import Array

Vector = tuple[float, float, float]

AHEAD = 120.0
"""s that an obstacle's line is long."""
MOST = 500_000
"""Segments times obstacles that one search for paths looks at; it ends there with what it has."""


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def angle_between(a: Vector, b: Vector) -> float:
    """Return asin(a . b / (|a| |b|)), rad; 0 where one of them is 0."""
    size = np.sqrt(dot(a, a) * dot(b, b))
    return float(np.arcsin(min(1.0, max(-1.0, dot(a, b) / size)))) if size > 0.0 else 0.0


def turn_about(begin: Array, end: Array, place: Array, velocity: Array) -> float:
    """Return how far a straight segment winds about an obstacle's line, in turns.

    The line runs from the obstacle's place now to its place in 120 s. The field of a current
    along it, integrated along the segment, is Gauss' double integral over two straight lines,

        1 / (4 pi) int int (r_1 - r_2) . (dr_1 x dr_2) / |r_1 - r_2|^3,

    which is a solid angle over 4 pi: that of all directions from one line to the other. A
    segment of any length takes the same work; the original adds steps of 0.1 up.

    References
    ----------
    K. Klenin, J. Langowski, Computation of writhe in modeling of supercoiled DNA, Biopolymers 54
    (2000), method 1a.
    """
    dx, dy = AHEAD * velocity[0], AHEAD * velocity[1]
    a = place[0] - begin[0], place[1] - begin[1], -begin[2]
    b = a[0] + dx, a[1] + dy, a[2] + AHEAD
    c = place[0] - end[0], place[1] - end[1], -end[2]
    d = c[0] + dx, c[1] + dy, c[2] + AHEAD
    ab, bd, dc, ca = cross(a, b), cross(b, d), cross(d, c), cross(c, a)
    solid = (
        angle_between(ab, bd) + angle_between(bd, dc) + angle_between(dc, ca)
        + angle_between(ca, ab)
    )  # fmt: skip
    span = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
    sense = dot(cross((dx, dy, AHEAD), span), a)
    turns: float = np.sign(sense) * solid / (4.0 * np.pi)
    return turns


def add_segment(
    begin: Array, end: Array, places: Array, velocities: Array, moving: bool, signature: Array
) -> None:
    """Add what a straight segment contributes to the signature (M,).

    Parameters
    ----------
    begin, end : (3,), x, y (m) and t (s).
    places, velocities : (M, 2), of the obstacles.
    moving : add the turns about the lines in x, y, t; else the angle that the segment turns about
        each obstacle, rad.
    """
    for m in range(len(places)):
        if moving:
            signature[m] += turn_about(begin, end, places[m], velocities[m])
        else:
            ax, ay = begin[0] - places[m, 0], begin[1] - places[m, 1]
            bx, by = end[0] - places[m, 0], end[1] - places[m, 1]
            signature[m] += np.arctan2(ax * by - ay * bx, ax * bx + ay * by)


def signature_of(points: Array, places: Array, velocities: Array, moving: bool) -> Array:
    """Return the signature (M,) of a trajectory (n, 3) in x, y (m) and t (s)."""
    signature = np.zeros(len(places))
    for i in range(len(points) - 1):
        add_segment(points[i], points[i + 1], places, velocities, moving, signature)
    return signature


def alike(first: Array, second: Array, moving: bool, threshold: float) -> bool:
    """Return whether two signatures pass every obstacle at the same side.

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
    """Return whether a straight step keeps away from discs: centres (M, 2), radii (M,)."""
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
    """Return which vertex is joined to which, (V, V): by a step that leads ahead and keeps clear.

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
    depth, arrived, left = 0, True, MOST // max(1, len(places))
    while depth >= 0 and count < len(known) and left > 0:
        if arrived and joined[node[depth], goal]:
            left -= 1
            step_to(points, signature, depth, vertices[goal], speed, places, velocities, moving)
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
        left -= 1
        step_to(points, signature, depth, vertices[j], speed, places, velocities, moving)
        depth += 1
        node[depth], following[depth], used[j], arrived = j, 0, True, True
    return paths, count


def step_to(
    points: Array, signature: Array, depth: int, place: Array, speed: float, places: Array,
    velocities: Array, moving: bool,
) -> None:  # fmt: skip
    """Write a path's next point, x, y and t, behind the one at ``depth``, and its signature."""
    dx, dy = place[0] - points[depth, 0], place[1] - points[depth, 1]
    points[depth + 1, 0], points[depth + 1, 1] = place[0], place[1]
    points[depth + 1, 2] = points[depth, 2] + np.sqrt(dx * dx + dy * dy) / speed
    signature[depth + 1] = signature[depth]
    add_segment(points[depth], points[depth + 1], places, velocities, moving, signature[depth + 1])


@cache
def compiled() -> tuple[Callable[..., Any], ...]:
    """Return `signature_of`, `alike`, `connections` and `new_paths` as Numba compiles them."""
    inner = cross, dot, angle_between, turn_about, add_segment, alike, keeps_clear, step_to
    return cached_njit((signature_of, alike, connections, new_paths), inner)
