"""What the map of a crowd holds, and when a way is sought: closed forms with stated numbers."""

from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np
import pytest
import shapely

from wideberth.controllers.pure_pursuit import PurePursuit
from wideberth.framework.control.command_limits import top_speed
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import INSCRIBED, LETHAL, Costmap
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.routes.around_crowds import AroundCrowds, WatchedCrowd, _inside, _Prices
from wideberth.routes.navfn import NavFn
from wideberth.routes.smoothed import SmoothedRoutes
from wideberth.routes.walls import box
from wideberth.tests.routes.test_around_crowds import (
    EAST,
    ROBOT,
    SQUARE,
    Recorder,
    crowd,
    followed,
    leader,
    looked,
    seen,
    wall_with,
)

BESIDE = 2.3
"""m around all that the map shows: 2 m and the robot's radius."""


def centres(costmap: Costmap) -> Array:
    rows, columns = np.mgrid[: costmap.height, : costmap.width]
    return np.asarray(costmap.map_to_world(np.stack([columns, rows], axis=-1)))


def prices_of(places: Array, dearer: float = 5.4, speed: float = 0.8) -> _Prices:
    return _Prices(looked(places), dearer, speed)


def shown(places: Array, prices: _Prices) -> Array:
    """Lowest and highest coordinates of places and of the ellipse at which the density ends."""
    middle, covariance = prices.crowd.mean, prices.crowd.covariance
    half = np.sqrt(6.0 * np.diag(covariance))
    corners = np.concatenate([places, [middle - half, middle + half]])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def test_a_cell_costs_the_price_of_its_metre() -> None:
    """NavFn counts 50 + 0.8 c for a cell of cost c, 50 for a free one; c is 252 at most."""
    prices = prices_of(crowd(10))
    costmap = leader()._map(seen([]), EAST.points, prices)
    ratio = prices.ratio(centres(costmap))
    counted = 1.0 + 0.8 * costmap.cells / 50.0
    below = costmap.cells < 252
    assert (counted[below] >= ratio[below] - 1e-9).all()
    assert (counted[below] < ratio[below] + 0.016 + 1e-9).all()
    assert (ratio[~below] > 1.0 + 0.8 * 251 / 50.0).all() and costmap.cells.max() <= 252
    assert (costmap.cells == 0).any() and costmap.cells.max() > 40
    dear = leader()._map(seen([]), EAST.points, replace(prices, dearer=500.0))
    assert dear.cells.max() == 252


@pytest.mark.parametrize(("scale", "cell"), [(1.0, 0.25), (20.0, None)])
def test_the_map_shows_the_path_and_the_crowd(scale: float, cell: float | None) -> None:
    """Cells of 0.25 m, or a 200th of the longer side."""
    path, prices = scale * EAST.points, prices_of(crowd(10, middle=(3.0, 6.0)) * scale)
    low, high = shown(path, prices)
    costmap = leader()._map(seen([]), path, prices)
    size = (high - low) + 2.0 * BESIDE
    resolution = cell or size.max() / 200.0
    assert costmap.resolution == pytest.approx(resolution, rel=1e-9)
    np.testing.assert_allclose(costmap.origin, low - BESIDE, atol=1e-9)
    cells = np.array([costmap.width, costmap.height])
    assert (np.abs(cells - size / resolution) <= 1.0).all()


def test_beside_walls_the_map_is_a_square_of_twice_the_side() -> None:
    prices, walls = prices_of(crowd(10)), wall_with((-1.0, 1.0), reach=500.0)
    costmap = leader()._map(seen([], walls=walls), EAST.points, prices)
    low, high = shown(EAST.points, prices)
    side = float((high - low).max()) + 2.0 * BESIDE
    np.testing.assert_allclose(costmap.origin, (low + high) / 2.0 - side, atol=1e-9)
    resolution = max(0.25, 2.0 * side / 200.0)
    assert costmap.resolution == pytest.approx(resolution, rel=1e-9)
    cells = np.array([costmap.width, costmap.height])
    assert (np.abs(cells - 2.0 * side / resolution) <= 1.0).all()


