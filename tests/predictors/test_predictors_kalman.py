"""The batched linear filter against filterpy, and `kalman` around it."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.measurements import Measurements
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.scoring import negative_log_likelihood
from wideberth.predictors.constant_acceleration import ConstantAcceleration
from wideberth.predictors.core.kalman_filter import (
    ModeStates,
    filtered,
    floored,
    whitened,
)
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.interacting_models import InteractingModels
from wideberth.predictors.kalman import DriftingVelocity, Kalman
from wideberth.tests.helpers.filter_steps import updated
from wideberth.tests.helpers.irregular import irregular_tracks
from wideberth.tests.oracles.linear_filter import filterpy_states

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


MOTION = DriftingVelocity(density=0.05, speed=1.3)


def compare(beliefs, states, covariances, tolerance=1e-12):
    """Compare beliefs of one mode with states (O, 2D) and covariances (O, 2D, 2D)."""
    _, state, covariance, origin = beliefs.values
    size, count = origin.shape
    place = state[:, :, 0].transpose(2, 0, 1).reshape(count, 2 * size)
    place[:, :size] += origin.T
    spread = covariance[..., 0, :].transpose(4, 0, 1, 2, 3).reshape(count, 2 * size, 2 * size)
    np.testing.assert_allclose(place, states, rtol=0, atol=tolerance)
    np.testing.assert_allclose(spread, covariances, rtol=0, atol=tolerance)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_batched_filter_equals_filterpy(size, missing):
    tracks = wandering(25, 18, size, missing=missing)
    compare(filtered(tracks, None, MOTION, 0.02), *filterpy_states(tracks, 0.05, 1.3, 0.02))


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("pauses", [False, True])
def test_measurements_at_any_times_are_filtered_as_by_filterpy(size, pauses):
    """With the covariance of each measurement, and begun anew after a pause of 7 steps."""
    tracks = irregular_tracks(20, size, pauses=pauses)
    beliefs = filtered(tracks, None, MOTION, 0.02)
    compare(beliefs, *filterpy_states(tracks, 0.05, 1.3, 0.02))
    counts = np.array([14 - k % 4 for k in range(20)])
    if pauses:
        counts[::3] -= counts[::3] // 2
    assert beliefs.count.tolist() == counts.tolist()
    assert beliefs.newest.tolist() == [100.0] * 20


def test_a_pause_is_one_of_more_than_six_steps():
    """Six steps between two measurements are bridged, and a little more ends the track."""
    tracks = wandering(1, 3, 2)
    for gap, count in ((6.0, 2), (6.0 + 1e-7, 2), (6.0 + 1e-4, 1), (7.0, 1)):
        sightings = Measurements([[-gap * DT, 0.0]], [np.eye(2)], [np.tile(np.eye(2), (2, 1, 1))])
        beliefs = filtered(replace(tracks, sightings=sightings), None, MOTION, 0.02)
        assert beliefs.count.tolist() == [count], gap


@pytest.mark.parametrize("size", [2, 3])
def test_filtering_on_is_filtering_from_the_first_measurement(size):
    """One by one, all at once or some at a time; and measurements of others change nothing."""
    tracks = irregular_tracks(8, size, pauses=True)
    whole = filtered(tracks, None, MOTION, 0.02)
    for stride in (1, 5):
        beliefs = None
        for end in [*range(1, 14, stride), 14]:
            seen = replace(tracks, sightings=tracks.measured.part([slice(end)] * 8))
            beliefs = filtered(seen, beliefs, MOTION, 0.02)
        assert beliefs.log == whole.log and beliefs.count.tolist() == whole.count.tolist()
        for part, wanted in zip(beliefs.values, whole.values, strict=True):
            np.testing.assert_allclose(part, wanted, rtol=1e-12, atol=1e-15)


def test_shared_and_own_covariances_agree():
    tracks = wandering(12, 20, 2, missing=0.2)
    tracks = replace(tracks, noise=np.repeat(tracks.noise[:1], 12, axis=0))
    whole = filtered(tracks, None, MOTION, 0.02)
    for index in range(12):
        alone = filtered(tracks.select([index]), None, MOTION, 0.02)
        for part, wanted in zip(whole.values, alone.values, strict=True):
            np.testing.assert_allclose(part[..., [index]], wanted, atol=1e-13)


def test_histories_that_begin_at_different_rows():
    tracks = wandering(6, 12, 2)
    positions = np.array(tracks.positions)
    for index in range(6):
        positions[index, : 2 * index] = NAN
    late = filtered(replace(tracks, positions=positions), None, MOTION, 0.02)
    for index in range(6):
        short = replace(tracks.select([index]), positions=positions[[index], 2 * index :])
        alone = filtered(short, None, MOTION, 0.02)
        for part, wanted in zip(late.values, alone.values, strict=True):
            np.testing.assert_allclose(part[..., [index]], wanted, atol=1e-13)


def one_mode(count, size=2, seed=1):
    """Return random states and covariances of one mode, and the latter as (O, 2D, 2D)."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((count, 2 * size, 2 * size))
    whole = root @ root.swapaxes(1, 2)
    covariance = whole.reshape(count, 2, size, 2, size).transpose(1, 2, 3, 4, 0)[..., None, :]
    state = rng.standard_normal((2, size, 1, count))
    return ModeStates(np.ones((1, count)), state, covariance), whole


