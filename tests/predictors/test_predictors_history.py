"""Histories of all obstacles at once, against one obstacle done by hand."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.propagation import joint_covariance, white_acceleration
from wideberth.predictors.core.velocity_forecast import past_velocities

NAN = np.nan


def tracks_of(positions, dt=0.5):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    noise = np.tile(1e-4 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, tuple(map(str, range(count))), np.full(count, 0.3), noise)


def line(samples, velocity=(0.5, -0.2), offset=(3.0, 1.0)):
    return np.asarray(offset) + 0.5 * np.arange(samples)[:, None] * np.asarray(velocity)


def by_hand(track, length, longest_gap):
    """Origin, positions, observed, late of one track, sample by sample."""
    seen = [i for i in range(len(track)) if np.isfinite(track[i]).all()]
    if not seen:
        return np.zeros(track.shape[1]), np.zeros((0, track.shape[1])), np.zeros(0, bool), 0
    kept = [seen[-1]]
    for i in reversed(seen[:-1]):
        if kept[0] - i - 1 > longest_gap:
            break
        kept.insert(0, i)
    if length is not None:
        kept = [i for i in kept if i > seen[-1] - length]
    rows = np.arange(kept[0], kept[-1] + 1)
    origin = track[seen[-1]]
    columns = [np.interp(rows, kept, track[kept, d] - origin[d]) for d in range(track.shape[1])]
    return origin, np.stack(columns, axis=1), np.isin(rows, kept), len(track) - 1 - seen[-1]


@pytest.mark.parametrize("length", [None, 1, 5, 40])
@pytest.mark.parametrize("longest_gap", [0, 2, 5])
def test_all_at_once_is_each_by_hand(length, longest_gap):
    rng = np.random.default_rng(3)
    positions = rng.normal(size=(60, 25, 2)).cumsum(axis=1)
    positions[rng.random((60, 25)) < rng.random((60, 1))] = NAN
    positions[7] = NAN
    past = gather(tracks_of(positions), length=length, longest_gap=longest_gap)
    for i, track in enumerate(positions):
        origin, path, observed, late = by_hand(track, length, longest_gap)
        began = past.began[i]
        np.testing.assert_array_equal(past.origin[i], origin)
        np.testing.assert_allclose(past.positions[i, began:], path, atol=1e-12)
        np.testing.assert_array_equal(past.observed[i, began:], observed)
        assert not past.observed[i, :began].any()
        assert (past.late[i], past.length[i], past.samples[i]) == (late, len(path), observed.sum())
        if len(path):  # before the history stands its first position
            assert (past.positions[i, :began] == past.positions[i, began]).all()


def test_gaps_are_filled_and_late_steps_counted():
    path = line(12)
    path[3], path[10:, 1] = NAN, NAN
    past = gather(tracks_of([path]))
    filled = past.positions[0, past.began[0] :] + past.origin[0]
    np.testing.assert_allclose(filled, line(10), atol=1e-12)
    assert (past.late[0], past.samples[0], past.length[0]) == (2, 9, 10)


def test_no_obstacles_and_no_rows():
    assert gather(tracks_of(np.zeros((0, 4, 2)))).positions.shape == (0, 4, 2)
    past = gather(tracks_of(np.zeros((3, 0, 2))))
    assert past.positions.shape == (3, 1, 2) and (past.samples == 0).all()


def test_constant_velocity_starts_from_the_trackers_covariance():
    rng = np.random.default_rng(5)
    tracks = tracks_of([line(9)])
    root = 0.1 * rng.normal(size=(1, 4, 4))
    tracked = replace(tracks, state_covariance=root @ root.swapaxes(1, 2))
    model = white_acceleration(0.5, 0.3, 2)
    predictor = ConstantVelocity(window=2, acceleration_density=0.3)
    forecast = predictor.predict(tracked, 4)
    drift = np.kron(np.diag([0.0, 0.3 * 1.0 / 3]), np.eye(2))  # q T / 3 over two steps
    start = tracked.state_covariance[0] + drift
    np.testing.assert_allclose(forecast.joint[0, 0], joint_covariance(*model, start, 2, 4))
    np.testing.assert_array_equal(forecast.mean, predictor.predict(tracks, 4).mean)


def test_velocities_come_newest_first_and_are_zero_where_there_are_fewer():
    past = gather(tracks_of([[[0.0, 1.0], [0.5, 1.0], [2.0, 0.0]]]))
    every, newest = past_velocities(past, 0.5, 4)
    np.testing.assert_allclose(every, [[[1.0, 0.0], [3.0, -2.0]]])
    np.testing.assert_allclose(newest, [[[3.0, -2.0], [1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]])
