"""Inflation against brute force over all pairs of cells, and its bad input."""

import numpy as np
import pytest

from wideberth import Costmap, Inflation, WideberthError
from wideberth.framework.values.costmap import INSCRIBED, LETHAL


@pytest.mark.parametrize("seed", range(6))
def test_costs_are_those_of_the_nearest_obstacle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.choice([0, 100, 254, 255], (17, 23), p=[0.8, 0.1, 0.03, 0.07])
    layer = Inflation(
        0.12, 0.37, rng.uniform(1.0, 9.0), bool(rng.integers(2)), bool(rng.integers(2))
    )
    found = layer.inflated(Costmap(cells, 0.05)).cells
    obstacle = (cells == 254) | (layer.inflate_around_unknown & (cells == 255))
    places = np.argwhere(obstacle)
    for (my, mx), old in np.ndenumerate(cells):
        distance = np.hypot(*(places - (my, mx)).T).min()
        new = 0
        if distance <= 8:  # ceil(0.37 / 0.05)
            metres = np.floor(100 * np.float32(distance) + 0.5) / 100 * 0.05
            fall = 252 * np.exp(-layer.cost_scaling_factor * (metres - 0.12))
            new = 254 if distance == 0 else 253 if metres <= 0.12 else int(fall)
        least = 1 if layer.inflate_unknown else 253
        wanted = max(old, new) if old != 255 else new if new >= least else 255
        assert found[my, mx] == wanted, (my, mx)


def test_a_window_changes_nothing_outside_and_sees_obstacles_near_it() -> None:
    cells = np.zeros((20, 30), dtype=int)
    cells[10, 9] = 254
    layer = Inflation(0.1, 0.5)
    costmap = Costmap(cells, 0.1)
    whole, part = layer.inflated(costmap).cells, layer.inflated(costmap, (10, 5, 20, 15)).cells
    inside = np.zeros_like(cells, dtype=bool)
    inside[5:15, 10:20] = True
    assert np.array_equal(part[inside], whole[inside]) and part[10, 10] == 253
    assert np.array_equal(part[~inside], cells[~inside])


def test_bad_input_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"inflation\.inflation_radius is -1"):
        Inflation(0.1, -1.0)
    with pytest.raises(WideberthError, match="inflation window is"):
        Inflation(0.1).inflated(Costmap([[0, 0]], 0.1), (0, 0, 3, 1))


def test_a_map_without_obstacles_stays_as_it_is() -> None:
    costmap = Costmap([[0, 7, 255]], 0.1)
    assert Inflation(0.1).inflated(costmap).cells.tolist() == [[0, 7, 255]]


def test_cells_far_smaller_than_the_radius_take_no_more_memory() -> None:
    """A table of all squares up to the radius has 3e11 entries here."""
    cells = np.zeros((3, 4), np.uint8)
    cells[1, 1] = LETHAL
    found = Inflation(0.1, 0.55).inflated(Costmap(cells, 1e-6))
    wanted = np.full((3, 4), INSCRIBED)
    wanted[1, 1] = LETHAL
    np.testing.assert_array_equal(found.cells, wanted)
