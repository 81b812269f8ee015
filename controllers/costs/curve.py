"""A path with rounded corners, as few numbers that a smooth expression is made of.

The polyline through the path's points c_j at arc lengths theta_0 + j h is rounded by the cubic
B-spline that has these points for its control points. With z = (theta - theta_0) / h, on the
segment k <= z < k + 1 and w = z - k::

    c = (c_{k-1} + 4 c_k + c_{k+1}) / 6 + (c_{k+1} - c_{k-1}) w / 2
        + (c_{k-1} - 2 c_k + c_{k+1}) w^2 / 2 + (-c_{k-1} + 3 c_k - 3 c_{k+1} + c_{k+2}) w^3 / 6

It is twice continuously differentiable, straight where the path is, with |c'| <= 1, and leaves a
corner of the polyline by h |d| / 6, d the change of the slope: 0.11 m at a right angle at the
paper's numbers. (A polyline of many points, a road, say, is left by its curvature times h^2 / 6.)
The corners are at multiples of h whatever the call, so that the curve does not move from one
call to the next. Beyond the last corner within reach, before the start and beyond the end of the
path, it goes straight on.

The point itself stops at the goal, theta = L, however far theta runs on::

    sigma(theta) = theta - h r((theta - L) / h)
    r(x) = (max(x + 1, 0)^3 - 2 max(x, 0)^3 + max(x - 1, 0)^3) / 6

so that the point's place is c(sigma) and its direction c'(sigma), which is no zero at the goal.

The segment is chosen by comparisons, whose derivatives are zero: derivatives of the expression are
then those of one cubic, a third of the operations that a sum over B-splines takes.

References: de Boor, A Practical Guide to Splines, chapter XI (Schoenberg's variation diminishing
approximation).
"""

from itertools import pairwise
from typing import Any

import numpy as np

from ...framework.numerics.symbolic import ca
from ...framework.values.arrays import Array
from ...framework.values.path import Path

_BEHIND = 2
"""Corners that lie behind the robot: it may have to back off."""

_BEYOND = 2
"""Points beyond the first and the last, on the straight continuation."""


def curve_width(knots: int, dimension: int) -> int:
    """How many numbers describe the curve: theta_0, h, L and the points."""
    return 3 + (knots + 2 + 2 * _BEYOND) * dimension


def lay_curve(path: Path, arc: float, reach: float, knots: int) -> Array:
    """Numbers of the curve around the next ``reach`` m of the path, (curve_width,).

    Parameters
    ----------
    path : to be rounded.
    arc : m, where the robot is along it.
    reach : m, how far a plan may come.
    knots : J, corners of the curve.
    """
    h = reach / (knots - _BEHIND - 2)  # one to spare before and behind
    first = np.floor(arc / h) - _BEHIND
    arcs = h * (first + np.arange(knots + 2, dtype=np.float64))
    beyond = arcs - np.clip(arcs, 0.0, path.length)
    points = path.at(arcs) + beyond[:, None] * path.direction(arcs)
    more = np.arange(1.0, _BEYOND + 1.0)[:, None]
    before = points[0] + more[::-1] * (points[0] - points[1])
    after = points[-1] + more * (points[-1] - points[-2])
    numbers = np.concatenate([before, points, after])
    return np.concatenate([[arcs[0], h, path.length], numbers.ravel()])


def curve_at(numbers: Any, theta: Any, knots: int) -> tuple[Any, Any, Any]:
    """Return expressions of the place c(sigma), the direction c'(sigma), (D,) each, and sigma'.

    Parameters
    ----------
    numbers : of `lay_curve`, symbolic.
    theta : m.
    knots : J.
    """
    begin, h, end = ca.vertsplit(numbers[:3])
    points = ca.vertsplit(numbers[3:], (numbers.numel() - 3) // (knots + 2 + 2 * _BEYOND))
    arc, share = _stopped(theta, end, h)
    z = (arc - begin) / h
    w, corners = z + 1.0, points[:4]
    steps = [after - before for before, after in pairwise(points)]
    for j in range(knots + 2):
        on = z >= j
        w -= on
        corners = [corner + on * steps[j + q] for q, corner in enumerate(corners)]
    first, second, third = (after - before for before, after in pairwise(corners))
    middle, bend = 0.5 * (first + second), second - first
    change = third - 2.0 * second + first
    place = corners[1] + bend / 6.0 + w * (middle + w * (0.5 * bend + w / 6.0 * change))
    return place, (middle + w * (bend + 0.5 * w * change)) / h, share


def _stopped(theta: Any, end: Any, h: Any) -> tuple[Any, Any]:
    """Return sigma and its derivative."""
    x = (theta - end) / h
    ramps = [(factor, ca.fmax(x + k, 0.0)) for k, factor in ((1.0, 1.0), (0.0, -2.0), (-1.0, 1.0))]
    arc = theta - h / 6.0 * sum(factor * ramp**3 for factor, ramp in ramps)
    return arc, 1.0 - 0.5 * sum(factor * ramp**2 for factor, ramp in ramps)
