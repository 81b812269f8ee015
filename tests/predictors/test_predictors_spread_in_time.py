"""Forecasts spread over the way of the next seconds: moments, closed form, and a crowd."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.shipped import read_experiment
from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.mixture_density import MixtureDensity
from wideberth.predictors.spread_in_time import SpreadInTime

DT, STEPS, LATER = 0.25, 6, 5


def walk(speed: float = 1.2) -> Tracks:
    """One who walks straight on and one who turned, measured to 5 cm."""
    time = DT * np.arange(-8, 1)
    straight = np.stack([speed * time, np.full_like(time, 2.0)], axis=1)
    turned = np.stack([np.minimum(time, -0.6), np.maximum(time, -0.6)], axis=1)
    noise = np.tile(0.05**2 * np.eye(2), (2, 1, 1))
    places = np.stack([straight, turned]).astype(np.float64)
    return Tracks(places, DT, ("one", "two"), np.full(2, 0.3), noise)


def test_its_moments_are_those_of_a_place_at_a_drawn_time() -> None:
    """Monte Carlo: a future of the base, and one T for all steps of it."""
    base, count = ConstantVelocity(window=1, acceleration_density=0.1), 40_000
    found = SpreadInTime(base, LATER * DT).predict(walk(), STEPS)
    rng = np.random.default_rng(1)
    futures = base.predict(walk(), STEPS + LATER).sample(rng, count)
    futures = futures.reshape(count, 2, STEPS + LATER, 2)
    drawn = rng.integers(0, LATER + 1, count)[:, None] + np.arange(STEPS)
    places = futures[np.arange(count)[:, None], :, drawn]  # (S, N, O, D)
    places = places.transpose(0, 2, 1, 3).reshape(count, 2, 2 * STEPS)
    joint = found.joint
    assert joint is not None
    deviation = np.sqrt(np.diagonal(joint[:, 0], axis1=1, axis2=2))
    apart = (places - found.mean[:, 0].reshape(2, 2 * STEPS)) / deviation
    assert np.abs(apart.mean(axis=0)).max() < 5 / np.sqrt(count)
    moment = np.einsum("soi,soj->oij", apart, apart) / count
    wanted = joint[:, 0] / (deviation[:, :, None] * deviation[:, None])
    assert np.abs(moment - wanted).max() < 10 / np.sqrt(count)
    blocks = joint[:, 0].reshape(2, STEPS, 2, STEPS, 2)[:, np.arange(STEPS), :, np.arange(STEPS)]
    np.testing.assert_allclose(blocks.swapaxes(0, 1), found.covariance[:, 0], atol=1e-12)


@pytest.mark.parametrize("later", [1, 5, 12])
def test_of_somebody_who_walks_straight_on_it_covers_the_way(later: int) -> None:
    """The docstring's deviation, and the content from which on the place now is covered."""
    speed = 1.2
    tracks = replace(walk(speed), noise=np.tile(1e-12 * np.eye(2), (2, 1, 1)))
    base = ConstantVelocity(window=1, acceleration_density=1e-9, noise_floor=1e-6)
    found = SpreadInTime(base, later * DT).predict(tracks, STEPS)
    time = DT * np.arange(1, STEPS + 1)
    way = speed * later * DT
    mean = np.stack([speed * time + way / 2, np.full(STEPS, 2.0)], axis=1)
    np.testing.assert_allclose(found.mean[0, 0], mean, atol=1e-6)
    along = way * np.sqrt((later + 2) / (12 * later))
    np.testing.assert_allclose(np.sqrt(found.covariance[0, 0, :, 0, 0]), along, rtol=1e-3)
    np.testing.assert_allclose(found.covariance[0, 0, :, 1, 1], 0.0, atol=1e-5)
    content = 1 - np.exp(-0.5 * (way / 2 / along) ** 2)
    assert content == pytest.approx(1 - np.exp(-3 * later / (2 * (later + 2))))
    assert way / 2 < 1.7321 * along < 2.447 * along  # the ellipse of 95 %


def test_less_than_half_a_step_is_the_base_and_modes_stay_apart() -> None:
    base, tracks = MixtureDensity(), walk()
    same, wide = (SpreadInTime(base, span).predict(tracks, STEPS) for span in (0.1, 1.0))
    alone = base.predict(tracks, STEPS)
    np.testing.assert_array_equal(same.mean, alone.mean)
    np.testing.assert_allclose(same.covariance, alone.covariance, atol=1e-15)
    words = "spread_in_time: over nothing, 0.1 s is no more than half a step of 0.25 s"
    assert all(why is not None and words in why for why in same.fallback)
    assert wide.fallback == alone.fallback
    assert wide.mean.shape == alone.mean.shape
    np.testing.assert_array_equal(wide.weight, alone.weight)
    longer = base.predict(tracks, STEPS + 4).mean
    np.testing.assert_allclose(wide.mean[:, :, 0], longer[:, :, :5].mean(axis=2), atol=1e-12)


def test_work_is_bounded_where_steps_are_fine() -> None:
    fine = replace(walk(), dt=1e-3)
    found = SpreadInTime(span=1.25).predict(fine, STEPS)
    assert set(found.fallback) == {"spread_in_time: over 0.04 s of 1.25 s, 40 steps"}
    alone = ConstantVelocity().predict(fine, STEPS + 40).mean
    np.testing.assert_allclose(found.mean[:, :, 0], alone[:, :, :41].mean(axis=2), atol=1e-9)
    assert set(SpreadInTime().predict(walk(), STEPS).fallback) == {None}


def test_it_says_what_is_wrong() -> None:
    with pytest.raises(WideberthError, match=r"spread_in_time\.span is 0"):
        SpreadInTime(span=0.0)
    with pytest.raises(WideberthError, match=r"spread_in_time\.base"):
        SpreadInTime(AdaptiveConformal())


def test_a_robot_stays_out_of_where_people_are_about_to_walk() -> None:
    """CrowdNav++ as it is shipped, a validation case: without the wrapper it intrudes."""
    experiment, _ = read_experiment("crowdnav_plus", [])
    assert isinstance(experiment, Comparison)
    (settings,), (robot,) = experiment.settings.values(), experiment.robots.values()
    spread = experiment.controllers["spread"]
    assert isinstance(spread, Planner) and isinstance(spread.predictor, SpreadInTime)
    scenario = replace(experiment.scenarios["plain"], phase="validation")  # type: ignore[type-var]
    intrusions = []
    for planner in (spread, replace(spread, predictor=spread.predictor.base)):
        row = scenario.judge(play(scenario, robot, planner, settings, 7))
        assert row["outcome"] == "success"
        intrusions.append(row["intrusion_percent"])
    assert intrusions[0] < 2.0 < 8.0 < intrusions[1]
