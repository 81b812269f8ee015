"""Static polygons, their convex parts, and signed distances between convex bodies."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from .arrays import FARTHEST, Array, checked, settle, whole
from .errors import WideberthError
from .roots import symmetric_root

MOST_CORNERS = 16
"""Vertices of the largest convex part that the MPC has room for."""
THIN = 1e-6
"""m. What is thinner has no sides that a normal could be computed of."""
_ANGLES = 32
"""Directions of either kind from which `best_direction` starts."""


@final
@dataclass(frozen=True)
class Polygon:
    """A simple polygon, convex or not: an obstacle without uncertainty.

    Parameters
    ----------
    vertices : corners in the world frame, m, in either orientation, the first not repeated at
        the end; kept counter-clockwise from the first one.
    name : for messages and plans.

    Raises
    ------
    WideberthError : fewer than three vertices, not (V, 2) finite numbers, beyond `FARTHEST`, a
        vertex closer than 1e-6 m to the one before it, all of it thinner than 1e-6 m, an outline
        that crosses or touches itself.

    Examples
    --------
    >>> square = Polygon(((0, 0), (0, 2), (2, 2), (2, 0)))
    >>> square.vertices
    ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
    """

    vertices: tuple[tuple[float, float], ...]
    name: str = ""

    def __init__(self, vertices: ArrayLike, name: str = "") -> None:
        label = f"polygon {name!r}.vertices" if name else "polygon.vertices"
        points = checked(label, vertices, (None, 2))
        if np.abs(points).max(initial=0.0) > FARTHEST:
            raise WideberthError(f"{label} reach beyond {FARTHEST:g} m from the origin")
        _check_simple(label, points)
        if _signed_area(points) < 0.0:
            points = np.roll(points[::-1], 1, axis=0)
        settle(self, vertices=tuple((float(x), float(y)) for x, y in points), name=name)

    @cached_property
    def points(self) -> Array:
        """The vertices as a read-only array, (V, 2), m, counter-clockwise."""
        return checked("polygon.vertices", self.vertices, (None, 2))

    @cached_property
    def parts(self) -> tuple[Array, ...]:
        """Convex parts of at most `MOST_CORNERS` vertices, cut once; see `convex_parts`."""
        parts = self.convex_parts(MOST_CORNERS)
        for part in parts:
            part.setflags(write=False)
        return parts

    def convex_parts(self, corners: int) -> tuple[Array, ...]:
        """Cut into convex parts that tile the polygon, each (V, 2), m, counter-clockwise.

        A convex polygon is its own only part; see the function `convex_parts`.

        Parameters
        ----------
        corners : most vertices that a part may have, at least 3.
        """
        return convex_parts(self.points, whole("corners", corners, least=3))


def area_within(outline: Array) -> float:
    """Area within an outline (V, 2) in either orientation, m^2."""
    return abs(_signed_area(outline))


def _signed_area(outline: Array) -> float:
    """Area within an outline, m^2, below 0 where it runs clockwise."""
    base = outline[0]  # an area about a far origin has no digits left
    ahead = np.roll(outline, -1, axis=0)
    return 0.5 * float(_cross(outline - base, ahead - base).sum())


def edge_normals(vertices: Array) -> Array:
    """Outward unit normals of the edges v_j -> v_j+1: (..., V, 2) m -> (..., V, 2).

    The vertices run counter-clockwise; the normal of an edge without length is zero.
    """
    edge = np.roll(vertices, -1, axis=-2) - vertices
    return _unit(np.stack([edge[..., 1], -edge[..., 0]], axis=-1))


def separation(first: Array, second: Array) -> tuple[Array, Array]:
    """Signed distance of convex bodies, m, and the unit normal that attains it.

        d = max over unit n of  min_i n . v_i - max_j n . w_j

    is the gap where the bodies are apart and minus the penetration depth where they overlap.
    The maximum lies at the normal of an edge of either body or, for a gap, along the line
    between two vertices, so trying these is exact.

    Parameters
    ----------
    first : vertices v_i, (..., W, 2), m, counter-clockwise; one alone is a point. Repeated
        vertices do no harm.
    second : vertices w_j, (..., V, 2), m, likewise.

    Returns
    -------
    distance : (...), m.
    normal : (..., 2), from the second body to the first.

    References
    ----------
    S. Gottschalk, M. C. Lin and D. Manocha, OBBTree (SIGGRAPH 1996), for the separating axes.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> distance, normal = separation(np.array([[4.0, 5.0]]), square)
    >>> float(distance), normal.tolist()
    (5.0, [0.6, 0.8])
    """
    first, second = _together(first, second)
    lines = _unit(first[..., :, None, :] - second[..., None, :, :])
    *several, own, other, _ = lines.shape
    lines = lines.reshape(*several, own * other, 2)  # no -1: there may be no bodies
    some = np.broadcast_to([1.0, 0.0], (*lines.shape[:-2], 1, 2))  # for points that coincide
    tried = [-edge_normals(first), edge_normals(second), lines, some]
    normals = np.concatenate(tried, axis=-2)
    gaps = np.where(normals.any(axis=-1), _gap(first, second, normals), -np.inf)
    best = gaps.argmax(axis=-1)[..., None]
    distance = np.take_along_axis(gaps, best, axis=-1)[..., 0]
    return distance, np.take_along_axis(normals, best[..., None], axis=-2)[..., 0, :]


def best_direction(first: Array, second: Array, spread: Array) -> tuple[Array, Array]:
    """Signed distance of convex bodies of which one is enlarged by an ellipse, m, and the normal.

        d = max over unit n of  min_i n . v_i - max_j n . w_j - sqrt(n^T M n)

    With one vertex w it is the distance of a polygon from the ellipse about w. Where M is zero
    this is `separation`. Elsewhere there is no closed form: the maximum is bracketed among
    directions in equal steps of the angle of n, in equal steps of the eccentric angle
    (a thin ellipse has all its turning in a few normals), and the normals of the edges, where
    the kinks are; then the sign of the slope is bisected down to 1e-12 rad. A gap has no
    other local maximum; of several depths of an overlap the best bracket is taken.

    Parameters
    ----------
    first, second : vertices v_i and w_j as in `separation`.
    spread : M, (..., 2, 2), m^2, positive semi-definite.

    Returns
    -------
    distance : (...), m, negative where the bodies overlap.
    normal : (..., 2), unit, from the second body to the first.
    """
    spread = np.asarray(spread, dtype=np.float64)
    first, second = _together(first, second, spread.shape[:-2])
    spread = np.broadcast_to(spread, (*first.shape[:-2], 2, 2))
    distance, normal = (np.array(one) for one in separation(first, second))
    wide = spread.any(axis=(-2, -1))
    if wide.any():
        roots = symmetric_root(spread[wide])
        distance[wide], normal[wide] = _search(first[wide], second[wide], roots, normal[wide])
    return distance, normal


def _search(first: Array, second: Array, root: Array, hint: Array) -> tuple[Array, Array]:
    """`best_direction` for flat batches (B, ...) and the root of M, from a hint (B, 2)."""
    normals = [-edge_normals(first), edge_normals(second), hint[:, None], _ellipse_normals(root)]
    tried = np.concatenate(normals, axis=1)
    angles = np.mod(np.arctan2(tried[..., 1], tried[..., 0]), 2.0 * np.pi)
    even = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)
    angles = np.concatenate([angles, np.broadcast_to(even, (len(angles), _ANGLES))], axis=1)
    values, _ = _enlarged_gap(first, second, root, angles)
    best = values.argmax(axis=1)[:, None]
    start = np.take_along_axis(angles, best, axis=1)
    turn = angles - start
    # Edges may be parallel: the neighbours are the nearest directions that differ.
    turn = np.concatenate([turn, turn + 2.0 * np.pi, turn - 2.0 * np.pi], axis=1)
    high = start + np.where(turn > 1e-12, turn, np.inf).min(axis=1, keepdims=True)
    low = start + np.where(turn < -1e-12, turn, -np.inf).max(axis=1, keepdims=True)
    for _ in range(40):
        middle = 0.5 * (low + high)
        _, slope = _enlarged_gap(first, second, root, middle)
        low, high = np.where(slope > 0.0, middle, low), np.where(slope > 0.0, high, middle)
    ends = np.concatenate([start, low, high], axis=1)  # at a kink either end may be the better
    values, _ = _enlarged_gap(first, second, root, ends)
    best = values.argmax(axis=1)[:, None]
    angle = np.take_along_axis(ends, best, axis=1)[:, 0]
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.take_along_axis(values, best, axis=1)[:, 0], normal


def _enlarged_gap(first: Array, second: Array, root: Array, angles: Array) -> tuple[Array, Array]:
    """Gap along the normals at angles (B, K), m, and its derivative by the angle, (B, K)."""
    normal = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    aside = np.stack([-normal[..., 1], normal[..., 0]], axis=-1)
    near, far = normal @ first.swapaxes(1, 2), normal @ second.swapaxes(1, 2)
    ahead, behind = near.argmin(axis=-1), far.argmax(axis=-1)
    rows = np.arange(len(angles))[:, None]
    between = first[rows, ahead] - second[rows, behind]
    pulled = normal @ root
    size = np.hypot(pulled[..., 0], pulled[..., 1])
    bend = (pulled * (aside @ root)).sum(axis=-1)
    bend = np.divide(bend, size, out=np.zeros_like(size), where=size > 0.0)
    return (between * normal).sum(axis=-1) - size, (between * aside).sum(axis=-1) - bend


def _ellipse_normals(root: Array) -> Array:
    """Return unit normals at equal steps of the eccentric angle: (B, 2, 2) -> (B, K, 2)."""
    axes, vectors = np.linalg.eigh(root)
    axes = np.maximum(axes, 1e-9 * axes[:, -1:])
    angle = np.linspace(0.0, 2.0 * np.pi, _ANGLES, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(_unit(circle / axes[:, None, :]) @ vectors.swapaxes(1, 2))


def _gap(first: Array, second: Array, normals: Array) -> Array:
    """Min_i n . v_i - max_j n . w_j for normals (..., K, 2) -> (..., K), m."""
    near = (normals @ first.swapaxes(-1, -2)).min(axis=-1)
    return np.asarray(near - (normals @ second.swapaxes(-1, -2)).max(axis=-1))


def _together(first: Array, second: Array, more: tuple[int, ...] = ()) -> tuple[Array, Array]:
    """Broadcast the batches of two lists of vertices and move both near the origin.

    Far from it products with a normal would lose the digits of the distance.
    """
    first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    base = second[..., :1, :]
    first, second = first - base, second - base
    batch = np.broadcast_shapes(first.shape[:-2], second.shape[:-2], more)
    return (
        np.broadcast_to(first, (*batch, *first.shape[-2:])),
        np.broadcast_to(second, (*batch, *second.shape[-2:])),
    )


def _unit(vectors: Array) -> Array:
    """Vectors (..., 2) at length 1; zero ones stay zero."""
    length = np.hypot(vectors[..., 0], vectors[..., 1])[..., None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def _cross(first: Array, second: Array) -> Array:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _check_simple(label: str, points: Array) -> None:
    """Refuse what is no simple polygon; raises as `Polygon`."""
    if len(points) < 3:
        raise WideberthError(f"{label} holds {len(points)} points; wanted at least 3")
    length = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    if length.min() <= THIN:
        where = int(length.argmin())
        raise WideberthError(
            f"{label}[{where}] repeats the vertex before it ({points[where].tolist()}); name each "
            "corner once, and the first not again at the end"
        )
    width = width_across(points)
    if width <= THIN:
        raise WideberthError(
            f"{label} are {width:.3g} m across: they lie on a line; wanted an area wider than "
            f"{THIN:g} m"
        )
    if _turns_once(points):
        return
    import shapely

    if not shapely.is_valid(outline := shapely.Polygon(points)):
        raise WideberthError(
            f"{label} cross or touch themselves ({shapely.is_valid_reason(outline)}); wanted a "
            "simple polygon: reorder the vertices or give two polygons"
        )


def _turns_once(points: Array) -> bool:
    """Whether an outline turns to one side alone, once round: it is convex and simple."""
    ahead = np.roll(points, -1, axis=0) - points
    after = np.roll(ahead, -1, axis=0)
    turned = float(np.arctan2(_cross(ahead, after), (ahead * after).sum(axis=1)).sum())
    ring = list(range(len(points)))
    return abs(abs(turned) - 2.0 * np.pi) < 1e-6 and _convex(
        points, ring if turned > 0.0 else ring[::-1]
    )


def convex_hull(points: Array) -> Array:
    """Return the corners of the convex hull of points (P, 2), (V, 2), clockwise from the lowest.

    Of points on a line they are its ends.

    References
    ----------
    A. M. Andrew, Another efficient algorithm for convex hulls in two dimensions, Information
    Processing Letters 9, 1979.
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    ring = _upper_side(ordered)[:-1] + _upper_side(ordered[::-1])[:-1]
    lowest = min(range(len(ring)), key=lambda place: ring[place][::-1])
    return np.array(ring[lowest:] + ring[:lowest])


