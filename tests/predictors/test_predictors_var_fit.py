"""The batched least squares of the VAR family against textbook, statsmodels and eigenvalues."""

import pickle
import subprocess
import sys

import numpy as np
import pytest

from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.least_squares import fit_velocities, fit_with_statsmodels, regress
from wideberth.predictors.core.velocity_process import VelocityProcess
from wideberth.predictors.var import VectorAutoregression

DT = 0.5


def walks(runs, samples, rng, size=2):
    """Velocities that persist and mix, (runs, T, D)."""
    lags = np.eye(3)[:, ::-1] * 0.2 + 0.6 * np.eye(3)
    path = np.zeros((runs, samples + 50, size))
    for k in range(1, samples + 50):
        path[:, k] = path[:, k - 1] @ lags[:size, :size] + 0.1 * rng.standard_normal((runs, size))
    return 0.3 + path[:, 50:]


def textbook(data, order):
    """B', residual covariance with df correction, (Z'Z)^-1."""
    columns = [data[order - lag - 1 : len(data) - lag - 1] for lag in range(order)]
    regressors = np.concatenate(columns, axis=1)
    moments = np.linalg.inv(regressors.T @ regressors)
    solution = moments @ regressors.T @ data[order:]
    rest = data[order:] - regressors @ solution
    return solution, rest.T @ rest / (len(rest) - regressors.shape[1]), moments


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("size", [2, 3])
def test_fits_of_different_lengths_equal_textbook_and_statsmodels(size, order):
    rng = np.random.default_rng(1)
    data, began = walks(6, 60, rng, size), np.array([0, 3, 30, 0, 41, 1])
    fits = fit_velocities(data, began, order, limit=1.0)
    other = fit_with_statsmodels(data, began, order)
    for o in range(6):
        solution, innovation, moments = textbook(data[o, began[o] :], order)
        lags = solution.reshape(order, size, size).swapaxes(1, 2)
        for fit in (fits, other):
            process, root = fit.process, fit.root[o]
            np.testing.assert_allclose(process.coefficients[o], lags, atol=1e-10)
            np.testing.assert_allclose(process.innovation[o], innovation, atol=1e-13)
            np.testing.assert_allclose(root @ root.T, moments, rtol=1e-8, atol=1e-12)
            assert fit.freedom[o] == 60 - began[o] - order - size * order
            assert fit.failed[o] is None
    np.testing.assert_allclose(fits.condition, other.condition, rtol=1e-9)


@pytest.mark.parametrize("covariance", ["paper", "exact", "exact+estimation"])
def test_both_back_ends_forecast_the_same(covariance):
    rng = np.random.default_rng(2)
    paths = DT * np.cumsum(walks(8, 70, rng), axis=1)
    paths[1, :30], paths[2, -4:], paths[3, [20, 21, 40]] = np.nan, np.nan, np.nan
    paths[4, 5:20], paths[5] = np.nan, DT * 0.4 * np.arange(70)[:, None]
    paths[6, :-10] = np.nan
    noise = np.tile(0.02**2 * np.eye(2), (8, 1, 1))
    tracks = Tracks(paths, DT, tuple("abcdefgh"), np.full(8, 0.3), noise)
    batched = VectorAutoregression(covariance=covariance).predict(tracks, 15)
    reference = VectorAutoregression(covariance=covariance, backend="statsmodels")
    reference = reference.predict(tracks, 15)
    fell = [reason is not None for reason in batched.fallback]
    assert fell == [reason is not None for reason in reference.fallback]
    assert fell[5] and fell[6] and sum(fell) < 5
    np.testing.assert_allclose(batched.mean, reference.mean, atol=1e-10)
    np.testing.assert_allclose(batched.covariance, reference.covariance, rtol=1e-10, atol=1e-13)
    if covariance != "paper":
        np.testing.assert_allclose(batched.joint, reference.joint, rtol=1e-8, atol=1e-12)


def test_ill_conditioned_fits_keep_their_digits():
    """Velocities with a mean 1e5 times their noise: normal equations would lose ten digits."""
    data = walks(3, 40, np.random.default_rng(3)) * 1e-5 + np.array([1.0, 2.0])
    began = np.zeros(3, dtype=np.int64)
    fits = fit_velocities(data, began, 2, limit=1.0)
    other = fit_with_statsmodels(data, began, 2)
    assert (fits.condition > 1e5).all()
    np.testing.assert_allclose(fits.process.coefficients, other.process.coefficients, atol=1e-8)
    np.testing.assert_allclose(fits.process.innovation, other.process.innovation, rtol=1e-9)


def test_the_condition_is_exact_above_the_limit_and_no_larger_than_it_below():
    data = walks(300, 12, np.random.default_rng(4))
    began = np.zeros(300, dtype=np.int64)
    exact = fit_velocities(data, began, 2, limit=0.0).condition
    limit = float(np.median(exact))
    loose = fit_velocities(data, began, 2, limit=limit).condition
    above = exact > limit
    np.testing.assert_allclose(loose[above], exact[above], rtol=1e-12)
    assert (loose[~above] <= limit).all() and (loose >= exact * (1 - 1e-12)).all()


