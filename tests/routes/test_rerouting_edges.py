"""Edges of rerouting: radii of people, clocks that go back, ends in walls, clearances."""

import numpy as np
import pytest
import shapely

from wideberth import Detection, WideberthError
from wideberth.framework.values.costmap import INSCRIBED, LETHAL
from wideberth.routes.rerouting import Rerouting
from wideberth.routes.walls import box
from wideberth.tests.routes.test_rerouting import (
    GOAL,
    HALL,
    HIGH,
    LOW,
    START,
    doors,
    found,
    passed,
    person,
)


@pytest.mark.parametrize("radius", [0.3, 1.1])
def test_a_person_stands_in_the_way_from_both_radii_on(radius: float) -> None:
    """In the open, beside the path: the edge is the robot's radius and the person's."""
    for surplus, blocks in ((0.02, False), (-0.02, True)):
        routes = Rerouting((), radius=1.0)
        first = found(routes, 0.0)
        there = np.array([10.0, 9.0])
        there[1] += 1.0 + radius + surplus - passed(first, there)
        assert passed(first, there) == pytest.approx(1.0 + radius + surplus, abs=1e-3)
        for time in (0.0, 3.0):
            path = found(routes, time, [Detection("1", there, None, radius)])
        assert (path is not first) == blocks
        if blocks:
            assert passed(path, there) >= 1.0 + 0.35 + radius - 1e-9


def test_after_a_clock_that_goes_back_people_stand_anew() -> None:
    """Who stood at 100 s has stood for no time at 0 s, and for long enough 3 s later."""
    routes = Rerouting(HALL, radius=1.0)
    first = found(routes, 100.0, [person(LOW)])
    for time in (0.0, 1.0, 2.9):
        assert found(routes, time, [person(LOW)]) is first
    assert passed(found(routes, 3.0, [person(LOW)]), HIGH) < 0.5


def test_after_a_clock_that_goes_back_a_route_is_sought_at_once() -> None:
    """An attempt of the clock before says nothing of when the next one is due."""
    routes, both = Rerouting(HALL, radius=1.0), [person(LOW), person(HIGH, "2")]
    for time in (100.0, 103.0):
        first = found(routes, time, both)
    assert found(routes, 0.0, both) is first
    assert passed(found(routes, 3.0, both[:1]), HIGH) < 0.5


def test_an_end_deep_in_a_wall_has_no_way() -> None:
    """The nearest free place is farther than the radius: the leg is straight."""
    block = (box((12.0, 2.0), (18.0, 10.0)),)
    route = Rerouting(block, radius=1.0).update(0.0, START, [(15.0, 6.0), (25.0, 6.0)])
    assert route.reason == "no way leads to waypoint 0: the path is straight"
    assert route.path is not None and passed(route.path, (15.0, 6.0)) < 1e-9


def test_at_the_end_of_its_path_a_robot_keeps_the_route() -> None:
    routes = Rerouting(HALL, radius=1.0)
    route = routes.update(0.0, START, [GOAL])
    for time in (1.0, 5.0):
        assert routes.update(time, GOAL, [GOAL], [person(LOW)]) is route


def test_the_map_grows_with_the_waypoints() -> None:
    routes = Rerouting((), radius=1.0)
    for goal in ((5.0, 3.5), (60.0, 3.5), (-60.0, 40.0)):
        route = routes.update(0.0, START, [goal])
        assert route.path is not None and not route.reason
        np.testing.assert_array_equal(route.path.goal, goal)


def test_a_door_narrower_than_the_last_clearance_has_no_way() -> None:
    """Cells of 0.1 m take at most 0.28 m off a door; from -0.1 m on 0.2 m are given back."""
    walls = doors(6.0 - 0.99, 6.0 + 0.99)
    route = Rerouting(walls, radius=1.0).update(0.0, START, [GOAL])
    assert route.reason == "no way leads to waypoint 0: the path is straight"


def test_every_clearance_needs_a_body() -> None:
    with pytest.raises(WideberthError, match=r"clearances is \(0\.3, -2\.0\)"):
        Rerouting((), 1.0, (0.3, -2.0))
    with pytest.raises(WideberthError, match=r"clearances is \(0\.3, inf\)"):
        Rerouting((), 1.0, (0.3, np.inf))


def test_a_robot_that_was_pushed_past_two_waypoints_turns_back_to_none() -> None:
    routes = Rerouting(HALL, radius=1.0)
    waypoints = [(4.0, 3.5), (6.0, 3.5), (14.0, 3.5), GOAL]
    routes.update(0.0, START, waypoints)
    route = routes.update(1.0, (7.5, 1.5), waypoints)
    assert route.path is not None and passed(route.path, (6.0, 3.5)) > 1.5
    assert passed(route.path, (14.0, 3.5)) < 1e-9


@pytest.mark.parametrize(("step", "stands"), [(0.29, True), (0.31, False)])
def test_a_person_stands_within_0_3_m(step: float, stands: bool) -> None:
    routes = Rerouting(HALL, radius=1.0)
    first = found(routes, 0.0, [person(LOW)])
    later = found(routes, 3.0, [person(LOW + step * np.array([0.6, 0.8]))])
    assert (later is not first) == stands


def test_the_map_reaches_a_metre_beyond_the_clearance_and_walls_cost_there() -> None:
    """Of cells of 0.1 m: closed up to the clearance and a diagonal, then 252 exp(-3 (d - it))."""
    routes = Rerouting(HALL, radius=1.0)
    found(routes, 0.0)
    bare = routes._bare
    assert bare is not None and bare.resolution == 0.1
    corners = np.concatenate([wall.points for wall in HALL])
    np.testing.assert_allclose(bare.origin, corners.min(axis=0) - (1.0 + 0.35 + 1.0), atol=1e-9)
    costmap = routes._inflated(0.15, [])
    rows, columns = np.mgrid[: bare.height, : bare.width]
    lethal = np.argwhere(bare.cells == LETHAL)
    places = shapely.points(np.stack([columns, rows], axis=-1))
    away = 0.1 * shapely.distance(shapely.MultiPoint(lethal[:, ::-1]), places)
    reach = 1.0 + 0.15 + np.sqrt(2.0) * 0.1
    falling = np.floor(252.0 * np.exp(-3.0 * (away - reach)))
    ring = (away > reach + 1e-6) & (away < reach + 1.0 - 1e-6)
    np.testing.assert_allclose(costmap.cells[ring].astype(float), falling[ring], atol=1.0)
    assert (costmap.cells[away < reach - 1e-6] >= INSCRIBED).all()
    assert (costmap.cells[away > reach + 1.0 + 0.15] == 0).all()


def test_cells_are_larger_where_walls_reach_far() -> None:
    """2000 of them along the longer side."""
    far = (*HALL, box((0.0, 900.0), (1.0, 901.0)))
    routes = Rerouting(far, radius=1.0)
    found(routes, 0.0)
    assert routes._bare is not None
    lowest = min(float(wall.points[:, 1].min()) for wall in HALL)
    assert routes._bare.resolution == pytest.approx((901.0 - lowest) / 2000.0)
