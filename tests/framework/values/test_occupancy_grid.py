"""Grids of cells: places, values, bad input."""

from typing import Any

import numpy as np
import pytest

from wideberth import Costmap, OccupancyGrid, WideberthError, draw


def test_centres_belong_to_their_cells() -> None:
    grid = OccupancyGrid(np.arange(12).reshape(3, 4), 0.05, (-3.1, 7.3))
    mx, my = np.meshgrid(np.arange(4), np.arange(3))
    cells = np.stack([mx, my], axis=-1)
    centres = grid.map_to_world(cells)
    assert np.array_equal(grid.world_to_map(centres), cells)
    assert np.array_equal(grid.at(centres, outside=-1), grid.cells)
    assert grid.inside(centres).all()
    assert (grid.width, grid.height, grid.cells.dtype) == (4, 3, np.int8)


@pytest.mark.parametrize(
    "point",
    [
        *((-0.01, 0.5), (0.5, -0.01), (1.0, 0.5), (0.5, 2.0)),
        *((np.nan, 0.5), (1e300, 0.5), (0.5, -np.inf)),
    ],
)
def test_points_off_the_grid_have_no_cell(point: tuple[float, float]) -> None:
    grid = OccupancyGrid(np.zeros((20, 10), dtype=int), 0.1)
    assert not grid.inside(point) and grid.at(point, outside=77) == 77


def test_cells_are_read_only_and_apart_from_what_was_given() -> None:
    given = np.zeros((2, 2), dtype=np.int8)
    grid = OccupancyGrid(given, 1.0)
    given[0, 0] = 100
    assert grid.cells[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        grid.cells[0, 0] = 1


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: OccupancyGrid([[101]], 1.0), r"occupancy_grid.cells\[0, 0\] is 101.*-1 to 100"),
        (lambda: OccupancyGrid([[0, -2]], 1.0), r"cells\[0, 1\] is -2"),
        (lambda: OccupancyGrid([[0.5]], 1.0), r"is 0\.5; wanted whole numbers"),
        (lambda: OccupancyGrid([0, 1], 1.0), "a row of cells per row of the map"),
        (lambda: OccupancyGrid(np.zeros((0, 3), int), 1.0), "wanted at least one cell"),
        (lambda: Costmap([[256]], 1.0), r"costmap.cells\[0, 0\] is 256"),
        (lambda: Costmap([[0]], 0.0), "costmap.resolution is 0"),
        (lambda: Costmap([[0]], 1.0, (np.nan, 0.0)), r"costmap.origin\[0\] is nan"),
        (lambda: Costmap([[0]], 1.0, (1e10, 0.0)), "reaches beyond"),
    ],
)
def test_bad_grids_are_refused(make: Any, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        make()


def test_the_static_layer_of_a_map() -> None:
    grid = OccupancyGrid([[-1, 0, 64, 65, 100]], 0.1, (1.0, 2.0))
    found = Costmap.from_grid(grid, track_unknown=False, lethal_threshold=65)
    assert found.cells.tolist() == [[0, 0, 0, 254, 254]] and found.origin == grid.origin
    assert Costmap.from_grid(grid).cells.tolist() == [[255, 0, 0, 0, 254]]


def test_blocked_steps() -> None:
    costmap = Costmap([[0, 252, 253, 254, 255, 0]], 1.0)
    points = np.array([[0.1, 0.5], [1.9, 0.5], [2.1, 0.5], [4.1, 0.5], [5.9, 0.5], [6.1, 0.5]])
    assert costmap.blocked_steps(points).tolist() == [False, True, True, False, True]
    assert costmap.blocked_steps(points[:1]).tolist() == []
    thin = np.zeros((1, 100), dtype=int)
    thin[0, 50] = 254
    assert Costmap(thin, 1.0).blocked_steps(np.array([[0.5, 0.5], [99.5, 0.5]])).all()


@pytest.mark.parametrize("grid", [OccupancyGrid([[-1, 0, 100]], 1.0), Costmap([[0, 9, 254]], 1.0)])
def test_grids_are_drawn(grid: Any) -> None:
    """The darker, the more occupied or the more costly a cell is."""
    (image,) = draw.grid(grid).images
    assert image.get_extent() == [0.0, 3.0, 0.0, 1.0]
    unknown, free, lethal = 0.25, 0.4 * 9 / 252, 1.0
    wanted = [0.0, free, lethal] if isinstance(grid, Costmap) else [unknown, 0.0, lethal]
    np.testing.assert_allclose(image.get_array(), [wanted])


def test_cells_of_no_size_are_refused() -> None:
    """In such cells the inflation radius is more of them than a float holds."""
    with pytest.raises(WideberthError, match="resolution is 1e-300 m; wanted at least 1e-06"):
        OccupancyGrid(np.zeros((2, 2), np.int8), 1e-300)
