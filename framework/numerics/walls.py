"""Convex polygons behind the points that a scan met on walls."""

from math import hypot

import numpy as np

from ..values.arrays import Array
from ..values.polygon import Polygon

STRAIGHT = 0.05
"""m, by which the points of one straight piece may lie beside it."""
DEPTH = 0.1
"""m, of the polygon behind what was met: how thick a wall is cannot be seen."""


def walls_behind(points: Array, sensor: Array, gap: float) -> tuple[Polygon, ...]:
    """Cover points on walls by convex polygons that lie behind them.

    Points that are neighbours as seen from the sensor, and no more than ``gap`` apart, are
    joined. Each such line is split where a point lies farther than `STRAIGHT` from the chord of
    its ends (Douglas and Peucker), until all pieces are straight. A piece becomes a rectangle that
    reaches from its point nearest to the sensor `DEPTH` behind its farthest one, so that every
    point is covered.

    Parameters
    ----------
    points : (S, 2), m, in any order.
    sensor : (2,), m, from where they were seen.
    gap : m; what the robot cannot pass through, it need not see through.

    Returns
    -------
    polygons : rectangles, named "wall 0", "wall 1" and so on.
    """
    if not len(points):
        return ()
    away = points - sensor
    azimuth = np.arctan2(away[:, 1], away[:, 0])
    points = points[np.argsort(azimuth, kind="stable")]
    apart = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1)
    if len(points) > 2:  # begin behind the widest gap: the seam of the angles is no end
        first = int(apart.argmax())
        points, apart = np.roll(points, -first, axis=0), np.roll(apart, -first)
    ends = np.flatnonzero(apart[1:] > gap) + 1
    pieces = [piece for line in np.split(points, ends) for piece in _straight(line)]
    corners = [_rectangle(piece, sensor) for piece in pieces]
    return tuple(
        Polygon(tuple(map(tuple, some.tolist())), f"wall {i}") for i, some in enumerate(corners)
    )


def _straight(line: Array) -> list[Array]:
    """Split a line of points into straight pieces; neighbours share a point."""
    found, waiting = [], [line]
    while waiting:
        piece = waiting.pop()
        aside = np.abs((piece - piece[0]) @ _normal(piece))
        worst = int(aside.argmax())
        if aside[worst] <= STRAIGHT:
            found.append(piece)
        else:
            waiting += [piece[worst:], piece[: worst + 1]]
    return found


def _normal(piece: Array) -> Array:
    """Return the unit vector across the chord of a piece, (2,)."""
    along = piece[-1] - piece[0]
    length = hypot(*along)
    if length < 1e-9:  # a single point, or a loop: across the way to its farthest point
        along = piece[np.linalg.norm(piece - piece[0], axis=1).argmax()] - piece[0]
        length = hypot(*along)
    if length < 1e-9:
        return np.array([1.0, 0.0])
    return np.array([-along[1], along[0]]) / length


def _rectangle(piece: Array, sensor: Array) -> Array:
    """Return the corners of a rectangle that covers a straight piece, (4, 2)."""
    normal = _normal(piece)
    if normal @ (piece[0] - sensor) < 0.0:
        normal = -normal
    along = np.array([normal[1], -normal[0]])
    across, ahead = piece @ normal, piece @ along
    near, far = across.min(), across.max() + DEPTH
    low, high = ahead.min(), ahead.max()
    if high - low < DEPTH:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * DEPTH, middle + 0.5 * DEPTH
    places = ((near, low), (near, high), (far, high), (far, low))
    return np.array([u * normal + v * along for u, v in places])
