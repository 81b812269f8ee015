"""Ways around crowds: integrals, costs and ways by other methods, walls, bad numbers."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot, pi
from time import perf_counter

import numpy as np
import pytest
import shapely
from scipy.integrate import quad
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from wideberth.controllers.orca import Orca
from wideberth.controllers.pure_pursuit import PurePursuit
from wideberth.controllers.withdrawing import Withdrawing
from wideberth.framework.controller import Controller, fresh
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.people.convex_area import ConvexArea, checked_area
from wideberth.robots.unicycle import Unicycle
from wideberth.routes import around_crowds
from wideberth.routes.around_crowds import (
    FORGET,
    LONGEST,
    SETTLING,
    WALK,
    AreaOfPeople,
    AroundCrowds,
    WatchedCrowd,
    _Prices,
)
from wideberth.routes.walls import box

ROBOT = Unicycle(radius=0.3, max_speed=1.0)
RADIUS = 0.3
EAST = Path(np.array([[-8.0, 0.0], [8.0, 0.0]]))
SQUARE = ((-5.0, -5.0), (5.0, -5.0), (5.0, 5.0), (-5.0, 5.0))
PENTAGON = np.array([[3.0, 0.0], [1.0, 2.5], [-2.0, 2.0], [-3.0, -1.0], [0.5, -3.0]])


@dataclass(frozen=True)
class Recorder(Controller):
    """Stands still, and notes which paths it is to follow."""

    robot: Unicycle = ROBOT
    reference_speed: float = 1.0
    period: float = 0.2
    paths: list[Path] = field(init=False, default_factory=list)

    def reset(self) -> None:
        self.paths.clear()

    def set_path(self, path: Path) -> None:
        self.paths.append(path)

    def remember(self, observation: Observation) -> None:
        pass

    def command(self, observation: Observation) -> Command:
        return Command((0.0, 0.0))

    @property
    def last_plan(self) -> Plan | None:
        return None


def leader(path: Path = EAST, area: Sequence[tuple[float, float]] = ()) -> AroundCrowds:
    one = AroundCrowds(Recorder(), area=tuple(area))
    one.set_path(path)
    return one


def followed(one: AroundCrowds) -> list[Path]:
    assert isinstance(one.controller, Recorder)
    return one.controller.paths


def seen(
    places: Sequence[Sequence[float]] | Array,
    stamp: float = 0.0,
    at: Sequence[float] = (-8.0, 0.0),
    walls: Sequence[Polygon] = (),
) -> Observation:
    people = tuple(
        Detection(str(k), np.asarray(place, float), None, RADIUS) for k, place in enumerate(places)
    )
    return Observation(stamp, np.array([*at, 0.0, 0.0, 0.0]), people, polygons=tuple(walls))


def crowd(count: int, seed: int = 0, middle: Sequence[float] = (0.0, 0.0)) -> Array:
    return np.random.default_rng(seed).uniform(-4.0, 4.0, (count, 2)) + middle


def looked(places: Array, radius: float = RADIUS) -> WatchedCrowd:
    found = WatchedCrowd.seen(None, 0.0, dict(zip(map(str, range(99)), places)), radius)  # noqa: B905
    assert found is not None
    return found


def grid(low: float, high: float, step: float) -> Array:
    line = np.arange(low + 0.5 * step, high, step)
    return np.stack(np.meshgrid(line, line), axis=-1)


def test_the_density_of_a_crowd_has_its_number_mean_and_covariance() -> None:
    found = looked(crowd(7, seed=3) * (1.5, 0.4) @ np.array([[0.8, 0.6], [-0.6, 0.8]]))
    places = grid(-30.0, 30.0, 0.05)
    weights = found.density(places) * 0.05**2
    assert (weights >= 0.0).all() and weights.sum() == pytest.approx(7.0, rel=1e-3)
    shares = weights / weights.sum()
    mean = np.einsum("xy,xyi->i", shares, places)
    np.testing.assert_allclose(mean, found.mean, atol=1e-3)
    apart = places - mean
    spread = np.einsum("xy,xyi,xyj->ij", shares, apart, apart)
    np.testing.assert_allclose(spread, found.covariance, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_the_density_in_an_area_integrates_to_one_and_moves_with_it(turned: float) -> None:
    turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    away = np.array([1.5, -0.5])
    found = AreaOfPeople.of(PENTAGON @ turn.T + away)
    places = grid(-8.0, 8.0, 0.02)
    shares = found.share(places)
    assert shares.sum() * 0.02**2 == pytest.approx(1.0, abs=0.01)
    inside = shapely.contains_xy(shapely.Polygon(PENTAGON @ turn.T + away), *places.T).T
    assert (shares[~inside] < 1e-9).all() and (shares[inside] > 0.0).all()
    alike = AreaOfPeople.of(PENTAGON).share((places - away) @ turn)
    np.testing.assert_allclose(shares, alike, rtol=0.02, atol=1e-4)
    known = leader(area=SQUARE)
    assert known._area is not None
    middle, outside = known._area.share(np.array([[0.0, 0.0], [5.1, 0.0]]))
    assert middle == pytest.approx(0.02, rel=0.015)  # of 2 a^2 with half a side a
    assert outside == 0.0


def test_moments_are_averages_over_the_time_of_the_looks() -> None:
    rng = np.random.default_rng(0)
    steps, found = rng.uniform(0.1, 0.8, 60), looked(crowd(5))
    weights, means, squares = [SETTLING], [found.mean], [found.square]
    for step in steps:
        places = rng.normal((3.0, -1.0), 2.0, (5, 2))
        after = WatchedCrowd.seen(found, found.stamp + step, dict(enumerate(places)), RADIUS)  # type: ignore[arg-type]
        assert after is not None
        found = after
        weights.append(step)
        means.append(places.mean(axis=0))
        squares.append(places.T @ places / 5.0)
    np.testing.assert_allclose(found.mean, np.average(means, axis=0, weights=weights))
    np.testing.assert_allclose(found.square, np.average(squares, axis=0, weights=weights))


def walked(seconds: float, speed: float = 0.6, tick: float = 0.2) -> WatchedCrowd:
    """Return a crowd of four who walk away from each other."""
    ways = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    found = None
    for k in range(round(seconds / tick) + 1):
        people = dict(zip("abcd", ways * (1.0 + speed * tick * k), strict=True))
        found = WatchedCrowd.seen(found, tick * k, people, RADIUS)
    assert found is not None
    return found


def test_the_speed_of_people_is_approached_by_looks_a_second_apart() -> None:
    assert walked(0.8).speed == walked(0.8, speed=9.0).speed == WALK
    for speed in (0.6, 2.0):
        gaps = [(walked(seconds, speed).speed - speed) / (WALK - speed) for seconds in (1.0, 2, 9)]
        expected = np.cumprod([1.0 - 0.2 / (SETTLING + k) for k in range(1, 10)])
        np.testing.assert_allclose(gaps, expected[[0, 1, 8]], atol=1e-9)


def test_what_has_gone_is_forgotten() -> None:
    found, alone = looked(crowd(5)), {"a": np.zeros(2)}
    kept = WatchedCrowd.seen(found, FORGET, alone, 0.0)
    assert kept is found and kept.radius == RADIUS
    assert WatchedCrowd.seen(found, FORGET + 0.01, alone, RADIUS) is None
    three = dict(zip("abc", crowd(3, middle=(50.0, 0.0)), strict=True))
    for stamp in (-1.0, FORGET + 0.01, 1e9):  # a clock that goes back, and one that jumps
        anew = WatchedCrowd.seen(found, stamp, three, RADIUS)
        assert anew is not None and anew.span == 0.0
        np.testing.assert_allclose(anew.mean, np.mean(list(three.values()), axis=0))
    assert WatchedCrowd.seen(None, 0.0, alone, RADIUS) is None


def test_an_old_crowd_counts_less_and_less() -> None:
    found, there = looked(crowd(5)), crowd(5, middle=(100.0, 0.0))
    begin = found.mean[0]
    for k in range(1, 601):
        after = WatchedCrowd.seen(found, float(k), dict(zip("abcde", there, strict=True)), RADIUS)
        assert after is not None
        found = after
    assert found.span == LONGEST
    left = (found.mean[0] - there.mean(axis=0)[0]) / (begin - there.mean(axis=0)[0])
    assert 0.0 < left < 1e-3  # about 3 / 63 exp(-540 / 63); 5e-3 if all looks counted alike


def test_the_cost_of_a_way_is_an_integral() -> None:
    prices = _Prices(looked(crowd(10)), 5.4, 0.8)
    points = np.array([[-8.0, -3.0], [-1.0, 0.4], [2.0, -4.0], [7.0, 1.0]])

    def one(share: float, begin: Array, step: Array) -> float:
        return float(prices.ratio(begin + share * step))

    expected = sum(
        quad(one, 0.0, 1.0, (begin, step), limit=200)[0] * hypot(*step) / 0.8
        for begin, step in zip(points[:-1], np.diff(points, axis=0), strict=True)
    )
    assert prices.of(points) == pytest.approx(expected, rel=1e-3)
    free = _Prices(looked(crowd(10, middle=(99.0, 0.0))), 5.4, 0.8)
    assert free.of(points) == pytest.approx(np.hypot(*np.diff(points, axis=0).T).sum() / 0.8)
    inner = prices.crowd
    middle = 10.0 / (3.0 * pi * np.sqrt(np.linalg.det(inner.covariance)))
    assert prices.ratio(inner.mean) == pytest.approx(1.0 + 5.4 * hypot(0.8, WALK) * middle)


def least_cost(prices: _Prices, begin: Array, end: Array, step: float = 0.125) -> float:
    """Return the cost of the best way over a grid, to 32 neighbours each, s."""
    line = np.arange(-10.0, 10.0 + step / 2.0, step)
    places = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1)
    numbers = np.arange(len(line) ** 2).reshape(len(line), len(line))
    moves = [(i, j) for i in range(-3, 4) for j in range(4) if np.gcd(i, j) == 1]
    rows, columns, costs = [], [], []
    for i, j in moves:
        one = (slice(max(-i, 0), len(line) - max(i, 0)), slice(0, len(line) - j))
        two = (slice(max(i, 0), len(line) + min(i, 0)), slice(j, len(line)))
        between = [places[one] + t * (places[two] - places[one]) for t in (0.17, 0.5, 0.83)]
        ratio = np.mean([prices.ratio(place) for place in between], axis=0)
        rows.append(numbers[one].ravel())
        columns.append(numbers[two].ravel())
        costs.append(ratio.ravel() * step * hypot(i, j) / prices.speed)
    graph = coo_matrix(
        (np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))),
        shape=(numbers.size, numbers.size),
    )
    source, target = (int(np.abs(places - p).sum(axis=-1).argmin()) for p in (begin, end))
    return float(dijkstra(graph.tocsr(), directed=False, indices=np.array([source]))[0, target])


@pytest.mark.parametrize("area", [(), SQUARE])
@pytest.mark.parametrize("count", [4, 10, 20])
def test_the_way_costs_little_more_than_the_best_one(
    count: int, area: tuple[tuple[float, float], ...]
) -> None:
    """NavFn counts in steps of 2 % up to five times a free metre, on cells of 0.25 m."""
    one = leader(area=area)
    one.command(seen(crowd(count)))
    found = one._memory.crowd
    assert found is not None
    known = WatchedCrowd(**(vars(found) | {"area": one._area}))
    prices = _Prices(known, 9.0 * 4.0 * RADIUS, 1.0)
    best, straight = least_cost(prices, EAST.points[0], EAST.points[1]), prices.of(EAST.points)
    way = followed(one)[-1]
    np.testing.assert_array_equal(way.goal, EAST.goal)
    cost = prices.of(way.points)
    assert cost <= straight + 1e-9
    assert cost <= 1.04 * best
    if count >= 10:
        assert one._memory.away and best < 0.9 * straight


def detour() -> Path:
    angles = np.linspace(np.pi, 0.0, 40)
    return Path(8.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1))


@pytest.mark.parametrize(
    "path", [EAST, detour(), Path(np.array([[-8.0, 0.0], [-8.0, 8.0], [8.0, 8.0], [8.0, 0.0]]))]
)
@pytest.mark.parametrize(
    "places", [[], crowd(2), crowd(12, middle=(0.0, 60.0)), crowd(12, middle=(-1e6, 1e6))]
)
def test_without_a_crowd_near_the_path_it_is_followed(path: Path, places: Array) -> None:
    one = leader(path)
    for k in range(12):
        one.command(seen(places, 0.2 * k))
    assert followed(one) == [path] and one._memory.note == ""


def test_a_crowd_at_the_second_half_changes_the_way_there() -> None:
    far = Path(np.array([[-8.0, 0.0], [40.0, 0.0]]))
    one = leader(far)
    one.command(seen(crowd(12, middle=(7.0, 0.0))))
    way = followed(one)[-1]
    assert np.abs(way.points[:, 1]).max() > 2.0
    np.testing.assert_array_equal(way.goal, far.goal)
    beyond = way.points[way.points[:, 0] > far.at(np.array(around_crowds.AHEAD))[0] + 1e-6]
    np.testing.assert_array_equal(beyond, [far.goal])  # what follows the way is the path


def wall_with(*gaps: tuple[float, float], reach: float = 12.0) -> list[Polygon]:
    """Return a wall across x = 0 with gaps between these y, m."""
    edges = np.reshape([-reach, *np.ravel(gaps), reach], (-1, 2))
    return [box((-0.1, low), (0.1, high)) for low, high in edges]


def clearance(way: Path, walls: Sequence[Polygon]) -> float:
    shapes = shapely.union_all([shapely.Polygon(wall.points) for wall in walls])
    return float(shapely.distance(shapely.LineString(way.points), shapes))


@pytest.mark.parametrize("reach", [12.0, 500.0, 1e5])
def test_ways_lead_through_gaps_and_not_through_walls(reach: float) -> None:
    walls = wall_with((-1.0, 1.0), (4.0, 6.0), reach=reach)
    one = leader()
    begin = perf_counter()
    one.command(seen(crowd(12) * (1.0, 0.5), walls=walls))
    assert perf_counter() - begin < 10.0
    way = followed(one)[-1]
    assert one._memory.away and clearance(way, walls) >= ROBOT.radius
    crossing = float(np.interp(0.0, way.points[:, 0], way.points[:, 1]))
    assert 4.3 < crossing < 5.7


def test_without_a_gap_wide_enough_the_path_is_followed() -> None:
    for walls in (wall_with((-0.35, 0.35), reach=1e3), wall_with((9.0, 9.01), reach=1e3)):
        one = leader()
        one.command(seen(crowd(12), walls=walls))
        assert followed(one) == [EAST]
        assert "no way around the crowd" in one._memory.note


@pytest.mark.parametrize("at", [(-8.0, 0.0), (8.0, 0.0)])
def test_an_end_close_to_a_wall_or_in_it_leaves_the_path(at: tuple[float, float]) -> None:
    """A way that ended beside the goal would never arrive."""
    x, y = at
    for low, high in (((0.35, -2.0), (0.6, 2.0)), ((-0.5, -0.5), (0.5, 0.5))):
        walls = [box((x + low[0], y + low[1]), (x + high[0], y + high[1]))]
        one = leader()
        one.command(seen(crowd(12), walls=walls))
        way = followed(one)[-1]
        np.testing.assert_array_equal(way.goal, EAST.goal)
        assert one._memory.away or "no way around the crowd" in one._memory.note


def test_a_note_ends_with_the_way() -> None:
    one = leader()
    one.command(seen(crowd(12)))
    assert "a way around 12 people saves" in one._memory.note and one._memory.away
    for k in range(1, 32):
        one.command(seen([], 0.2 * k))
    assert one._memory.note == "" and not one._memory.away
    np.testing.assert_array_equal(followed(one)[-1].points, EAST.points)


def test_the_last_step_to_the_goal_is_the_paths() -> None:
    one = leader()
    one.command(seen(crowd(12)))
    one.command(seen(crowd(12), 1.0, at=(7.5, 0.5)))
    assert not one._memory.away and one._memory.note == ""
    np.testing.assert_array_equal(followed(one)[-1].goal, EAST.goal)


def test_another_path_and_reset_begin_anew() -> None:
    one, north = leader(), Path(np.array([[-8.0, 0.0], [-8.0, 9.0]]))
    one.command(seen(crowd(12)))
    one.set_path(north)
    assert followed(one)[-1] is north and not one._memory.away
    one.command(seen(crowd(12), 0.2))
    np.testing.assert_array_equal(followed(one)[-1].goal, north.goal)
    one.reset()
    assert one._memory.crowd is None and followed(one) == [north]
    with pytest.raises(WideberthError, match="no path is set"):
        AroundCrowds(Recorder()).command(seen([]))


def drive(one: Controller, count: int = 12, ticks: int = 40) -> list[Command]:
    """Return the commands while a unicycle moves on by them, among people who walk."""
    rng = np.random.default_rng(1)
    places, steps = crowd(count), rng.normal(0.0, 0.15, (count, 2))
    state, found = np.array([-8.0, 0.0, 0.0]), []
    for k in range(ticks):
        people = seen(places + k * steps, 0.2 * k).detections
        found.append(one.command(Observation(0.2 * k, np.array([*state, 0.0, 0.0]), people)))
        speed, rate = found[-1].linear[0], found[-1].omega
        state = state + 0.2 * np.array([speed * np.cos(state[2]), speed * np.sin(state[2]), rate])
    return found


@pytest.mark.parametrize(
    "one",
    [
        AroundCrowds(PurePursuit(ROBOT)),
        AroundCrowds(Orca(ROBOT), area=SQUARE),
        AroundCrowds(Withdrawing(Orca(ROBOT))),
        Withdrawing(AroundCrowds(Orca(ROBOT))),
        AroundCrowds(AroundCrowds(Orca(ROBOT)), price=3.0),
    ],
    ids=["pure_pursuit", "orca", "outside", "inside", "twice"],
)
def test_it_composes_and_repeats_itself(one: Controller) -> None:
    one.set_path(EAST)
    first = drive(one)
    one.reset()
    assert drive(one) == first
    other = fresh(one)
    other.set_path(EAST)
    assert drive(other) == first
    rebuilt = build("controllers", describe(one))
    assert describe(rebuilt) == describe(one)
    rebuilt.set_path(EAST)
    assert drive(rebuilt) == first
    one.reset()
    drive(one, ticks=15)
    twin = copy.deepcopy(one)
    last = seen(crowd(12), 3.0, at=(-6.0, 0.3))
    assert twin.command(last) == one.command(last)


def test_it_keeps_the_laws_of_controllers() -> None:
    check_controller(AroundCrowds(Orca(ROBOT)))


def wild() -> list[Observation]:
    good = seen(crowd(12))
    people = good.detections
    nowhere = [Detection(f"n{k}", np.full(2, np.nan), None, 0.3) for k in range(4)]
    vast = [Detection(f"v{k}", np.array([1e9, -1e9]), None, 1e9) for k in range(4)]
    flat = [Detection(f"f{k}", np.array([1.0, 2.0, 3.0]), None, np.nan) for k in range(4)]
    return [
        Observation(stamp, np.array([*at, 0.0, 0.0, 0.0]), (*people, *others))
        for stamp, at, others in [
            (0.0, (-8.0, 0.0), ()),
            (1.0, (-8.0, 0.0), nowhere),
            (2.0, (-8.0, 0.0), vast),
            (3.0, (np.nan, 0.0), ()),
            (4.0, (1e9, -1e9), ()),
            (5.0, (-8.0, 0.0), (*people, *people)),
            (6.0, (-8.0, 0.0), flat),
            (1e9, (-8.0, 0.0), ()),
            (2.0, (-8.0, 0.0), ()),
            (np.nan, (-8.0, 0.0), ()),
            (1e300, (-8.0, 0.0), ()),
        ]
    ]  # fmt: skip


def test_no_numbers_raise_or_take_long() -> None:
    one = leader()
    for observation in wild():
        begin = perf_counter()
        one.command(observation)
        assert perf_counter() - begin < 10.0
        for path in followed(one):
            assert np.isfinite(path.points).all()
            np.testing.assert_array_equal(path.goal, EAST.goal)


def test_a_thousand_people_at_once() -> None:
    one = leader()
    begin = perf_counter()
    one.command(seen(crowd(1000)))
    assert perf_counter() - begin < 10.0
    np.testing.assert_array_equal(followed(one)[-1].goal, EAST.goal)


def test_far_from_the_origin_the_way_is_the_same() -> None:
    """To what float64 leaves of second moments of 1e6 m: some millimetres."""
    away = np.array([1e6, -2e6])
    near, far = leader(), leader(Path(EAST.points + away))
    near.command(seen(crowd(12)))
    far.command(seen(crowd(12) + away, at=EAST.points[0] + away))
    ways = followed(near)[-1], followed(far)[-1]
    apart = shapely.hausdorff_distance(
        shapely.LineString(ways[0].points), shapely.LineString(ways[1].points - away)
    )
    assert near._memory.away and far._memory.away and apart < 0.3


@dataclass(frozen=True)
class Breaking(Recorder):
    """Breaks when it is given a way."""

    def set_path(self, path: Path) -> None:
        if path is not EAST:
            raise ArithmeticError("no")


def test_what_breaks_ends_in_a_note() -> None:
    one = AroundCrowds(Breaking())
    one.set_path(EAST)
    assert one.command(seen(crowd(12))) == Command((0.0, 0.0))
    assert one._memory.note == "no way around the crowd was sought: no"


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"price is 0"):
        AroundCrowds(Recorder(), price=0.0)
    with pytest.raises(WideberthError, match=r"around_crowds\.area"):
        AroundCrowds(Recorder(), area=((0.0, 0.0), (1.0, 0.0)))
    with pytest.raises(WideberthError, match="3 dimensions"):
        AroundCrowds(Orca(build("robots", "holonomic_3d")))
    with pytest.raises(WideberthError, match="does not know its robot"):
        AroundCrowds("orca")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("corners", "words"),
    [
        (((0, 0), (1, 0)), "three corners"),
        (((0, 0), (5, 0), (9, 0.01)), "wider than"),
        (((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), "shape"),
        (((0, 0), (1, 0), (1,)), "area"),
        ((0, 0, 4, 0, 4, 4), "shape"),
        (((0, 0), (4, 0), (4, np.nan)), "finite"),
        (((0, 0), (4, 0), (1, 1), (0, 4)), "not convex"),
        (((0, 0), (4, 4), (4, 0), (0, 4)), "not convex"),
    ],
)
def test_areas_that_are_none_are_refused(corners: object, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        checked_area("area", corners)  # type: ignore[arg-type]


def test_areas_that_are_some() -> None:
    assert len(checked_area("area", ())) == 0
    for corners in (SQUARE, SQUARE[::-1], (*SQUARE[:2], (5.0, 0.0), *SQUARE[2:])):
        np.testing.assert_array_equal(checked_area("area", corners), corners)
    checked_area("area", tuple((x + 4e6, y - 5e6) for x, y in SQUARE))


@pytest.mark.parametrize("corners", [PENTAGON, PENTAGON[::-1]])
def test_depth_and_ways_to_the_border_are_those_of_shapely(corners: Array) -> None:
    area, shape = ConvexArea.around(corners, 0.0), shapely.Polygon(corners)
    rng = np.random.default_rng(0)
    places = rng.uniform(-2.0, 2.0, (40, 2))
    places = places[shapely.contains_xy(shape, *places.T)]
    depth = shapely.distance(shapely.points(places), shape.exterior)
    np.testing.assert_allclose(area.depth(places), depth)
    assert (area.depth(PENTAGON * 1.2) < 0.0).all()
    angles = rng.uniform(0.0, 2.0 * np.pi, 9)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    left = area.way_left(places[None], rays[None])[0]
    for place, row in zip(places, left, strict=True):
        for ray, distance in zip(rays, row, strict=True):
            line = shapely.LineString([place, place + 20.0 * ray]).intersection(shape)
            assert distance == pytest.approx(max(line.length, 0.1))
    wider = ConvexArea.around(corners, 0.5)
    np.testing.assert_allclose(wider.depth(places), depth + 0.5)
