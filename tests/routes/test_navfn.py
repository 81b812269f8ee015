"""NavFn: laws, reasons, an interpreted twin, the closed form of a plane."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth import Costmap, Inflation, WideberthError, build
from wideberth.framework.testing import check_route_planner
from wideberth.routes import _wave
from wideberth.routes.navfn import NavFn
from wideberth.tests.helpers.contracts import Contract

PLANNERS = ("navfn", {"type": "navfn", "use_astar": True}, "smoothed")
CONTRACT = Contract.of(
    [build("route_planners", one) for one in PLANNERS], check_route_planner.laws
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_route_planners_keep_the_law(name: str, law: str) -> None:
    CONTRACT.check(name, law)


def test_a_planner_that_goes_straight_breaks_the_law() -> None:
    from wideberth import Path, Route, RoutePlanner

    class Straight(RoutePlanner):
        def plan(self, costmap: Costmap, start: Any, goal: Any) -> Route:
            return Route(Path([start, *np.linspace(start, goal, 50)[1:]]))

    with pytest.raises(AssertionError, match=r"touches no lethal cell.*\n.*no way, a reason"):
        check_route_planner(Straight())


def clutter(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.choice([0, 100, 254, 255], (24, 30), p=[0.5, 0.2, 0.25, 0.05])


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_compiled_and_interpreted_code_agree_bit_by_bit(seed: int, astar: bool) -> None:
    costmap = Costmap(clutter(seed), 0.1)
    wave = NavFn(use_astar=astar).wave(costmap, (0.5, 0.5), (2.4, 1.9))
    wide, flat = costmap.width, wave.costs.ravel()
    robot, goal = 5 * wide + 5, 19 * wide + 24
    potential, _ = _wave.spread(flat, robot, goal, wide, astar)
    assert np.array_equal(potential, wave.potential.ravel())
    if potential[goal] < _wave.UNREACHED:
        way, _ = wave.way_down((24, 19), 200)
        assert np.array_equal(_wave.descend(potential, robot, goal, wide, 200)[0], way)


def test_along_an_axis_a_cell_costs_what_it_says() -> None:
    """In a corridor of one cell the potential is the sum of the costs."""
    cells = np.full((3, 40), 254)
    cells[1] = np.arange(40)
    wave = NavFn().wave(Costmap(cells, 1.0), (1.0, 1.0), (38.0, 1.0))
    wanted = np.cumsum([0, *(int(50 + 0.8 * cost) for cost in range(2, 39))])
    assert wave.potential[1, 1:39].tolist() == wanted.tolist()


def test_reached_is_what_is_connected() -> None:
    """A flood fill over the four neighbours reaches the same cells, where nothing ends early."""
    from scipy.ndimage import label

    for seed in range(5):
        cells = np.where(np.random.default_rng(seed).random((80, 90)) < 0.35, 254, 0)
        cells[5, 5], cells[19, 24] = 0, 254  # a goal that is never reached: the wave fills all
        costmap = Costmap(cells, 0.1)
        wave = NavFn().wave(costmap, (0.5, 0.5), (2.4, 1.9))
        assert not wave.cut_short
        regions, _ = label(wave.costs < 254)
        assert np.array_equal(wave.potential < 1e10, regions == regions[5, 5])


def test_the_start_may_stand_in_an_obstacle_if_a_way_leads_out() -> None:
    cells = np.zeros((20, 20), dtype=int)
    cells[10, 10] = 254
    assert NavFn().plan(Costmap(cells, 0.1), (1.0, 1.0), (0.3, 0.3)).path is not None
    cells[8:13, 8:13] = 254
    route = NavFn().plan(Costmap(cells, 0.1), (1.0, 1.0), (0.3, 0.3))
    assert route.path is None and "the start (1, 1) lies in an obstacle" in route.reason


def test_a_goal_in_an_obstacle_gives_a_route_that_ends_near_it() -> None:
    cells = np.zeros((40, 40), dtype=int)
    cells[28:33, 28:33] = 254
    costmap = Costmap(cells, 0.05)
    route = NavFn(tolerance=0.5).plan(costmap, (0.3, 0.3), (1.5, 1.5))
    assert route.path is not None
    assert 0.05 < np.hypot(*(route.path.goal - 1.5)) < 0.2 and "ends 0." in route.reason
    for tolerance in (0.0, 0.05):
        route = NavFn(tolerance=tolerance).plan(costmap, (0.3, 0.3), (1.5, 1.5))
        assert route.path is None and "lies in an obstacle" in route.reason


def test_of_equally_near_ends_the_first_from_below_is_taken_and_the_square_has_a_border() -> None:
    """A block of 5 x 5 cells about the goal: with 0.25 m cells its free border is at 0.75 m."""
    cells = np.zeros((40, 40), dtype=int)
    cells[18:23, 18:23] = 254
    costmap = Costmap(cells, 0.25)
    route = NavFn(tolerance=0.75).plan(costmap, (1.0, 9.0), (5.0, 5.0))
    assert route.path is not None and route.path.goal.tolist() == [5.0, 4.25]
    assert NavFn(tolerance=0.5).plan(costmap, (1.0, 9.0), (5.0, 5.0)).path is None
    cells[:21] = 254  # free above the block alone: at the upper border of the square
    route = NavFn(tolerance=0.75).plan(Costmap(cells, 0.25), (1.0, 9.0), (5.0, 5.0))
    assert route.path is not None
    cells[:23] = 254
    route = NavFn(tolerance=0.75).plan(Costmap(cells, 0.25), (1.0, 9.0), (5.0, 5.0))
    assert route.path is not None and route.path.goal.tolist() == [5.0, 5.75]


def test_a_maze_on_a_small_map_meets_the_limit_of_cycles() -> None:
    cells = np.zeros((41, 41), dtype=int)
    for row in range(4, 40, 4):
        cells[row, slice(1, 37) if row % 8 else slice(4, 40)] = 254
    route = NavFn().plan(Costmap(cells, 0.1), (0.2, 0.2), (2.0, 3.8))
    assert route.path is None and "limit of cycles" in route.reason


def test_unknown_cells_are_passed_only_if_they_may_be() -> None:
    cells = np.zeros((20, 20), dtype=int)
    cells[:, 10] = 255
    assert NavFn().plan(Costmap(cells, 0.1), (0.3, 1.0), (1.7, 1.0)).path is not None
    planner = NavFn(allow_unknown=False, tolerance=0.1)
    assert planner.plan(Costmap(cells, 0.1), (0.3, 1.0), (1.7, 1.0)).path is None


def test_paths_prefer_the_middle_of_a_passage() -> None:
    cells = np.zeros((41, 100), dtype=int)
    cells[[0, -1]] = 254
    costmap = Inflation(0.2, 1.0, 2.0).inflated(Costmap(cells, 0.05))
    route = NavFn().plan(costmap, (0.3, 0.5), (4.7, 0.5))
    assert route.path is not None
    assert np.abs(route.path.at(np.array([2.0]))[0, 1] - 1.0) < 0.15


def test_nothing_to_drive_is_a_reason() -> None:
    route = NavFn().plan(Costmap(np.zeros((9, 9), dtype=int), 0.1), (0.4, 0.4), (0.4, 0.4))
    assert route.path is None and "same point" in route.reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"tolerance": -1.0}, "navfn.tolerance is -1"),
        ({"max_cycles_factor": 0}, "navfn.max_cycles_factor is 0"),
    ],
)
def test_bad_settings_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        NavFn(**arguments)


def test_a_start_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"start has shape \(3,\); wanted \(2,\)"):
        NavFn().plan(Costmap([[0]], 0.1), (0.0, 0.0, 0.0), (0.0, 0.0))
