"""Walls of boxes, segments and shapes: what they cover and how far they reach."""

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from wideberth import WideberthError
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.polygon import MOST_CORNERS, Polygon
from wideberth.routes.walls import box, walls_around, walls_of_segments, walls_of_shapes


def together(walls: tuple[Polygon, ...]) -> Any:
    return shapely.union_all([shapely.Polygon(wall.vertices) for wall in walls])


def check_convex(walls: tuple[Polygon, ...]) -> None:
    for wall in walls:
        shape = shapely.Polygon(wall.vertices)
        assert len(wall.points) <= MOST_CORNERS and len(wall.parts) == 1
        assert shape.area == pytest.approx(shapely.convex_hull(shape).area, rel=1e-9)


# segments


def lines(segments: Array) -> Any:
    ends = np.reshape(segments, (-1, 2, 2))  # one of no length is a point
    found = [*map(shapely.LineString, ends), *map(shapely.Point, np.reshape(ends, (-1, 2)))]
    return shapely.union_all(found)


def check_segments(segments: Array, width: float) -> tuple[Polygon, ...]:
    """Hold walls to both laws: all is covered, and nothing is farther than the width."""
    walls = walls_of_segments(segments, width)
    check_convex(walls)
    covered = shapely.buffer(together(walls), 1e-9)
    assert shapely.covers(covered, lines(segments)), "a segment is not covered"
    corners = np.concatenate([wall.points for wall in walls])
    far = shapely.distance(shapely.points(corners), lines(segments))
    assert far.max() <= np.sqrt(0.5) * width + 1e-9, "a wall reaches too far"
    return walls


coordinates = st.integers(-4, 4).map(float)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(*[coordinates] * 4), min_size=1, max_size=12), st.sampled_from([0.02, 1.0])
)
def test_segments_are_covered_and_no_more(
    rows: list[tuple[float, float, float, float]], width: float
) -> None:
    segments = np.array(rows)
    walls = check_segments(segments, width)
    assert len(walls) <= len(segments)


def test_segments_of_any_direction_are_covered_and_no_more() -> None:
    rng = np.random.default_rng(0)
    for scale in (0.1, 10.0, 1000.0):
        check_segments(scale * rng.standard_normal((40, 4)), 0.05)


def test_what_meets_on_a_line_is_one_wall() -> None:
    rng = np.random.default_rng(0)
    for angle in rng.uniform(0.0, 2.0 * np.pi, 20):
        unit = np.array([np.cos(angle), np.sin(angle)])
        stops = np.array([0.0, 1.0, 2.5, 4.0, 4.0])  # and one of no length
        ends = np.stack([stops[:-1], stops[1:]], axis=1)[..., None] * unit + [20.0, -7.0]
        some = rng.permutation(len(ends))
        turned = np.where(rng.random((len(ends), 1, 1)) < 0.5, ends[some], ends[some][:, ::-1])
        assert len(check_segments(np.reshape(turned, (-1, 4)), 0.1)) == 1


def test_a_door_stays_open() -> None:
    walls = walls_of_segments([[0, 0, 3, 0], [4, 0, 9, 0], [9, 0, 5, 0], [6, 0, 6, 4]], 0.2)
    assert [wall.vertices[::2] for wall in walls] == [
        ((-0.1, -0.1), (3.1, 0.1)),
        ((3.9, -0.1), (9.1, 0.1)),
        ((6.1, -0.1), (5.9, 4.1)),
    ]


def test_segments_come_as_rows_or_as_ends() -> None:
    ends = [[[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]]
    assert walls_of_segments(ends) == walls_of_segments(np.reshape(ends, (2, 4)))
    assert walls_of_segments([]) == ()


def test_useless_segments_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"segments has shape \(1, 3\)"):
        walls_of_segments([[0, 0, 1]])
    with pytest.raises(WideberthError, match=r"segments\[0, 2\] is nan"):
        walls_of_segments([[0, 0, np.nan, 1]])
    with pytest.raises(WideberthError, match="width is 1e-06 m; wanted at least 1e-05 m"):
        walls_of_segments([[0, 0, 1, 1]], 1e-6)


