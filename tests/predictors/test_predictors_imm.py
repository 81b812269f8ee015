"""Interacting models against filterpy and brute force; an obstacle that stops."""

from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import pytest

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.kalman_filter import (
    ModeStates,
    ModeStep,
    Motion,
    filtered,
    moments_ahead,
    moved,
    readings,
)
from wideberth.predictors.core.propagation import joint_covariance
from wideberth.predictors.interacting_models import MODES, InteractingModels
from wideberth.predictors.kalman import DriftingVelocity
from wideberth.tests.helpers.filter_steps import mixed
from wideberth.tests.helpers.irregular import irregular_tracks

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


def models(motion, time, size):
    """Return F (M, 2D, 2D), Q and pi of a step, of all axes."""
    step = motion.step(np.array([time]))
    f, q = (np.moveaxis(part[..., 0], 2, 0) for part in step[:2])
    whole = ([np.kron(one, np.eye(size)) for one in part] for part in (f, q))
    return *(np.array(part) for part in whole), step.switching[..., 0]


def whole_state(beliefs):
    """Return weights (O, M), states (O, M, 2D), in the world, and covariances."""
    weight, state, covariance, origin = beliefs.values
    size, modes, count = state.shape[1:]
    place = state.transpose(3, 2, 0, 1).reshape(count, modes, 2 * size)
    place[..., :size] += origin.T[:, None]
    spread = covariance.transpose(5, 4, 0, 1, 2, 3).reshape(count, modes, 2 * size, 2 * size)
    return weight.T, place, spread


def filterpy_bank(motion, place, noise):
    """The same filters and their mixing in filterpy, started alike."""
    from filterpy.kalman import IMMEstimator, KalmanFilter

    size = len(noise)
    filters = []
    for _ in motion.usual:
        one = KalmanFilter(dim_x=2 * size, dim_z=size)
        one.H = np.eye(size, 2 * size)
        one.x = np.concatenate([place, np.zeros(size)])
        one.P = np.diag(np.r_[np.zeros(size), np.full(size, motion.start[0])])
        one.P[:size, :size] = noise
        filters.append(one)
    return IMMEstimator(filters, motion.usual, np.eye(len(filters)))


def filterpy_steps(bank, motion, lag, dt):
    """Let filterpy predict over a lag in steps of nearly dt; only the last one is measured."""
    steps = max(1, round(lag / dt))
    for left in reversed(range(steps)):
        size = bank.filters[0].dim_z
        transitions, processes, bank.M = models(motion, lag / steps, size)
        for one, transition, process in zip(bank.filters, transitions, processes, strict=True):
            one.F, one.Q = transition, process
        bank._compute_mixing_probabilities()
        bank.predict()
        if left:
            bank.mu = bank.cbar


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("irregular", [False, True])
def test_batched_bank_equals_filterpy(size, irregular):
    """On the grid, and at any times, each measurement with its own covariance."""
    tracks = replace(wandering(6, 12, size), noise=correlated(6, size))
    if irregular:
        tracks = irregular_tracks(6, size)
    predictor = InteractingModels(speed=1.2)
    weights, states, spreads = whole_state(predictor.filtered(tracks))
    measured, floor = tracks.measured, 0.01**2 * np.eye(size)
    for o in range(6):
        times, places = measured.times[o], measured.positions[o]
        noise = measured.noise[o] + floor
        reference = filterpy_bank(predictor._motion, places[0], noise[0])
        for k in range(1, len(times)):
            filterpy_steps(reference, predictor._motion, times[k] - times[k - 1], tracks.dt)
            for one in reference.filters:
                one.R = noise[k]
            reference.update(places[k])
        np.testing.assert_allclose(weights[o], reference.mu, rtol=0, atol=1e-11)
        for mode, one in enumerate(reference.filters):
            np.testing.assert_allclose(states[o, mode], one.x, rtol=0, atol=1e-11)
            np.testing.assert_allclose(spreads[o, mode], one.P, rtol=0, atol=1e-11)