def test_exactly_dependent_regressors_are_told_and_do_not_touch_the_others():
    data = walks(3, 30, np.random.default_rng(5))
    data[1, :, 1], data[2] = 2 * data[1, :, 0], 0.0
    fits = fit_velocities(data, np.zeros(3, dtype=np.int64), 2, limit=1e6)
    assert np.isinf(fits.condition[1:]).all() and np.isfinite(fits.condition[0])
    alone = fit_velocities(data[:1], np.zeros(1, dtype=np.int64), 2, limit=1e6)
    np.testing.assert_allclose(
        fits.process.coefficients[0], alone.process.coefficients[0], rtol=1e-12
    )


def test_regression_returns_a_root_of_the_inverse_moments():
    rng = np.random.default_rng(6)
    regressors, targets = rng.standard_normal((4, 9, 5)), rng.standard_normal((2, 9, 5))
    found = regress(regressors, targets)
    for o in range(5):
        z, y = regressors[:, :, o].T, targets[:, :, o].T
        solution, squares = np.linalg.lstsq(z, y, rcond=None)[:2]
        np.testing.assert_allclose(found.solution[:, :, o], solution, atol=1e-12)
        np.testing.assert_allclose(np.diag(found.squares[:, :, o]), squares, rtol=1e-12)
        root, triangle = found.root[:, :, o], found.triangle[:, :, o]
        np.testing.assert_allclose(root @ root.T, np.linalg.inv(z.T @ z), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(triangle.T @ triangle, z.T @ z, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("samples", range(1, 9))
@pytest.mark.parametrize("backend", ["batched", "statsmodels"])
def test_histories_too_short_for_a_fit_say_so(samples, backend):
    rng = np.random.default_rng(7)
    paths = np.full((1, 12, 2), np.nan)
    paths[0, -samples:] = rng.standard_normal((samples, 2)).cumsum(axis=0)
    tracks = Tracks(paths, DT, ("a",), np.full(1, 0.3), 1e-4 * np.eye(2)[None])
    wild = VectorAutoregression(minimum_history=4, gate=False, backend=backend)
    (reason,) = wild.predict(tracks, 4).fallback
    freedom = samples - 1 - 2 - 4
    if samples < 4:
        assert reason == f"var: {samples} sample{'s' * (samples > 1)}, needs 4"
    elif freedom < 1:
        assert reason == f"var: {freedom} residual degrees of freedom"
    else:
        assert reason is None or reason == "var: forecast diverges"


def test_a_filled_gap_counts_as_rows_but_not_as_samples():
    path = DT * np.cumsum(walks(1, 24, np.random.default_rng(8)), axis=1)
    path[0, 10:13] = np.nan
    tracks = Tracks(path, DT, ("a",), np.full(1, 0.3), 1e-4 * np.eye(2)[None])
    filled = gather(tracks).positions[0]
    solution, _, _ = textbook(np.diff(filled, axis=0) / DT, 2)
    forecast = VectorAutoregression().predict(tracks, 1)
    recent = np.diff(filled, axis=0)[-2:][::-1].ravel()
    np.testing.assert_allclose(forecast.mean[0, 0, 0], path[0, -1] + recent @ solution, atol=1e-12)
    few = VectorAutoregression(minimum_history=22).predict(tracks, 1)
    assert few.fallback == ("var: 21 samples, needs 22",)


def test_radius_says_whether_velocities_explode():
    lags = np.array([[1.2, -0.22], [1.3, -0.2]])[:, :, None, None] * np.eye(2)
    radius = VelocityProcess(lags, np.zeros((2, 2, 2))).radius()
    assert radius[0] == pytest.approx(np.roots([1, -1.2, 0.22]).max())
    assert radius[1] > 1


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_floor_under_the_radius_changes_nothing_above_it(size, order):
    rng = np.random.default_rng(10 * size + order)
    lags = 0.8 * rng.standard_normal((400, order, size, size)) / np.sqrt(order * size)
    process = VelocityProcess(lags, np.zeros((400, size, size)))
    exact, floored = process.radius(), process.radius(floor=0.9)
    assert 50 < (exact < 0.9).sum() < 350
    np.testing.assert_array_equal(floored[exact >= 0.9], exact[exact >= 0.9])
    assert (floored[exact < 0.9 - 1e-3] == 0.9).all()


def test_a_copy_in_another_process_has_its_library_before_it_forecasts() -> None:
    """The import takes seconds, which would be the first decision's."""
    text = pickle.dumps(VectorAutoregression(backend="statsmodels"))
    code = f"import pickle, sys; pickle.loads({text!r}); assert 'statsmodels' in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
