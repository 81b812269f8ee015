"""Walls as simulators and maps describe them: boxes, segments and shapes, as convex polygons."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..framework.values.arrays import Array, checked, checked_rows, positive
from ..framework.values.errors import WideberthError
from ..framework.values.polygon import MOST_CORNERS, THIN, Polygon, convex_parts, width_across

STRAIGHT = 1e-6
"""m, by which segments that are joined may lie beside one line, or apart on it."""
THINNEST = 1e-5
"""m, least width of a wall."""

Corner = tuple[float, float]


def box(low: Corner, high: Corner, name: str = "") -> Polygon:
    """Return the rectangle between two corners, m."""
    (left, below), (right, above) = low, high
    return Polygon(((left, below), (right, below), (right, above), (left, above)), name)


def walls_around(low: Corner, high: Corner, thickness: float = 0.5) -> tuple[Polygon, ...]:
    """Return four walls outside of a rectangle, which keep a robot inside of it.

    Parameters
    ----------
    low, high : corners of the rectangle, m; the walls begin there.
    thickness : m; a robot that has passed a wall's middle is driven out on the other side.

    Raises
    ------
    WideberthError : a thickness that is not above zero.

    Examples
    --------
    >>> [wall.vertices[::2] for wall in walls_around((0.0, 0.0), (8.0, 6.0), 1.0)][0]
    ((-1.0, -1.0), (0.0, 7.0))
    """
    (left, below), (right, above) = low, high
    wide = positive("thickness", thickness)
    return (
        box((left - wide, below - wide), (left, above + wide), "left wall"),
        box((right, below - wide), (right + wide, above + wide), "right wall"),
        box((left, below - wide), (right, below), "lower wall"),
        box((left, above), (right, above + wide), "upper wall"),
    )


def walls_of_segments(segments: ArrayLike, width: float = 0.02) -> tuple[Polygon, ...]:
    """Cover line segments by rectangles, one for all that meet on one line.

    Each rectangle reaches ``width / 2`` beyond the segments, along them as across. Hence two laws:
    every segment is covered, and no point of a rectangle is farther than ``width`` from one. What
    closed outlines enclose stays free; `walls_of_shapes` of ``shapely.polygonize`` fills it.

    Parameters
    ----------
    segments : (S, 4), x1, y1, x2, y2, or (S, 2, 2), ends, m. One may have no length.
    width : m.

    Raises
    ------
    WideberthError : another shape, numbers that are not finite, a width below `THINNEST`.

    Examples
    --------
    >>> walls = walls_of_segments([[0, 0, 2, 0], [4, 0, 2, 0], [4, 0, 4, 3]], width=1.0)
    >>> [(wall.points.min(axis=0).tolist(), wall.points.max(axis=0).tolist()) for wall in walls]
    [([3.5, -0.5], [4.5, 3.5]), ([-0.5, -0.5], [4.5, 0.5])]
    """
    if np.ndim(segments) == 3:
        segments = np.reshape(checked("segments", segments, (None, 2, 2)), (-1, 4))
    ends = np.reshape(checked_rows("segments", segments, 4), (-1, 2, 2))
    if positive("width", width) < THINNEST:
        raise WideberthError(f"width is {width:g} m; wanted at least {THINNEST:g} m")
    return _named(_around(start, end, 0.5 * width) for start, end in _joined(ends))


def walls_of_shapes(shapes: Any, width: float = 0.02) -> tuple[Polygon, ...]:
    """Cut geometries of shapely into convex polygons; holes stay free.

    The polygons of one geometry tile it to within 1e-6 m. Geometries that
    overlap or touch give fewer polygons where ``shapely.union_all`` has joined them before.

    Parameters
    ----------
    shapes : one geometry or a sequence: polygons, with holes or without, lines, and collections.
    width : m, of what stands for a line, see `walls_of_segments`.

    Raises
    ------
    WideberthError : a geometry that is not valid, or is a point; numbers as of `Polygon`.

    Examples
    --------
    >>> import shapely
    >>> yard = shapely.difference(shapely.box(0, 0, 6, 6), shapely.box(2, 2, 4, 4))
    >>> sum(shapely.Polygon(wall.vertices).area for wall in walls_of_shapes(yard))
    32.0
    """
    import shapely

    parts: list[Array] = []
    lines: list[Array] = []
    for shape in shapely.get_parts(shapely.get_parts(np.atleast_1d(shapes))):
        if shape.is_empty:
            continue
        if not shapely.is_valid(shape):
            reason = shapely.is_valid_reason(shape)
            raise WideberthError(f"a shape is not valid ({reason}); see shapely.make_valid")
        if isinstance(shape, shapely.Polygon):
            parts += _tiles(shape)
        elif isinstance(shape, shapely.LineString):
            points = shapely.get_coordinates(shape)
            lines += [*np.stack([points[:-1], points[1:]], axis=1)]
        else:
            raise WideberthError(f"a shape is a {shape.geom_type}; wanted polygons or lines")
    return (*_named(parts), *walls_of_segments(np.reshape(lines, (-1, 4)), width))


def _tiles(shape: Any) -> list[Array]:
    """Return the convex parts of a polygon of shapely, each (V, 2), m."""
    import shapely

    sound = shapely.orient_polygons(shapely.simplify(shape, THIN))  # without repeated corners
    outer, *holes = (shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(sound))
    parts = convex_parts(outer, MOST_CORNERS, holes)
    return [part for part in parts if width_across(part) > THIN]


def _named(parts: Iterable[Array]) -> tuple[Polygon, ...]:
    """Return polygons with these corners, each (V, 2), m, named after their numbers."""
    return tuple(Polygon(tuple(map(tuple, part)), f"wall {i}") for i, part in enumerate(parts))


def _joined(ends: Array) -> list[tuple[Array, Array]]:
    """Return the ends of segments (S, 2, 2), of all that meet on one line together."""
    step = ends[:, 1] - ends[:, 0]
    length = np.hypot(step[:, 0], step[:, 1])
    found = []
    left = np.ones(len(ends), dtype=np.bool_)
    for i in np.argsort(-length, kind="stable"):
        if not left[i]:
            continue
        along = step[i] / length[i] if length[i] > 0.0 else np.array([1.0, 0.0])
        apart = ends - ends[i, 0]
        ahead, aside = apart @ along, apart @ np.array([-along[1], along[0]])
        mine = np.flatnonzero(left & (np.abs(aside) <= STRAIGHT).all(axis=1))
        left[mine] = False
        low, high = np.sort(ahead[mine], axis=1)[np.argsort(ahead[mine].min(axis=1))].T
        gaps = low[1:] > np.maximum.accumulate(high)[:-1] + STRAIGHT
        for some in np.split(np.arange(len(mine)), np.flatnonzero(gaps) + 1):
            reach = low[some].min(), high[some].max()
            found.append((ends[i, 0] + reach[0] * along, ends[i, 0] + reach[1] * along))
    return found


def _around(start: Array, end: Array, reach: float) -> Array:
    """Return the corners of the rectangle that lies ``reach`` m around a segment, (4, 2), m."""
    step = end - start
    length = float(np.hypot(*step))
    along = step / length if length > 0.0 else np.array([1.0, 0.0])
    along = reach * along
    aside = np.array([-along[1], along[0]])
    return np.array([start - along - aside, end + along - aside,
                     end + along + aside, start - along + aside])  # fmt: skip
