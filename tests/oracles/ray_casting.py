"""Rays on discs and polygons, one after the other by the textbook: slow and plain."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan


def disc_range(origin: Array, unit: Array, centre: Array, radius: float) -> Array:
    """Distance to a circle along rays, (n,), m; infinite where they miss it."""
    away = np.asarray(centre) - origin
    along = (away * unit).sum(axis=-1)
    squared = radius**2 - ((away**2).sum(axis=-1) - along**2)
    with np.errstate(invalid="ignore"):
        found = along - np.sqrt(squared)
    return np.where((squared >= 0.0) & (found > 0.0), found, np.inf)


def side_range(origin: Array, unit: Array, first: Array, second: Array) -> Array:
    """Distance to a straight side along rays, (n,), m; infinite where they miss it."""
    along, away = np.asarray(second) - first, np.asarray(first) - origin
    cross = unit[..., 0] * along[1] - unit[..., 1] * along[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (away[..., 0] * along[1] - away[..., 1] * along[0]) / cross
        share = (away[..., 0] * unit[..., 1] - away[..., 1] * unit[..., 0]) / cross
    return np.where((share >= 0.0) & (share <= 1.0) & (found > 0.0), found, np.inf)


def box_corners(centre: Array, half: tuple[float, float], heading: float) -> Array:
    """Corners of a box, (4, 2), m."""
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.asarray(half)
    return np.asarray(corners @ turn.T + centre)


def cast(
    poses: Array,
    bearings: Array,
    discs: list[tuple[Array, float]],
    polygons: list[Array],
    longest: float = 15.0,
) -> Array:
    """True range of each beam, (B,), m, from poses (B, 3); infinite where nothing stands.

    A disc's centre may be (B, 2): where it is at the instant of each beam.
    """
    angle = poses[:, 2] + bearings
    unit, origin = np.stack([np.cos(angle), np.sin(angle)], axis=-1), poses[:, :2]
    found = np.full(len(angle), np.inf)
    for centre, radius in discs:
        found = np.minimum(found, disc_range(origin, unit, centre, radius))
    for corners in polygons:
        for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            found = np.minimum(found, side_range(origin, unit, first, second))
    return np.where(found <= longest, found, np.inf)


def scan_of(
    poses: Array,
    rng: np.random.Generator,
    discs: list[tuple[Array, float]],
    polygons: list[Array] | None = None,
    *,
    end: float = 0.1,
    deviation: float = 0.01,
    dropped: float = 0.0,
) -> Scan:
    """One turn of a LiDAR of as many beams as there are poses, over the last 0.1 s before an end.

    Parameters
    ----------
    poses : (B, 3), of the robot at each beam; the sensor is at its centre.
    dropped : share of the beams that are lost.
    """
    count = len(poses)
    bearings = -np.pi + 2.0 * np.pi * np.arange(count) / count
    ranges = cast(poses, bearings, discs, polygons or [])
    ranges = ranges + deviation * rng.standard_normal(count)
    ranges = np.where(rng.random(count) < dropped, np.nan, ranges)
    times = end - 0.1 * (count - 1 - np.arange(count)) / count
    return Scan("lidar", times, bearings, ranges, deviation, 15.0)
