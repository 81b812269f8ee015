"""Numbers of drawn half-planes: closed forms, moments of draws, and brute force."""

from dataclasses import replace
from itertools import product
from math import ceil, hypot

import numpy as np
import pytest
import shapely

from wideberth.controllers.slots.drawn_futures import (
    DrawnFutures,
    _anchor,
    _closest,
    _normals,
    _obstacles,
)
from wideberth.controllers.slots.scenario_risk import largest_support, risk_of_support
from wideberth.framework.mpc.ocp.reference import Reference
from wideberth.framework.mpc.slots.base import PlanningContext
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.robot import Robot
from wideberth.framework.testing.slot_kind import Sample, sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.tracks import Tracks
from wideberth.robots.unicycle import Unicycle

STEPS = 6
KIND = DrawnFutures(risk=0.2, doubt=0.1, scenarios=400)
ROUND = Unicycle(radius=0.4)
LONG = Unicycle(radius=1.0, footprint=Discs(((-0.5, 0.0), (0.5, 0.0)), 0.4))
MARGIN = 0.1
RADII = 0.4 + 0.3 + MARGIN
"""m, of a disc of either robot, a person and the margin."""


def view_of(mean: Array, covariance: Array, **changes: object) -> PlanningContext:
    """People of radius 0.3 m with means (O, N, 2) and covariances (O, N, 2, 2)."""
    count, steps = mean.shape[:2]
    names = tuple(f"person {k}" for k in range(count))
    seen = np.repeat(mean[:, :1], 2, axis=1)
    tracks = Tracks(
        seen, 0.5, names, np.full(count, 0.3), np.tile(1e-4 * np.eye(2), (count, 1, 1))
    )
    place = np.zeros((steps, 2))
    ahead = np.tile([1.0, 0.0], (steps, 1))
    view = replace(
        sample_view(),
        tracks=tracks,
        forecast=Forecast.single(mean, covariance, 0.5),
        times=0.5 * np.arange(1.0, steps + 1.0),
        reference=Reference(place, ahead, np.full(steps, 0.5), np.zeros((steps, 0))),
        route=np.stack([place, place]),
        planned=place,
        own=np.zeros((steps, 2, 2)),
        travel=np.full(steps, np.inf),
        margin=MARGIN,
    )
    return replace(view, **changes)  # type: ignore[arg-type]


def still(
    *places: tuple[float, float], deviation: float = 0.0, **changes: object
) -> PlanningContext:
    """People who stand at places, known but for a deviation, m."""
    mean = np.repeat(np.array(places)[:, None], STEPS, axis=1)
    covariance = np.tile(deviation**2 * np.eye(2), (len(places), STEPS, 1, 1))
    return view_of(mean, covariance, **changes)


def covariances(rng: np.random.Generator, *shape: int) -> Array:
    factor = rng.standard_normal((*shape, 2, 2))
    return np.asarray(factor @ factor.swapaxes(-1, -2))


def test_people_are_drawn_independently_and_the_robots_place_once() -> None:
    """Covariance between any two people at a step, within four standard errors.

    Of one person it is n . (S + Q) n, of two n_1 . Q n_2, with S the person's covariance and Q
    that of the robot's place.
    """
    rng, steps, people = np.random.default_rng(0), 2, 3
    kind = replace(KIND, scenarios=20_000)
    mean, covariance = rng.standard_normal((people, steps, 2)), covariances(rng, people, steps)
    own = 0.3 * covariances(rng, steps)
    angle = rng.uniform(0.0, 2.0 * np.pi, (steps, people))
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for place_error in (np.zeros_like(own), own):
        view = view_of(mean, covariance, own=place_error)
        draws = kind._drawn(view, _obstacles(view), normal)
        expected = np.einsum("noi,nij,npj->nop", normal, place_error, normal)
        people_alone = np.einsum("noi,onij,noj->no", normal, covariance, normal)
        expected += people_alone[:, :, None] * np.eye(people)
        variance = np.einsum("noo->no", expected)
        error = np.sqrt((variance[:, :, None] * variance[:, None] + expected**2) / len(draws))
        sampled = np.einsum("sno,snp->nop", draws, draws) / len(draws)
        assert (np.abs(sampled - expected) <= 4.0 * error).all()
        assert (np.abs(draws.mean(axis=0)) <= 4.0 * np.sqrt(variance / len(draws))).all()


