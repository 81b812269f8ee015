"""Which points of a scan belong to the same body."""

from itertools import pairwise
from math import log, sqrt

import numpy as np

from wideberth.framework.values.arrays import Array

from .hits import Hits, IntArray

MISSING = 2
"""Most beams without a hit between two neighbours of a group."""


def by_gap(hits: Hits, gap: float, growth: float | None = None) -> list[IntArray]:
    """Split the points, in the order of their bearings, at gaps that grow with the range.

    Neighbours belong together if at most `MISSING` beams lie between them and

        |p_i - p_j| < (1 + l) (gap + growth r),   r the nearer range, l the lost beams between

    The last and the first point of a full turn are neighbours too.

    Beams that met nothing do not count as lost, since they passed through. A lost beam leaves an
    outline whole: the distance between its neighbours is that of two pairs of points.

    Parameters
    ----------
    gap : m.
    growth : per m of range; by default twice the angle between two beams.

    Returns
    -------
    Indices of the points of each group, by bearing.

    References
    ----------
    Borges and Aldon, "Line extraction in 2D range images for mobile robotics", J. Intell.
    Robot. Syst. 2004 (breakpoints that adapt to the range).
    """
    count = len(hits)
    if not count:
        return []
    after = np.roll(np.arange(count), -1)
    share = 2.0 * hits.spacing if growth is None else growth
    apart = np.linalg.norm(hits.points[after] - hits.points, axis=1)
    nearer = np.minimum(hits.ranges[after], hits.ranges)
    between = np.mod(hits.beams[after] - hits.beams, max(hits.total, 1)) - 1
    reach = (1.0 + hits.lost[after]) * (gap + share * nearer)
    joined = (apart < reach) & (between <= MISSING)
    joined[-1] &= hits.closed and count > 1
    if joined.all():
        return [np.arange(count)]
    first = int(np.argmin(joined)) + 1  # a group begins after the first break
    order = np.roll(np.arange(count), -first)
    breaks = np.flatnonzero(~joined[order][:-1]) + 1
    return [np.asarray(part, dtype=np.int64) for part in np.split(order, breaks)]


def at_notches(hits: Hits, index: IntArray, depth: float) -> list[IntArray]:
    """Split a group where its outline goes back between two bodies.

    The points that a convex body shows lie on the side of their convex hull that faces the
    sensor. The point farthest behind that side, by more than ``depth``, is between two bodies
    that stand side by side; it goes with the nearer of its neighbours.

    Parameters
    ----------
    hits : of a scan.
    index : of the points of a group, by bearing.
    depth : m.

    Returns
    -------
    Indices of the points of each part, by bearing.
    """
    points = hits.points[index]
    behind = _behind_the_face(points)
    at = int(behind.argmax())
    if behind[at] <= depth:
        return [index]
    before, after = np.linalg.norm(np.diff(points[at - 1 : at + 2], axis=0), axis=1)
    cut = at + 1 if before < after else at
    return at_notches(hits, index[:cut], depth) + at_notches(hits, index[cut:], depth)


def deepest_of_noise(points: int) -> float:
    """Return how deep a notch the noise makes in a smooth outline, in deviations of a range.

    The largest of n normal numbers is about sqrt(2 ln n). The hull passes through the outermost
    points, and the notch is at the innermost one: twice as much, and one for good measure.

    Parameters
    ----------
    points : n, of the group.
    """
    return 1.0 + 2.0 * sqrt(2.0 * log(max(points, 2)))


def _behind_the_face(points: Array) -> Array:
    """Distance of points, by increasing bearing, behind the face of their hull, (n,), m."""
    face: list[int] = []
    for last, (x, y) in enumerate(points.tolist()):
        while len(face) > 1:
            (ax, ay), (bx, by) = points[face[-2]].tolist(), points[face[-1]].tolist()
            if (bx - ax) * (y - by) - (by - ay) * (x - bx) < 0.0:  # it bulges at b
                break
            face.pop()
        face.append(last)
    found = np.zeros(len(points))
    for begin, end in pairwise(face):
        along, away = points[end] - points[begin], points[begin:end] - points[begin]
        cross = along[0] * away[:, 1] - along[1] * away[:, 0]
        found[begin:end] = np.abs(cross) / max(float(np.hypot(*along)), 1e-9)
    return found


def width(points: Array) -> float:
    """Return the largest distance between two of the points, m."""
    if len(points) < 2:
        return 0.0
    apart = points[:, None] - points[None]
    return float(np.sqrt((apart**2).sum(axis=2).max()))