@pytest.mark.parametrize("size", [2, 3])
def test_mixing_keeps_the_moments_of_each_model_and_of_all(size):
    """Mean and second moment of the mixture do not change; brute force over all pairs."""
    beliefs = InteractingModels().filtered(irregular_tracks(5, size))
    modes = ModeStates(*beliefs.values[:3])
    chain = np.random.default_rng(2).dirichlet(np.ones(3), (5, 3)).transpose(1, 2, 0)
    after = mixed(modes, chain)
    for o in range(5):
        for j in range(3):
            share = chain[:, j, o] * modes.weight[:, o]
            total = share.sum()
            mean = sum(share[i] * modes.state[:, :, i, o] for i in range(3)) / total
            assert after.weight[j, o] == pytest.approx(total, rel=1e-12)
            np.testing.assert_allclose(after.state[:, :, j, o], mean, atol=1e-13)
            spread = np.zeros((2, size, 2, size))
            for i in range(3):
                gap = modes.state[:, :, i, o] - mean
                own = modes.covariance[..., i, o] + np.multiply.outer(gap, gap)
                spread += share[i] * own / total
            np.testing.assert_allclose(after.covariance[..., j, o], spread, atol=1e-13)


@dataclass(frozen=True)
class Alike(Motion):
    """Three models that are the same, with a chain between them."""

    one: DriftingVelocity

    @property
    def start(self):
        return self.one.start

    @property
    def usual(self):
        return (0.5, 0.3, 0.2)

    def step(self, times):
        part = self.one.step(times)
        chain = np.array([[0.8, 0.1, 0.1], [0.2, 0.5, 0.3], [0.1, 0.0, 0.9]])
        repeated = (np.repeat(matrix, 3, axis=2) for matrix in part[:2])
        return ModeStep(*repeated, np.repeat(chain[..., None], len(times), axis=2))


def test_identical_models_are_one_kalman_filter_with_missing_samples():
    tracks = wandering(5, 14, 2)
    positions = np.array(tracks.positions)
    positions[0, 3:5], positions[1, 8], positions[2, -2:], positions[3, :6] = NAN, NAN, NAN, NAN
    one = DriftingVelocity(0.1, 1.2)
    for seen in (replace(tracks_of(positions), noise=correlated(5, 2)), irregular_tracks(5, 2)):
        single = filtered(seen, None, one, 0.01).values
        several = filtered(seen, None, Alike(one), 0.01).values
        for mode in range(3):
            np.testing.assert_allclose(several[1][:, :, mode], single[1][:, :, 0], atol=1e-12)
            spread = several[2][..., mode, :]
            np.testing.assert_allclose(spread, single[2][..., 0, :], atol=1e-12)


def test_without_a_measurement_only_the_chain_moves_on():
    """Who was not seen for 4 steps at the end is forecast as 4 steps ago, 4 steps further."""
    tracks = wandering(3, 10, 2)
    predictor = InteractingModels(stopping=0.3, dwell=2.0)
    gone = tracks_of(np.concatenate([tracks.positions, np.full((3, 4, 2), NAN)], axis=1))
    before, late = predictor.predict(tracks, 9), predictor.predict(gone, 5)
    np.testing.assert_allclose(late.mean, before.mean[:, :, 4:], atol=1e-12)
    np.testing.assert_allclose(late.covariance, before.covariance[:, :, 4:], atol=1e-12)
    assert late.joint is not None and before.joint is not None
    np.testing.assert_allclose(late.joint, before.joint[:, :, 8:, 8:], atol=1e-12)


