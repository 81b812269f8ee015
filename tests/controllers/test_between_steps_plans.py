"""What plans enter between their steps, and by how much radii grow: closed forms alone."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from wideberth.controllers.levels.discounted import Discounted
from wideberth.controllers.slots.between_steps import (
    BetweenSteps,
    _Segments,
    entered_between,
    largest_bend,
    plan_between,
    turned_aside,
)
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.slots.base import PlanningContext
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs
from wideberth.framework.testing.region_cases import turned
from wideberth.framework.testing.slot_kind import sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.footprint import Discs
from wideberth.framework.values.forecast import Forecast, GaussianObstacle
from wideberth.framework.values.plan import Plan, Situation, Status
from wideberth.framework.values.tracks import Tracks
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.park import Park
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle

STEPS = 5
TRACKED = ("a", "b", "twice", "two", "unplanned")
IDS = ("b", "twice", "a", "twice", "two")
ROOM, RADII = 0.4, np.array([0.3, 0.2, 0.3, 0.3, 0.3])
SIGMA, LEVEL = np.array([0.1, 0.05, 0.1, 0.1, 0.1]), np.array([1.0, 2.0, 1.5, 1.0, 1.0])
"""m and s, of the obstacles in the order of `TRACKED`."""


def plan_among(mean: Array) -> Plan:
    """A plan along x with steps of 1 m among obstacles with means (O, N, 2) and round covariances.

    "two" has two likely modes.
    """
    positions = np.stack([np.arange(STEPS + 1.0), np.zeros(STEPS + 1)], axis=1)
    modes = np.stack([mean, mean + 50.0], axis=1)
    covariance = np.tile(np.eye(2), (len(TRACKED), 2, STEPS, 1, 1))
    covariance *= (SIGMA**2)[:, None, None, None, None]
    covariance[:, 1] *= 9.0
    weight = np.array([[0.6, 0.4] if name == "two" else [1.0, 0.0] for name in TRACKED])
    level = np.tile([LEVEL[TRACKED.index(name)] for name in IDS], (STEPS, 1))
    return Plan(
        stamp=0.0, dt=0.5, states=positions, inputs=np.zeros((STEPS, 2)), positions=positions,
        reference=positions[1:], auxiliaries=np.zeros((STEPS, len(IDS), 0)), level=level,
        target=level, content=np.full_like(level, 0.9), ids=IDS, status=Status.SOLVED,
        rung="optimal", tracked=TRACKED,
        forecast=Forecast(modes, covariance, weight, 0.5, (None,) * len(TRACKED)),
        situation=Situation(MinkowskiSum(), ROOM, RADII, ROOM),
    )  # fmt: skip


def random_plan(rng: np.random.Generator) -> tuple[Plan, Array]:
    start = rng.uniform([0.0, -0.8], [5.0, 0.8], (len(TRACKED), 2))
    way = rng.uniform(-0.4, 0.4, (len(TRACKED), 2))
    mean = start[:, None] + way[:, None] * np.arange(STEPS)[:, None]
    return plan_among(mean), mean


def test_a_plan_enters_what_two_capsules_overlap() -> None:
    """Round and of one size an obstacle's region sweeps a capsule around the relative way."""
    rng, deep = np.random.default_rng(0), 0
    for _ in range(12):
        plan, mean = random_plan(rng)
        expected = np.zeros((STEPS - 1, len(IDS)))
        for name in ("a", "b"):  # names that are unique, of one mode
            o, k = TRACKED.index(name), IDS.index(name)
            radius = ROOM + RADII[o] + LEVEL[o] * SIGMA[o]
            apart = plan.positions[1:] - mean[o]
            for i in range(STEPS - 1):
                away = shapely.distance(shapely.LineString(apart[i : i + 2]), shapely.Point(0, 0))
                expected[i, k] = max(radius - float(away), 0.0)
        depth = plan_between(plan)
        assert depth is not None
        np.testing.assert_allclose(depth, expected, atol=1e-6)
        deep += int((expected > 0.05).sum())
    assert deep >= 15


def test_a_plan_without_unique_obstacles_enters_nothing() -> None:
    plan = plan_among(np.zeros((len(TRACKED), STEPS, 2)))
    for ids in (("twice", "twice"), ("unknown", "two"), ()):
        level = np.ones((STEPS, len(ids)))
        depth = plan_between(replace(plan, ids=ids, level=level))
        np.testing.assert_array_equal(depth, np.zeros((STEPS - 1, len(ids))))


