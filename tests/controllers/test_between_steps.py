"""What a plan enters between its steps: closed forms, dense looks, and Monte Carlo."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.slots.between_steps import (
    BetweenSteps,
    entered_between,
    largest_bend,
    plan_between,
    turned_aside,
)
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.slots.base import PlanningContext
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.region import Convex
from wideberth.framework.robot import step
from wideberth.framework.testing.region_cases import turned
from wideberth.framework.testing.slot_kind import sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs
from wideberth.framework.values.forecast import Forecast, GaussianObstacle
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati

LEVEL, MARGIN = 2.0, 0.7


def depth(region: Convex, places: Array, mean: Array, covariance: Array) -> float:
    """Depth on the way from step 1 to step 2; the robot comes straight from step 0."""
    way = np.concatenate([[2.0 * places[0] - places[1]], places])
    pair = GaussianObstacle(mean[:, None], covariance[:, None])
    parameters = region.parameters(pair, np.full((2, 1), MARGIN))
    return float(entered_between(region, way, parameters, np.full((2, 1), LEVEL))[0, 0])


@pytest.mark.parametrize("way", [0.3, 0.6, 1.0])
def test_a_straight_pass_loses_the_sagitta(way: float) -> None:
    """Both ends on the boundary of a disc: sqrt(rho^2 - (way / 2)^2), about way^2 / (8 rho)."""
    rho = MARGIN + LEVEL * 0.1
    height = np.sqrt(rho**2 - (0.5 * way) ** 2)
    places = np.array([[-0.5 * way, height], [0.5 * way, height]])
    found = depth(MinkowskiSum(), places, np.zeros((2, 2)), np.tile(0.01 * np.eye(2), (2, 1, 1)))
    assert found == pytest.approx(rho - height, abs=1e-9)
    assert found == pytest.approx(way**2 / (8.0 * rho), rel=0.15)
    # nothing is entered at the steps alone
    at_steps = [depth(MinkowskiSum(), np.tile(one, (2, 1)), np.zeros((2, 2)),
                      np.tile(0.01 * np.eye(2), (2, 1, 1))) for one in places]  # fmt: skip
    assert at_steps == pytest.approx([0.0, 0.0], abs=1e-9)


def test_both_move_and_the_difference_counts() -> None:
    """Against each other's motion the same is found as for one who stands."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        covariance = turned(rng, rng.uniform(0.05, 0.4, (2, 2)))
        mean = np.zeros((2, 2))
        places, shift = rng.uniform(-1.2, 1.2, (2, 2)), rng.uniform(-2.0, 2.0, (2, 2))
        both = depth(MinkowskiSum(), places + shift, mean + shift, covariance)
        assert both == pytest.approx(depth(MinkowskiSum(), places, mean, covariance), abs=1e-6)


@pytest.mark.parametrize("region", [MinkowskiSum(), MahalanobisEllipse(), EigenRectangle()])
def test_it_is_the_distance_from_all_that_is_swept(region: Convex) -> None:
    """Dense oracle: every u and every normal; the best normal of the worst u."""
    rng = np.random.default_rng(1)
    angle = np.linspace(0.0, 2.0 * np.pi, 7200, endpoint=False)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    share = np.linspace(0.0, 1.0, 101)[:, None]
    entered = 0
    for _ in range(60):
        mean, places = rng.uniform(-0.8, 0.8, (2, 2)), rng.uniform(-1.8, 1.8, (2, 2))
        covariance = turned(rng, rng.uniform(0.02, 0.3, (2, 2)))
        parameters = region.parameters(GaussianObstacle(mean, covariance), np.full(2, MARGIN))
        heights = [
            normals @ place - region.support(normals, one, np.full(7200, LEVEL))
            for place, one in zip(places, parameters, strict=True)
        ]
        between = (1.0 - share) * heights[0] + share * heights[1]
        outside = between.max(axis=1)  # signed distance at each u
        found = depth(region, places, mean, covariance)
        entered += found > 0.0
        # the hull is entered as soon as one of its regions is, and at least as deep
        assert (found > 1e-4) == (outside.min() < -1e-4) or abs(outside.min()) < 2e-3
        together = np.minimum(heights[0], heights[1]).max()
        # at a kink the dense normals miss the best one by up to half a step of 0.9 mrad
        assert max(-together, 0.0) - 2e-3 < found < max(-together, 0.0) + 1e-6
        assert found >= max(-outside.min(), 0.0) - 1e-3
    assert 10 < entered < 50


