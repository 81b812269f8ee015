"""Interacting models against filterpy and brute force; an obstacle that stops."""

from itertools import pairwise, product

import numpy as np
import pytest

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.kalman_filter import AxisModel, filter_axes, on_all_axes
from wideberth.predictors.core.propagation import step_covariances, white_acceleration
from wideberth.predictors.interacting_models import (
    MODES,
    InteractingModels,
    ModeBank,
    filter_modes,
    merged_joint,
)

DT = 0.4
NAN = np.nan


def tracks_of(positions, noise=0.02, dt=DT):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, tuple(map(str, range(count))), np.full(count, 0.3), spread)


def wandering(count, rows, size, seed=0):
    rng = np.random.default_rng(seed)
    return tracks_of(np.cumsum(0.3 * rng.standard_normal((count, rows, size)), axis=1))


def correlated(count, size, seed=3):
    root = np.random.default_rng(seed).standard_normal((count, size, size))
    root = 0.05 * (np.eye(size) + 0.4 * root)
    return root @ root.swapaxes(1, 2)


def filterpy_bank(bank, noise, first, speed):
    """The same filters and their mixing in filterpy, started alike."""
    from filterpy.kalman import IMMEstimator, KalmanFilter

    size = len(noise)
    filters = []
    for transition, process in bank.models:
        one = KalmanFilter(dim_x=2 * size, dim_z=size)
        one.F, one.Q, one.H, one.R = transition, process, np.eye(size, 2 * size), noise
        one.x = np.concatenate([first, np.zeros(size)])
        one.P = np.diag(np.r_[np.zeros(size), np.full(size, speed**2)])
        one.P[:size, :size] = noise
        filters.append(one)
    return IMMEstimator(filters, bank.usual, bank.switching)


@pytest.mark.parametrize("size", [2, 3])
def test_batched_bank_equals_filterpy(size):
    tracks, noise = wandering(6, 12, size), correlated(6, size)
    bank = InteractingModels().bank(DT, size)
    past = gather(tracks)
    beliefs = filter_modes(past, noise, bank, 1.2)
    for o in range(6):
        reference = filterpy_bank(bank, noise[o], past.positions[o, 0], 1.2)
        for position in past.positions[o, 1:]:
            reference.predict()
            reference.update(position)
        np.testing.assert_allclose(beliefs.weight[:, o], reference.mu, rtol=0, atol=1e-12)
        for mode, one in enumerate(reference.filters):
            state, spread = beliefs.state[:, mode, o], beliefs.covariance[:, :, mode, o]
            np.testing.assert_allclose(state, one.x, rtol=0, atol=1e-12)
            np.testing.assert_allclose(spread, one.P, rtol=0, atol=1e-12)


def test_identical_models_are_one_kalman_filter_with_missing_samples():
    tracks = wandering(5, 14, 2)
    positions = np.array(tracks.positions)
    positions[0, 3:5], positions[1, 8], positions[2, -2:], positions[3, :6] = NAN, NAN, NAN, NAN
    past = gather(tracks_of(positions))
    noise, model = correlated(5, 2), AxisModel(*white_acceleration(DT, 0.1, 1), np.array([1.44]))
    single = filter_axes(past, noise, model)
    three = [
        np.repeat(on_all_axes(part, 2)[None], 3, axis=0)
        for part in (model.transition, model.process)
    ]
    bank = ModeBank(*three, InteractingModels().bank(DT, 2).switching)
    beliefs = filter_modes(past, noise, bank, 1.2)
    for mode in range(3):
        np.testing.assert_allclose(beliefs.state[:, mode].T, single.state, atol=1e-12)
        spread = beliefs.covariance[:, :, mode].transpose(2, 0, 1)
        np.testing.assert_allclose(spread, single.covariance, atol=1e-12)


def test_without_a_measurement_only_the_chain_moves_the_probabilities():
    tracks = wandering(1, 10, 2)
    positions = np.concatenate([tracks.positions, np.full((1, 3, 2), NAN)], axis=1)
    positions = np.concatenate([positions, tracks.positions[:, -1:]], axis=1)
    bank = InteractingModels().bank(DT, 2)
    noise = tracks.noise
    short = filter_modes(gather(tracks), noise, bank, 1.0).weight[:, 0]
    past = gather(tracks_of(positions))
    unseen = np.array(past.observed)
    unseen[:, -1] = False
    blind = past.__class__(past.origin, past.positions, unseen, past.began, past.late)
    long = filter_modes(blind, noise, bank, 1.0).weight[:, 0]
    np.testing.assert_allclose(long, short @ np.linalg.matrix_power(bank.switching, 4), atol=1e-12)


