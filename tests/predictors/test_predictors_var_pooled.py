"""The pooled vector autoregression: learnt from many tracks, exact where it is true."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.pooled_var import IsotropicProcess, PooledVectorAutoregression

DT = 0.5
TRUTH = IsotropicProcess((0.7, 0.25), 0.01, DT)


def tracks_of(positions, dt=DT, noise=0.0):
    count, _, size = positions.shape
    ids = tuple(f"o{i}" for i in range(count))
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, ids, np.full(count, 0.3), spread)


def walks(law, runs, samples, rng, size=2):
    """Positions of bodies that follow the law, (runs, T, D)."""
    order = len(law.coefficients)
    velocity = np.zeros((runs, samples + 100, size))
    for k in range(order, samples + 100):
        push = np.sqrt(law.innovation) * rng.standard_normal((runs, size))
        velocity[:, k] = push + sum(
            a * velocity[:, k - 1 - j] for j, a in enumerate(law.coefficients)
        )
    return law.dt * np.cumsum(velocity[:, 100:], axis=1)


def test_fit_equals_a_regression_of_every_stretch_of_every_track():
    rng = np.random.default_rng(0)
    paths = walks(TRUTH, 8, 30, rng)
    paths[0, :20], paths[1, 7], paths[2, -3:] = np.nan, np.nan, np.nan
    scenes = [tracks_of(paths[:5]), tracks_of(paths[5:, :25])]
    rows, targets = [], []
    for scene in scenes:
        for path in scene.positions:
            for k in range(3, len(path)):
                piece = np.diff(path[k - 3 : k + 1], axis=0) / DT
                if np.isfinite(piece).all():
                    rows.extend(piece[[1, 0]].T)
                    targets.extend(piece[2])
    solution, squares = np.linalg.lstsq(np.array(rows), np.array(targets), rcond=None)[:2]
    fitted = PooledVectorAutoregression().fit(scenes).fitted
    assert fitted is not None and fitted.dt == DT
    np.testing.assert_allclose(fitted.coefficients, solution, rtol=1e-10)
    assert fitted.innovation == pytest.approx(float(squares[0]) / (len(rows) - 2), rel=1e-10)


def test_fit_finds_the_truth_within_its_standard_error():
    paths = walks(TRUTH, 200, 40, np.random.default_rng(1))
    fitted = PooledVectorAutoregression().fit([tracks_of(paths)]).fitted
    # Stationary moments of the VAR(2) give the covariance of the estimate: s^2 Gamma^-1 / rows.
    first, second = TRUTH.coefficients
    share = first / (1 - second)
    variance = TRUTH.innovation / (1 - first * share - second * (first * share + second))
    gamma = variance * np.array([[1, share], [share, 1]])
    rows = 200 * 37 * 2
    error = np.array(fitted.coefficients) - TRUTH.coefficients
    assert error @ gamma @ error * rows / TRUTH.innovation < chi2.ppf(0.9999, 2)
    assert abs(fitted.innovation / TRUTH.innovation - 1) < 4 * np.sqrt(2 / rows)


@pytest.mark.parametrize("size", [2, 3])
def test_it_covers_as_promised_on_its_own_model(size):
    rng, runs, steps = np.random.default_rng(2), 2000, 12
    paths = walks(TRUTH, runs, 5 + steps, rng, size)
    predictor = PooledVectorAutoregression(fitted=TRUTH, noise_floor=1e-6)
    forecast = predictor.predict(tracks_of(paths[:, :5]), steps)
    assert forecast.fallback == (None,) * runs
    error = paths[:, 5:] - forecast.mean[:, 0]
    inverse = np.linalg.inv(forecast.covariance[:, 0])
    inside = np.einsum("oni,onij,onj->on", error, inverse, error) < chi2.ppf(0.9, size)
    assert (np.abs(inside.mean(axis=0) - 0.9) < 3.5 * np.sqrt(0.09 / runs)).all()
    flat = error.reshape(runs, -1)
    joint = forecast.joint[:, 0]
    whole = np.einsum("oi,oi->o", flat, np.linalg.solve(joint, flat[..., None])[..., 0])
    assert abs((whole < chi2.ppf(0.9, steps * size)).mean() - 0.9) < 3.5 * np.sqrt(0.09 / runs)


def test_unfitted_it_is_a_random_walk_of_the_velocity():
    path = np.cumsum(np.full((1, 6, 2), [0.3, -0.1]), axis=1)
    predictor = PooledVectorAutoregression(acceleration_density=0.04, noise_floor=0.02)
    forecast = predictor.predict(tracks_of(path), 8)
    h = np.arange(1, 9)
    np.testing.assert_allclose(forecast.mean[0, 0], path[0, -1] + h[:, None] * [0.3, -0.1])
    drift = DT**2 * 0.04 * DT * h * (h + 1) * (2 * h + 1) / 6
    start = 0.02**2 * ((1 + h) ** 2 + h**2)  # p_k + h (p_k - p_{k-1})
    np.testing.assert_allclose(forecast.covariance[0, 0, :, 0, 0], start + drift, rtol=1e-10)
    np.testing.assert_allclose(forecast.covariance[0, 0, :, 0, 1], 0.0, atol=1e-15)


def test_an_explosive_estimate_is_held_at_radius_one():
    velocity = 1.05 ** np.arange(40.0)[:, None] * np.array([[0.1, 0.05]])
    paths = DT * np.cumsum(velocity, axis=0) * np.arange(1.0, 5.0)[:, None, None]
    fitted = PooledVectorAutoregression(order=1).fit([tracks_of(paths)]).fitted
    assert fitted.coefficients[0] == pytest.approx(1.0, abs=1e-12)
    rate = np.array([0.05 / 1.05 * v for v in velocity[1:]])  # what it then leaves unexplained
    squares = sum(np.sum((k * rate) ** 2) for k in range(1, 5))
    # The first row of positions has no step before it: one velocity less, one row less.
    first = sum(np.sum((k * rate[0]) ** 2) for k in range(1, 5))
    rows = 4 * 38 * 2
    assert fitted.innovation == pytest.approx((squares - first) / (rows - 1), rel=1e-9)


def test_gaps_and_late_tracks_are_served():
    rng = np.random.default_rng(3)
    path = walks(TRUTH, 1, 12, rng)
    predictor = PooledVectorAutoregression(fitted=TRUTH)
    early = predictor.predict(tracks_of(path), 8)
    gone = np.concatenate([path, np.full((1, 3, 2), np.nan)], axis=1)
    late = predictor.predict(tracks_of(gone), 5)
    np.testing.assert_allclose(late.mean, early.mean[:, :, 3:], atol=1e-12)
    np.testing.assert_allclose(late.joint, early.joint[:, :, 6:, 6:], atol=1e-14)
    path[0, -2] = np.nan
    filled = path.copy()
    filled[0, -2] = (path[0, -1] + path[0, -3]) / 2
    wanted = predictor.predict(tracks_of(filled), 4)
    np.testing.assert_allclose(predictor.predict(tracks_of(path), 4).mean, wanted.mean)


def test_what_it_cannot_serve_is_left_to_the_fallback_with_a_reason():
    paths = walks(TRUTH, 3, 12, np.random.default_rng(4))
    paths[0, :-2], paths[1, :-1] = np.nan, np.nan
    forecast = PooledVectorAutoregression(fitted=TRUTH).predict(tracks_of(paths), 4)
    assert forecast.fallback == (
        "pooled_var: 2 samples, needs 3",
        "pooled_var: 1 sample, needs 3",
        None,
    )


@pytest.mark.parametrize("finer", [5, 2])
def test_another_step_is_resampled_to_that_of_the_recordings(finer):
    """Tracks of 0.1 and 0.25 s: at every 0.5 s ahead the forecast is that of tracks of 0.5 s."""
    predictor = PooledVectorAutoregression(fitted=TRUTH)
    paths = walks(TRUTH, 3, 12, np.random.default_rng(4))
    clock = np.arange(0.0, 11.0 + 1e-9, 1 / finer)
    fine = np.stack([
        np.stack([np.interp(clock, np.arange(12.0), path[:, axis]) for axis in (0, 1)], axis=1)
        for path in paths
    ])  # fmt: skip
    wanted = predictor.predict(tracks_of(paths), 4)
    found = predictor.predict(tracks_of(fine, dt=DT / finer), 4 * finer)
    assert found.fallback == (None,) * 3
    every = slice(finer - 1, None, finer)
    np.testing.assert_allclose(found.mean[:, :, every], wanted.mean, atol=1e-9)
    np.testing.assert_allclose(found.covariance[:, :, every], wanted.covariance, atol=1e-9)
    fine[0, -finer:] = np.nan  # last seen half a second ago: as if one step of 0.5 s were missing
    paths[0, -1] = np.nan
    late, early = predictor.predict(tracks_of(fine, dt=DT / finer), 2 * finer), tracks_of(paths)
    np.testing.assert_allclose(
        late.mean[0, :, every], predictor.predict(early, 2).mean[0], atol=1e-9
    )
    short = predictor.predict(tracks_of(fine[:, -finer - 1 :], dt=DT / finer), 4)
    assert all("needs 3" in reason for reason in short.fallback)
    coarse = predictor.predict(tracks_of(paths, dt=2 * DT), 3)  # straight lines between samples
    assert coarse.fallback == (None,) * 3


def test_laws_and_plain_config():
    fitted = PooledVectorAutoregression(fitted=TRUTH, noise_floor=0.02)
    check_predictor(fitted)
    check_predictor(replace(fitted, order=1, fitted=IsotropicProcess((1.0,), 0.02, 0.3)))
    config = describe(fitted)
    assert build("predictors", config) == fitted
    assert config["fitted"] == {"coefficients": [0.7, 0.25], "innovation": 0.01, "dt": 0.5}


@pytest.mark.parametrize(
    ("maker", "words"),
    [
        (lambda: PooledVectorAutoregression(order=0), "pooled_var.order is 0"),
        (lambda: PooledVectorAutoregression(noise_floor=0.0), "pooled_var.noise_floor is 0"),
        (
            lambda: PooledVectorAutoregression(order=3, fitted=TRUTH),
            "pooled_var.fitted has 2 coefficients; wanted 3",
        ),
        (lambda: IsotropicProcess((), 0.1, DT), "process.coefficients is empty"),
        (lambda: IsotropicProcess((1.0,), 0.0, DT), "process.innovation is 0"),
        (
            lambda: PooledVectorAutoregression().fit([tracks_of(np.zeros((2, 9, 2)))]),
            r"pooled_var.fit: 1 scenes hold 12 windows of 4 \+ 0",
        ),
        (
            lambda: PooledVectorAutoregression().fit(
                [tracks_of(np.zeros((20, 9, 2)), dt) for dt in (0.4, 0.5)]
            ),
            "pooled_var.fit: scenes have steps of 0.4, 0.5 s",
        ),
    ],
)
def test_bad_input_is_refused_by_name(maker, words):
    with pytest.raises(WideberthError, match=words):
        maker()
