"""Convex polygons that cover the occupied cells of a map, walls for the MPC; and the way back."""

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np

from ..framework.values.arrays import Array, BoolArray, positive, whole
from ..framework.values.occupancy_grid import (
    FREE_CELL,
    OCCUPIED_CELL,
    UNKNOWN_CELL,
    OccupancyGrid,
)
from ..framework.values.polygon import MOST_CORNERS, Polygon, convex_parts

Ring = list[int]


def convex_polygons(
    grid: OccupancyGrid,
    tolerance: float,
    lethal_threshold: int = OCCUPIED_CELL,
    unknown: bool = False,
) -> tuple[Polygon, ...]:
    """Cover the occupied cells of a map by few convex polygons.

    The outlines of the occupied cells are simplified outwards: a corner that points into the
    cells is left out where all that the new edge skips lies behind it, by no more than
    the tolerance, and the outline stays simple; the least deviation comes first. What is left is
    cut into convex parts. Hence two laws: the polygons cover every occupied cell whole, and no
    point of them is farther than the tolerance from an occupied cell. Cells that touch at a
    corner alone belong to different polygons unless the tolerance closes the gap.

    Parameters
    ----------
    grid : the map.
    tolerance : m; 0 keeps the outlines of the cells.
    lethal_threshold : percent from which a cell is occupied, 1 to 100.
    unknown : whether unknown cells are covered as well.

    Returns
    -------
    polygons : convex, without overlap within one outline, each with at most `MOST_CORNERS`
        vertices; named after their number.

    Raises
    ------
    WideberthError : a tolerance that is negative, a threshold below 1.

    Examples
    --------
    >>> stairs = OccupancyGrid(100 * np.tri(4, dtype=int), resolution=0.5)
    >>> [len(convex_polygons(stairs, tolerance)) for tolerance in (0.0, 0.4)]
    [5, 1]
    """
    least = whole("lethal_threshold", lethal_threshold)
    occupied = grid.cells >= least
    if unknown:
        occupied |= grid.cells == UNKNOWN_CELL
    reach = positive("tolerance", tolerance, zero=True) / grid.resolution
    found: list[Array] = []
    for rings in outlines(occupied):
        outer, *holes = _Outline.of(rings).simplified(reach)
        found += convex_parts(outer, MOST_CORNERS, holes)
    return tuple(
        Polygon(tuple(map(tuple, grid.origin + grid.resolution * part)), f"wall {i}")
        for i, part in enumerate(found)
    )


def grid_of_polygons(
    polygons: Sequence[Polygon], places: Array, beyond: float, resolution: float
) -> OccupancyGrid:
    """Return the map on which polygons stand; a cell is free only if none is in it.

    Parameters
    ----------
    polygons : what stands there. places : (K, 2), m, that the map shows beside them.
    beyond : m, by which it reaches beyond them all. resolution : m, of its cells.

    Examples
    --------
    >>> wall = Polygon([[0.25, 0.25], [0.75, 0.25], [0.75, 0.75], [0.25, 0.75]])
    >>> grid = grid_of_polygons([wall], np.array([[3.0, 1.0]]), 0.25, 0.5)
    >>> grid
    OccupancyGrid(7 x 3 cells of 0.5 m from (0, 0))
    >>> grid.cells[:2].tolist()
    [[100, 100, 0, 0, 0, 0, 0], [100, 100, 0, 0, 0, 0, 0]]
    """
    import shapely

    points = np.concatenate([places, *(one.points for one in polygons)])
    low = points.min(axis=0) - beyond
    height, width = np.ceil((points.max(axis=0) + beyond - low) / resolution)[::-1]
    rows, columns = np.mgrid[: int(height), : int(width)]
    x, y = low[:, None, None] + resolution * (np.stack([columns, rows]) + 0.5)
    shapes = shapely.union_all([shapely.Polygon(one.points) for one in polygons])
    reach = resolution / np.sqrt(2.0)
    around = shapely.buffer(shapes, 1.1 * reach)  # a point of shapely for each cell takes long
    shapely.prepare([shapes, around])
    taken = shapely.intersects_xy(shapes, x, y)
    near = shapely.intersects_xy(around, x, y) & ~taken
    taken[near] = shapely.dwithin(shapes, shapely.points(x[near], y[near]), reach)
    cells = np.where(taken, OCCUPIED_CELL, FREE_CELL)
    return OccupancyGrid(cells, resolution, (float(low[0]), float(low[1])))


