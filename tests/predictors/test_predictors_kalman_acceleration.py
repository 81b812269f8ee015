"""Constant acceleration that decays: Singer's matrices, and the filter with three components."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_acceleration import (
    ConstantAcceleration,
    DecayingAcceleration,
    singer,
)
from wideberth.predictors.core.kalman_filter import filtered
from wideberth.predictors.kalman import Kalman
from wideberth.tests.helpers.irregular import irregular_tracks
from wideberth.tests.oracles.linear_filter import filter_one_by_one

DT = 0.4


def tracks_of(positions, noise=0.02):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    return Tracks(positions, DT, tuple(map(str, range(count))), np.full(count, 0.3), spread)


def van_loan(dt, acceleration, time_constant):
    """The same matrices by one matrix exponential."""
    from scipy.linalg import expm

    drift = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -1 / time_constant]])
    noise = np.zeros((3, 3))
    noise[2, 2] = 2 * acceleration**2 / time_constant
    block = expm(dt * np.block([[-drift, noise], [np.zeros((3, 3)), drift.T]]))
    transition = block[3:, 3:].T
    return transition, transition @ block[:3, 3:]


def singer_step(dt, acceleration, time_constant):
    """Return the matrices of one step."""
    return (part[..., 0] for part in singer(np.array([dt]), acceleration, time_constant))


def test_steps_of_different_times_are_each_alone():
    times = np.array([1e-3, 0.4, 2.0, 0.4])
    several = singer(times, 0.7, 0.9)
    for k, time in enumerate(times):
        for part, wanted in zip(several, singer_step(time, 0.7, 0.9), strict=True):
            np.testing.assert_allclose(part[..., k], wanted, rtol=1e-14)


@pytest.mark.parametrize("dt", [0.01, 0.4, 2.0])
@pytest.mark.parametrize("time_constant", [0.3, 1.0, 50.0])
def test_singer_equals_the_matrix_exponential(dt, time_constant):
    transition, process = singer_step(dt, 0.7, time_constant)
    wanted_transition, wanted = van_loan(dt, 0.7, time_constant)
    np.testing.assert_allclose(transition, wanted_transition, rtol=1e-11, atol=1e-13)
    # The exponential has an absolute error of 1e-16 in all its entries.
    np.testing.assert_allclose(process, wanted, rtol=1e-9, atol=1e-15)


def test_a_lasting_acceleration_is_the_textbooks():
    transition, process = singer_step(DT, 1.0, 1e9)
    np.testing.assert_allclose(transition, [[1, DT, DT**2 / 2], [0, 1, DT], [0, 0, 1]], rtol=1e-8)
    shape = [
        [DT**5 / 20, DT**4 / 8, DT**3 / 6],
        [DT**4 / 8, DT**3 / 3, DT**2 / 2],
        [DT**3 / 6, DT**2 / 2, DT],
    ]
    np.testing.assert_allclose(process / 2e-9, shape, rtol=1e-8)
    assert np.linalg.eigvalsh(process).min() > 0


def test_the_acceleration_keeps_its_long_run_variance():
    transition, process = singer_step(DT, 0.7, 0.9)
    decay = transition[2, 2]
    assert process[2, 2] / (1 - decay**2) == pytest.approx(0.49, rel=1e-12)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("irregular", [False, True])
def test_three_components_equal_filterpy(size, irregular):
    rng = np.random.default_rng(0)
    positions = np.cumsum(0.3 * rng.standard_normal((10, 15, size)), axis=1)
    positions[rng.random((10, 15)) < 0.2] = np.nan
    root = 0.05 * (np.eye(size) + 0.4 * rng.standard_normal((10, size, size)))
    tracks = replace(tracks_of(positions), noise=root @ root.swapaxes(1, 2))
    if irregular:
        tracks = irregular_tracks(10, size, pauses=True)
    motion = DecayingAcceleration(0.4, 0.8, 1.0)
    ours, theirs = filtered(tracks, None, motion, 0.03), filter_one_by_one(tracks, motion, 0.03)
    assert ours.count.tolist() == theirs.count.tolist() and ours.log == theirs.log
    for part, wanted in zip(ours.values, theirs.values, strict=True):
        np.testing.assert_allclose(part, wanted, rtol=0, atol=1e-12)


def test_a_short_lived_acceleration_is_white():
    rng = np.random.default_rng(1)
    tracks = tracks_of(np.cumsum(0.3 * rng.standard_normal((5, 20, 2)), axis=1))
    tau = 1e-4
    white = Kalman(acceleration_density=2 * 30.0**2 * tau, noise_floor=0.03).predict(tracks, 8)
    singers = ConstantAcceleration(acceleration=30.0, time_constant=tau).predict(tracks, 8)
    np.testing.assert_allclose(singers.mean, white.mean, atol=5e-3)
    np.testing.assert_allclose(singers.covariance, white.covariance, rtol=2e-3, atol=1e-6)


def test_it_follows_a_parabola_and_then_lets_go():
    time = DT * np.arange(30)
    path = np.stack([time, 0.25 * time**2], axis=1)
    tracks = tracks_of([path[:20]], noise=1e-6)
    lasting = ConstantAcceleration(0.5, 1e6, noise_floor=1e-6).predict(tracks, 10)
    np.testing.assert_allclose(lasting.mean[0, 0], path[20:], atol=1e-3)
    fading = ConstantAcceleration(0.5, 0.5, noise_floor=1e-6).predict(tracks, 10)
    gained = np.diff(fading.mean[0, 0, :, 1]) / DT
    assert gained[-1] - gained[-2] < 0.01 * DT
    assert fading.mean[0, 0, -1, 1] < path[-1, 1]


def test_joint_and_marginal_covariances_agree():
    rng = np.random.default_rng(2)
    tracks = tracks_of(np.cumsum(0.3 * rng.standard_normal((3, 9, 2)), axis=1))
    forecast = ConstantAcceleration().predict(tracks, 5)
    blocks = forecast.joint[:, 0].reshape(3, 5, 2, 5, 2)[:, np.arange(5), :, np.arange(5)]
    np.testing.assert_allclose(blocks.swapaxes(0, 1), forecast.covariance[:, 0], atol=1e-12)


def test_settings():
    check_predictor(ConstantAcceleration(2.0, 1e5), dimensions=(2,))
    with pytest.raises(WideberthError, match=r"constant_acceleration\.time_constant is 0"):
        ConstantAcceleration(time_constant=0.0)
