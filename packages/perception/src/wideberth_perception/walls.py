"""Convex polygons behind segments of what stands still."""

from math import hypot

import numpy as np

from wideberth.framework.values.arrays import FARTHEST, Array
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.sensing.perceived import Segments

STRAIGHT = 0.05
"""m, by which the ends of segments that are joined may lie beside one line."""
DEPTH = 0.1
"""m, of the polygon behind what was met: how thick a wall is cannot be seen."""
SURE = 3.0
"""Deviations by which a polygon begins before its segment."""


def walls_behind(segments: Segments, sensor: Array, gap: float) -> tuple[Polygon, ...]:
    """Cover segments by rectangles that lie behind them.

    Segments that are neighbours as seen from the sensor, no more than ``gap`` apart and straight
    together, are joined: the parts of a wall that lost beams have cut. Each rectangle begins
    `SURE` deviations of the segment's ends before it and reaches `DEPTH` behind it.

    Parameters
    ----------
    segments : S of them, in any order.
    sensor : (2,), m, from where they were seen.
    gap : m; what the robot cannot pass through, it need not see through.

    Returns
    -------
    polygons : at most S rectangles, named "wall 0", "wall 1" and so on; none that would reach
        beyond `FARTHEST`.
    """
    corners = [_rectangle(*some, sensor) for some in _joined(segments, sensor, gap)]
    within = [some for some in corners if np.abs(some).max() <= FARTHEST]
    return tuple(
        Polygon(tuple(map(tuple, some.tolist())), f"wall {i}") for i, some in enumerate(within)
    )


def _joined(segments: Segments, sensor: Array, gap: float) -> list[tuple[Array, Array]]:
    """Return ends (E, 2) and their deviations (E,) of segments, of several where they line up."""
    if not len(segments):
        return []
    away = segments.ends.mean(axis=1) - sensor
    order = np.argsort(np.arctan2(away[:, 1], away[:, 0]), kind="stable")
    ends = segments.ends[order]
    sure = np.sqrt(np.diagonal(segments.covariance, axis1=1, axis2=2))[order]
    apart = np.linalg.norm(ends[:, 0] - np.roll(ends[:, 1], 1, axis=0), axis=1)
    first = int(apart.argmax())  # begin behind the widest gap: the seam of the angles is no end
    found: list[tuple[Array, Array]] = []
    for i in np.roll(np.arange(len(ends)), -first):
        if found and apart[i] <= gap:
            both = np.concatenate([found[-1][0], ends[i]])
            if np.abs((both - both[0]) @ _normal(both, sensor)).max() <= STRAIGHT:
                found[-1] = both, np.concatenate([found[-1][1], sure[i]])
                continue
        found.append((ends[i], sure[i]))
    return found


def _normal(ends: Array, sensor: Array) -> Array:
    """Return the unit vector across the chord of some ends, away from the sensor, (2,)."""
    along = ends[np.linalg.norm(ends - ends[0], axis=1).argmax()] - ends[0]
    length = hypot(*along)
    normal = np.array([-along[1], along[0]]) if length > 1e-9 else ends[0] - sensor
    normal = normal if normal @ (ends[0] - sensor) >= 0.0 else -normal
    length = hypot(*normal)
    return normal / length if length > 1e-9 else np.array([1.0, 0.0])


def _rectangle(ends: Array, sure: Array, sensor: Array) -> Array:
    """Return the corners of a rectangle that covers segments on a line, (4, 2)."""
    normal = _normal(ends, sensor)
    along = np.array([normal[1], -normal[0]])
    across, ahead = ends @ normal, ends @ along
    near, far = (across - SURE * sure).min(), across.max() + DEPTH
    low, high = ahead.min(), ahead.max()
    if high - low < DEPTH:
        middle = 0.5 * (low + high)
        low, high = middle - 0.5 * DEPTH, middle + 0.5 * DEPTH
    places = ((near, low), (near, high), (far, high), (far, low))
    return np.array([u * normal + v * along for u, v in places])