def _upper_side(ordered: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners that turn right alone on the way from the first point to the last."""
    chain: list[tuple[float, float]] = []
    for point in ordered:
        while len(chain) > 1 and _left_of(chain[-2], chain[-1], point) >= 0.0:
            chain.pop()
        chain.append(point)
    return chain


def _left_of(start: Sequence[float], end: Sequence[float], point: Sequence[float]) -> float:
    """Twice the area of a triangle, m^2; above 0 where the point is left of the line."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (
        point[0] - start[0]
    )


def width_across(points: Array) -> float:
    """Return the least distance of two parallel lines between which points (V, 2) lie, m."""
    middle = points.mean(axis=0)
    normals = edge_normals(convex_hull(points)[::-1] - middle)
    across = normals[normals.any(axis=1)] @ (points - middle).T
    return float(np.ptp(across, axis=1).min())


FLAT = 1e-10
"""m. A vertex that stands out less from the line between its neighbours is left out."""

Ring = list[int]


def convex_parts(points: Array, corners: int, holes: Sequence[Array] = ()) -> tuple[Array, ...]:
    """Convex parts that tile a simple polygon, with holes or without.

    A constrained Delaunay triangulation; then its diagonals are taken in order of length, the
    longest first, and one is removed where the two parts beside it form a convex part. There
    are then at most four times as many parts as in the best cut, mostly far fewer. A part of
    more than ``corners`` vertices is halved between opposite ones until it fits.

    Parameters
    ----------
    points : (V, 2), m, counter-clockwise, a simple polygon.
    corners : most vertices of a part, at least 3.
    holes : each (V, 2), m, clockwise; they may touch the polygon or each other at corners.

    Returns
    -------
    parts : each (V, 2), m, counter-clockwise, without vertices on a straight line.

    References
    ----------
    S. Hertel and K. Mehlhorn, Fast triangulation of simple polygons, FCT 1983 (BibTeX key
    hertel1983triangulation), for the merging and its bound.
    """
    if not holes:  # a hole may touch a corner that stands on a straight line
        points = points[_pruned(points, list(range(len(points))))]
    rings = [points, *holes]
    points = np.concatenate(rings)
    parts = [list(range(len(points)))]
    if holes or not _convex(points, parts[0]):
        parts = _joined(points, _triangles(points, rings))
    kept = [half for part in parts for half in _halved(_pruned(points, part), corners)]
    return tuple(points[part] for part in kept)


