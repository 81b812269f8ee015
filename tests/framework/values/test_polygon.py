"""Polygons, their convex parts and separations, against shapely, closed forms and brute force."""

import sys
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.plugins import config
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import (
    Polygon,
    area_within,
    best_direction,
    convex_hull,
    edge_normals,
    separation,
)

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
ELL = ((0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3))
PLUS = ((1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (2, 2),
        (2, 3), (1, 3), (1, 2), (0, 2), (0, 1), (1, 1))  # fmt: skip


def star(count: int, rng: np.random.Generator) -> Any:
    """Return a star-shaped polygon, most of its vertices reflex or sharp."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    return rng.uniform(0.3, 2.0, (count, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def convex(count: int, rng: np.random.Generator) -> Any:
    """Return a convex polygon, counter-clockwise."""
    angle = (np.arange(count) + rng.uniform(-0.4, 0.4, count)) * 2.0 * np.pi / count
    turn = rng.uniform(0.0, 2.0 * np.pi)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    axes = [1.0, rng.uniform(0.05, 1.0)]
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1) * axes @ rotation.T


# the value


@pytest.mark.parametrize(
    "vertices", [SQUARE, SQUARE[::-1], np.array(SQUARE), [[0, 0], [0, 1], [1, 1]]]
)
def test_kept_counter_clockwise_and_read_only(vertices: Any) -> None:
    polygon = Polygon(vertices)
    assert shapely.LinearRing(polygon.points).is_ccw
    assert polygon.vertices[0] == tuple(np.asarray(vertices, dtype=float)[0])
    assert shapely.Polygon(polygon.points).equals(shapely.Polygon(vertices))
    assert not polygon.points.flags.writeable and polygon.points.dtype == np.float64
    assert polygon == Polygon(polygon.vertices) and eval(repr(polygon)) == polygon


def test_convex_hull_and_area_are_shapelys() -> None:
    rng = np.random.default_rng(5)
    for count in rng.integers(3, 40, 300):
        points = rng.normal(size=(count, 2)) * 10.0 ** rng.integers(-2, 3)
        wanted = shapely.convex_hull(shapely.MultiPoint(points))
        found = convex_hull(np.concatenate([points, points[:2]]))
        np.testing.assert_array_equal(found, shapely.get_coordinates(wanted)[:-1])
        assert area_within(found) == pytest.approx(wanted.area, rel=1e-12)
    line = np.linspace([0.0, 1.0], [4.0, 3.0], 5)
    assert convex_hull(line).tolist() == [[0.0, 1.0], [4.0, 3.0]]
    assert convex_hull(line[:1]).tolist() == [[0.0, 1.0]]


def test_a_convex_outline_does_not_wait_for_the_import_of_shapely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "shapely", None)
    rng = np.random.default_rng(6)
    for count in (3, 4, 7, 16):
        outline = convex(count, rng)
        middle = 0.5 * (outline[0] + outline[1])  # a corner on a straight side
        for one in (outline, outline[::-1], np.insert(outline, 1, middle, axis=0)):
            assert len(Polygon(one).parts) == 1


def star_of_five() -> Any:
    """Return a pentagram, which turns to one side alone, twice round."""
    angle = 4.0 * np.pi * np.arange(5) / 5
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def test_orientation_far_from_the_origin() -> None:
    small: Any = np.array(SQUARE) * 1e-3 + 1e7
    assert Polygon(small[::-1]).vertices[0] == tuple(small[-1])
    assert shapely.LinearRing(Polygon(small[::-1]).points - 1e7).is_ccw


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        (((0, 0), (1, 0)), "holds 2 points; wanted at least 3"),
        (((0, 0), (1, 0), (0, np.inf)), r"\[2, 1\] is inf"),
        (((0, 0, 0), (1, 0, 0), (0, 1, 0)), r"shape \(3, 3\); wanted \(any, 2\)"),
        (("a", "b", "c"), "not an array of numbers"),
        (((0, 0), (1, 0), (2, 0)), "lie on a line"),
        (((0, 0), (5, 5), (2, 2), (3, 3 + 1e-10)), "lie on a line"),
        (((0, 0), (1, 0), (1, 5e-10), (0, 5e-10)), "repeats the vertex before it"),
        (((0, 0), (1, 0), (1, 1), (1, 1)), r"\[3\] repeats the vertex before it"),
        ((*SQUARE, SQUARE[0]), r"\[0\] repeats .* not again at the end"),
        (((0, 0), (1, 1), (1, 0), (0, 1)), "cross or touch themselves"),
        (((0, 0), (2, 0), (2, 2), (1, 0), (0, 2)), "cross or touch themselves"),
        (((0, 0), (2, 0), (1, 1), (2, 2), (0, 2), (1, 1)), "cross or touch themselves"),
    ],
)  # fmt: skip
def test_bad_vertices_are_refused(vertices: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=rf"polygon 'shed'\.vertices.*{words}"):
        Polygon(vertices, name="shed")


def test_configs_hold_polygons() -> None:
    given = {"vertices": [[0, 0], [0, 1.5], [2, 0]], "name": "shed"}
    (polygon,) = config._convert(tuple[Polygon, ...], [given], "scene.polygons")
    assert polygon == Polygon(((0, 0), (0, 1.5), (2, 0)), "shed")
    assert config._convert(Polygon, config.describe(polygon), "again") == polygon
    with pytest.raises(WideberthError, match=r"^scene\.vertices"):
        config._convert(Polygon, {"vertices": [[0, "x"]]}, "scene")


# convex parts


def check_tiling(points: Any, corners: int = 16) -> int:
    """Hold the parts of a polygon against shapely; return how many they are."""
    parts = Polygon(points).convex_parts(corners)
    whole, shapes = shapely.Polygon(points), [shapely.Polygon(part) for part in parts]
    for part in parts:
        edge = np.roll(part, -1, axis=0) - part
        ahead = np.roll(edge, -1, axis=0)
        assert (edge[:, 0] * ahead[:, 1] - edge[:, 1] * ahead[:, 0] > 0.0).all()
        assert 3 <= len(part) <= corners and shapely.LinearRing(part).is_ccw
    assert sum(shape.area for shape in shapes) == pytest.approx(
        whole.area, rel=1e-12
    )  # no overlap
    assert shapely.union_all(shapes).symmetric_difference(whole).area < 1e-9
    return len(parts)


def test_known_shapes() -> None:
    assert check_tiling(SQUARE) == 1
    assert check_tiling(ELL) == 2
    assert check_tiling(PLUS) == 3
    assert check_tiling(((0, 0), (2, 0), (2, 2), (1, 0.5))) == 2


def test_the_corners_of_a_part_are_limited() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle: Any = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert check_tiling(circle, 40) == 1
    assert check_tiling(circle, 3) == 38
    assert check_tiling(circle, 16) == 4
    comb: Any = [(0, 0), (40, 0), *((40 - x, 1 + x % 2) for x in range(41))]
    assert check_tiling(comb, 3) == 22  # 20 teeth and the halves of what lies below them
    assert check_tiling(comb, 4) == 21
    with pytest.raises(WideberthError, match="corners is 2"):
        Polygon(circle).convex_parts(2)


def test_vertices_on_a_straight_line_are_dropped() -> None:
    bent: Any = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 3), (1, 3), (0, 3), (0, 1)]
    (part,) = Polygon(bent).convex_parts(4)
    assert len(part) == 4 and shapely.Polygon(part).equals(shapely.Polygon(bent))
    tilted = np.array(bent) @ [[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]] + 100.0
    assert check_tiling(tilted, 4) == 1


def test_random_polygons_are_tiled() -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        points = star(int(rng.integers(4, 25)), rng)
        # Hertel and Mehlhorn: at most 2 r + 1 parts for r reflex vertices
        edge = points - np.roll(points, 1, axis=0)
        ahead = np.roll(edge, -1, axis=0)
        reflex = int((edge[:, 0] * ahead[:, 1] - edge[:, 1] * ahead[:, 0] < 0.0).sum())
        if shapely.is_valid(shapely.Polygon(points)):
            assert check_tiling(points, 30) <= 2 * reflex + 1
    for _ in range(60):  # outlines of heaps of boxes: not star-shaped, many right angles
        low = rng.integers(0, 12, (8, 2)).astype(float)
        high = low + rng.integers(1, 6, (8, 2))
        heap = shapely.union_all(shapely.box(*low.T, *high.T))
        heap = max(getattr(heap, "geoms", [heap]), key=lambda part: part.area)
        check_tiling(shapely.get_coordinates(heap.exterior)[:-1])


def test_parts_are_the_same_each_time() -> None:
    points = star(20, np.random.default_rng(5))
    first, second = Polygon(points).parts, Polygon(points).parts
    assert [part.tolist() for part in first] == [part.tolist() for part in second]


# separation


def test_separation_agrees_with_shapely() -> None:
    rng = np.random.default_rng(0)
    for _ in range(600):
        first = convex(int(rng.integers(3, 9)), rng) + rng.uniform(-2.5, 2.5, 2)
        second = convex(int(rng.integers(3, 9)), rng)
        if rng.random() < 0.3:
            first = first[: rng.integers(1, 3)]  # a point or a segment
        distance, normal = separation(first, second)
        body = shapely.MultiPoint(first).convex_hull
        wanted = body.distance(shapely.Polygon(second))
        if wanted == 0.0:  # the depth is the distance to the edge of the Minkowski difference
            apart = (first[:, None] - second).reshape(-1, 2)
            hull: Any = shapely.MultiPoint(apart).convex_hull
            wanted = -hull.exterior.distance(shapely.Point(0.0, 0.0))
        assert distance == pytest.approx(wanted, abs=1e-12)
        assert np.hypot(*normal) == pytest.approx(1.0, abs=1e-15)
        got = (first @ normal).min() - (second @ normal).max()
        assert got == pytest.approx(wanted, abs=1e-12)


def test_depth_agrees_with_a_grid_of_directions() -> None:
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 20000)
    grid = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for _ in range(50):
        first, second = convex(5, rng) + rng.uniform(-1.0, 1.0, 2), convex(4, rng)
        best = ((grid @ first.T).min(axis=1) - (grid @ second.T).max(axis=1)).max()
        distance, _ = separation(first, second)
        assert best <= distance + 1e-12 and distance - best < 2e-3


def test_no_bodies_have_no_separations() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    distance, normal = separation(np.zeros((0, 1, 2)), square)
    assert (distance.shape, normal.shape) == ((0,), (0, 2))


def test_separation_is_batched_padded_and_keeps_digits_far_away() -> None:
    rng = np.random.default_rng(2)
    bodies = convex(4, rng) + rng.uniform(-3.0, 3.0, (7, 1, 1, 2))
    walls = np.stack([convex(5, rng) for _ in range(3)])
    distance, normal = separation(bodies, walls)
    assert distance.shape == (7, 3) and normal.shape == (7, 3, 2)
    padded = np.concatenate([walls, walls[:, -1:].repeat(4, axis=1)], axis=1)
    for got, wanted in zip(separation(bodies, padded), (distance, normal), strict=True):
        assert np.allclose(got, wanted, atol=1e-14)
    far, _ = separation(bodies + 2.0**20, walls + 2.0**20)
    assert np.allclose(far, distance, atol=1e-9)


def test_separation_of_points() -> None:
    distance, normal = separation(np.array([[3.0, 4.0]]), np.zeros((1, 2)))
    assert distance == 5.0 and normal.tolist() == [0.6, 0.8]
    distance, normal = separation(np.ones((1, 2)), np.ones((1, 2)))
    assert distance == 0.0 and np.hypot(*normal) == 1.0


def test_normals_of_edges() -> None:
    assert edge_normals(np.array(SQUARE)).tolist() == [[0, -1], [1, 0], [0, 1], [-1, 0]]
    assert not edge_normals(np.ones((2, 2))).any()


# with an ellipse


def test_no_spread_is_plain_separation() -> None:
    rng = np.random.default_rng(4)
    bodies = convex(4, rng) + rng.uniform(-3.0, 3.0, (9, 1, 2))
    wall = convex(6, rng)
    spread = np.zeros((9, 2, 2))
    spread[::2] = np.diag([0.2, 0.1])
    distance, normal = best_direction(bodies, wall, spread)
    plain, other = separation(bodies, wall)
    assert (distance[1::2] == plain[1::2]).all() and (normal[1::2] == other[1::2]).all()
    assert (distance[::2] < plain[::2] - 0.3).all()


def test_round_spread_is_a_disc() -> None:
    rng = np.random.default_rng(6)
    bodies = convex(4, rng) + rng.uniform(-4.0, 4.0, (200, 1, 2))
    wall = convex(6, rng)
    distance, _ = best_direction(bodies, wall, 0.09 * np.eye(2))
    assert np.allclose(distance, separation(bodies, wall)[0] - 0.3, atol=1e-12)


def spreads(rng: np.random.Generator, count: int) -> Any:
    """Return covariances with conditions up to infinity."""
    turn = rng.uniform(0.0, np.pi, count)
    axes = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    ratio = np.where(rng.random(count) < 0.1, 0.0, 10.0 ** rng.uniform(-8.0, 0.0, count))
    along = axes[:, :, None] * axes[:, None]
    size = rng.uniform(0.01, 2.0, count)[:, None, None]
    found = size * (along + ratio[:, None, None] * (np.eye(2) - along))
    return 0.5 * (found + found.swapaxes(1, 2))


@pytest.mark.parametrize(("corners", "vertices"), [(1, 1), (1, 6), (4, 1), (4, 8), (8, 5)])
def test_best_direction_agrees_with_brute_force(corners: int, vertices: int) -> None:
    rng = np.random.default_rng(corners + 10 * vertices)
    count = 150
    first = np.stack([convex(max(corners, 3), rng)[:corners] for _ in range(count)])
    second = np.stack([convex(max(vertices, 3), rng)[:vertices] for _ in range(count)])
    first += rng.uniform(-2.5, 2.5, (count, 1, 2))
    spread = spreads(rng, count)
    distance, normal = best_direction(first, second, spread)

    def value(normals: Any) -> Any:  # (count, K, 2)
        near = (normals @ first.swapaxes(1, 2)).min(axis=-1)
        far = (normals @ second.swapaxes(1, 2)).max(axis=-1)
        size = np.maximum(np.einsum("bki,bij,bkj->bk", normals, spread, normals), 0.0)
        return near - far - np.sqrt(size)

    assert np.allclose(value(normal[:, None])[:, 0], distance, atol=3e-8)  # sqrt(rounding of M)
    angle = np.linspace(0.0, 2.0 * np.pi, 4000)
    grid = np.broadcast_to(np.stack([np.cos(angle), np.sin(angle)], axis=-1), (count, 4000, 2))
    short = value(grid).max(axis=1) - distance
    assert short[distance > 0.0].max() < 3e-8  # a gap has one local maximum
    assert np.quantile(short, 0.98) < 3e-8 and short.max() < 1e-3  # a depth may have several
    fine = np.arctan2(normal[:, 1], normal[:, 0])[:, None] + np.linspace(-1e-3, 1e-3, 2001)
    assert (value(np.stack([np.cos(fine), np.sin(fine)], -1)).max(axis=1) < distance + 3e-8).all()


def test_ellipse_against_a_buffered_shape() -> None:
    """Enlarging by an ellipse is, after whitening, enlarging by the unit disc."""
    rng = np.random.default_rng(8)
    body, wall = convex(4, rng), convex(6, rng)
    spread = np.array([[0.3, 0.1], [0.1, 0.1]])
    whiten = np.linalg.inv(np.linalg.cholesky(spread))
    for _ in range(300):
        place = rng.uniform(-3.0, 3.0, 2)
        apart = shapely.Polygon((body + place) @ whiten.T).distance(
            shapely.Polygon(wall @ whiten.T)
        )
        distance, _ = best_direction(body + place, wall, spread)
        assert np.sign(distance) == np.sign(apart - 1.0)