def test_cells_near_walls_are_closed() -> None:
    """Within the robot's radius and a cell of a lethal one, up to half a diagonal off the wall."""
    prices, walls = prices_of(crowd(10)), [box((-0.1, 1.0), (0.1, 6.0)), box((4, -3), (5, -2))]
    costmap = leader()._map(seen([], walls=walls), EAST.points, prices)
    shape = shapely.union_all([shapely.Polygon(wall.points) for wall in walls])
    away = shapely.distance(shape, shapely.points(centres(costmap)))
    reach, half = 0.3 + costmap.resolution, np.sqrt(0.5) * costmap.resolution
    closed = costmap.cells >= INSCRIBED
    assert closed[away <= reach - half - 1e-9].all()
    assert not closed[away > reach + half + 1e-9].any()
    assert (costmap.cells[away == 0.0] == LETHAL).all()
    ratio = prices.ratio(centres(costmap))
    counted = 1.0 + 0.8 * costmap.cells / 50.0
    priced = np.abs(counted - ratio - 0.008) <= 0.008 + 1e-9
    assert priced[away > 1.0].all()
    lethal = shapely.MultiPoint(centres(costmap)[costmap.cells == LETHAL])
    apart = shapely.distance(lethal, shapely.points(centres(costmap)))
    falling = costmap.cells == np.floor(252.0 * np.exp(reach - apart))
    assert (priced | falling)[~closed].all()  # within a cell of what is closed


def test_walls_outside_of_the_square_change_nothing() -> None:
    prices = prices_of(crowd(10))
    far = leader()._map(seen([], walls=[box((300, 0), (301, 1))]), EAST.points, prices)
    free = leader()._map(seen([]), EAST.points, prices)
    np.testing.assert_array_equal(far.cells, free.cells)
    assert far.resolution == free.resolution


def test_a_metre_costs_the_encounters_to_expect() -> None:
    """1 + price 2 (r + q) hypot(v, w) rho, over 1 / v, with the radius of those who are seen."""
    assert leader()._dearer(0.3) == pytest.approx(9.0 * 2.0 * 0.6)
    one = AroundCrowds(Recorder(), price=4.0)
    assert one._dearer(0.2) == pytest.approx(4.0 * 2.0 * (0.3 + 0.2))
    found, place = looked(crowd(6)), np.array([0.5, -0.5])
    ratio = _Prices(found, one._dearer(0.2), 0.7).ratio(place)
    expected = 1.0 + 4.0 * hypot(0.7, 1.3) * float(found.density(place))
    assert ratio == pytest.approx(expected, rel=1e-12)


def test_a_way_of_one_place_and_a_long_one_cost_what_they_should() -> None:
    prices = _Prices(looked(crowd(6, middle=(900.0, 0.0))), 5.4, 0.5)
    assert prices.of(np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 3.0]])) == pytest.approx(6.0)
    assert prices.of(np.array([[0.0, 0.0], [0.0, 600.0]])) == pytest.approx(1200.0)


def test_the_mean_radius_of_people_makes_a_metre_dearer() -> None:
    people = tuple(
        Detection(str(k), place, None, 0.1 + 0.2 * (k % 3)) for k, place in enumerate(crowd(6))
    )
    one = leader()
    one.command(Observation(0.0, np.array([-8.0, 0.0, 0.0, 0.0, 0.0]), people))
    watched = one._memory.crowd
    assert watched is not None and watched.radius == pytest.approx(0.3)


def test_the_speed_is_that_of_the_path_or_the_robots_largest() -> None:
    observation = seen([])
    slow = AroundCrowds(Recorder(reference_speed=0.45))
    assert slow._speed(observation) == 0.45
    other = AroundCrowds(PurePursuit(ROBOT))
    expected = getattr(other.controller, "reference_speed", None) or top_speed(
        ROBOT, observation.state
    )
    assert other._speed(observation) == expected


def test_three_people_are_a_crowd_and_walk_at_1_3_m_s() -> None:
    two = {"a": np.zeros(2), "b": np.ones(2)}
    assert WatchedCrowd.seen(None, 0.0, two, 0.3) is None
    three = WatchedCrowd.seen(None, 0.0, {**two, "c": np.array([2.0, 0.0])}, 0.3)
    assert three is not None and (three.count, three.span, three.speed) == (3, 0.0, 1.3)
    np.testing.assert_allclose(three.mean, [1.0, 1.0 / 3.0])


