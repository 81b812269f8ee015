"""Rays of a planar LiDAR: measured ones, or cast against discs and polygons."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import final

import numpy as np

from wideberth.framework.values.arrays import FARTHEST, Array, BoolArray
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan


@final
@dataclass(frozen=True, eq=False)
class Rays:
    """Rays from one place, and how far each is free.

    Attributes
    ----------
    origin : (2,), m.
    directions : (B, 2), unit vectors.
    ranges : (B,), m, to what each met; infinite where nothing is near enough; NaN where lost.
    longest : m, beyond which nothing is seen.
    """

    origin: Array
    directions: Array
    ranges: Array
    longest: float

    @property
    def met(self) -> BoolArray:
        """Which rays met something, (B,)."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.ranges > 0.0) & (self.ranges <= self.longest))

    @property
    def free(self) -> BoolArray:
        """Which rays met nothing, (B,); lost ones did not."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.ranges > self.longest)

    @classmethod
    def of_scan(cls, scan: Scan, pose: Array) -> "Rays":
        """Return the rays of a scan by a robot that stood at a pose (3,)."""
        placed = scan.beams(np.tile(pose, (len(scan.times), 1)))
        directions = np.stack([np.cos(placed.directions), np.sin(placed.directions)], axis=1)
        origin = placed.origins[0] if len(directions) else pose[:2]
        ranges = np.where(placed.known, scan.ranges, np.nan)
        return cls(origin, directions, ranges, min(scan.longest, FARTHEST))

    @classmethod
    def cast(
        cls, origin: Array, centres: Array, radii: Array, polygons: Sequence[Polygon],
        longest: float = 12.0, beams: int = 360,
    ) -> "Rays":  # fmt: skip
        """Cast rays at equal angles against what is known to stand around.

        Parameters
        ----------
        origin : (2,), m.
        centres, radii : (O, 2) and (O,), m, of discs; one that holds the origin is not seen.
        polygons : their edges are seen from both sides.
        longest : m.
        beams : number of rays; the first points along x.
        """
        angle = 2.0 * np.pi / beams * np.arange(beams)
        directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ranges = ranges_along(origin, directions, centres, radii, polygons)
        return cls(origin, directions, np.where(ranges <= longest, ranges, inf), longest)


def ranges_along(
    origin: Array, directions: Array, centres: Array, radii: Array, polygons: Sequence[Polygon]
) -> Array:
    """Return how far rays in some directions are free, (B,), m; arguments as of `Rays.cast`.

    Parameters
    ----------
    directions : (B, 2), unit vectors.
    """
    near = (np.abs(centres) <= FARTHEST).all(axis=1) & (radii <= FARTHEST)
    discs = _to_discs(directions, centres[near] - origin, radii[near])
    return np.minimum(discs, _to_edges(directions, origin, polygons))


def _to_discs(directions: Array, centres: Array, radii: Array) -> Array:
    """Distance along each ray to the nearest disc, (B,), m; infinite where there is none."""
    if not len(centres):
        return np.full(len(directions), inf)
    along = directions @ centres.T
    outside = (centres**2).sum(axis=1) - radii**2
    root = along**2 - outside
    seen = (root >= 0.0) & (along > 0.0) & (outside > 0.0)
    found = np.where(seen, along - np.sqrt(np.maximum(root, 0.0)), inf)
    return np.asarray(found.min(axis=1))


def _to_edges(directions: Array, origin: Array, polygons: Sequence[Polygon]) -> Array:
    """Distance along each ray to the nearest edge, (B,), m; infinite where there is none."""
    if not polygons:
        return np.full(len(directions), inf)
    begin = np.concatenate([one.points for one in polygons]) - origin
    end = np.concatenate([np.roll(one.points, -1, axis=0) for one in polygons]) - origin
    edge = end - begin
    across = directions[:, :1] * edge[:, 1] - directions[:, 1:] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (begin[:, 0] * edge[:, 1] - begin[:, 1] * edge[:, 0]) / across
        share = (begin[:, 0] * directions[:, 1:] - begin[:, 1] * directions[:, :1]) / across
    seen = (across != 0.0) & (far > 0.0) & (share >= 0.0) & (share <= 1.0)
    return np.asarray(np.where(seen, far, inf).min(axis=1))
