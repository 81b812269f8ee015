"""The Bayesian vector autoregression against closed forms, integration and simulation."""

import numpy as np
import pytest
from scipy.stats import chi2, invwishart

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.scoring import negative_log_likelihood
from wideberth.predictors import bayesian_var
from wideberth.predictors.bayesian_var import BayesianVectorAutoregression, Prior, posterior
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.least_squares import fit_velocities
from wideberth.predictors.pooled_var import IsotropicProcess, PooledVectorAutoregression

DT = 0.5
LAW = IsotropicProcess((0.7, 0.25), 0.01, DT)


def tracks_of(positions, dt=DT):
    count, _, size = positions.shape
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), np.zeros((count, size, size)))


def simulate(lags, root, samples, rng, burn=60):
    """Velocities of one VAR per run; lags (O, p, D, D), root (O, D, D) of the innovation."""
    runs, order, size = lags.shape[:3]
    path = np.zeros((runs, samples + burn, size))
    for k in range(order, samples + burn):
        past = path[:, k - order : k][:, ::-1]
        path[:, k] = np.einsum("opij,opj->oi", lags, past)
        path[:, k] += np.einsum("oij,oj->oi", root, rng.standard_normal((runs, size)))
    return path[:, burn:]


def positions_of(velocities):
    start = np.zeros_like(velocities[:, :1])
    return DT * np.cumsum(np.concatenate([start, velocities], axis=1), axis=1)


def believe(prior, velocities):
    return posterior(prior, velocities, gather(tracks_of(positions_of(velocities))))


@pytest.fixture
def predictor_of(monkeypatch):
    """Make predictors whose prior has the mean of a process, for tracks without noise."""

    def made(law, deviation, samples):
        monkeypatch.setattr(bayesian_var, "NOISE_FLOOR", 1e-9)
        monkeypatch.setattr(IsotropicProcess, "random_walk", lambda order, density, dt: law)
        return BayesianVectorAutoregression(
            order=len(law.coefficients), deviation=deviation, samples=samples
        )

    return made


def generic(runs, samples, rng, size=2):
    lags = np.stack([0.5 * np.eye(size), 0.2 * np.eye(size)[::-1]])
    root = 0.1 * np.linalg.cholesky(np.eye(size) + 0.3)
    return simulate(np.tile(lags, (runs, 1, 1, 1)), np.tile(root, (runs, 1, 1)), samples, rng)


@pytest.mark.parametrize("size", [2, 3])
def test_posterior_equals_the_textbook_formulas(size):
    data, tau, n0 = generic(3, 9, np.random.default_rng(0), size), 0.2, 4.0
    found = believe(Prior(LAW, tau, n0), data)
    for o in range(3):
        z = np.concatenate([data[o, 1:-1], data[o, :-2]], axis=1)
        y, mean = data[o, 2:], np.concatenate([0.7 * np.eye(size), 0.25 * np.eye(size)])
        precision = LAW.innovation / tau**2 * np.eye(2 * size)
        total = precision + z.T @ z
        solution = np.linalg.solve(total, precision @ mean + z.T @ y)
        # Another, equal form of Psi_n: it has no residuals in it.
        psi = n0 * LAW.innovation * np.eye(size) + y.T @ y + mean.T @ precision @ mean
        psi = psi - solution.T @ total @ solution
        lags = solution.reshape(2, size, size).swapaxes(1, 2)
        np.testing.assert_allclose(found.process.coefficients[o], lags, atol=1e-12)
        np.testing.assert_allclose(found.process.innovation[o], psi / (n0 + len(y)), rtol=1e-9)
        np.testing.assert_allclose(
            found.root[o] @ found.root[o].T, np.linalg.inv(total), rtol=1e-9, atol=1e-12
        )