@pytest.mark.parametrize(("dt", "stopping"), [(0.4, 0.1), (0.05, 0.3), (30.0, 1e-300)])
def test_the_models_start_as_likely_as_in_the_long_run(dt, stopping):
    """Flows balance: each moving model leaves for the stopping one at a share, which leaves."""
    predictor = InteractingModels(stopping=stopping)
    usual, chain = np.array(predictor._motion.usual), models(predictor._motion, dt, 2)[2]
    np.testing.assert_allclose(usual @ chain, usual, atol=1e-12)
    share = stopping / (1.0 + stopping)
    np.testing.assert_allclose(usual, [0.5 - share / 2, 0.5 - share / 2, share], atol=1e-12)
    weight = predictor.filtered(tracks_of(np.ones((1, 1, 2)))).values[0][:, 0]
    np.testing.assert_array_equal(weight, usual)
    assert (weight > 0.0).all()


def test_who_was_seen_twice_is_expected_to_walk_on():
    """Two samples at 1.3 m/s: of 6.2 m in 4.8 s, stopping takes its share and no third."""
    path = 1.3 * DT * np.arange(2.0)[:, None] * np.array([1.0, 0.0])
    forecast = InteractingModels().predict(tracks_of([path]), 12)
    gone = forecast.mean[0, 0, -1, 0] - path[-1, 0]
    assert 0.8 * 6.24 < gone < 6.24
    assert np.sqrt(np.trace(forecast.covariance[0, 0, -1]) / 2) < 1.8


def enumerated(start, motion, dt, steps):
    """Mean and joint covariance over all sequences of models, one after the other.

    ``start`` has weights (M,), states (M, 2D) and covariances of one obstacle.
    """
    weights, states, spreads = start
    size = states.shape[1] // 2
    transitions, processes, chain = models(motion, dt, size)
    total, mean = 0.0, np.zeros(steps * size)
    second = np.zeros((steps * size, steps * size))
    for modes in product(range(len(chain)), repeat=steps + 1):
        chance = weights[modes[0]]
        for before, after in pairwise(modes):
            chance *= chain[before, after]
        # All steps as one linear map of the start and the noises.
        columns = [np.eye(2 * size)]
        noises = [spreads[modes[0]]]
        rows = []
        for mode in modes[1:]:
            columns = [transitions[mode] @ column for column in columns] + [np.eye(2 * size)]
            noises.append(processes[mode])
            rows.append([*columns])
        own_mean, own = [], np.zeros((steps * size, steps * size))
        for h, row in enumerate(rows):
            own_mean.append((row[0] @ states[modes[0]])[:size])
            for i, other in enumerate(rows):
                block = sum(a @ q @ b.T for a, b, q in zip(row, other, noises, strict=False))
                own[h * size : (h + 1) * size, i * size : (i + 1) * size] = block[:size, :size]
        flat = np.concatenate(own_mean)
        total += chance
        mean += chance * flat
        second += chance * (own + np.outer(flat, flat))
    assert total == pytest.approx(1.0)
    return mean, second - np.outer(mean, mean)


@pytest.mark.parametrize("size", [2, 3])
def test_the_merged_forecast_is_exact_for_the_switching_system(size):
    predictor = InteractingModels(dwell=1.0, stopping=0.3)
    tracks = wandering(1, 6, size, seed=4)
    weight, state, spread = whole_state(predictor.filtered(tracks))
    forecast = predictor.predict(tracks, 4)
    origin = tracks.positions[0, 0]
    state[..., :size] -= origin
    mean, joint = enumerated((weight[0], state[0], spread[0]), predictor._motion, DT, 4)
    np.testing.assert_allclose((forecast.mean[0, 0] - origin).ravel(), mean, atol=1e-12)
    np.testing.assert_allclose(forecast.joint[0, 0], joint, atol=1e-12)
    diagonal = forecast.joint[0, 0].reshape(4, size, 4, size)[np.arange(4), :, np.arange(4)]
    np.testing.assert_allclose(diagonal, forecast.covariance[0, 0], atol=1e-12)