# shapes


def rings(rng: np.random.Generator, corners: int) -> Any:
    """Return a star with a hole, or two, in it."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    far = rng.uniform(3.0, 5.0, corners)
    outer = shapely.Polygon(far[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    hole = shapely.buffer(shapely.Point(rng.uniform(-0.5, 0.5, 2)), 0.5, quad_segs=3)
    other = shapely.box(-1.5, -1.5, -1.0, -1.0)
    return shapely.difference(shapely.buffer(outer, 0.0), shapely.union(hole, other))


@pytest.mark.parametrize("seed", range(10))
def test_parts_tile_shapes_with_holes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [affinity.translate(rings(rng, 24), 12.0 * i, 3.0) for i in range(3)]
    for given_as in (shapes, shapely.MultiPolygon([*shapely.get_parts(shapes)])):
        walls = walls_of_shapes(given_as)
        check_convex(walls)
        all_shapes = shapely.union_all(shapes)
        assert shapely.symmetric_difference(together(walls), all_shapes).area < 1e-9
        assert sum(shapely.Polygon(wall.vertices).area for wall in walls) == pytest.approx(
            all_shapes.area
        )
        assert len({wall.name for wall in walls}) == len(walls)


def test_orientation_does_not_matter() -> None:
    square, hole = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (2, 1), (2, 2), (1, 2)]
    areas = [
        together(walls_of_shapes(shapely.Polygon(outer, [inner]))).area
        for outer in (square, square[::-1])
        for inner in (hole, hole[::-1])
    ]
    assert areas == pytest.approx([15.0] * 4)


def test_slivers_and_repeated_corners_are_left_out() -> None:
    corners = [(0, 0), (2, 0), (2, 0), (4, 1e-8), (4, 3), (0, 3)]
    assert together(walls_of_shapes(shapely.Polygon(corners))).area == pytest.approx(12.0)
    assert walls_of_shapes(shapely.Polygon([(0, 0), (5, 0), (5, 1e-8)])) == ()
    assert walls_of_shapes([]) == walls_of_shapes(shapely.Polygon()) == ()


def test_lines_are_thin_walls() -> None:
    room = shapely.LinearRing([(0, 0), (4, 0), (4, 3), (0, 3)])
    walls = walls_of_shapes([room, shapely.box(1, 1, 2, 2)], 0.1)
    assert len(walls) == 5
    inside = shapely.box(0.05, 0.05, 3.95, 2.95)
    assert shapely.intersection(together(walls), inside).area == pytest.approx(1.0)


def test_closed_outlines_of_segments_can_be_filled() -> None:
    square = np.array([[1, 1, 2, 1], [2, 1, 2, 2], [2, 2, 1, 2], [1, 2, 1, 1.0]])
    filled = walls_of_shapes(
        shapely.polygonize([*map(shapely.LineString, square.reshape(-1, 2, 2))])
    )
    assert [shapely.Polygon(wall.vertices).area for wall in filled] == [1.0]


def test_useless_shapes_are_refused() -> None:
    with pytest.raises(WideberthError, match="a shape is a Point; wanted polygons or lines"):
        walls_of_shapes(shapely.Point(0, 0))
    with pytest.raises(WideberthError, match=r"not valid \(Self-intersection.*shapely.make_valid"):
        walls_of_shapes(shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)]))


# boxes


def test_a_box_lies_between_its_corners() -> None:
    assert shapely.Polygon(box((1, 2), (3, 5)).vertices).equals(shapely.box(1, 2, 3, 5))


def test_walls_around_leave_the_inside_free_and_close_it() -> None:
    walls = walls_around((0.0, 0.0), (8.0, 6.0), 0.3)
    ring = shapely.difference(shapely.box(-0.3, -0.3, 8.3, 6.3), shapely.box(0, 0, 8, 6))
    assert shapely.symmetric_difference(together(walls), ring).area < 1e-12
    assert sum(shapely.Polygon(wall.vertices).area for wall in walls) == pytest.approx(ring.area)
    with pytest.raises(WideberthError, match="thickness is 0"):
        walls_around((0.0, 0.0), (8.0, 6.0), 0.0)