def test_posterior_equals_brute_force_integration_in_one_dimension(predictor_of):
    """Prior times likelihood on a grid of (b, sigma^2): moments of both, and of the next step."""
    law, tau, n0 = IsotropicProcess((0.9,), 0.02, DT), 0.15, 5.0
    data = simulate(
        np.full((1, 1, 1, 1), 0.6), np.full((1, 1, 1), 0.2), 8, np.random.default_rng(1)
    )
    found = believe(Prior(law, tau, n0), data)
    b = np.linspace(-1.5, 2.5, 1601)[:, None]
    variance = np.exp(np.linspace(np.log(5e-4), np.log(5.0), 2001))
    x, y = data[0, :-1, 0], data[0, 1:, 0]
    # IW(n0 s^2, n0 + 2) in one dimension: sigma^2 to the power -(n0 + 4) / 2.
    density = -0.5 * (n0 + 4) * np.log(variance) - n0 * law.innovation / (2 * variance)
    spread = variance * tau**2 / law.innovation
    density = density - 0.5 * np.log(spread) - (b - 0.9) ** 2 / (2 * spread)
    squares = ((y - b * x) ** 2).sum(axis=1)[:, None]
    density = density - 0.5 * len(y) * np.log(variance) - squares / (2 * variance)
    weight = np.exp(density - density.max()) * variance  # the grid is even in log sigma^2
    weight /= weight.sum()
    mean = (weight * b).sum()
    assert found.process.coefficients.item() == pytest.approx(mean, rel=1e-6)
    assert found.process.innovation.item() == pytest.approx((weight * variance).sum(), rel=1e-5)
    scatter = (weight * (b - mean) ** 2).sum()
    assert found.root.item() ** 2 * found.process.innovation.item() == pytest.approx(
        scatter, rel=1e-4
    )
    predictor = predictor_of(law, tau, n0)
    forecast = predictor.predict(tracks_of(positions_of(data)), 1)
    following = (weight * (variance + b**2 * y[-1] ** 2)).sum() - (mean * y[-1]) ** 2
    assert forecast.covariance.item() == pytest.approx(DT**2 * following, rel=1e-5)


def test_a_weak_prior_gives_least_squares():
    data = generic(4, 30, np.random.default_rng(2))
    found = believe(Prior(LAW, 1e5, 1e-9), data)
    fits = fit_velocities(data, np.zeros(4, dtype=np.int64), 2, 1e6)
    np.testing.assert_allclose(found.process.coefficients, fits.process.coefficients, atol=1e-9)
    share = fits.freedom[0] / 28  # the posterior divides by all rows
    np.testing.assert_allclose(
        found.process.innovation, share * fits.process.innovation, rtol=1e-8
    )
    np.testing.assert_allclose(found.root, fits.root, atol=1e-7)


def test_a_long_history_gives_least_squares_whatever_the_prior():
    data = generic(2, 20_000, np.random.default_rng(3))
    found = believe(Prior(IsotropicProcess((1.0, 0.0), 0.05, DT), 0.1, 10.0), data)
    fits = fit_velocities(data, np.zeros(2, dtype=np.int64), 2, 1e6)
    # Z'Z is about 400 (m/s)^2, the prior's weight 5: a share of some percent of the way at
    # 500 rows, of a few thousandths of it here.
    gap = np.abs(found.process.coefficients - fits.process.coefficients).max()
    assert gap < 0.02 * np.abs(fits.process.coefficients[:, 0] - np.eye(2)).max()
    np.testing.assert_allclose(found.process.innovation, fits.process.innovation, rtol=0.04)