def test_a_crowd_in_one_place_has_a_deviation_of_half_a_metre() -> None:
    found = looked(np.tile([3.0, -2.0], (4, 1)))
    np.testing.assert_allclose(found.covariance, 0.25 * np.eye(2), atol=1e-12)
    inside, outside = found.density(np.array([[3.0, -2.0 + 1.22], [3.0, -2.0 + 1.23]]))
    assert inside > 0.0 and outside == 0.0  # sqrt(6) / 2 m


def watched(stamps: list[float], people: list[Array]) -> WatchedCrowd:
    found = None
    for stamp, places in zip(stamps, people, strict=True):
        found = WatchedCrowd.seen(found, stamp, dict(zip("abcd", places, strict=True)), 0.3)
    assert found is not None
    return found


def test_the_first_look_counts_for_3_s_and_all_of_them_for_63() -> None:
    first, second = np.zeros((4, 2)), np.tile([10.0, 0.0], (4, 1))
    assert watched([0.0, 2.0], [first, second]).mean[0] == pytest.approx(10.0 * 2.0 / 5.0)
    looks = [4.0 * k for k in range(31)]
    old = watched(looks, [first] * 31)
    assert old.span == 60.0
    later = watched([*looks, 121.0], [first] * 31 + [second])
    assert later.mean[0] == pytest.approx(10.0 / 63.0)


def test_a_crowd_is_forgotten_after_5_s() -> None:
    first = looked(crowd(5))
    assert WatchedCrowd.seen(first, 5.0, {}, 0.0) is first
    assert WatchedCrowd.seen(first, 5.001, {}, 0.0) is None


def test_speed_is_measured_between_looks_a_second_apart() -> None:
    """At 2 m/s, looked at every 0.5 s; a look changes the speed by a tenth at most."""
    ways = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    stamps = [0.5 * k for k in range(8)]
    speeds = [
        watched(stamps[: k + 1], [ways * (1.0 + 2.0 * stamp) for stamp in stamps[: k + 1]]).speed
        for k in range(8)
    ]
    expected, speed = [1.3, 1.3], 1.3
    for k in range(2, 8):
        if k % 2 == 0:  # marks are a second old
            speed += min(0.1, 0.5 / (0.5 * k + 3.0)) * (2.0 - speed)
        expected.append(speed)
    np.testing.assert_allclose(speeds, expected, atol=1e-12)
    slow = watched([0.0, 4.9], [ways, ways * 1.49])
    assert slow.speed == pytest.approx(1.3 + 0.1 * (0.1 - 1.3))


def test_ways_are_sought_once_a_second() -> None:
    one, sought = leader(), []
    for stamp in (0.0, 0.4, 0.999, 1.0, 1.9, 2.0 - 1e-12, 2.5, 3.5, 0.2, 0.3):
        one.command(seen(crowd(12), stamp))
        sought.append(one._memory.looked)
    assert sought == [0.0, 0.0, 0.0, 1.0, 1.0, 2.0 - 1e-12, 2.0 - 1e-12, 3.5, 0.2, 0.2]


@pytest.mark.parametrize(("middle", "away"), [(12.0, True), (26.0, False)])
def test_a_crowd_counts_on_the_25_m_ahead(middle: float, away: bool) -> None:
    one = leader(Path(np.array([[-8.0, 0.0], [60.0, 0.0]])))
    one.command(seen(0.5 * crowd(12) + [middle, 0.0]))
    assert one._memory.away == away
    if away:
        np.testing.assert_array_equal(followed(one)[-1].points[-1], [60.0, 0.0])
        assert followed(one)[-1].points[-2, 0] == pytest.approx(17.0, abs=1e-6)