def test_draws_of_a_person_do_not_depend_on_who_else_is_there() -> None:
    rng = np.random.default_rng(1)
    mean, covariance = rng.uniform(2.0, 5.0, (3, STEPS, 2)), covariances(rng, 3, STEPS)
    normal = np.tile([0.6, 0.8], (STEPS, 3, 1))
    views = view_of(mean, covariance), view_of(mean[:2], covariance[:2])
    every, fewer = (
        KIND._drawn(view, _obstacles(view), normal[:, : len(view.tracks or ())]) for view in views
    )
    np.testing.assert_array_equal(every[:, :, :2], fewer)


def test_modes_of_a_forecast_have_common_moments() -> None:
    rng = np.random.default_rng(2)
    weight = np.array([[0.2, 0.5, 0.3], [1.0, 0.0, 0.0]])
    mean = rng.standard_normal((2, 3, STEPS, 2))
    covariance = covariances(rng, 2, 3, STEPS)
    forecast = Forecast(mean, covariance, weight, 0.5, (None, None))
    people = _obstacles(replace(still((1.0, 1.0), (2.0, 2.0)), forecast=forecast))
    for o, n in product(range(2), range(STEPS)):
        modes = list(zip(weight[o], mean[o, :, n], covariance[o, :, n], strict=True))
        first = sum(share * place for share, place, _ in modes)
        second = sum(share * (spread + np.outer(place, place)) for share, place, spread in modes)
        np.testing.assert_allclose(people.mean[n, o], first, atol=1e-12)
        np.testing.assert_allclose(
            people.covariance[n, o], second - np.outer(first, first), atol=1e-12
        )
    assert people.ids == ("person 0", "person 1")


@pytest.mark.parametrize("part", ["tracks", "forecast"])
def test_without_people_there_are_no_half_planes(part: str) -> None:
    view = replace(still((1.0, 0.0)), **{part: None})  # type: ignore[arg-type]
    chosen = KIND.choose(ROUND, view)
    assert chosen.names == () and chosen.numbers.parameters.shape == (STEPS, 0, 4)
    assert chosen.risk == risk_of_support(0, KIND.scenarios, KIND.doubt)


@pytest.mark.parametrize(("robot", "body"), [(ROUND, 0.0), (LONG, 0.5)])
def test_an_obstacle_gets_half_of_the_gap_for_nothing(robot: Robot, body: float) -> None:
    """Exactly known people at distances d: room = max(d - body - radii, 0) / 2."""
    distance = np.array([RADII + 0.2, RADII + 0.8, 3.0, 7.0])
    angle = np.array([0.3, 2.0, -2.1, -0.6])
    places = distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    planes = KIND.half_planes(robot, still(*map(tuple, places.tolist()))).planes
    np.testing.assert_allclose(planes.normal[2], -places / distance[:, None], atol=1e-9)
    np.testing.assert_allclose(planes.least[2], RADII - distance, atol=1e-9)
    gap = np.maximum(distance - body - RADII, 0.0)
    np.testing.assert_allclose(planes.room[2], 0.5 * gap, atol=1e-6)


@pytest.mark.parametrize(("robot", "body"), [(ROUND, 0.0), (LONG, 0.5)])
def test_people_are_out_of_reach_from_a_known_distance_on(robot: Robot, body: float) -> None:
    """Exactly known: where c, half of the gap, is what the robot reaches at the last step.

    d / 2 + (radii - body) / 2 = d - T - sqrt(2) body.
    """
    travel = 0.3 * np.arange(1.0, STEPS + 1.0)
    edge = 2.0 * (travel[-1] + np.sqrt(2.0) * body) + RADII - body
    view = still((edge - 1e-3, 0.0), (0.0, edge + 1e-3), (edge - 1e-3, edge), travel=travel)
    chosen = KIND.choose(robot, view)
    assert chosen.names == ("person 0",) and chosen.left_out == ()
    assert chosen.out_of_reach is not None
    assert chosen.out_of_reach.names == ("person 1", "person 2")
    np.testing.assert_array_equal(chosen.out_of_reach.level, np.ones((STEPS, 2)))


