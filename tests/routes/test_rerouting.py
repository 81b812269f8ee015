"""Routes through waypoints around walls and around people who stand: distances by shapely."""

from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from wideberth import Detection, WideberthError
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.routes.rerouting import Rerouting
from wideberth.routes.walls import box, walls_around, walls_of_segments

LOW, HIGH = np.array([10.0, 3.5]), np.array([10.0, 8.5])
"""Middles of the two doors."""
START, GOAL = (2.0, 3.5), (18.0, 3.5)


def doors(*edges: float) -> tuple[Polygon, ...]:
    """Return a hall of 20 m by 12 m, divided by a wall with doors between these edges."""
    pieces = np.reshape([0.0, *edges, 12.0], (-1, 2))
    walls = [[10.0, low, 10.0, high] for low, high in pieces]
    return (*walls_around((0.0, 0.0), (20.0, 12.0)), *walls_of_segments(walls))


HALL = doors(2.0, 5.0, 7.0, 10.0)


def clearance(path: Path, walls: Sequence[Polygon]) -> float:
    """Least distance of a path from walls, m."""
    shapes = shapely.union_all([shapely.Polygon(wall.vertices) for wall in walls])
    return float(shapely.distance(shapely.LineString(path.points), shapes))


def passed(path: Path, point: Sequence[float] | Array) -> float:
    """Distance at which a path passes a point, m."""
    return float(shapely.distance(shapely.LineString(path.points), shapely.Point(point)))


def person(place: Sequence[float] | Array, ident: str = "1") -> Detection:
    return Detection(ident, np.asarray(place, float), None, 0.4)


def found(routes: Rerouting, time: float, people: Sequence[Detection] = ()) -> Path:
    path = routes.update(time, START, [GOAL], people).path
    assert path is not None
    return path


def test_a_route_keeps_the_first_clearance_from_walls_on_each_leg() -> None:
    waypoints = [(14.0, 8.5), (6.0, 9.0), (4.0, 2.0)]
    routes = Rerouting(HALL, radius=1.0)
    route = routes.update(0.0, START, waypoints)
    assert route.path is not None and not route.reason
    for waypoint in waypoints:
        assert passed(route.path, waypoint) < 1e-9
    np.testing.assert_array_equal(route.path.points[[0, -1]], [START, waypoints[-1]])
    assert clearance(route.path, HALL) >= 1.35 - 1e-9


@pytest.mark.parametrize(("gap", "least"), [(3.1, 0.35), (2.7, 0.15), (2.35, 0.0), (2.2, -0.1)])
def test_a_narrow_door_takes_a_smaller_clearance(gap: float, least: float) -> None:
    walls = doors(6.0 - 0.5 * gap, 6.0 + 0.5 * gap)
    route = Rerouting(walls, radius=1.0).update(0.0, START, [GOAL])
    assert route.path is not None and not route.reason
    assert 1.0 + least <= clearance(route.path, walls) < 0.5 * gap


def test_a_narrow_door_takes_no_clearance_from_other_legs() -> None:
    walls = doors(4.9, 7.1)
    waypoints = [(15.0, 6.0), (18.0, 1.5)]
    path = Rerouting(walls, radius=1.0).update(0.0, START, waypoints).path
    assert path is not None
    beyond = path.arc > path.project(np.array(waypoints[0])) + 1e-6
    assert clearance(Path(path.points[beyond]), walls) >= 1.35 - 1e-9


def test_places_too_near_to_walls_are_moved_by_less_than_the_radius() -> None:
    walls = walls_around((0.0, 0.0), (20.0, 12.0))
    path = Rerouting(walls, radius=1.0).update(0.0, (0.6, 6.0), [(19.3, 6.0)]).path
    assert path is not None
    np.testing.assert_array_equal(path.points[0], (0.6, 6.0))
    assert 1.35 <= path.points[1, 0] < 1.6 and 18.4 < path.goal[0] <= 18.65
    assert clearance(Path(path.points[1:]), walls) >= 1.35 - 1e-9


def test_where_no_way_leads_the_leg_is_straight_and_said_to_be() -> None:
    walls = doors(5.5, 6.5)
    route = Rerouting(walls, radius=1.0).update(0.0, START, [(5.0, 3.5), GOAL])
    assert route.reason == "no way leads to waypoint 1: the path is straight"
    assert route.path is not None and passed(route.path, (11.0, 3.5)) < 1e-9


def test_a_route_stays_while_nothing_is_new() -> None:
    routes = Rerouting(HALL, radius=1.0)
    waypoints = [(5.0, 6.0), (14.0, 8.5), GOAL]
    route = routes.update(0.0, START, waypoints)
    for time, rest in enumerate((waypoints, waypoints[1:], waypoints[2:])):
        assert routes.update(float(time), (3.0 + time, 5.0), rest) is route
    assert routes.update(3.0, (17.0, 4.0), []) is route
    assert routes.update(4.0, (6.0, 5.0), [(5.0, 6.0), GOAL]) is not route