def test_a_way_leads_over_the_corners_of_the_path_that_follow_it() -> None:
    corners = np.array([[-8.0, 0.0], [15.0, 0.0], [30.0, 5.0], [40.0, 0.0]])
    one = leader(Path(corners))
    one.command(seen(crowd(12)))
    way = followed(one)[-1].points
    assert one._memory.away
    np.testing.assert_array_equal(way[-2:], corners[2:])
    assert (np.abs(np.diff(way, axis=0)).max(axis=1) > 1e-9).all()
    assert max(hypot(*(b - a)) for a, b in pairwise(way[:-2])) < 16.0


def searches(one: AroundCrowds, observation: Observation) -> bool:
    """Tell whether a map was drawn to search a way on."""
    maps, draw = [], AroundCrowds._map

    def drawn(wrapper: AroundCrowds, *inputs: object) -> Costmap:
        maps.append(draw(wrapper, *inputs))  # type: ignore[arg-type]
        return maps[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AroundCrowds, "_map", drawn)
        one.command(observation)
    return bool(maps)


@pytest.mark.parametrize(("seconds", "expected"), [(0.29, False), (0.31, True)])
def test_people_have_to_cost_0_3_s(seconds: float, expected: bool) -> None:
    """At a price at which a crowd adds that much to the path."""
    places = crowd(12)
    each = prices_of(places, 1.0, 1.0).of(EAST.points) - 16.0
    one = AroundCrowds(Recorder(), price=seconds / each / (2.0 * 0.6))
    one.set_path(EAST)
    assert searches(one, seen(places)) == expected


@pytest.mark.parametrize(("left", "expected"), [(0.59, False), (0.61, True)])
def test_no_way_is_sought_within_two_radii_of_the_goal(left: float, expected: bool) -> None:
    places = np.tile([8.0 - left, 0.0], (9, 1))
    assert searches(leader(), seen(places, at=(8.0 - left, 0.0))) == expected


def test_a_way_is_navfns_on_that_map_averaged_over_half_a_metre() -> None:
    one, places = leader(), crowd(12)
    one.command(seen(places))
    prices = prices_of(places, 9.0 * 2.0 * 0.6, 1.0)
    costmap = leader()._map(seen(places), EAST.points, prices)
    route = SmoothedRoutes(NavFn(tolerance=0.0), 0.5).plan(costmap, *EAST.points)
    assert route.path is not None
    np.testing.assert_allclose(followed(one)[-1].points, route.path.points, atol=1e-9)
    saved = prices.of(EAST.points) - prices.of(route.path.points)
    assert one._memory.note == f"a way around 12 people saves {saved:.1f} s"


def test_a_note_gives_the_reason_why_there_is_no_way() -> None:
    walls, places = wall_with((-0.35, 0.35), reach=1e3), crowd(12)
    one = leader()
    one.command(seen(places, walls=walls))
    costmap = leader()._map(seen(places, walls=walls), EAST.points, prices_of(places, 10.8, 1.0))
    route = SmoothedRoutes(NavFn(tolerance=0.0), 0.5).plan(costmap, *EAST.points)
    assert route.path is None and route.reason
    assert one._memory.note == f"no way around the crowd: {route.reason}"


def test_slivers_of_walls_are_no_part_of_the_map() -> None:
    """Less than a square centimetre."""
    square = np.array([[0.0, 0.0], [10.0, 10.0]])
    thin, thick = box((2.0, 2.0), (2.009, 2.01)), box((4.0, 4.0), (4.015, 4.01))
    across = box((8.0, -50.0), (8.5, 50.0))
    parts = _inside(square, [thin, thick, across])
    corners = [np.sort(part.points, axis=0)[[0, -1]].tolist() for part in parts]
    assert corners == [[[4.0, 4.0], [4.015, 4.01]], [[8.0, 0.0], [8.5, 10.0]]]


def test_what_is_remembered_and_the_period_are_the_controllers() -> None:
    notes: list[Observation] = []

    class Noting(Recorder):
        def remember(self, observation: Observation) -> None:
            notes.append(observation)

    one = AroundCrowds(Noting(period=0.35), area=SQUARE)
    assert one.period == 0.35 and one.robot is one.controller.robot  # type: ignore[attr-defined]
    one.set_path(EAST)
    observation = seen(crowd(3))
    one.remember(observation)
    assert notes == [observation]