def test_a_strong_prior_is_the_pooled_process(predictor_of):
    tracks = tracks_of(positions_of(generic(3, 15, np.random.default_rng(4))))
    strong = predictor_of(LAW, 1e-7, 1e12)
    pooled = PooledVectorAutoregression(fitted=LAW, noise_floor=1e-9).predict(tracks, 9)
    forecast = strong.predict(tracks, 9)
    np.testing.assert_allclose(forecast.mean, pooled.mean, atol=1e-9)
    # The history still weighs 1e-11 of s^2, off the diagonal, too.
    np.testing.assert_allclose(forecast.covariance, pooled.covariance, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(forecast.joint, pooled.joint, rtol=1e-7, atol=1e-10)


def test_three_samples_give_the_prior_and_two_a_reason(predictor_of):
    path = positions_of(generic(1, 12, np.random.default_rng(5)))
    path[0, :-3] = np.nan
    predictor = predictor_of(LAW, 0.1, 6.0)
    forecast = predictor.predict(tracks_of(path), 4)
    pooled = PooledVectorAutoregression(fitted=LAW, noise_floor=1e-9).predict(tracks_of(path), 4)
    assert forecast.fallback == (None,)
    np.testing.assert_allclose(forecast.mean, pooled.mean, atol=1e-12)
    # Wider than the prior's mean process alone: its coefficients are uncertain.
    gain = np.linalg.eigvalsh(forecast.covariance[0, 0] - pooled.covariance[0, 0])
    assert gain.min() > 0
    path[0, -3] = np.nan
    assert predictor.predict(tracks_of(path), 4).fallback == ("bayesian_var: 2 samples, needs 3",)


def test_it_covers_as_promised_where_the_prior_is_true(predictor_of):
    """Coefficients and innovations drawn from the prior, a short history, then the future."""
    rng, runs, samples, steps = np.random.default_rng(6), 4000, 12, 8
    n0, tau, s2 = 12.0, 0.05, 0.01
    sigma = invwishart(df=n0 + 3, scale=n0 * s2 * np.eye(2)).rvs(runs, random_state=rng)
    root = np.linalg.cholesky(sigma)
    noise = rng.standard_normal((runs, 4, 2)) * tau / np.sqrt(s2)
    solution = np.concatenate([0.6 * np.eye(2), 0.2 * np.eye(2)]) + noise @ root.swapaxes(1, 2)
    lags = solution.reshape(runs, 2, 2, 2).swapaxes(2, 3)
    paths = positions_of(simulate(lags, root, samples + steps, rng))
    predictor = predictor_of(IsotropicProcess((0.6, 0.2), s2, DT), tau, n0)
    forecast = predictor.predict(tracks_of(paths[:, : samples + 1]), steps)
    assert forecast.fallback == (None,) * runs
    error = paths[:, samples + 1 :] - forecast.mean[:, 0]
    square = np.einsum(
        "oni,oni->on", error, np.linalg.solve(forecast.covariance[:, 0], error[..., None])[..., 0]
    )
    # Whitened errors have covariance I: the mean of their squares is D.
    assert (np.abs(square.mean(axis=0) / 2 - 1) < 5 * square.std(axis=0) / 2 / np.sqrt(runs)).all()
    for content in (0.5, 0.9, 0.95):
        inside = (square < chi2.ppf(content, 2)).mean(axis=0)
        # A t of 20 degrees of freedom is not quite a Gaussian: one more percent is granted.
        limit = 3 * np.sqrt(content * (1 - content) / runs) + 0.01
        assert (np.abs(inside - content) < limit).all(), (content, inside)


def test_no_forecast_explodes():
    growth = 1.2 ** np.arange(25.0)[:, None] * np.array([[0.01, 0.02]])
    path = positions_of(growth[None])
    wild = BayesianVectorAutoregression(deviation=10.0)
    forecast = wild.predict(tracks_of(path), 40)
    speed = np.linalg.norm(np.diff(forecast.mean[0, 0], axis=0), axis=1) / DT
    assert forecast.fallback == (None,)
    assert speed.max() <= 1.001 * np.linalg.norm(growth[-1])
    free = believe(Prior(IsotropicProcess((1.0, 0.0), 0.01, DT), 10.0, 6.0), growth[None])
    assert free.process.radius()[0] > 1.15
    assert free.process.settled().radius()[0] == pytest.approx(1.0, abs=1e-9)


def mixed_crowd(seed, count=60, samples=40):
    """Walkers of constant velocity but for pushes; half of them are pushed three times as hard."""
    rng = np.random.default_rng(seed)
    scale = np.where(np.arange(count) % 2, 0.03, 0.09)
    push = scale[:, None, None] * rng.standard_normal((count, samples, 2))
    return positions_of(rng.normal(scale=0.8, size=(count, 1, 2)) + np.cumsum(push, axis=1))


def test_fit_learns_the_spread_and_how_much_obstacles_differ():
    scenes = [tracks_of(mixed_crowd(seed)) for seed in (1, 2)]
    unfitted = BayesianVectorAutoregression()
    fitted = unfitted.fit(scenes)
    assert fitted == unfitted.fit(scenes)
    # E sigma^2 is 0.0045, and n_0 is small where two variances a factor nine apart are mixed.
    assert 0.0009 < DT * fitted.acceleration_density < 0.009 and 0.3 < fitted.samples < 12
    paths = mixed_crowd(3)
    loss = {}
    for name, predictor in (("unfitted", unfitted), ("fitted", fitted)):
        said = predictor.predict(tracks_of(paths[:, :20]), 12)
        given = said.mean, said.covariance, said.weight
        loss[name] = negative_log_likelihood(*given, paths[:, 20:32], 0.01).mean()
    assert loss["fitted"] < loss["unfitted"] - 0.1
    assert build("predictors", describe(fitted)) == fitted


def test_laws(predictor_of):
    check_predictor(BayesianVectorAutoregression(deviation=0.3))
    check_predictor(BayesianVectorAutoregression(order=1, acceleration_density=0.5), dataset=())
    check_predictor(predictor_of(LAW, 0.02, 3.0), dataset=())


def test_late_forecasts_drop_the_steps_gone_by():
    path = positions_of(generic(1, 20, np.random.default_rng(8)))
    gone = np.concatenate([path, np.full((1, 2, 2), np.nan)], axis=1)
    predictor = BayesianVectorAutoregression(deviation=0.1)
    early = predictor.predict(tracks_of(path), 7)
    late = predictor.predict(tracks_of(gone), 5)
    np.testing.assert_allclose(late.mean, early.mean[:, :, 2:], atol=1e-12)
    np.testing.assert_allclose(late.joint, early.joint[:, :, 4:, 4:], atol=1e-14)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"order": 0}, "bayesian_var.order is 0"),
        ({"deviation": 0.0}, "bayesian_var.deviation is 0"),
        ({"samples": 0.0}, "bayesian_var.samples is 0"),
    ],
)
def test_bad_settings_are_refused_by_name(settings, words):
    with pytest.raises(WideberthError, match=words):
        BayesianVectorAutoregression(**settings)


