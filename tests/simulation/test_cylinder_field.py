"""Fields of a cellular automaton: its rule, their cover by rectangles, and ways through them."""

import numpy as np
import pytest
import shapely

from wideberth.framework.values.errors import WideberthError
from wideberth.routes.navfn import NavFn
from wideberth.simulation.scenarios.cylinder_field import (
    CELLS,
    SIDE,
    CylinderField,
    grown,
    passable,
    rectangles,
)


def by_hand(rng: np.random.Generator, fill: float, smoothings: int) -> np.ndarray:
    """The same automaton, cell by cell."""
    cells = rng.random((CELLS, CELLS)) < fill
    cells[0] = cells[-1] = True
    for _ in range(smoothings):
        after = cells.copy()
        for i in range(CELLS):
            for j in range(CELLS):
                count = 0
                for a in range(i - 1, i + 2):
                    for b in range(j - 1, j + 2):
                        if (a, b) == (i, j):
                            continue
                        if not 0 <= a < CELLS:
                            count += 1
                        elif 0 <= b < CELLS:
                            count += cells[a, b]
                if count > 4:
                    after[i, j] = True
                elif count < 2:
                    after[i, j] = False
        cells = after
    return cells


@pytest.mark.parametrize(("fill", "smoothings"), [(0.15, 2), (0.3, 4)])
def test_cells_change_as_the_rule_says(fill: float, smoothings: int) -> None:
    found = grown(np.random.default_rng(3), fill, smoothings)
    np.testing.assert_array_equal(found, by_hand(np.random.default_rng(3), fill, smoothings))
    assert 0.02 < found.mean() < 0.6


def test_rectangles_cover_the_filled_cells_and_nothing_else() -> None:
    cells = grown(np.random.default_rng(5), 0.25, 3)
    shapes = [shapely.Polygon(one.points) for one in rectangles(cells)]
    rows, columns = np.mgrid[:CELLS, :CELLS] + 0.5
    middles = shapely.points(SIDE * columns, SIDE * (rows - 0.5 * CELLS))
    inside = sum(shapely.contains(shape, middles).astype(int) for shape in shapes)
    np.testing.assert_array_equal(inside, cells.astype(int))
    area = sum(shape.area for shape in shapes)
    assert area == pytest.approx(cells.sum() * SIDE**2)
    assert len(shapes) < cells.sum()


def test_a_gap_lets_through_whom_it_has_room_for() -> None:
    cells = np.zeros((CELLS, CELLS), dtype=bool)
    cells[:, 10] = True
    assert not passable(cells, 0.01)
    cells[12:16, 10] = False  # 0.6 m
    assert passable(cells, 0.28)
    assert not passable(cells, 0.36)


def test_paths_keep_clear_of_all_pillars_and_seeds_repeat() -> None:
    scenario = CylinderField(routes=NavFn())
    for seed in (0, 4):
        cast, again = scenario.cast(seed), scenario.cast(seed)
        assert cast.polygons == again.polygons
        (one,) = cast.placements
        np.testing.assert_array_equal(one.path.points, again.placements[0].path.points)
        pillars = shapely.union_all([shapely.Polygon(wall.points) for wall in cast.polygons])
        apart = shapely.distance(shapely.LineString(one.path.points), pillars)
        assert apart >= scenario.robot_radius
        np.testing.assert_allclose(one.path.points[[0, -1]], [[-2.0, 0.0], [8.0, 0.0]], atol=0.05)


def test_later_kinds_are_more_crowded() -> None:
    scenario = CylinderField()
    first, last = (len(scenario.cast(seed).polygons) for seed in (0, 9))
    assert last > 1.5 * first
    (one,) = scenario.cast(0).placements
    assert one.path.length == pytest.approx(10.0)


def test_a_robot_that_is_too_large_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wideberth.simulation.scenarios.cylinder_field._DRAWS", 5)
    with pytest.raises(WideberthError, match=r"in 5 draws no field .* radius 1\.5 m"):
        CylinderField(routes=NavFn(), robot_radius=1.5).cast(0)