def test_it_holds_whatever_the_correlation_of_both_ends() -> None:
    """Monte Carlo: between, an obstacle crosses the proven line no more often than at an end."""
    rng = np.random.default_rng(2)
    deviations = np.array([0.2, 0.3])
    mean = np.array([[-0.4, 0.0], [0.4, 0.1]])
    covariance = np.stack([d**2 * np.eye(2) for d in deviations])
    places = np.array([[0.3, 1.4], [-0.3, 1.5]])
    assert depth(MinkowskiSum(), places, mean, covariance) == 0.0
    draws = 40_000
    for correlation in (-1.0, -0.3, 0.4, 1.0):
        one = rng.standard_normal((draws, 2))
        other = correlation * one + np.sqrt(1.0 - correlation**2) * rng.standard_normal((draws, 2))
        for u in (0.25, 0.5, 0.75):
            person = (1.0 - u) * (mean[0] + deviations[0] * one)
            person = person + u * (mean[1] + deviations[1] * other)
            robot = (1.0 - u) * places[0] + u * places[1]
            hit = np.linalg.norm(person - robot, axis=1) < MARGIN
            bound = 0.0227501  # Phi(-2), what the exact sum promises at level 2
            assert hit.mean() <= bound + 3.0 * np.sqrt(bound / draws)


def test_an_arc_is_deeper_than_its_chord() -> None:
    """A robot that turns about a standing disc at the distance of its rim stays on it."""
    rho, turn = 2.0, 0.3
    angle = turn * np.arange(4)
    places = rho * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    covariance = np.zeros((3, 1, 2, 2))
    pair = GaussianObstacle(np.zeros((3, 1, 2)), covariance)
    parameters = MinkowskiSum().parameters(pair, np.full((3, 1), rho))
    level = np.full((3, 1), LEVEL)
    found = entered_between(MinkowskiSum(), places, parameters, level)
    # the arc lies outside of its chord: the bend is no loss, and what the chord loses is counted
    assert found[:, 0] == pytest.approx(rho * (1.0 - np.cos(0.5 * turn)), rel=1e-3)
    # outside of the turn, the arc comes nearer than the chord by its sagitta
    outer = GaussianObstacle(np.tile([2.0 * rho + 0.01, 0.0], (3, 1, 1)), covariance)
    parameters = MinkowskiSum().parameters(outer, np.full((3, 1), rho + 0.03))
    angle -= 1.5 * turn
    places = rho * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    found = entered_between(MinkowskiSum(), places, parameters, level)
    assert found[0, 0] == pytest.approx(0.02, abs=1e-3)  # 0.03 m less 0.01 m, in the arc's middle


def view_of(mean: Array, covariance: Array, robot_margin: float) -> PlanningContext:
    """One obstacle of radius 0.3 m on a forecast of two steps of 0.5 s."""
    forecast = Forecast.single(mean[None], covariance[None], 0.5)
    tracks = Tracks(np.tile(mean[:1], (1, 2, 1)), 0.5, ("a",), np.array([0.3]),
                    1e-4 * np.eye(2)[None])  # fmt: skip
    none = np.zeros((2, 2, 2))
    return replace(
        sample_view(),
        tracks=tracks,
        forecast=forecast,
        level=Fixed(),
        margin=robot_margin,
        own=none,
    )


