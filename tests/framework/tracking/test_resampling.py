"""Irregular times: straight lines onto the grid, never across long gaps, as `History` does."""

import numpy as np
import pytest

from wideberth.framework.plugins.registry import load, names
from wideberth.framework.tracking.history import History
from wideberth.framework.tracking.resampling import interpolated
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection
from wideberth.predictors.data.resampled import resampled_tracks

NAN = np.nan


def irregular(seed: int = 0, rows: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    times = 5.0 + np.cumsum(rng.uniform(0.05, 0.6, rows))
    return times, np.cumsum(rng.normal(size=(rows, 2)), axis=0)


def test_it_is_linear_interpolation() -> None:
    times, positions = irregular()
    tracks = resampled_tracks({"a": (times, positions)}, 0.25, bridge=10.0)
    grid = tracks.stamp - 0.25 * np.arange(tracks.positions.shape[1])[::-1]
    wanted = np.stack([np.interp(grid, times, column) for column in positions.T], axis=1)
    assert tracks.stamp == times[-1] and times[0] <= grid[0] < times[0] + 0.25
    assert np.allclose(tracks.positions[0], wanted, rtol=0, atol=1e-12)


def test_samples_on_the_grid_stay_as_they_are() -> None:
    """Also late on a clock that counts from 1970, where a step of 0.1 s has lost nine digits."""
    times = 1.7e9 + 0.1 * np.arange(50)
    positions = np.random.default_rng(1).normal(size=(50, 3))
    tracks = resampled_tracks({"a": (times, positions)}, 0.1, bridge=0.0)
    assert tracks.positions.shape == (1, 50, 3)
    assert np.abs(tracks.positions[0] - positions).max() < 1e-4
    assert np.isfinite(tracks.positions).all()


def test_times_inside_long_gaps_and_outside_are_unobserved() -> None:
    """Brute force: a grid time is known between samples at most `bridge` apart, or next to one."""
    bridge = 0.4
    measurements = {"early": irregular(2, 20), "late": irregular(3, 70)}
    tracks = resampled_tracks(measurements, 0.25, bridge=bridge, noise=0.02, radius=0.4)
    rows = tracks.positions.shape[1]
    for (times, _), got in zip(measurements.values(), tracks.positions, strict=True):
        for row in range(rows):
            at = tracks.stamp - 0.25 * (rows - 1 - row)
            before, after = times[times <= at + 1e-9], times[times >= at - 1e-9]
            known = bool(len(before) and len(after) and after[0] - before[-1] <= bridge + 1e-9)
            known |= bool(np.abs(times - at).min() <= 0.125)
            assert np.isfinite(got[row]).all() == known
    assert np.isnan(tracks.positions[0, -1]).all(), "it ended before the other"
    assert 0.2 < np.isfinite(tracks.positions).mean() < 0.95
    assert tracks.ids == ("early", "late") and (tracks.radius == 0.4).all()
    assert np.allclose(tracks.noise, 0.02**2 * np.eye(2))


def test_the_length_can_be_stated() -> None:
    times, positions = irregular()
    short = resampled_tracks({"a": (times, positions)}, 0.5, length=4)
    long = resampled_tracks({"a": (times, positions)}, 0.5, length=1000)
    assert short.positions.shape == (1, 4, 2)
    assert np.array_equal(long.positions[0, -4:], short.positions[0], equal_nan=True)
    assert np.isnan(long.positions[0, 0]).all()


@pytest.mark.parametrize("seed", range(30))
def test_a_sighting_beside_the_grid_is_carried_along_the_motion(seed: int) -> None:
    """Of a straight motion: exact where two sightings half a step apart show it, else bounded."""
    rng = np.random.default_rng(seed)
    dt, velocity = 0.4, np.array([1.2, -0.5])
    begin, length = rng.uniform(2.0, 6.0), rng.choice([0.0, 0.1, 0.25, 0.5, 1.3])
    times = np.unique(begin + length * rng.random(rng.integers(1, 8)))
    tracks = resampled_tracks(
        {"far": ([0.0, 8.0], np.zeros((2, 2))), "brief": (times, times[:, None] * velocity)},
        dt, bridge=1.0, noise=0.01,
    )  # fmt: skip
    grid = 8.0 - dt * np.arange(20.0, -1.0, -1.0)
    got, seen = tracks.positions[1], np.isfinite(tracks.positions[1, :, 0])
    near = np.abs(grid[:, None] - times).min(axis=1) <= 0.5 * dt
    inside = (grid >= times[0]) & (grid <= times[-1])
    np.testing.assert_array_equal(seen, near | inside)
    assert seen.any()
    off = np.abs(got[seen] - grid[seen, None] * velocity).max(axis=1)
    if times[-1] - times[0] >= dt:
        assert off.max() < 1e-9
    assert off.max() <= 0.5 * dt * 1.2 + 1e-9
    lag = np.sqrt(np.diagonal(tracks.noise[1] - 0.01**2 * np.eye(2)).clip(0.0))
    newest = np.flatnonzero(seen)[-1]
    exact = np.abs(got[newest] - grid[newest] * velocity).max() < 1e-9
    wanted = 0.0 if exact else np.abs(grid[newest] - times).min()
    np.testing.assert_allclose(lag, [wanted, wanted], atol=1e-7)


def test_it_agrees_with_what_a_controller_remembers() -> None:
    times, positions = irregular(4, 40)
    history = History(dt=0.5, samples=12, forget=100.0, gap=0.5)
    for time, place in zip(times, positions, strict=True):
        history = history.add(float(time), (Detection("a", place, 0.01 * np.eye(2), 0.3, 0.0),))
    wanted = history.tracks()
    assert wanted is not None
    got = resampled_tracks({"a": (times, positions)}, 0.5, bridge=0.5, length=12)
    assert np.allclose(got.positions, wanted.positions, rtol=0, atol=1e-12, equal_nan=True)
    assert np.isnan(got.positions).any() and np.isfinite(got.positions).any()


def test_one_measurement_is_enough() -> None:
    tracks = resampled_tracks({"a": ([3.0], [[1.0, 2.0]])}, 0.1)
    assert tracks.positions.tolist() == [[[1.0, 2.0]]] and tracks.stamp == 3.0
    grid = np.array([0.0, 0.1])
    assert np.isnan(interpolated([np.array([3.0])], [np.ones((1, 2))], grid, 1.0, 0.0)).all()


@pytest.mark.parametrize("name", [name for name in names("predictors") if name != "game"])
def test_predictors_take_what_comes_out(name: str) -> None:
    measurements = {"early": irregular(2, 20), "late": irregular(3, 70), "one": irregular(5, 1)}
    tracks = resampled_tracks(measurements, 0.4, bridge=0.5)
    forecast = load("predictors", name)().predict(tracks, 5)
    assert np.isfinite(forecast.mean).all() and np.isfinite(forecast.covariance).all()


@pytest.mark.parametrize(
    ("measurements", "dt", "words"),
    [
        ({}, 0.4, "measurements is empty"),
        ({"a": ([], np.zeros((0, 2)))}, 0.4, r"measurements\['a'\] times must hold one"),
        ({"a": ([1.0, 1.0], np.zeros((2, 2)))}, 0.4, "increase strictly"),
        ({"a": ([1.0, NAN], np.zeros((2, 2)))}, 0.4, "times.* is nan"),
        ({"a": ([1.0], [[NAN, 0.0]])}, 0.4, "positions.* is nan"),
        ({"a": ([1.0], np.zeros((2, 2)))}, 0.4, r"positions has shape \(2, 2\)"),
        ({"a": ([1.0], [[0, 0]]), "b": ([1.0], [[0, 0, 0]])}, 0.4, r"\['b'\] positions"),
        ({"a": ([0.0, 1e9], np.zeros((2, 2)))}, 0.4, "state a larger dt or a length"),
        ({"a": ([1.0], [[0, 0]])}, 0.0, "dt is 0"),
    ],
)
def test_refusals(measurements, dt: float, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(WideberthError, match=words):
        resampled_tracks(measurements, dt)


def test_obstacles_that_share_their_times_are_laid_like_others() -> None:
    """Those that are reported together share one array of times, which is looked up once."""
    rng, noise = np.random.default_rng(4), 1e-4 * np.eye(2)
    history = History(dt=0.5, samples=12, forget=100.0, gap=0.8)
    for tick in range(9):
        names = ("a", "b") if tick < 3 else ("a", "b", "c")
        seen = [Detection(name, rng.uniform(size=2), noise, 0.3) for name in names]
        history = history.add(0.4 * tick, tuple(seen))
    logs = history.logs
    assert logs["a"].times is logs["b"].times and len(logs["c"].times) == 6
    times = [logs[name].times for name in "abc"]
    places = [logs[name].positions for name in "abc"]
    grid = 3.2 - 0.5 * np.arange(11.0, -1.0, -1.0)
    shared = interpolated(times, places, grid, 0.8, 1e-7)
    apart = interpolated([own.copy() for own in times], places, grid, 0.8, 1e-7)
    alone = [
        interpolated([t.copy()], [p], grid, 0.8, 1e-7)[0]
        for t, p in zip(times, places, strict=True)
    ]
    np.testing.assert_array_equal(shared, apart)
    np.testing.assert_array_equal(shared, np.array(alone))
    tracks = history.tracks()
    assert tracks is not None
    np.testing.assert_array_equal(tracks.positions, shared)
