"""The batched linear filter against filterpy, and `kalman` around it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.scoring import negative_log_likelihood
from wideberth.predictors.constant_acceleration import ConstantAcceleration
from wideberth.predictors.core.history import gather, measurement_noise
from wideberth.predictors.core.kalman_filter import (
    AxisModel,
    filter_axes,
    measured_update,
    scalar_update,
)
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.interacting_models import InteractingModels
from wideberth.predictors.kalman import Kalman, filter_one_by_one

DT = 0.5
NAN = np.nan


def wandering(count, rows, size, *, missing=0.0, seed=0, far=0.0):
    """Random walks with holes and with measurement noise that differs and correlates."""
    rng = np.random.default_rng(seed)
    positions = far + np.cumsum(0.3 * rng.standard_normal((count, rows, size)), axis=1)
    positions[rng.random((count, rows)) < missing] = NAN
    root = 0.05 * (np.eye(size) + 0.4 * rng.standard_normal((count, size, size)))
    noise = root @ root.swapaxes(1, 2)
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, DT, ids, np.full(count, 0.3), noise)


def model_of(density=0.05, speed=1.3):
    return AxisModel(*white_acceleration(DT, density, 1), np.array([speed**2]))


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_batched_filter_equals_filterpy(size, missing):
    tracks = wandering(25, 18, size, missing=missing)
    past = gather(tracks, length=15)
    noise = measurement_noise(tracks, 0.02)
    ours = filter_axes(past, noise, model_of())
    theirs = filter_one_by_one(past, noise, model_of())
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=0, atol=1e-12)


def test_shared_and_own_covariances_agree():
    tracks = wandering(12, 20, 2, missing=0.2)
    shared = np.repeat(tracks.noise[:1], 12, axis=0)
    whole = filter_axes(gather(tracks), shared, model_of())
    for index in range(12):
        alone = filter_axes(gather(tracks.select([index])), shared[:1], model_of())
        np.testing.assert_allclose(whole.state[index], alone.state[0], atol=1e-13)
        np.testing.assert_allclose(whole.covariance[index], alone.covariance[0], atol=1e-13)


def test_histories_that_begin_at_different_rows():
    tracks = wandering(6, 12, 2)
    positions = np.array(tracks.positions)
    for index in range(6):
        positions[index, : 2 * index] = NAN
    late = replace(tracks, positions=positions)
    filtered = filter_axes(gather(late), tracks.noise, model_of())
    for index in range(6):
        short = replace(tracks.select([index]), positions=positions[[index], 2 * index :])
        alone = filter_axes(gather(short), short.noise, model_of())
        np.testing.assert_allclose(filtered.state[index], alone.state[0], atol=1e-13)
        np.testing.assert_allclose(filtered.covariance[index], alone.covariance[0], atol=1e-13)


def test_updates_stay_positive_semi_definite_with_tiny_noise():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 4, 500))
    covariance = np.einsum("abo,cbo->aco", root, root)
    _, after, _ = measured_update(
        np.zeros((4, 500)), covariance, np.zeros((2, 500)), np.full((2, 500), 1e-18)
    )
    spread = np.abs(after).max()
    assert np.linalg.eigvalsh(after.transpose(2, 0, 1)).min() > -1e-12 * spread
    gain, total, one = scalar_update(covariance, 1, np.full(500, 0.3))
    np.testing.assert_allclose(gain, covariance[:, 1] / (covariance[1, 1] + 0.3))
    np.testing.assert_allclose(total, covariance[1, 1] + 0.3)
    np.testing.assert_allclose(one[1, 1], 0.3 * covariance[1, 1] / total, rtol=1e-10)


@pytest.mark.parametrize("size", [2, 3])
def test_the_backends_forecast_the_same(size):
    tracks = wandering(8, 20, size, missing=0.2, far=1e3)
    ours = Kalman().predict(tracks, 7)
    theirs = Kalman(backend="filterpy").predict(tracks, 7)
    assert ours.fallback == theirs.fallback
    np.testing.assert_allclose(ours.mean, theirs.mean, rtol=0, atol=1e-11)
    np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.joint, theirs.joint, rtol=0, atol=1e-12)


def test_the_filterpy_backend_keeps_the_laws():
    """But for those of `fit`, which the other backend keeps, at a hundredth of the time."""
    check_predictor(Kalman(backend="filterpy"), dimensions=(2,), dataset=())


def test_the_joint_covariance_travels_between_processes():
    forecast = pickle.loads(pickle.dumps(Kalman().predict(wandering(3, 9, 2), 4)))
    blocks = forecast.joint[:, 0].reshape(3, 4, 2, 4, 2)[:, np.arange(4), :, np.arange(4)]
    np.testing.assert_allclose(blocks.swapaxes(0, 1), forecast.covariance[:, 0], atol=1e-12)


def test_a_far_origin_costs_no_digits_of_the_spread():
    near, far = wandering(4, 15, 2), wandering(4, 15, 2, far=2.0**20)
    one, two = Kalman().predict(near, 5), Kalman().predict(far, 5)
    np.testing.assert_allclose(two.covariance, one.covariance, rtol=1e-12)
    np.testing.assert_allclose(two.mean - 2.0**20, one.mean, atol=1e-8)


def test_a_trackers_covariance_replaces_the_filters_own():
    tracks = wandering(3, 15, 2)
    rng = np.random.default_rng(5)
    root = 0.1 * rng.standard_normal((3, 4, 4))
    tracked = replace(tracks, state_covariance=root @ root.swapaxes(1, 2))
    plain, forecast = Kalman().predict(tracks, 4), Kalman().predict(tracked, 4)
    transition, process = white_acceleration(DT, 0.02, 2)
    spread = tracked.state_covariance
    for h in range(4):
        spread = transition @ spread @ transition.T + process
        np.testing.assert_allclose(forecast.covariance[:, 0, h], spread[:, :2, :2], atol=1e-12)
    # It starts at the tracked position with the velocity of the filter.
    steps = np.diff(
        np.concatenate([tracks.positions[:, None, -1:], forecast.mean], axis=2), axis=2
    )
    np.testing.assert_allclose(
        steps, np.diff(plain.mean, axis=2)[:, :, :1].repeat(4, 2), atol=1e-12
    )


def test_one_tracked_sample_keeps_the_spread_of_an_unknown_velocity():
    tracks = wandering(2, 1, 2)
    tracked = replace(tracks, state_covariance=np.tile(1e-6 * np.eye(4), (2, 1, 1)))
    one, two = Kalman().predict(tracks, 3), Kalman().predict(tracked, 3)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def drifting(density, noise, *, count=60, rows=20, seed=0):
    """Measured paths of bodies under white acceleration, each a recording row of its own."""
    rng = np.random.default_rng(seed)
    transition, process = white_acceleration(0.4, density, 2)
    root = np.linalg.cholesky(process)
    state = np.concatenate([np.zeros((count, 2)), rng.standard_normal((count, 2))], axis=1)
    path = np.empty((count, rows, 2))
    for k in range(rows):
        path[:, k] = state[:, :2]
        state = state @ transition.T + rng.standard_normal((count, 4)) @ root.T
    measured = path + noise * rng.standard_normal(path.shape)
    zero = np.zeros((count, 2, 2))
    return Tracks(measured, 0.4, tuple(map(str, range(count))), np.full(count, 0.3), zero)


@pytest.mark.parametrize("scale", [30.0, 1.0, 0.04])
def test_fitting_finds_the_scale_of_its_own_model(scale):
    density, noise = 0.05 * scale, 0.05 * scale**0.5
    unfitted = Kalman(acceleration_density=0.05, noise_floor=0.05)
    scenes = [drifting(density, noise, seed=seed, count=200) for seed in (0, 1)]
    fitted = unfitted.fit(scenes)
    # Four hundred windows of twelve correlated steps, and a last step of 20 %.
    assert fitted.acceleration_density == pytest.approx(density, rel=0.25)
    ratio = fitted.noise_floor**2 / fitted.acceleration_density
    assert ratio == pytest.approx(0.05, rel=1e-12)
    assert unfitted == Kalman(0.05, noise_floor=0.05) and unfitted.fit(scenes) == fitted


@pytest.mark.parametrize("predictor", [ConstantAcceleration(), InteractingModels()], ids=repr)
def test_relatives_are_fitted_too(predictor):
    fitted = predictor.fit([drifting(1e-4, 1e-3, seed=seed) for seed in (0, 1)])
    assert type(fitted) is type(predictor)
    held = drifting(1e-4, 1e-3, seed=7)
    ahead = replace(held, positions=held.positions[:, :8])
    future = held.positions[:, 8:]
    scores = []
    for one in (predictor, fitted):
        said = one.predict(ahead, 12)
        score = negative_log_likelihood(said.mean, said.covariance, said.weight, future, 0.01)
        scores.append(score.mean())
    assert scores[1] < scores[0] - 1.0


def test_too_little_to_fit_to_is_said():
    with pytest.raises(WideberthError, match=r"kalman\.fit.* 5 windows .*wanted at least 20"):
        Kalman().fit([drifting(0.1, 0.1, count=5)])
    with pytest.raises(WideberthError, match=r"kalman\.backend is 'simd'"):
        Kalman(backend="simd")


def test_the_density_of_a_position_is_that_of_its_innovation():
    rng = np.random.default_rng(17)
    root = rng.standard_normal((4, 4))
    spread, state = root @ root.T, rng.standard_normal(4)
    place, variance = rng.standard_normal(2), np.array([0.3, 0.7])
    batch = [np.repeat(one[..., None], 3, axis=-1) for one in (state, spread, place, variance)]
    after, left, density = measured_update(*batch)
    wide = spread[:2, :2] + np.diag(variance)
    gain = spread[:, :2] @ np.linalg.inv(wide)
    np.testing.assert_allclose(density, multivariate_normal(state[:2], wide).logpdf(place))
    np.testing.assert_allclose(after[:, 1], state + gain @ (place - state[:2]))
    np.testing.assert_allclose(left[..., 2], spread - gain @ spread[:2], atol=1e-12)