def test_people_whose_draws_come_within_reach_have_a_slot() -> None:
    """Brute force: out of reach is who keeps clear of every reachable place in every draw."""
    travel, distance = 0.3 * np.arange(1.0, STEPS + 1.0), 6.0
    outcomes = set()
    for deviation in (0.05, 0.5, 0.7, 0.9, 1.1, 2.0):
        view = still((distance, 0.0), deviation=deviation, travel=travel)
        normal = np.tile([-1.0, 0.0], (STEPS, 1, 1))
        draws = KIND._drawn(view, _obstacles(view), normal)[:, :, 0]
        clear = (draws - distance + RADII <= -travel).all()
        chosen = KIND.choose(ROUND, view)
        assert (chosen.out_of_reach is not None) == clear
        outcomes.add(bool(clear))
    assert outcomes == {True, False}


def test_people_without_a_slot_are_named_and_their_scenarios_not_counted() -> None:
    """Scenarios of a person without a slot hold no half-plane of the plan."""
    view = still((2.0, 0.0), (3.0, 0.5), (0.0, 4.0), deviation=0.4, most=2)
    chosen = KIND.choose(ROUND, view)
    assert chosen.names == ("person 0", "person 1") and chosen.left_out == ("person 2",)
    alone = KIND.half_planes(ROUND, still((2.0, 0.0), (3.0, 0.5), deviation=0.4))
    drawn = KIND.half_planes(ROUND, view)
    assert drawn.support == alone.support and sum(drawn.support) > 0
    np.testing.assert_allclose(drawn.planes.room, alone.planes.room, atol=1e-12)
    assert chosen.risk == risk_of_support(sum(drawn.support), KIND.scenarios, KIND.doubt)


def test_slots_hold_the_half_planes_and_empty_ones_a_dummy() -> None:
    view = still((2.0, 0.0), (3.0, 0.5), (0.0, 4.0), deviation=0.4)
    drawn, numbers = KIND.half_planes(ROUND, view), KIND.choose(ROUND, view).numbers
    assert numbers.parameters.shape == (STEPS, 5, 4)
    normal, least, room = np.split(numbers.parameters, [2, 3], axis=2)
    np.testing.assert_array_equal(normal[:, :3], drawn.planes.normal)
    np.testing.assert_array_equal(least[:, :3, 0], drawn.planes.least)
    np.testing.assert_array_equal(room[:, :3, 0], drawn.planes.room)
    np.testing.assert_array_equal(numbers.parameters[:, 3:], np.tile([1, 0, 0, 1], (STEPS, 2, 1)))
    np.testing.assert_array_equal(numbers.active, [1, 1, 1, 0, 0])
    assert numbers.level is not None
    np.testing.assert_array_equal(numbers.level, np.ones((STEPS, 5)))


def test_a_constraint_is_the_distance_beyond_the_half_plane() -> None:
    """n . p - least - level room, at random poses of a robot of one disc."""
    view = still((2.0, 0.0), (0.0, 4.0), deviation=0.4)
    numbers = KIND.choose(ROUND, view).numbers
    sample = Sample(KIND, view, ROUND)
    states = sample.states[: STEPS + 1]
    numbers = replace(numbers, level=np.full((STEPS, 2), 1.5))
    free, tied = sample.rows(states, numbers, np.zeros((STEPS, 2, 0)))
    along = np.einsum("nod,nd->no", numbers.parameters[..., :2], states[1:, :2])
    expected = along - numbers.parameters[..., 2] - 1.5 * numbers.parameters[..., 3]
    np.testing.assert_allclose(free[..., 0], expected, atol=1e-9)
    assert free.shape == (STEPS, 2, 1) and tied.size == 0