def test_the_larger_radius_is_enough_and_no_more() -> None:
    """Wherever a step begins and ends outside of the grown region, nothing between is entered."""
    robot, kind, region = Unicycle(radius=0.35), BetweenSteps(MinkowskiSum()), MinkowskiSum()
    rng, level = np.random.default_rng(3), region.level(0.05)
    looked_at = without = 0
    for case in range(600):
        towards = rng.uniform(0.0, 2.0 * np.pi)
        turn = towards + rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 0.8) * np.pi
        side, ahead = (np.array([np.cos(one), np.sin(one)]) for one in (towards, turn))
        begin = rng.uniform(0.6, 1.4) * side
        places = np.stack([begin, begin + 0.35 * ahead])
        mean = np.stack([np.zeros(2), -0.5 * ahead + rng.uniform(-0.1, 0.1, 2)])
        deviations = rng.uniform(0.0, 0.2, (2, 2))
        if case % 2:
            deviations[:, 1] = deviations[:, 0]
        covariance = turned(rng, deviations)
        view = view_of(mean, covariance, 0.0)
        grown = 0.65 + kind.lost(robot, view)[0] - largest_bend(robot, 0.5)
        way = np.concatenate([[2.0 * places[0] - places[1]], places])
        held = np.full((2, 1), level)
        pair = GaussianObstacle(mean[:, None], covariance[:, None])
        outside = region.signed_distance(
            places[:, None], region.parameters(pair, np.full((2, 1), grown)), held
        )
        bare = region.parameters(pair, np.full((2, 1), 0.65))
        deep = entered_between(region, way, bare, held)[0, 0]
        if outside.min() >= 0.0:
            looked_at += 1
            assert deep <= 1e-6
        elif region.signed_distance(places[:, None], bare, held).min() >= 0.0:
            without += deep > 1e-3
    assert looked_at > 100 and without > 10


def test_the_radius_grows_by_what_a_pass_of_discs_loses() -> None:
    """Against the closed form at the fastest pass; a tenth less would not be enough."""
    robot, kind = Unicycle(radius=0.35), BetweenSteps(MahalanobisEllipse())
    mean = np.array([[0.0, 0.0], [0.4, 0.0]])
    found = kind.lost(robot, view_of(mean, np.tile(0.04 * np.eye(2), (2, 1, 1)), 0.05))[0]
    half, rho = 0.5 * (0.7 * 0.5 + 0.4), 0.35 + 0.3 + 0.05
    sagitta = np.sqrt(rho**2 + half**2) - rho
    assert found == pytest.approx(sagitta + largest_bend(robot, 0.5), abs=1e-12)
    still = GaussianObstacle(np.zeros((2, 1, 2)), np.zeros((2, 1, 2, 2)))
    parameters = MahalanobisEllipse().parameters(still, np.full((2, 1), rho))
    for share, entered in ((1.0, False), (0.9, True)):
        height = np.sqrt((rho + share * sagitta) ** 2 - half**2)
        way = np.array([[-3.0 * half, height], [-half, height], [half, height]])
        deep = entered_between(MahalanobisEllipse(), way, parameters, np.ones((2, 1)))
        assert (deep[0, 0] > 1e-9) == entered


def test_points_of_ellipses_turn_aside_no_farther() -> None:
    """Dense normals; near to it where ellipses grow as they are, and nothing for round ones."""
    rng = np.random.default_rng(5)
    angle = np.linspace(0.0, np.pi, 720)
    n = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    t = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)

    def aside(covariance: Array) -> Array:
        along = np.maximum(np.einsum("ki,ij,kj->k", n, covariance, n), 1e-300)
        return np.asarray(np.einsum("ki,ij,kj->k", t, covariance, n) / np.sqrt(along))

    for case in range(300):
        deviations = 10.0 ** rng.uniform(-2.0, 0.0, (1, 2))
        first = turned(rng, deviations)[0]
        grown = rng.uniform(1.0, 1.2) ** 2 * first
        other = grown if case % 2 else grown + 0.1 * turned(rng, deviations)[0]
        truth = np.abs(aside(other) - aside(first)).max()
        found = turned_aside(np.stack([first, other]))[0]
        assert found >= truth - 1e-9
        apart = 2.4 * np.ptp(deviations)
        assert found <= apart + 1e-9 or not case % 2
    equal = np.tile(first, (2, 1, 1))
    assert turned_aside(equal)[0] == pytest.approx(0.0, abs=1e-9)
    round_ones = np.stack([np.eye(2), 4.0 * np.eye(2), 0.0 * np.eye(2)])
    np.testing.assert_allclose(turned_aside(round_ones), 0.0, atol=1e-9)


