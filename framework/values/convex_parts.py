"""Cutting a simple polygon into convex parts."""

import numpy as np

from .arrays import Array

_FLAT = 1e-10
"""m. A vertex that stands out less from the line between its neighbours is left out."""

Ring = list[int]


def convex_parts(points: Array, corners: int) -> tuple[Array, ...]:
    """Convex parts that tile a simple polygon.

    A constrained Delaunay triangulation; then its diagonals are taken in order of length, the
    longest first, and one is removed where the two parts beside it form a convex part. There
    are then at most four times as many parts as in the best cut, mostly far fewer. A part of
    more than ``corners`` vertices is halved between opposite ones until it fits.

    Parameters
    ----------
    points : (V, 2), m, counter-clockwise, a simple polygon.
    corners : most vertices of a part, at least 3.

    Returns
    -------
    parts : each (V, 2), m, counter-clockwise, without vertices on a straight line.

    References
    ----------
    S. Hertel and K. Mehlhorn, Fast triangulation of simple polygons, FCT 1983 (BibTeX key
    hertel1983triangulation), for the merging and its bound.
    """
    points = points[_pruned(points, list(range(len(points))))]
    parts = [list(range(len(points)))]
    if not _convex(points, parts[0]):
        parts = _triangles(points)
        for edge in _diagonals(points, parts):
            first, second = (part for part in parts if edge <= set(part))
            merged = _merged(first, second, edge)
            if _convex(points, merged):
                parts[parts.index(first)] = merged
                parts.remove(second)
    kept = [half for part in parts for half in _halved(_pruned(points, part), corners)]
    return tuple(points[part] for part in kept)


def _halved(ring: Ring, corners: int) -> list[Ring]:
    """Cut a convex ring until each piece has at most this many vertices."""
    if len(ring) <= corners:
        return [ring]
    middle = len(ring) // 2
    pieces = ring[: middle + 1], [*ring[middle:], ring[0]]
    return [half for piece in pieces for half in _halved(piece, corners)]


def _triangles(points: Array) -> list[Ring]:
    """Constrained Delaunay triangles as counter-clockwise indices of the points."""
    import shapely

    index = {(float(x), float(y)): place for place, (x, y) in enumerate(points)}
    found = shapely.constrained_delaunay_triangles(shapely.Polygon(points)).geoms
    rings = []
    for triangle in found:
        corners = shapely.get_coordinates(triangle)[:3]
        ring = [index[float(x), float(y)] for x, y in corners]
        if _heights(points, ring)[0] < 0.0:
            ring.reverse()
        first = ring.index(min(ring))
        rings.append(ring[first:] + ring[:first])
    return sorted(rings)


def _diagonals(points: Array, triangles: list[Ring]) -> list[frozenset[int]]:
    """Edges that two triangles share, the longest first."""
    seen: set[frozenset[int]] = set()
    shared = []
    for ring in triangles:
        for edge in map(frozenset, zip(ring, ring[1:] + ring[:1], strict=True)):
            if edge in seen:
                shared.append(edge)
            seen.add(edge)
    return sorted(
        shared,
        key=lambda edge: (
            -np.ptp(points[sorted(edge)], axis=0) @ np.ptp(points[sorted(edge)], axis=0),
            sorted(edge),
        ),
    )


def _merged(first: Ring, second: Ring, edge: frozenset[int]) -> Ring:
    """Join two rings along an edge, which runs a -> b in the first and b -> a in the second."""
    place = next(i for i, a in enumerate(first) if {a, first[i - 1]} == edge)
    start, end = first[place], first[place - 1]  # the first ring without the edge: start .. end
    around = first[place:] + first[:place]
    other = second.index(end)
    beyond = second[other:] + second[:other]  # end .. start
    assert beyond[-1] == start
    return around + beyond[1:-1]


def _heights(points: Array, ring: Ring) -> Array:
    """How far each vertex stands out over the line between its neighbours, m."""
    here = points[ring]
    before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
    chord, arm = after - before, here - before
    twice = arm[:, 0] * chord[:, 1] - arm[:, 1] * chord[:, 0]
    length = np.hypot(chord[:, 0], chord[:, 1])
    return np.divide(twice, length, out=np.copysign(np.inf, twice), where=length > 0.0)


def _convex(points: Array, ring: Ring) -> bool:
    return bool((_heights(points, ring) > -_FLAT).all())


def _pruned(points: Array, ring: Ring) -> Ring:
    """Leave out vertices on a straight line, the flattest first."""
    ring = list(ring)
    while len(ring) > 3:
        heights = np.abs(_heights(points, ring))
        flattest = int(heights.argmin())
        if heights[flattest] > _FLAT:
            break
        del ring[flattest]
    return ring