@pytest.mark.parametrize(("place", "discards"), [((-20.0, 0.0), False), ((5.0, 0.0), True)])
def test_scenarios_are_discarded_where_they_lie_over_the_reference(
    place: tuple[float, float], discards: bool
) -> None:
    """A person at (4, 0), and a reference before its half-planes, or beyond."""
    view = still((4.0, 0.0), deviation=1.0)
    view = replace(view, reference=replace(view.reference, position=np.tile(place, (STEPS, 1))))
    assert (KIND.half_planes(ROUND, view).support.discarded > 0) == discards


def discarded_one_by_one(over: Array, depth: Array) -> tuple[Array, int, int]:
    """Discard as `DrawnFutures` says, with all maxima computed again in each turn."""
    most = largest_support(KIND.risk, KIND.scenarios, KIND.doubt)
    left, discarded = list(range(len(over))), 0
    while True:
        height = np.maximum(over[left].max(axis=0), 0.0)
        holds = {s: (over[s] == height) & (height > 0.0) for s in left}
        holds = {s: cells for s, cells in holds.items() if cells.any()}
        price = {
            s: float((np.maximum(depth + height, 0.0)[cells] ** 2).sum())
            for s, cells in holds.items()
        }
        dearest = max(price, key=price.__getitem__, default=-1)
        if dearest < 0 or price[dearest] <= 0.0:
            break
        if len(holds) + discarded + int(holds[dearest].sum()) > most:
            break
        left.remove(dearest)
        discarded += 1
    return height, len(holds), discarded


def test_the_dearest_scenarios_are_discarded_while_the_risk_allows_it() -> None:
    rng, turns = np.random.default_rng(3), 0
    for scale in (1.0, 0.02) * 6:  # m; the same rule for prices of any size
        over = rng.standard_normal((400, 4, 3)) @ np.triu(rng.standard_normal((3, 3)))
        over = scale * (over - rng.uniform(0.0, 3.0, (4, 3)))
        depth = scale * rng.uniform(-2.0, 1.0, (4, 3))
        height, support = KIND.discard(over, depth)
        expected, holding, discarded = discarded_one_by_one(over, depth)
        np.testing.assert_array_equal(height, expected)
        assert support == (holding, discarded)
        turns += discarded
    assert turns > 30


def test_scenarios_below_what_is_free_hold_nothing() -> None:
    height, support = KIND.discard(-np.ones((400, 4, 3)), np.ones((4, 3)))
    np.testing.assert_array_equal(height, np.zeros((4, 3)))
    assert support == (0, 0)


def test_normals_are_those_of_ellipses_around_the_means() -> None:
    """Axis-aligned covariances: n ~ ((x - mu) / (4 S_x + rho^2), ...)."""
    rng = np.random.default_rng(4)
    variance, mean = rng.uniform(0.0, 1.0, (3, STEPS, 2)), rng.uniform(2.0, 5.0, (3, STEPS, 2))
    covariance = np.zeros((3, STEPS, 2, 2))
    covariance[..., 0, 0], covariance[..., 1, 1] = variance[..., 0], variance[..., 1]
    view = view_of(mean, covariance)
    anchor = rng.standard_normal((STEPS, 2))
    expected = (anchor - mean) / (4.0 * variance + RADII**2)
    expected /= np.hypot(expected[..., 0], expected[..., 1])[..., None]
    normal = _normals(ROUND, _obstacles(view), anchor, view)
    np.testing.assert_allclose(normal, expected.swapaxes(0, 1), atol=1e-12)


def test_a_normal_at_a_mean_points_back_along_the_reference() -> None:
    view = still((2.0, 1.0), (4.0, 1.0))
    anchor = np.tile([2.0, 1.0], (STEPS, 1))
    normal = _normals(ROUND, _obstacles(view), anchor, view)
    np.testing.assert_allclose(normal, np.tile([[-1.0, 0.0]], (STEPS, 2, 1)), atol=1e-12)


