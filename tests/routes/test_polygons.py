"""Polygons of a map: they cover every occupied cell, and reach no farther than the tolerance."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wideberth import OccupancyGrid, WideberthError
from wideberth.framework.values.polygon import MOST_CORNERS, Polygon
from wideberth.routes.polygons import convex_polygons, grid_of_polygons, outlines
from wideberth.routes.walls import box


def grid_of(occupied: np.ndarray, resolution: float = 0.25) -> OccupancyGrid:
    return OccupancyGrid(np.where(occupied, 100, 0), resolution, (-2.0, 3.0))


def covered(grid: OccupancyGrid) -> shapely.Geometry:
    my, mx = np.nonzero(grid.cells == 100)
    low = np.array(grid.origin) + grid.resolution * np.stack([mx, my], axis=1)
    high = low + grid.resolution
    return shapely.union_all(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))


def check(grid: OccupancyGrid, polygons: tuple[Polygon, ...], tolerance: float) -> None:
    cells = covered(grid)
    shapes = [shapely.Polygon(one.points) for one in polygons]
    together = shapely.union_all(shapes)
    assert shapely.difference(cells, together).area < 1e-9, "a cell is not covered"
    round_them = shapely.buffer(cells, tolerance / np.cos(np.pi / 256) + 1e-9, quad_segs=64)
    assert shapely.difference(together, round_them).area < 1e-9, "a polygon reaches too far"
    for one, shape in zip(polygons, shapes, strict=True):
        assert len(one.points) <= MOST_CORNERS and len(one.parts) == 1
        assert shape.area == pytest.approx(shapely.convex_hull(shape).area, abs=1e-12)
    edge = shapely.length(cells)
    most = cells.area + tolerance * edge + 0.5 * np.pi * tolerance**2 * max(len(polygons), 1) * 16
    assert sum(shape.area for shape in shapes) <= most + 1e-9


masks = st.integers(3, 14).flatmap(
    lambda n: st.lists(st.lists(st.booleans(), min_size=n, max_size=n), min_size=3, max_size=14)
)


IN_THE_WAY = (
    [[1, 1, 1, 1, 0], [1, 1, 0, 1, 1], [0, 1, 0, 0, 1], [1, 0, 1, 1, 1], [1, 0, 0, 0, 0]],
    [[0, 1, 1, 1, 1], [1, 1, 0, 1, 1], [1, 1, 0, 0, 1], [1, 1, 1, 1, 1], [1, 1, 1, 0, 1]],
)
"""Maps on which outlines would cross if other corners were not looked at."""


@settings(max_examples=120, deadline=None)
@given(masks, st.sampled_from([0.0, 0.1, 0.2, 0.4, 1.0]))
@example([[False] * 3] * 3, 0.1)
@example([[True] * 3] * 3, 0.1)
@example([[True, True, False], [True, False, True], [False, True, True]], 0.0)
@example([[True, True, True], [True, False, True], [True, True, True]], 1.0)
@example(IN_THE_WAY[0], 0.4)
@example(IN_THE_WAY[1], 0.7)
def test_random_maps(mask: list[list[bool]], tolerance: float) -> None:
    grid = grid_of(np.array(mask))
    check(grid, convex_polygons(grid, tolerance), tolerance)


@pytest.mark.parametrize("tolerance", [0.0, 0.25, 0.6])
@pytest.mark.parametrize("seed", range(3))
def test_larger_maps(seed: int, tolerance: float) -> None:
    from scipy.ndimage import gaussian_filter

    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(60, 70)), 1.5)
    grid = grid_of(noise > 0.5 * noise.std())
    check(grid, convex_polygons(grid, tolerance), tolerance)


def test_without_tolerance_the_area_is_that_of_the_cells() -> None:
    grid = grid_of(np.random.default_rng(3).random((12, 12)) < 0.5)
    area = sum(shapely.Polygon(one.points).area for one in convex_polygons(grid, 0.0))
    assert area == pytest.approx(covered(grid).area, abs=1e-9)


def test_a_slanted_wall_is_one_polygon_with_a_tolerance() -> None:
    mx, my = np.meshgrid(np.arange(60), np.arange(30))
    grid = grid_of(np.abs(my - 5 - mx // 3) <= 1)
    assert len(convex_polygons(grid, 0.0)) > 15
    assert len(convex_polygons(grid, 0.25)) == 1


def test_the_tolerance_is_met_to_the_digit() -> None:
    """The inner corner of a stair of one cell stands half a diagonal off the slope."""
    deep = 0.25 / np.sqrt(2.0)
    stairs = grid_of(np.tri(8, dtype=bool))
    assert len(convex_polygons(stairs, 0.999 * deep)) > 1
    assert len(convex_polygons(stairs, 1.001 * deep)) == 1


def test_a_room_keeps_its_inside_free() -> None:
    walls = np.ones((20, 30), dtype=bool)
    walls[2:-2, 2:-2] = False
    polygons = convex_polygons(grid_of(walls), 0.3)
    assert len(polygons) == 4
    inside = shapely.union_all([shapely.Polygon(one.points) for one in polygons])
    assert len(inside.interiors) == 1


def test_a_hole_smaller_than_the_tolerance_is_filled() -> None:
    walls = np.ones((5, 5), dtype=bool)
    walls[2, 2] = False
    assert len(convex_polygons(grid_of(walls), 0.1)) > 1
    (block,) = convex_polygons(grid_of(walls), 0.2)
    assert block.points.tolist() == [[-2.0, 3.0], [-0.75, 3.0], [-0.75, 4.25], [-2.0, 4.25]] or (
        shapely.Polygon(block.points).area == pytest.approx(1.25**2)
    )


def test_outlines_have_corners_alone() -> None:
    (group,) = outlines(np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=bool))
    assert [len(ring) for ring in group] == [4, 4]


def test_unknown_cells_on_request() -> None:
    grid = OccupancyGrid([[0, -1, 0, 70]], 1.0)
    assert convex_polygons(grid, 0.0) == ()
    assert len(convex_polygons(grid, 0.0, lethal_threshold=70, unknown=True)) == 2


def test_bad_input_is_refused() -> None:
    grid = OccupancyGrid([[0]], 1.0)
    with pytest.raises(WideberthError, match="tolerance is -1"):
        convex_polygons(grid, -1.0)
    with pytest.raises(WideberthError, match="lethal_threshold is 0"):
        convex_polygons(grid, 0.1, lethal_threshold=0)


@settings(max_examples=60, deadline=None)
@given(masks, st.sampled_from([0.06, 0.25, 0.4]))
def test_the_way_back_covers_the_polygons_and_no_more_than_a_cell_around_them(
    mask: list[list[bool]], resolution: float
) -> None:
    rows = np.array([row[: len(mask[0])] for row in mask])
    walls = convex_polygons(grid_of(rows), 0.0)
    corner = np.array([[-2.0, 3.0]])
    grid = grid_of_polygons(walls, corner, 0.5, resolution)
    together = shapely.union_all([shapely.Polygon(one.points) for one in walls])
    assert shapely.difference(together, covered(grid)).area < 1e-9
    reach = shapely.buffer(together, 1.5 * resolution)
    assert shapely.difference(covered(grid), reach).area < 1e-9
    low, high = (
        np.array(grid.origin),
        np.array(grid.origin) + resolution * np.array(grid.cells.shape[::-1]),
    )
    assert low == pytest.approx([-2.5, 2.5]) and (high >= corner[0] + 0.5 - 1e-9).all()


def test_cells_near_polygons_are_those_that_a_distance_finds() -> None:
    rng = np.random.default_rng(0)
    for digits in (1, 9):  # on the corners of cells, and anywhere
        low = rng.uniform(0.0, 9.0, (12, 2)).round(digits)
        high = low + rng.uniform(0.2, 3.0, (12, 2)).round(digits)
        walls = [box(tuple(a), tuple(b)) for a, b in zip(low, high, strict=True)]
        grid = grid_of_polygons(walls, low[:1], 0.5, 0.1)
        my, mx = np.indices(grid.cells.shape)
        together = shapely.union_all([shapely.Polygon(one.points) for one in walls])
        centres = grid.map_to_world(np.stack([mx, my], axis=-1))
        away = shapely.distance(shapely.points(centres), together)
        np.testing.assert_array_equal(grid.cells == 100, away <= 0.1 / np.sqrt(2.0))