@pytest.mark.parametrize("size", [2, 3])
def test_updates_stay_positive_semi_definite_with_tiny_noise(size):
    modes, _ = one_mode(500, size)
    noise = np.tile(1e-18 * np.eye(size), (500, 1, 1))
    after = updated(modes, np.zeros((size, 500)), noise).covariance[..., 0, :]
    spread = after.transpose(4, 0, 1, 2, 3).reshape(500, 2 * size, 2 * size)
    assert np.linalg.eigvalsh(spread).min() > -1e-12 * np.abs(spread).max()


@pytest.mark.parametrize("size", [2, 3])
def test_whitening_makes_errors_independent(size):
    """W R W' = I and W is lower triangular, also where axes differ by a factor of 1e6."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((40, size, size)) * np.logspace(0, -3, size)[:, None]
    noise = root @ root.swapaxes(1, 2)
    whitening = whitened(noise)
    assert (whitening == np.tril(whitening)).all()
    unit = whitening @ noise @ whitening.swapaxes(1, 2)
    np.testing.assert_allclose(unit, np.tile(np.eye(size), (40, 1, 1)), atol=1e-6)


def test_noise_has_a_floor():
    """R + max(floor^2, 1e-12 tr R) I: the share of the trace is for noise of kilometres."""
    small, large = np.diag([1e-4, 0.0]), np.diag([1e12, 0.0])
    found = floored(np.stack([small, large]), 0.1)
    np.testing.assert_allclose(found, [small + 0.01 * np.eye(2), large + np.eye(2)], rtol=1e-15)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("irregular", [False, True])
def test_the_forecast_is_that_of_filterpy(size, irregular):
    tracks = wandering(8, 20, size, missing=0.2, far=1e3)
    if irregular:
        tracks = irregular_tracks(8, size, pauses=True, far=1e3, latest=2.0)
    ours = Kalman().predict(tracks, 7)
    states, spreads = filterpy_states(tracks, 0.02, 1.0, 0.01)
    for o, times in enumerate(tracks.measured.times):
        late = tracks.stamp - times[-1] + tracks.dt * np.arange(1.0, 8.0)
        ahead = [white_acceleration(lag, 0.02, size) for lag in late]
        state = np.stack([f @ states[o] for f, _ in ahead])
        spread = [f @ spreads[o] @ f.T + q for f, q in ahead]
        np.testing.assert_allclose(ours.mean[o, 0], state[:, :size], rtol=0, atol=1e-11)
        for h in range(7):
            for j in range(h, 7):
                between, _ = white_acceleration(late[j] - late[h], 0.02, size)
                block = ours.joint[o, 0, j * size : (j + 1) * size, h * size : (h + 1) * size]
                wanted = (between @ spread[h])[:size, :size]
                np.testing.assert_allclose(block, wanted, rtol=0, atol=1e-12)
            np.testing.assert_allclose(
                ours.covariance[o, 0, h], spread[h][:size, :size], rtol=0, atol=1e-12
            )


def test_who_was_measured_before_the_newest_instant_is_carried_over_the_lag():
    """The forecast from there is the one that began earlier, from its second step on."""
    tracks = irregular_tracks(5, 2)
    early = Kalman().predict(tracks, 6)
    late = Kalman().predict(replace(tracks, stamp=tracks.stamp + 2 * tracks.dt), 4)
    np.testing.assert_allclose(late.mean, early.mean[:, :, 2:], rtol=1e-12)
    np.testing.assert_allclose(late.covariance, early.covariance[:, :, 2:], rtol=1e-12)
    np.testing.assert_allclose(late.joint, early.joint[:, :, 4:, 4:], rtol=1e-12)
    states, spreads = filterpy_states(tracks, 0.02, 1.0, 0.01)
    part = Kalman().predict(replace(tracks, stamp=tracks.stamp + 0.13), 3)
    for h in range(3):
        f, q = white_acceleration(0.13 + tracks.dt * (h + 1), 0.02, 2)
        np.testing.assert_allclose(part.mean[:, 0, h], (states @ f.T)[:, :2], atol=1e-11)
        spread = (f @ spreads @ f.T + q)[:, :2, :2]
        np.testing.assert_allclose(part.covariance[:, 0, h], spread, atol=1e-11)


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


def test_an_update_is_the_textbooks_gain():
    """P+ = P - K S K' and x+ = x + K y, with noise that correlates."""
    modes, whole = one_mode(7, 3)
    rng = np.random.default_rng(17)
    root = rng.standard_normal((7, 3, 3))
    noise, place = root @ root.swapaxes(1, 2), rng.standard_normal((3, 7))
    after = updated(modes, place, noise)
    state = modes.state[:, :, 0].transpose(2, 0, 1).reshape(7, 6)
    gain = whole[:, :, :3] @ np.linalg.inv(whole[:, :3, :3] + noise)
    moved = state + np.einsum("oij,oj->oi", gain, place.T - state[:, :3])
    found = after.state[:, :, 0].transpose(2, 0, 1).reshape(7, 6)
    np.testing.assert_allclose(found, moved, rtol=1e-9)
    left = after.covariance[..., 0, :].transpose(4, 0, 1, 2, 3).reshape(7, 6, 6)
    np.testing.assert_allclose(left, whole - gain @ whole[:, :3], atol=1e-10)


def test_modes_are_weighted_by_the_density_of_the_innovation():
    """mu_j = c_j N(z; p_j, P_j + R) / sum of them."""
    rng = np.random.default_rng(18)
    several = [one_mode(4, seed=seed) for seed in range(3)]
    weight = rng.dirichlet(np.ones(3), 4).T
    modes = ModeStates(
        weight,
        np.concatenate([modes.state for modes, _ in several], axis=2),
        np.concatenate([modes.covariance for modes, _ in several], axis=4),
    )
    root = rng.standard_normal((4, 2, 2))
    noise, place = root @ root.swapaxes(1, 2), rng.standard_normal((2, 4))
    after = updated(modes, place, noise)
    for o in range(4):
        density = [
            multivariate_normal(modes.state[0, :, m, o], whole[o, :2, :2] + noise[o]).pdf(
                place[:, o]
            )
            for m, (_, whole) in enumerate(several)
        ]
        wanted = weight[:, o] * density
        np.testing.assert_allclose(after.weight[:, o], wanted / wanted.sum(), rtol=1e-9)
