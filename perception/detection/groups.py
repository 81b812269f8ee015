"""Which points of a scan belong to the same body."""

from importlib import import_module
from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from .hits import Hits, IntArray

MISSING = 2
"""Most beams without a hit between two neighbours of a group."""
REACH, CROWD = 0.3, 3
"""m and points: `by_density` joins points with at least `CROWD` others within `REACH`."""


def by_gap(hits: Hits, gap: float, growth: float | None = None) -> list[IntArray]:
    """Split the points, in the order of their bearings, at gaps that grow with the range.

    Neighbours belong together if at most `MISSING` beams between them met nothing and

    |p_i - p_j| < gap + growth r,   r the nearer range

    The last and the first point of a full turn are neighbours too.

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
    share = 2.0 * hits.spacing if growth is None else growth
    after = np.roll(np.arange(count), -1)
    apart = np.linalg.norm(hits.points[after] - hits.points, axis=1)
    nearer = np.minimum(hits.ranges[after], hits.ranges)
    between = np.mod(hits.beams[after] - hits.beams, max(hits.total, 1)) - 1
    joined = (apart < gap + share * nearer) & (between <= MISSING)
    joined[-1] &= hits.closed and count > 1
    if joined.all():
        return [np.arange(count)]
    first = int(np.argmin(joined)) + 1  # a group begins after the first break
    order = np.roll(np.arange(count), -first)
    breaks = np.flatnonzero(~joined[order][:-1]) + 1
    return [np.asarray(part, dtype=np.int64) for part in np.split(order, breaks)]


def by_density(hits: Hits) -> list[IntArray]:
    """Group the points by DBSCAN of scikit-learn, whatever their order.

    Points that have too few others around them belong to no group.

    References
    ----------
    Ester et al., "A density-based algorithm for discovering clusters", KDD 1996.
    """
    if not len(hits):
        return []
    labels: Array = density_library().DBSCAN(eps=REACH, min_samples=CROWD).fit(hits.points).labels_
    return [np.flatnonzero(labels == name) for name in range(int(labels.max()) + 1)]


def density_library() -> Any:
    """Return ``sklearn.cluster``.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module("sklearn.cluster")
    except ImportError as error:
        raise WideberthError(
            f"groups by density need scikit-learn ({error}); install it with: "
            "pip install 'wideberth[perception]', or choose groups: gap"
        ) from None


def width(points: Array) -> float:
    """Return the largest distance between two of the points, m."""
    if len(points) < 2:
        return 0.0
    apart = points[:, None] - points[None]
    return float(np.sqrt((apart**2).sum(axis=2).max()))
