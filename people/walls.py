"""Walls around walkers: their distances, and the directions away from them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Self, final

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.polygon import Polygon, separation


@final
@dataclass(frozen=True, eq=False)
class WallField:
    """Static polygons that many points are held against at once.

    Parameters
    ----------
    polygons : W of them.
    """

    polygons: tuple[Polygon, ...] = ()

    @cached_property
    def _parts(self) -> tuple[Array, tuple[slice, ...]]:
        """Convex parts with as many vertices each, (K, V, 2), and which of them each polygon has.

        The last vertex is repeated.
        """
        found = [one.parts for one in self.polygons]
        most = max((len(part) for parts in found for part in parts), default=1)
        same = [
            np.concatenate([part, np.repeat(part[-1:], most - len(part), axis=0)])
            for parts in found
            for part in parts
        ]
        ends = np.cumsum([0, *map(len, found)]).tolist()
        rows = tuple(slice(first, last) for first, last in pairwise(ends))
        return np.reshape(same, (-1, most, 2)), rows

    def beside(self, places: Array) -> Array:
        """Distance of each point from each polygon, and unit vectors away, (N, W, 3).

        Distances (m) come first and are negative inside. Inside a polygon that is not convex all
        three belong to the convex part that holds the point.

        Parameters
        ----------
        places : (N, 2), m.
        """
        found = np.empty((len(places), len(self.polygons), 3))
        if not found.size:
            return found
        parts, rows = self._parts
        gaps, normals = separation(places[:, None, None], parts)
        every = np.arange(len(places))
        for wall, own in enumerate(rows):
            nearest = own.start + gaps[:, own].argmin(axis=1)
            found[:, wall, 0] = gaps[every, nearest]
            found[:, wall, 1:] = normals[every, nearest]
        return found

    def nearest(self, places: Array, count: int) -> Self:
        """Return the polygons that come nearest to any of the points (N, 2), at most ``count``."""
        if len(self.polygons) <= count:
            return self
        away = self.beside(places)[..., 0].min(axis=0, initial=np.inf)
        kept = np.sort(np.argsort(away, kind="stable")[:count])
        return type(self)(tuple(self.polygons[int(index)] for index in kept))


def away_from_walls(place: Array, polygons: Sequence[Polygon]) -> tuple[Array, Array]:
    """Signed distance of a point from each polygon, (W,), m, and unit vectors away, (W, 2)."""
    found = WallField(tuple(polygons)).beside(place[None])[0]
    return found[:, 0], found[:, 1:]