@pytest.mark.parametrize(("dt", "stopping"), [(0.4, 0.1), (0.05, 0.3), (30.0, 1e-300)])
def test_the_models_start_as_likely_as_in_the_long_run(dt, stopping):
    """Flows balance: each moving model leaves for the stopping one at a share, which leaves."""
    bank = InteractingModels(stopping=stopping).bank(dt, 2)
    np.testing.assert_allclose(bank.usual @ bank.switching, bank.usual, atol=1e-12)
    share = stopping / (1.0 + stopping)
    np.testing.assert_allclose(bank.usual, [0.5 - share / 2, 0.5 - share / 2, share], atol=1e-12)
    past = gather(tracks_of(np.ones((1, 1, 2))))
    weight = filter_modes(past, tracks_of(np.ones((1, 1, 2))).noise, bank, 1.0).weight[:, 0]
    np.testing.assert_array_equal(weight, bank.usual)
    assert (weight > 0.0).all()


def test_who_was_seen_twice_is_expected_to_walk_on():
    """Two samples at 1.3 m/s: of 6.2 m in 4.8 s, stopping takes its share and no third."""
    path = 1.3 * DT * np.arange(2.0)[:, None] * np.array([1.0, 0.0])
    forecast = InteractingModels().predict(tracks_of([path]), 12)
    gone = forecast.mean[0, 0, -1, 0] - path[-1, 0]
    assert 0.8 * 6.24 < gone < 6.24
    assert np.sqrt(np.trace(forecast.covariance[0, 0, -1]) / 2) < 1.8


def enumerated(beliefs, bank, size, steps):
    """Mean and joint covariance over all sequences of models, one after the other."""
    total, states = 0.0, len(beliefs.state)
    mean, second = np.zeros(steps * size), np.zeros((steps * size, steps * size))
    count = len(bank.switching)
    for modes in product(range(count), repeat=steps + 1):
        chance = beliefs.weight[modes[0], 0]
        for before, after in pairwise(modes):
            chance *= bank.switching[before, after]
        # All steps as one linear map of the start and the noises.
        columns = [np.eye(states)]
        noises = [beliefs.covariance[:, :, modes[0], 0]]
        rows = []
        for mode in modes[1:]:
            columns = [bank.transition[mode] @ column for column in columns] + [np.eye(states)]
            noises.append(bank.process[mode])
            rows.append([*columns])
        own_mean, own = [], np.zeros((steps * size, steps * size))
        for h, row in enumerate(rows):
            own_mean.append((row[0] @ beliefs.state[:, modes[0], 0])[:size])
            for i, other in enumerate(rows):
                block = sum(a @ q @ b.T for a, b, q in zip(row, other, noises, strict=False))
                own[h * size : (h + 1) * size, i * size : (i + 1) * size] = block[:size, :size]
        flat = np.concatenate(own_mean)
        total += chance
        mean += chance * flat
        second += chance * (own + np.outer(flat, flat))
    assert total == pytest.approx(1.0)
    return mean, second - np.outer(mean, mean)


def test_the_merged_forecast_is_exact_for_the_switching_system():
    predictor = InteractingModels(dwell=1.0, stopping=0.3)
    tracks = wandering(1, 6, 2, seed=4)
    past = gather(tracks)
    beliefs = predictor.filter(past, tracks)
    forecast = predictor.predict(tracks, 4)
    mean, joint = enumerated(beliefs, predictor.bank(DT, 2), 2, 4)
    np.testing.assert_allclose((forecast.mean[0, 0] - past.origin[0]).ravel(), mean, atol=1e-12)
    np.testing.assert_allclose(forecast.joint[0, 0], joint, atol=1e-12)
    diagonal = forecast.joint[0, 0].reshape(4, 2, 4, 2)[np.arange(4), :, np.arange(4)]
    np.testing.assert_allclose(diagonal, forecast.covariance[0, 0], atol=1e-12)


def test_late_steps_are_dropped_from_the_joint_covariance():
    tracks = wandering(2, 8, 2)
    predictor = InteractingModels()
    bank, late = predictor.bank(DT, 2), np.array([0, 2])
    beliefs = predictor.filter(gather(tracks), tracks)
    whole = merged_joint(beliefs, bank, 2, 5, np.zeros(2, dtype=np.int64))
    cut = merged_joint(beliefs, bank, 2, 3, late)
    np.testing.assert_allclose(cut[0], whole[0, :6, :6], atol=1e-14)
    np.testing.assert_allclose(cut[1], whole[1, 4:, 4:], atol=1e-14)


def test_kept_modes_keep_their_models():
    tracks = wandering(4, 9, 2)
    predictor = InteractingModels(modes="kept")
    forecast = predictor.predict(tracks, 5)
    beliefs = predictor.filter(gather(tracks), tracks)
    np.testing.assert_allclose(forecast.weight, beliefs.weight.T)
    for mode, (transition, process) in enumerate(predictor.bank(DT, 2).models):
        start = beliefs.covariance[:, :, mode].transpose(2, 0, 1)
        wanted = step_covariances(transition, process, start, 2, 5)
        np.testing.assert_allclose(forecast.covariance[:, mode], wanted, atol=1e-14)
        blocks = forecast.joint[:, mode].reshape(4, 5, 2, 5, 2)[:, np.arange(5), :, np.arange(5)]
        np.testing.assert_allclose(blocks.swapaxes(0, 1), wanted, atol=1e-12)
    unseen = predictor.predict(tracks_of(np.full((1, 4, 2), NAN)), 3)
    assert unseen.fallback == ("imm: never observed; kalman: never observed",)