def _joined(points: Array, parts: list[Ring]) -> list[Ring]:
    """Join triangles to convex parts across the edges that they share."""
    beside: dict[frozenset[int], list[int]] = {}
    for place, ring in enumerate(parts):
        for edge in map(frozenset, zip(ring, ring[1:] + ring[:1], strict=True)):
            beside.setdefault(edge, []).append(place)
    home = list(range(len(parts)))  # of each triangle, the part that holds it
    held = [[place] for place in home]
    rings: list[Ring | None] = [*parts]
    for edge in _diagonals(points, beside):
        one, two = sorted(home[place] for place in beside[edge])
        first, second = rings[one], rings[two]
        assert first is not None and second is not None
        merged = _merged(first, second, edge)
        if _convex(points, merged):
            rings[one], rings[two] = merged, None
            held[one] += held[two]
            for place in held[two]:
                home[place] = one
    return [ring for ring in rings if ring is not None]


def _halved(ring: Ring, corners: int) -> list[Ring]:
    """Cut a convex ring until each piece has at most this many vertices."""
    if len(ring) <= corners:
        return [ring]
    middle = len(ring) // 2
    pieces = ring[: middle + 1], [*ring[middle:], ring[0]]
    return [half for piece in pieces for half in _halved(piece, corners)]