def test_no_arc_bends_farther_than_the_largest() -> None:
    """Whatever is driven within the limits: the middle of a step against that of its chord."""
    robot, rng, dt = Unicycle(), np.random.default_rng(4), 0.5
    most = largest_bend(robot, dt)
    seen = 0.0
    for _ in range(300):
        state = (0.0, 0.0, rng.uniform(-3, 3), rng.uniform(-0.7, 0.7), rng.uniform(-0.3, 0.3))
        control = (rng.uniform(-0.7, 0.7), rng.uniform(-0.1, 0.1))
        ends = np.array([state[:2], step(robot, state, control, dt)[:2]])
        for share in (0.25, 0.5, 0.75):
            place = np.array(step(robot, state, control, share * dt)[:2])
            gap = np.linalg.norm(place - (1.0 - share) * ends[0] - share * ends[1])
            seen = max(seen, float(gap))
    assert 0.8 * most < seen <= most + 1e-9
    assert largest_bend(build("robots", "holonomic_velocity"), dt) == 0.0


def test_contact_is_that_of_the_bodies() -> None:
    """What plans to stop are compared by knows nothing of the larger radius."""
    robot, view = Unicycle(radius=0.4), sample_view()
    plain = GaussianDiscs(MahalanobisEllipse()).choose(robot, view).known
    known = BetweenSteps(MahalanobisEllipse()).choose(robot, view).known
    assert isinstance(plain, KnownDiscs) and isinstance(known, KnownDiscs)
    assert known.obstacles.ids == plain.obstacles.ids
    np.testing.assert_allclose(known.obstacles.radius, plain.obstacles.radius, atol=1e-12)


def test_robots_of_several_discs_are_refused() -> None:
    long = Unicycle(radius=1.0, footprint=Discs(((-0.5, 0.0), (0.5, 0.0)), 0.4))
    with pytest.raises(WideberthError, match="robots of one disc"):
        BetweenSteps(MahalanobisEllipse()).choose(long, sample_view())


def passing(*kinds: BetweenSteps) -> Planner:
    """A planner without margin whose robot one crosses who walks at 1 m/s."""
    planner = Planner(
        robot=Unicycle(radius=0.3), region=MahalanobisEllipse(),
        predictor=ConstantVelocity(acceleration_density=1e-4), level=Fixed(), solver=Riccati(),
        further_kinds=kinds,
    )  # fmt: skip
    planner.set_path(Path(np.array([[0.0, 0.0], [12.0, 0.0]])))
    for tick in range(6):
        seen = (Detection("walker", np.array([2.6, 0.5 * tick - 5.0]), 1e-6 * np.eye(2), 0.3),)
        planner.command(Observation(0.5 * tick, np.array([0.2 * tick, 0, 0, 0.4, 0]), seen))
    return planner


def test_plans_between_their_steps_with_and_without() -> None:
    """A plan that keeps its regions at the steps enters one between them; with the kind none."""
    plain, held = passing(), passing(BetweenSteps(MahalanobisEllipse()))
    for planner, entered in ((plain, True), (held, False)):
        plan = planner.plan
        assert plan is not None and plan.violation <= 1e-4
        deep = plan_between(plan)
        assert deep is not None and deep.shape == (plan.level.shape[0] - 1, 1)
        assert (deep.max() > 1e-3) == entered
    words = [planner.explain().text().splitlines()[-1] for planner in (plain, held)]
    assert words[0].startswith("between its steps it enters the region of 'walker' by 0.054 m")
    assert words[1].startswith("the plan taken keeps every constraint")
    again = build("controllers", describe(held))
    assert again.further_kinds == (BetweenSteps(MahalanobisEllipse()),)


def test_plans_of_which_nothing_is_known() -> None:
    plan = passing().plan
    assert plan is not None
    assert plan_between(replace(plan, situation=None)) is None
    assert plan_between(replace(plan, forecast=None)) is None
