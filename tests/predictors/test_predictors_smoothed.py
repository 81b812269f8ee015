"""The smoothing wrapper: against filterpy, against dense algebra, and what it is good for."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.smoothed import (
    FEWEST,
    Smoothed,
    acceleration_increment,
    noise_variance,
    smoothed,
)
from wideberth.predictors.static import Static
from wideberth.predictors.var import VectorAutoregression

DT = 0.5
NAN = np.nan


def tracks_of(positions: Array, noise: Array | float = 0.02, dt: float = DT) -> Tracks:
    count, _, size = positions.shape
    spread = noise if isinstance(noise, np.ndarray) else noise**2 * np.eye(size)
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), np.tile(spread, (count, 1, 1)))


def drive(count: int, rows: int, density: float, rng: np.random.Generator, size: int = 2) -> Array:
    """White acceleration, exactly sampled: positions and velocities, (O, T, 2D)."""
    transition, process = white_acceleration(DT, density, size)
    root = np.linalg.cholesky(process)
    states = np.zeros((count, rows, 2 * size))
    states[:, 0, size:] = 0.5 * rng.standard_normal((count, size))
    for k in range(1, rows):
        push = rng.standard_normal((count, 2 * size)) @ root.T
        states[:, k] = states[:, k - 1] @ transition.T + push
    return states


@dataclass(frozen=True)
class Seen(Predictor):
    """Keeps what it was handed."""

    handed: list[Tracks]

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        self.handed.append(tracks)
        return Static().predict(tracks, steps, scene)


def handed(tracks: Tracks, **settings: Any) -> Tracks:
    seen: list[Tracks] = []
    Smoothed(Seen(seen), **settings).predict(tracks, 2)
    return seen[0]


def test_it_is_the_smoother_of_filterpy() -> None:
    """With full noise matrices and samples missing in the middle and at the end."""
    from filterpy.kalman import KalmanFilter

    rng = np.random.default_rng(1)
    noise = np.array([[4e-4, 1e-4], [1e-4, 2e-4]])
    positions = drive(3, 25, 0.02, rng)[..., :2] + rng.multivariate_normal([0, 0], noise, (3, 25))
    positions[1, [4, 5, 9]] = NAN
    positions[2, -2:] = NAN
    positions[2, :6] = NAN
    past = gather(tracks_of(positions))
    q = np.array([0.01, 0.02, 0.05])
    smooth, newest = smoothed(past, np.tile(noise, (3, 1, 1)), q * DT**3, 1.5 * DT)
    for place in range(3):
        first = int(past.began[place])
        history = past.positions[place, first:]
        engine = KalmanFilter(dim_x=4, dim_z=2)
        engine.F, engine.Q = white_acceleration(DT, float(q[place]), 2)
        engine.H, engine.R = np.eye(2, 4), noise
        engine.x = np.concatenate([history[0], np.zeros(2)])
        engine.P = np.block([[noise, np.zeros((2, 2))], [np.zeros((2, 2)), 1.5**2 * np.eye(2)]])
        seen = past.observed[place, first:]
        means, covariances = [engine.x], [engine.P]
        for row, known in zip(history[1:], seen[1:], strict=True):
            engine.predict()
            engine.update(row if known else None)
            means.append(engine.x)
            covariances.append(engine.P)
        wanted = engine.rts_smoother(np.array(means), np.array(covariances))
        assert np.allclose(smooth[place, first:], wanted[0][:, :2], rtol=0, atol=1e-12)
        per_second = np.diag([1.0, 1.0, 1 / DT, 1 / DT])
        got = per_second @ newest[place] @ per_second
        assert np.allclose(got, wanted[1][-1], rtol=1e-10, atol=1e-14)


def test_it_is_the_mean_of_a_joint_gaussian() -> None:
    """The same by dense algebra: the posterior of all positions at once, in 3-D."""
    rng = np.random.default_rng(2)
    rows, density, noise = 12, 0.03, 0.02
    positions = drive(1, rows, density, rng, 3)[..., :3] + noise * rng.standard_normal(
        (1, rows, 3)
    )
    transition, process = white_acceleration(1.0, density * DT**3, 1)
    start = np.diag([noise**2, DT**2])
    covariance = np.zeros((rows - 1, rows - 1))
    spreads = [start]
    for _ in range(rows - 1):
        spreads.append(transition @ spreads[-1] @ transition.T + process)
    for i in range(1, rows):
        for j in range(i, rows):
            cross = np.linalg.matrix_power(transition, j - i) @ spreads[i]
            covariance[i - 1, j - 1] = covariance[j - 1, i - 1] = cross[0, 0]
    past = gather(tracks_of(positions))
    first, later = past.positions[0, 0], past.positions[0, 1:]
    gain = covariance @ np.linalg.inv(covariance + noise**2 * np.eye(rows - 1))
    wanted = first + gain @ (later - first)
    eye = noise**2 * np.eye(3)[None]
    smooth, _ = smoothed(past, eye, np.array([density * DT**3]), DT)
    assert np.allclose(smooth[0, 1:], wanted, atol=1e-12)


@pytest.mark.parametrize(("density", "noise"), [(1e-4, 0.02), (0.02, 0.01), (0.05, 0.05)])
def test_both_estimators_are_unbiased_on_their_model(density: float, noise: float) -> None:
    """From histories so long that no estimate is cut at 0, with samples missing."""
    rng = np.random.default_rng(3)
    count, rows = 60, 1500
    positions = drive(count, rows, density, rng)[..., :2]
    positions = positions + noise * rng.standard_normal(positions.shape)
    positions[:, ::50] = NAN
    past = gather(tracks_of(positions))
    for got, wanted in (
        (noise_variance(past), noise**2),
        (acceleration_increment(past), density * DT**3),
    ):
        assert got.min() > 0
        assert abs(got.mean() - wanted) < 4 * got.std() / np.sqrt(count)


@pytest.mark.parametrize("size", [2, 3])
def test_the_deviation_of_the_estimate_is_as_stated(size: int) -> None:
    rng = np.random.default_rng(4)
    past = gather(tracks_of(0.03 * rng.standard_normal((3000, 20, size))))
    ratio = noise_variance(past).std() / 0.03**2
    assert abs(ratio - 0.41 * np.sqrt(2 / size)) < 0.03


def test_nothing_is_estimated_from_too_little() -> None:
    positions = np.random.default_rng(5).standard_normal((4, 30, 2))
    positions[0, : -FEWEST - 2] = NAN
    positions[1, : -FEWEST - 3] = NAN
    positions[2, ::3] = NAN
    tracks = tracks_of(positions)
    got = noise_variance(gather(tracks))
    assert np.isnan(got).tolist() == [True, False, True, False]
    asked, given = handed(tracks), handed(tracks, noise="given")
    for index, unknown in enumerate(np.isnan(got)):
        first, second = asked.positions[index], given.positions[index]
        assert np.array_equal(first, second, equal_nan=True) == unknown


def test_gaps_stay_gaps_and_the_rest_is_handed_on() -> None:
    rng = np.random.default_rng(6)
    positions = drive(3, 30, 0.02, rng)[..., :2] + 0.02 * rng.standard_normal((3, 30, 2)) + 1e3
    positions[0, [3, 4, 20]] = NAN
    positions[1, -3:] = NAN
    positions[1, 12, 0] = NAN
    positions[2, 4:20] = NAN
    tracks = tracks_of(positions)
    got = handed(tracks, noise="given")
    seen = np.isfinite(positions).all(axis=2)
    assert np.array_equal(np.isfinite(got.positions).all(axis=2), seen)
    assert (got.ids, got.dt, got.stamp) == (tracks.ids, tracks.dt, tracks.stamp)
    moved = np.abs(got.positions - positions)[seen].max()
    assert 0.005 < moved < 0.1
    assert np.array_equal(got.positions[2, :4], positions[2, :4]), "before a long gap"
    assert got.state_covariance is not None
    assert np.array_equal(got.noise, got.state_covariance[:, :2, :2])
    largest = np.linalg.eigvalsh(got.noise).max()
    assert largest < 0.02**2 + 0.001**2


def test_the_covariance_it_hands_on_is_true() -> None:
    """Normalised squared error of the newest position: 2 on average, as chi-square."""
    rng = np.random.default_rng(7)
    count, noise, density = 2000, 0.03, 0.02
    states = drive(count, 40, density, rng)
    tracks = tracks_of(states[..., :2] + noise * rng.standard_normal((count, 40, 2)), noise)
    past = gather(tracks)
    spread = np.tile(noise**2 * np.eye(2), (count, 1, 1))
    smooth, newest = smoothed(past, spread, np.full(count, density * DT**3), 0.5 * DT)
    error = past.origin + smooth[:, -1] - states[:, -1, :2]
    score = np.einsum("oi,oij,oj->o", error, np.linalg.inv(newest[:, :2, :2]), error)
    assert abs(score.mean() - 2) < 4 * np.sqrt(4 / count)


def final_error(predictor: Predictor, path: Array, noise: float, seed: int = 8) -> float:
    rng = np.random.default_rng(seed)
    seen = path[:, :40] + noise * rng.standard_normal((len(path), 40, 2))
    mean = predictor.predict(tracks_of(seen, noise), 10).mean[:, 0]
    errors = np.linalg.norm(mean - path[:, 40:50], axis=2).mean(axis=1)
    return float(np.mean(np.minimum(errors, 5.0)))


@pytest.mark.parametrize("noise", [0.01, 0.03])
@pytest.mark.parametrize("way", ["given", "estimated"])
def test_errors_of_differencing_predictors_fall(noise: float, way: Any) -> None:
    path = drive(200, 50, 1e-3, np.random.default_rng(9))[..., :2]
    for base in (ConstantVelocity(window=1), VectorAutoregression()):
        plain = final_error(base, path, noise)
        better = final_error(Smoothed(base, noise=way), path, noise)
        assert better < (0.75 if noise > 0.02 else 0.97) * plain, (base, plain, better)


def test_a_trackers_state_is_not_filtered_twice() -> None:
    rng = np.random.default_rng(10)
    tracks = replace(
        tracks_of(rng.standard_normal((2, 12, 2))),
        state_covariance=np.tile(np.eye(4), (2, 1, 1)),
    )
    assert handed(tracks) is tracks


@pytest.mark.parametrize("way", ["given", "estimated"])
def test_laws(way: Any) -> None:
    check_predictor(Smoothed(ConstantVelocity(), noise=way))
    made = Smoothed(Static(), noise=way, speed=2.0)
    assert build("predictors", describe(made)) == made


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"noise": "guess"}, "smoothed.noise is 'guess'"), ({"speed": 0.0}, "smoothed.speed is 0")],
)
def test_bad_settings(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Smoothed(**settings)