def test_nothing_is_known_of_some_plans() -> None:
    plan, _ = random_plan(np.random.default_rng(0))
    known = plan.situation
    assert known is not None and plan_between(plan) is not None
    long = replace(known, footprint=Discs(((-0.2, 0.0), (0.2, 0.0)), 0.3))
    space = np.zeros((STEPS + 1, 3))
    for changes in (
        {"situation": None}, {"forecast": None}, {"situation": long}, {"positions": space},
        {"situation": replace(known, region=Park())}, {"situation": replace(known, region=None)},
    ):  # fmt: skip
        assert plan_between(replace(plan, **changes)) is None


def test_the_bend_of_a_way_is_an_eighth_of_its_second_differences() -> None:
    """Over a straight rim y = 0: the lower end of a step, less the mean bend around the step.

    At the last step it is the bend before it. A bend away from the rim is no gain.
    """
    height = np.array([0.3, -0.1, -0.2, 0.1, 0.15, -0.4])
    way = np.stack([0.2 * np.arange(6.0), height], axis=1)
    radius, steps = 1e5, 5
    rim = GaussianObstacle(np.tile([0.0, -radius], (steps, 1, 1)), np.zeros((steps, 1, 2, 2)))
    parameters = MinkowskiSum().parameters(rim, np.full((steps, 1), radius))
    depth = entered_between(MinkowskiSum(), way, parameters, np.ones((steps, 1)))[:, 0]
    second = np.diff(height, n=2)
    bend = np.array([second[i] + second[min(i + 1, 3)] for i in range(4)]) / 16.0
    lower = np.minimum(height[1:-1], height[2:]) - np.maximum(bend, 0.0)
    np.testing.assert_allclose(depth, np.maximum(-lower, 0.0), atol=2e-5)
    assert (bend > 0.0).sum() == 2 and (depth > 0.0).sum() == 3
    assert not entered_between(MinkowskiSum(), way, parameters[:, :0], np.ones((steps, 0))).size


def test_the_first_look_is_towards_the_nearest_place_of_the_robot() -> None:
    """Of discs: the direction from the origin to the relative way, by shapely."""
    rng, count = np.random.default_rng(1), 80
    places, mean = rng.uniform(-3.0, 3.0, (2, 2, count, 2))
    places[1, :5], mean[1, :5] = places[0, :5], mean[0, :5]  # nothing moves
    covariance = np.tile(0.04 * np.eye(2), (2, count, 1, 1))
    parameters = MinkowskiSum().parameters(
        GaussianObstacle(mean, covariance), np.full((2, count), 0.5)
    )
    level = np.ones((2, count))
    segments = _Segments(MinkowskiSum(), places, np.zeros((count, 2)), parameters, level)
    for angle, way in zip(
        segments.towards_the_robot(), (places - mean).swapaxes(0, 1), strict=True
    ):
        line, origin = shapely.LineString(way), shapely.Point(0.0, 0.0)
        nearest = line.interpolate(line.project(origin))
        assert np.exp(1j * angle) == pytest.approx(
            (nearest.x + 1j * nearest.y) / abs(nearest.x + 1j * nearest.y), abs=1e-6
        )


def aside(first: Array, last: Array) -> float:
    """The bound of the module, of one pair of covariances."""
    (b_0, *_, a_0), (b_1, *_, a_1) = (np.sqrt(np.linalg.eigvalsh(one)) for one in (first, last))
    c, *_, d = np.linalg.eigvalsh(last - first)
    apart = a_0 - b_0 + a_1 - b_1
    if not b_0 * b_1 > 0.0:
        return float(apart)
    smooth = 0.5 * (d - c) / b_1
    smooth += 0.5 * (a_0**2 - b_0**2) * max(abs(c), abs(d)) / (b_0 * b_1 * (b_0 + b_1))
    return float(min(smooth, apart))


def test_points_turn_aside_by_the_lesser_of_two_bounds() -> None:
    rng = np.random.default_rng(2)
    series = turned(rng, 10.0 ** rng.uniform(-1.0, 0.0, (40, 2)))
    slow = series[0] * (1.0 + 0.05 * np.arange(20.0))[:, None, None]
    slow += 0.002 * turned(rng, 10.0 ** rng.uniform(-1.0, 0.0, (20, 2)))
    sharp = np.stack([np.diag([0.0, 1.0]), np.diag([0.0, 4.0]), np.diag([1.0, 4.0])])
    factor = rng.standard_normal((20, 3, 3))
    space = np.eye(3) + 0.02 * factor @ factor.swapaxes(1, 2)
    for covariance in (series, slow, sharp, space):
        expected = [aside(*pair) for pair in pairwise(covariance)]
        np.testing.assert_allclose(turned_aside(covariance), expected, atol=1e-12)
        two = np.stack([covariance, covariance[::-1]])
        assert turned_aside(two).shape == (2, len(covariance) - 1)
        np.testing.assert_allclose(turned_aside(two)[0], expected, atol=1e-12)
    values = [aside(*pair) for pair in pairwise(slow)]
    spread = np.sqrt(np.linalg.eigvalsh(slow))
    assert (np.array(values) < (spread[:-1] + spread[1:]) @ [-1.0, 1.0]).any()