def _triangles(points: Array, rings: Sequence[Array]) -> list[Ring]:
    """Constrained Delaunay triangles as counter-clockwise indices of the points of all rings."""
    import shapely

    index = {(float(x), float(y)): place for place, (x, y) in enumerate(points)}
    found = shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:])).geoms
    triangles = []
    for triangle in found:
        corners = shapely.get_coordinates(triangle)[:3]
        ring = [index[float(x), float(y)] for x, y in corners]
        if _heights(points, ring)[0] < 0.0:
            ring.reverse()
        first = ring.index(min(ring))
        triangles.append(ring[first:] + ring[:first])
    return sorted(triangles)


def _diagonals(points: Array, beside: Mapping[frozenset[int], list[int]]) -> list[frozenset[int]]:
    """Edges that two triangles share, the longest first."""
    return sorted(
        (edge for edge, triangles in beside.items() if len(triangles) > 1),
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
    return bool((_heights(points, ring) > -FLAT).all())


def _pruned(points: Array, ring: Ring) -> Ring:
    """Leave out vertices on a straight line, the flattest first."""
    ring = list(ring)
    while len(ring) > 3:
        heights = np.abs(_heights(points, ring))
        flattest = int(heights.argmin())
        if heights[flattest] > FLAT:
            break
        del ring[flattest]
    return ring