def test_readings_are_the_moments_over_all_sequences_of_models():
    """E[a], its covariance and the variance of the noise, from each model that is in force."""
    motion, steps = InteractingModels(dwell=1.0, stopping=0.3)._motion, 5
    step = motion.step(np.array([DT]))
    f, q, chain = step.transition[..., 0], step.process[..., 0], step.switching[..., 0]
    reads = readings(motion, DT, steps)
    for first in range(3):
        for h in range(1, steps + 1):
            chances, rows, noises = [], [], []
            for modes in product(range(3), repeat=h):
                pairs = pairwise((first, *modes))
                chances.append(np.prod([chain[i, j] for i, j in pairs]))
                row, noise = np.array([1.0, 0.0]), 0.0
                for mode in reversed(modes):
                    noise += row @ q[..., mode] @ row
                    row = row @ f[..., mode]
                rows.append(row)
                noises.append(noise)
            mean = np.average(rows, axis=0, weights=chances)
            gap = np.array(rows) - mean
            spread = np.einsum("k,ka,kb->ab", chances, gap, gap)
            np.testing.assert_allclose(reads.mean[h - 1, first], mean, atol=1e-13)
            np.testing.assert_allclose(reads.spread[h - 1, first], spread, atol=1e-14)
            wanted = np.dot(chances, noises)
            np.testing.assert_allclose(reads.noise[h - 1, first], wanted, rtol=1e-12)


def test_the_closed_form_over_the_horizon_is_that_of_the_steps():
    """`moments_ahead` against `moved`, step by step."""
    predictor = InteractingModels(dwell=1.5, stopping=0.4)
    modes = ModeStates(*predictor.filtered(irregular_tracks(6, 3, latest=1.0)).values[:3])
    middle, spread = moments_ahead(modes, readings(predictor._motion, DT, 8))
    step = predictor._motion.step(np.array([DT]))
    for h in range(8):
        modes = moved(modes, step)
        mean = (modes.weight * modes.state[0]).sum(axis=1)
        gap = modes.state[0] - mean[:, None]
        own = modes.covariance[0, :, 0]
        wanted = (modes.weight * (own + gap[:, None] * gap[None])).sum(axis=2)
        np.testing.assert_allclose(middle[h], mean, rtol=1e-11, atol=1e-13)
        np.testing.assert_allclose(spread[h], wanted, rtol=1e-11, atol=1e-13)


def test_the_forecast_is_that_of_drawn_futures():
    """Monte Carlo of the chain and of each step's noise, within four standard errors."""
    predictor = InteractingModels(dwell=1.0, stopping=0.4, manoeuvring=0.5)
    tracks = irregular_tracks(1, 2, seed=5)
    weight, state, spread = (part[0] for part in whole_state(predictor.filtered(tracks)))
    transitions, processes, chain = models(predictor._motion, tracks.dt, 2)
    rng, count, steps = np.random.default_rng(1), 200_000, 6
    mode = rng.choice(3, count, p=weight)
    drawn = np.empty((count, 4))
    for m in range(3):
        here = mode == m
        drawn[here] = rng.multivariate_normal(state[m], spread[m], int(here.sum()))
    forecast = predictor.predict(tracks, steps)
    for h in range(steps):
        below = np.cumsum(chain[mode], axis=1)
        mode = np.minimum((rng.random(count)[:, None] > below).sum(axis=1), 2)
        for m in range(3):
            here = mode == m
            noise = rng.multivariate_normal(np.zeros(4), processes[m], int(here.sum()))
            drawn[here] = drawn[here] @ transitions[m].T + noise
        place = drawn[:, :2]
        error = place.std(axis=0) / np.sqrt(count)
        assert (np.abs(place.mean(axis=0) - forecast.mean[0, 0, h]) < 4 * error).all()
        square = (place - place.mean(axis=0))[:, :, None] * (place - place.mean(axis=0))[:, None]
        error = square.std(axis=0) / np.sqrt(count)
        gap = np.abs(square.mean(axis=0) - forecast.covariance[0, 0, h])
        assert (gap < 4 * error).all()