def test_a_person_who_stands_in_the_door_is_driven_around() -> None:
    routes = Rerouting(HALL, radius=1.0)
    first = found(routes, 0.0)
    assert passed(first, LOW) < 0.5
    for time in (0.0, 1.0, 2.0, 2.9):
        assert found(routes, time, [person(LOW)]) is first
    second = found(routes, 3.0, [person(LOW)])
    assert passed(second, HIGH) < 0.5 and passed(second, LOW) > 1.4
    assert clearance(second, HALL) >= 1.35 - 1e-9
    assert found(routes, 9.0) is second, "the new one is free"


def test_the_route_stays_where_there_is_no_other() -> None:
    routes = Rerouting(HALL, radius=1.0)
    first, both = found(routes, 0.0), [person(LOW), person(HIGH, "2")]
    for time in np.arange(0.0, 20.0, 0.5):
        assert found(routes, float(time), both) is first
    assert passed(found(routes, 21.0, both[:1]), HIGH) < 0.5, "it is tried again"


def test_people_who_walk_or_stand_aside_change_nothing() -> None:
    routes = Rerouting(HALL, radius=1.0)
    first = found(routes, 0.0)
    for step in range(100):
        walking = person((10.0, 2.5 + 0.02 * step))
        assert found(routes, 0.1 * step, [walking, person((10.0, 1.0), "2")]) is first


def test_who_was_passed_is_not_in_the_way() -> None:
    routes = Rerouting(HALL, radius=1.0)
    route = routes.update(0.0, START, [GOAL])
    for time in (0.0, 4.0, 8.0):
        assert routes.update(time, (14.0, 3.5), [GOAL], [person(LOW)]) is route


def test_a_person_who_is_almost_touched_can_be_left() -> None:
    routes = Rerouting(HALL, radius=1.0)
    for time in (0.0, 4.0):
        route = routes.update(time, (8.6, 3.5), [GOAL], [person(LOW)])
    assert route.path is not None and not route.reason
    assert passed(route.path, HIGH) < 0.5 and passed(route.path, LOW) >= 1.4 - 1e-9


def test_numbers_of_no_use_leave_the_route() -> None:
    routes = Rerouting(HALL, radius=1.0)
    assert "position is [nan, 0.0]" in routes.update(0.0, (np.nan, 0.0), [GOAL]).reason
    route = routes.update(0.0, START, [GOAL])
    bad = Detection("1", np.array([np.nan, 0.0]), None, np.inf)
    for time in (np.nan, np.inf, -5.0, 5.0):
        assert routes.update(time, START, [GOAL], [bad, person((10.0, 1.0))]) is route
        assert routes.update(time, (np.inf, 0.0), [GOAL]) is route


def test_a_robot_far_away_or_at_its_goal_has_an_answer() -> None:
    far = Rerouting(HALL, radius=1.0).update(0.0, (1e6, 0.0), [GOAL])
    assert far.path is not None
    there = Rerouting(HALL, radius=1.0).update(0.0, GOAL, [GOAL])
    assert there.path is None and there.reason == "the robot is at the last waypoint"
    routes = Rerouting(HALL, radius=1.0)
    assert routes.update(0.0, GOAL, [GOAL]).path is None
    assert routes.update(0.1, START, [GOAL]).path is not None
    free = Rerouting((), radius=1.0).update(0.0, START, [GOAL])
    assert free.path is not None and free.path.length == pytest.approx(16.0, abs=0.1)


def test_clearances_need_a_body() -> None:
    with pytest.raises(WideberthError, match=r"clearances is \(-1\.0,\)"):
        Rerouting((), 1.0, (-1.0,))
    with pytest.raises(WideberthError, match=r"clearances is \(\)"):
        Rerouting((), 1.0, ())
    with pytest.raises(WideberthError, match=r"rerouting\.radius is 0"):
        Rerouting((box((0, 0), (1, 1)),), 0.0)


def test_a_robot_that_has_left_its_route_gets_another_one() -> None:
    """Pushed beside the door, it is led back to its mouth, not through the wall."""
    routes = Rerouting(HALL, radius=1.0)
    first = routes.update(0.0, START, [GOAL])
    assert routes.update(1.0, (5.0, 4.2), [GOAL]) is first, "it is beside it by less"
    beside = (8.5, 0.8)
    route = routes.update(2.0, beside, [GOAL])
    assert route is not first and route.path is not None
    np.testing.assert_array_equal(route.path.points[0], beside)
    assert passed(route.path, LOW) < 0.6
    assert routes.update(3.0, (8.5, 7.0), [GOAL]) is route, "not before its patience is over"
    assert routes.update(5.5, (8.5, 7.0), [GOAL]) is not route


def test_a_robot_that_was_pushed_past_a_waypoint_does_not_turn_back() -> None:
    routes = Rerouting(HALL, radius=1.0)
    waypoints = [(5.0, 3.5), (14.0, 3.5), GOAL]
    routes.update(0.0, START, waypoints)
    route = routes.update(1.0, (6.0, 1.5), waypoints)
    assert route.path is not None and passed(route.path, (5.0, 3.5)) > 1.5
    assert passed(route.path, (14.0, 3.5)) < 1e-9
    assert np.diff(route.path.points[:, 0]).min() > -0.05, "it goes on"


def test_a_robot_beside_its_route_without_a_waypoint_left_keeps_it() -> None:
    routes = Rerouting(HALL, radius=1.0)
    route = routes.update(0.0, START, [GOAL])
    assert routes.update(1.0, (8.5, 0.8), []) is route