def view_of(mean: Array, covariance: Array, own: Array) -> PlanningContext:
    """Obstacles of radii 0.3 m and 0.6 m, means (2, M, N, 2), whose modes are equally likely."""
    count, modes, steps = mean.shape[:3]
    weight = np.full((count, modes), 1.0 / modes)
    noise = np.tile(1e-4 * np.eye(2), (count, 1, 1))
    seen = np.repeat(mean[:, 0, :1], 2, axis=1)
    shorter = {
        name: getattr(sample_view(), name)[:steps]
        for name in ("times", "planned", "own_on_map", "travel")
    }
    reference = sample_view().reference
    laid = (reference.position, reference.direction, reference.speed, reference.curve)
    return replace(
        sample_view(),
        **shorter,
        tracks=Tracks(seen, 0.5, ("a", "b"), np.array([0.3, 0.6]), noise),
        forecast=Forecast(mean, covariance, weight, 0.5, (None,) * count),
        reference=type(reference)(*(part[:steps] for part in laid)),
        route=sample_view().route[:, :steps],
        level=Fixed(0.05),
        margin=0.05,
        own=own,
    )


def test_radii_grow_by_the_longest_relative_way() -> None:
    """l = v dt + |mu' - mu| + s turn over all steps and modes, with the largest level s."""
    rng, robot, kind = (
        np.random.default_rng(3),
        Unicycle(radius=0.35),
        BetweenSteps(MinkowskiSum()),
    )
    for modes, policy in ((1, Fixed(0.05)), (3, Fixed(0.05)), (2, Discounted(0.01, 0.5))):
        mean = np.cumsum(rng.uniform(-0.4, 0.4, (2, modes, 4, 2)), axis=2) + 3.0
        shape = rng.uniform(0.1, 0.5, (2, modes, 4, 2))
        covariance = turned(rng, shape.reshape(-1, 2)).reshape(2, modes, 4, 2, 2)
        own = turned(rng, rng.uniform(0.1, 0.4, (4, 2)))
        view = replace(view_of(mean, covariance, own), level=policy)
        level = policy.levels(MinkowskiSum(), 4, 2, 2).max()
        for o, radius in enumerate((0.3, 0.6)):
            ways = [
                np.hypot(*(mean[o, m, i + 1] - mean[o, m, i]))
                + level * aside(covariance[o, m, i] + own[i], covariance[o, m, i + 1] + own[i + 1])
                for m in range(modes)
                for i in range(3)
            ]
            rho, half = 0.35 + radius + 0.05, 0.5 * (0.7 * 0.5 + max(ways))
            expected = np.hypot(rho, half) - rho + largest_bend(robot, 0.5)
            assert kind.lost(robot, view)[o] == pytest.approx(expected, abs=1e-9)


def test_what_fills_slots_is_the_larger_radius() -> None:
    robot, view, kind = Unicycle(radius=0.4), sample_view(), BetweenSteps(MahalanobisEllipse())
    assert view.tracks is not None
    larger = replace(view.tracks, radius=view.tracks.radius + kind.lost(robot, view))
    plain = GaussianDiscs(MahalanobisEllipse())
    expected = plain.choose(robot, replace(view, tracks=larger))
    chosen = kind.choose(robot, view)
    np.testing.assert_array_equal(chosen.numbers.parameters, expected.numbers.parameters)
    assert chosen.names == expected.names
    assert isinstance(chosen.known, KnownDiscs)
    np.testing.assert_array_equal(chosen.known.obstacles.radius, np.full(3, 0.3))


@pytest.mark.parametrize("part", ["tracks", "forecast"])
def test_without_obstacles_nothing_is_chosen(part: str) -> None:
    view = replace(sample_view(), **{part: None})  # type: ignore[arg-type]
    chosen = BetweenSteps(MahalanobisEllipse()).choose(Unicycle(radius=0.4), view)
    assert chosen.names == () and not chosen.numbers.active.any()


def test_under_the_largest_acceleration_a_way_bends_by_an_eighth() -> None:
    """a dt^2 / 8 in the direction of a; at the corner of the box of accelerations."""
    for robot in (Holonomic(), Holonomic(max_acceleration=1.3)):
        bounds = robot.input_bounds()
        largest = np.hypot(*np.maximum(np.abs(bounds.lower[:2]), np.abs(bounds.upper[:2])))
        for dt in (0.2, 0.5):
            assert largest_bend(robot, dt) == pytest.approx(0.125 * largest * dt**2, rel=1e-6)