def stopped(moving, standing, noise, seed=0):
    """A person that walks at 1.2 m/s, then stands, measured with noise."""
    rng = np.random.default_rng(seed)
    way = 1.2 * DT * np.minimum(np.arange(moving + standing), moving - 1)
    path = np.stack([way, np.zeros_like(way)], axis=1)
    return tracks_of([path + noise * rng.standard_normal(path.shape)], noise)


@pytest.mark.parametrize("seed", range(5))
def test_an_obstacle_that_stops_is_soon_believed_to_stand(seed):
    predictor, stopping = InteractingModels(), MODES.index("stopping")
    tracks = {count: stopped(12, count, 0.01, seed) for count in (0, 4, 6)}
    weight = {
        count: predictor.filter(gather(seen), seen).weight[stopping, 0]
        for count, seen in tracks.items()
    }
    assert weight[0] < 0.02 and weight[4] > 0.1 and weight[6] > 0.8
    # While it walked, the forecast went 1.2 m/s * 4.8 s far.
    place = tracks[4].positions[0, -1]
    drift = predictor.predict(tracks[4], 12).mean[0, 0] - place
    assert np.linalg.norm(drift, axis=1).max() < 0.3
    kept = InteractingModels(modes="kept").predict(tracks[6], 12).mean[0, stopping]
    np.testing.assert_allclose(kept, np.tile(kept[0], (12, 1)), atol=0.03)


def test_a_slow_robot_is_not_taken_for_one_that_stops():
    """At 0.06 m/s, measured to 2 mm, it goes on: 0.45 m in 7.5 s, and not a third of that."""
    rng = np.random.default_rng(0)
    way = 0.06 * 0.5 * np.arange(20)
    path = np.stack([way, 0 * way], axis=1) + 0.002 * rng.standard_normal((10, 20, 2))
    tracks = tracks_of(path, 0.002, 0.5)
    gone = InteractingModels().predict(tracks, 15).mean[:, 0, -1, 0] - tracks.positions[:, -1, 0]
    assert 0.36 < gone.mean() < 0.5


def test_settings():
    check_predictor(InteractingModels(modes="kept"))
    for bad, words in (
        ({"modes": "all"}, r"imm\.modes is 'all'"),
        ({"dwell": 0.0}, r"imm\.dwell is 0"),
        ({"stopping": 1.0}, r"imm\.stopping is 1"),
    ):
        with pytest.raises(WideberthError, match=words):
            InteractingModels(**bad)


def seen_once(velocity: bool) -> Tracks:
    """Two obstacles with a tracker's state: one of a single sample, one of three."""
    positions = np.full((2, 5, 2), np.nan)
    positions[0, -1] = 1.0, 2.0
    positions[1, -3:] = [(0.0, 0.0), (0.1, 0.1), (0.2, 0.1)]
    root = np.random.default_rng(4).normal(size=(2, 4, 4))
    joint = 0.02 * root @ root.transpose(0, 2, 1) + 1e-3 * np.eye(4)
    rows = np.array([(0.4, -0.3), (5.0, 5.0)])
    return Tracks(
        positions, 0.25, ("new", "old"), np.full(2, 0.3), noise=joint[:, :2, :2],
        state_covariance=joint, velocity=rows if velocity else None,
    )  # fmt: skip


def test_who_is_seen_for_the_first_time_has_the_trackers_velocity() -> None:
    """Each model rolls the tracker's own state out; who has a history keeps to it."""
    tracks, steps = seen_once(True), 6
    own = InteractingModels(modes="kept")
    found, without = (own.predict(one, steps) for one in (tracks, seen_once(False)))
    bank = own.bank(tracks.dt, 2)
    assert tracks.velocity is not None and tracks.state_covariance is not None
    np.testing.assert_allclose(found.weight[0], bank.usual)
    for mode, (transition, process) in enumerate(bank.models):
        state = np.array([1.0, 2.0, *tracks.velocity[0]])
        spread = tracks.state_covariance[0]
        for h in range(steps):
            state, spread = transition @ state, transition @ spread @ transition.T + process
            np.testing.assert_allclose(found.mean[0, mode, h], state[:2])
            np.testing.assert_allclose(found.covariance[0, mode, h], spread[:2, :2])
    np.testing.assert_array_equal(found.mean[1], without.mean[1])
    np.testing.assert_array_equal(found.covariance[1], without.covariance[1])