def test_who_was_seen_earlier_is_forecast_from_there():
    """A lag of two steps drops them, from the joint covariance too; half a step is a step."""
    tracks = wandering(2, 8, 2)
    predictor = InteractingModels()
    positions = np.concatenate([tracks.positions, np.full((2, 2, 2), NAN)], axis=1)
    positions[0] = np.concatenate([np.full((2, 2), NAN), tracks.positions[0]])
    whole, cut = predictor.predict(tracks, 5), predictor.predict(tracks_of(positions), 3)
    for row, steps in ((0, slice(0, 3)), (1, slice(2, 5))):
        np.testing.assert_allclose(cut.mean[row], whole.mean[row, :, steps], atol=1e-13)
        np.testing.assert_allclose(cut.covariance[row], whole.covariance[row, :, steps])
        both = slice(2 * steps.start, 2 * steps.stop)
        np.testing.assert_allclose(cut.joint[row], whole.joint[row, :, both, both], atol=1e-14)
    grid = replace(tracks, sightings=None)
    lag = replace(grid, stamp=0.2, sightings=grid.measured)
    weight, state, spread = (part[0] for part in whole_state(predictor.filtered(lag)))
    transitions, processes, chain = models(predictor._motion, 0.2, 2)
    share = weight[:, None] * chain
    weight = share.sum(axis=0)
    before = np.einsum("ij,is->js", share, state) / weight[:, None]
    gap = state[:, None] - before
    square = spread[:, None] + gap[..., :, None] * gap[..., None, :]
    spread = np.einsum("ij,ijst->jst", share, square) / weight[:, None, None]
    state = np.einsum("jst,jt->js", transitions, before)
    spread = transitions @ spread @ transitions.swapaxes(1, 2) + processes
    mean, joint = enumerated((weight, state, spread), predictor._motion, DT, 3)
    forecast = predictor.predict(lag, 3)
    np.testing.assert_allclose(forecast.mean[0, 0].ravel(), mean, atol=1e-11)
    np.testing.assert_allclose(forecast.joint[0, 0], joint, atol=1e-10)


def test_kept_modes_keep_their_models():
    tracks = wandering(4, 9, 2)
    predictor = InteractingModels(modes="kept")
    forecast = predictor.predict(tracks, 5)
    weight, _, spread = whole_state(predictor.filtered(tracks))
    np.testing.assert_allclose(forecast.weight, weight)
    transitions, processes, _ = models(predictor._motion, DT, 2)
    for mode in range(3):
        model = transitions[mode], processes[mode]
        alone = [
            joint_covariance(*model, own, 2, 5).reshape(5, 2, 5, 2) for own in spread[:, mode]
        ]
        wanted = np.stack([joint[np.arange(5), :, np.arange(5)] for joint in alone])
        np.testing.assert_allclose(forecast.covariance[:, mode], wanted, atol=1e-13)
        blocks = forecast.joint[:, mode].reshape(4, 5, 2, 5, 2)[:, np.arange(5), :, np.arange(5)]
        np.testing.assert_allclose(blocks.swapaxes(0, 1), wanted, atol=1e-12)
    unseen = predictor.predict(tracks_of(np.full((1, 4, 2), NAN)), 3)
    assert unseen.fallback == ("imm: never observed",)


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
        count: predictor.filtered(seen).values[0][stopping, 0] for count, seen in tracks.items()
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
    bank = models(own._motion, tracks.dt, 2)
    assert tracks.velocity is not None and tracks.state_covariance is not None
    np.testing.assert_allclose(found.weight[0], own._motion.usual)
    for mode, (transition, process) in enumerate(zip(*bank[:2], strict=True)):
        state = np.array([1.0, 2.0, *tracks.velocity[0]])
        spread = tracks.state_covariance[0]
        for h in range(steps):
            state, spread = transition @ state, transition @ spread @ transition.T + process
            np.testing.assert_allclose(found.mean[0, mode, h], state[:2])
            np.testing.assert_allclose(found.covariance[0, mode, h], spread[:2, :2])
    np.testing.assert_array_equal(found.mean[1], without.mean[1])
    np.testing.assert_array_equal(found.covariance[1], without.covariance[1])