def outlines(occupied: BoolArray) -> list[list[Array]]:
    """Outlines of groups of cells that share sides, in columns and rows.

    Parameters
    ----------
    occupied : (height, width).

    Returns
    -------
    groups : of each the corners (V, 2) of its outer ring, counter-clockwise, and of its holes,
        clockwise; none on a straight line.
    """
    import shapely

    rows = np.pad(occupied.astype(np.int8), ((0, 0), (1, 1)))
    turns = np.diff(rows, axis=1)
    row, begin = np.nonzero(turns == 1)
    _, end = np.nonzero(turns == -1)
    together = shapely.union_all(shapely.box(begin, row, end, row + 1))
    groups = shapely.get_parts(shapely.orient_polygons(together))
    return [
        [_corners(shapely.get_coordinates(ring)[:-1]) for ring in shapely.get_rings(group)]
        for group in groups
    ]


def _corners(ring: Array) -> Array:
    """Return the points of a ring where it turns."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    return np.asarray(ring[before[:, 0] * after[:, 1] != before[:, 1] * after[:, 0]])


@dataclass(frozen=True, eq=False)
class _Outline:
    """The rings of one polygon while corners are left out; its inside is to their left.

    Attributes
    ----------
    points : (N, 2), corners of all rings.
    before, after : neighbours of each corner on its ring; -1 once it has been left out.
    skipped : corners that the edge behind each corner skips.
    firsts : number of the first corner of each ring.
    """

    points: Array
    before: Ring
    after: Ring
    skipped: list[Ring]
    firsts: Ring

    @classmethod
    def of(cls, rings: list[Array]) -> "_Outline":
        """Return the outline that has all corners of some rings."""
        before, after, firsts = Ring(), Ring(), Ring()
        for ring in rings:
            first, count = len(before), len(ring)
            firsts.append(first)
            before += [first + (i - 1) % count for i in range(count)]
            after += [first + (i + 1) % count for i in range(count)]
        points = np.concatenate(rings)
        return cls(points, before, after, [[] for _ in points], firsts)

    def simplified(self, reach: float) -> list[Array]:
        """Leave out the corners that point inwards by at most ``reach``; return the rings left.

        A hole that is lower than that disappears.
        """
        waiting = [entry for i in range(len(self.points)) if (entry := self._entry(i, reach))]
        heapify(waiting)
        while waiting:
            _, i, before, after = heappop(waiting)
            if (self.before[i], self.after[i]) != (before, after) or self._in_the_way(i):
                continue
            self.skipped[before] += [i, *self.skipped[i]]
            self.after[before], self.before[after] = after, before
            self.before[i] = self.after[i] = -1
            if self.after[after] == before:  # two corners are left of a hole
                for j in (before, after):
                    self.before[j] = self.after[j] = -1
                continue
            for j in (before, after):
                if entry := self._entry(j, reach):
                    heappush(waiting, entry)
        bounds = zip(self.firsts, [*self.firsts[1:], len(self.points)], strict=True)
        rings = (self._ring(first, last) for first, last in bounds)
        return [ring for ring in rings if len(ring)]

    def _entry(self, i: int, reach: float) -> tuple[float, int, int, int] | None:
        """Return a corner that may be left out, with how far the outline would move, or None."""
        before, after = self.before[i], self.after[i]
        start, corner, end = self.points[[before, i, after]]
        along, arm = end - start, corner - start
        if arm[0] * along[1] - arm[1] * along[0] >= 0.0:  # it points outwards
            return None
        behind = self.points[[i, *self.skipped[before], *self.skipped[i]]] - start
        share = np.clip(behind @ along / (along @ along), 0.0, 1.0)
        gap = behind - share[:, None] * along
        far = float(np.sqrt((gap**2).sum(axis=1).max()))
        return (far, i, before, after) if far <= reach else None

    def _in_the_way(self, i: int) -> bool:
        """Tell whether another corner lies in the triangle that leaving one out would add."""
        mine = [self.before[i], i, self.after[i]]
        corners = self.points[mine]
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = ((self.points >= low) & (self.points <= high)).all(axis=1)
        near[mine] = False
        others = [j for j in np.flatnonzero(near) if self.after[j] >= 0]
        if not others:
            return False
        place = self.points[others]
        inside = np.ones(len(others), dtype=np.bool_)
        for a, b in ((0, 2), (2, 1), (1, 0)):  # counter-clockwise, since the corner points inwards
            side, arm = corners[b] - corners[a], place - corners[a]
            inside &= side[0] * arm[:, 1] - side[1] * arm[:, 0] >= 0.0
        return bool(inside.any())

    def _ring(self, first: int, last: int) -> Array:
        """Return the corners that are left of the ring with these numbers."""
        start = next((i for i in range(first, last) if self.after[i] >= 0), None)
        if start is None:
            return np.empty((0, 2))
        ring, i = [start], self.after[start]
        while i != start:
            ring.append(i)
            i = self.after[i]
        return np.asarray(self.points[ring])