def test_too_few_windows_are_refused():
    short = tracks_of(mixed_crowd(1)[:, :15])
    with pytest.raises(WideberthError, match=r"bayesian_var.fit: 1 scenes hold 0 windows of 8"):
        BayesianVectorAutoregression().fit([short])


def test_rows_with_a_sample_that_was_filled_in_do_not_count():
    rng = np.random.default_rng(21)
    positions = positions_of(rng.normal(size=(1, 14, 2)).cumsum(axis=1))
    hollow = positions.copy()
    hollow[0, 6] = np.nan
    past = gather(tracks_of(hollow))
    velocities = np.diff(past.positions, axis=1) / DT
    prior = Prior(IsotropicProcess.random_walk(2, 0.5, DT), 0.3, 4.0)
    found = posterior(prior, velocities, past)
    # Sample 6 spoils velocities 5 and 6, and with them rows 3 to 6 (targets 5 to 8).
    rows = [h for h in range(2, velocities.shape[1]) if not {5, 6} & {h, h - 1, h - 2}]
    regressors = np.array([np.r_[velocities[0, h - 1], velocities[0, h - 2]] for h in rows])
    targets = velocities[0, rows]
    weight = 0.5 * DT / 0.3**2
    mean = np.vstack([np.eye(2), np.zeros((2, 2))])
    moments = weight * np.eye(4) + regressors.T @ regressors
    solution = np.linalg.solve(moments, weight * mean + regressors.T @ targets)
    np.testing.assert_allclose(
        np.concatenate([lag.T for lag in found.process.coefficients[0]]), solution, atol=1e-12
    )
    residuals, moved = targets - regressors @ solution, solution - mean
    scale = 4.0 * 0.5 * DT * np.eye(2) + residuals.T @ residuals + weight * moved.T @ moved
    np.testing.assert_allclose(found.process.innovation[0], scale / (4.0 + len(rows)), atol=1e-12)