def test_the_nearest_point_of_a_broken_line_is_that_of_shapely() -> None:
    rng = np.random.default_rng(5)
    ways = rng.uniform(-2.0, 2.0, (2, 60, 2)) + rng.uniform(-2.0, 2.0, (60, 2))
    ways[1, :5] = ways[0, :5]  # stands still
    longer = np.concatenate([ways, rng.uniform(-3.0, 3.0, (3, 60, 2))])
    for lines in (ways, longer):
        expected = [
            shapely.distance(shapely.LineString(line), shapely.Point(0.0, 0.0))
            for line in lines.swapaxes(0, 1)
        ]
        np.testing.assert_allclose(_closest(lines), expected, atol=1e-9)


TRIED = [(1.0, 0.0), (1.0, 0.4), (0.5, 0.0), (0.5, 0.4), (1.0, 0.8), (0.0, 0.0), (1.0, 1.3)]
"""Share of the pace, and rad to either side, in turn."""


def clear_way(people: ObstacleSet, view: PlanningContext, enough: float) -> Array:
    """Return the first group's best way that leaves enough, or the best of all, by shapely."""

    def left(way: Array) -> float:
        lines = [shapely.LineString(line) for line in (way[:, None] - people.mean).swapaxes(0, 1)]
        away = [float(shapely.distance(line, shapely.Point(0.0, 0.0))) for line in lines]
        gaps = zip(away, people.radius.tolist(), strict=True)
        return min(float(d - (0.4 + MARGIN + r)) for d, r in gaps)

    here, best = view.route[1], view.planned
    if left(best) >= 0.0:
        return best
    for pace, turn in TRIED:
        ways = [best]
        for way, side in product((view.planned, view.reference.position), (turn, -turn)):
            turned = np.array([[np.cos(side), -np.sin(side)], [np.sin(side), np.cos(side)]])
            ways.append(here + pace * (way - here) @ turned.T)
        best = max(ways, key=left)
        if left(best) >= enough:
            break
    return best


def test_half_planes_lie_beside_the_first_way_that_is_clear_of_all() -> None:
    rng, kinds = np.random.default_rng(6), set()
    for case in range(150):
        count = 1 + case % 4
        share = np.arange(1.0, STEPS + 1.0)[:, None]
        here = rng.uniform(-1.0, 1.0, 2)
        reference = here + share * [0.5, 0.0]
        planned = here + share * rng.uniform(-0.4, 0.6, 2)
        mean = here + rng.uniform([0.3, -1.5], [3.5, 1.5], (count, 2))
        mean = (
            np.repeat(mean[:, None], STEPS, axis=1) + rng.uniform(-0.2, 0.2, (count, 1, 2)) * share
        )
        view = view_of(mean, np.tile(0.01 * np.eye(2), (count, STEPS, 1, 1)), planned=planned)
        view = replace(
            view,
            reference=replace(view.reference, position=reference),
            route=np.stack([reference, np.tile(here, (STEPS, 1))]),
        )
        people = _obstacles(view)
        expected = clear_way(people, view, 0.4)
        np.testing.assert_allclose(_anchor(ROUND, people, view), expected, atol=1e-9)
        kinds.add(int(10.0 * hypot(*(expected[-1] - here))))
    assert len(kinds) > 10


def test_a_level_falls_as_the_content_of_an_ellipse() -> None:
    for level, tail in ((-0.1, 1.0), (0.0, 1.0), (1.0, 0.2), (2.0, 0.2**4)):
        assert KIND.tail(level, "content", 2) == pytest.approx(tail, rel=1e-12)
    np.testing.assert_array_equal(KIND.levels(sample_view().level, 3, 2, 2), np.ones((3, 2)))
    assert KIND.auxiliary_start(
        ROUND, ROUND.pose((0.0,) * 5), KIND.choose(ROUND, still((2.0, 0.0))).numbers
    ).shape == (STEPS, 1, 0)  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value"),
    [("risk", 0.0), ("risk", 1.0), ("doubt", 0.0), ("doubt", 1.0), ("scenarios", 0), ("seed", -1)],
)
def test_numbers_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(WideberthError, match=rf"drawn_futures\.{name} is {ceil(value)}"):
        replace(KIND, **{name: value})  # type: ignore[arg-type]
    assert replace(KIND, seed=0).seed == 0
