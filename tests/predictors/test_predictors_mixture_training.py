"""Training of the mixture density network: likelihood, gradient, and worlds that it must learn."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.scoring import negative_log_likelihood
from wideberth.predictors.core import adam
from wideberth.predictors.core.density_network import decode, forward, output_count
from wideberth.predictors.core.density_training import Material, log_densities, loss
from wideberth.predictors.data.windows import cut_windows
from wideberth.predictors.mixture_density import MixtureDensity
from wideberth.predictors.single_gaussian import SingleGaussian
from wideberth.predictors.static import Static

DT = 0.4
MODES, STEPS, LENGTH, FLOOR = 3, 5, 2.5, 0.01
TURN, DRIFT = np.deg2rad(50.0), 0.08


def scene_of(positions, dt=DT):
    count, _, size = positions.shape
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), np.zeros((count, size, size)))


def corner_world(count, rng, observed=6, predicted=8):
    """People who turn left or right where the window's past ends, each at a pace of its own.

    Returns positions, and for each person speed and heading.
    """
    heading = rng.uniform(-np.pi, np.pi, count)
    speed = rng.uniform(0.8, 1.4, count)
    side = rng.choice([-1.0, 1.0], count)
    past = speed[:, None, None] * DT * np.arange(-observed + 1, 1)[:, None] * unit(heading)
    after = speed[:, None] * unit(heading + side * TURN)[:, 0]
    after += DRIFT * rng.standard_normal((count, 2))
    future = DT * np.arange(1, predicted + 1)[:, None] * after[:, None]
    return np.concatenate([past, future], axis=1), speed, heading


def unit(angle):
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, None]


def outputs(seed=0, count=4):
    rng = np.random.default_rng(seed)
    raw = rng.standard_normal((count, output_count(MODES)))
    return raw, rng.uniform(0.2, 1.0, count), rng.standard_normal((count, STEPS, 2))


def by_scipy(raw, certain, residual):
    """Log weights (W, K) and log densities (W, K, N), written out one Gaussian at a time."""
    scores = raw[:, :MODES]
    weight = scores - logsumexp(scores, axis=1, keepdims=True)
    density = np.zeros((len(raw), MODES, STEPS))
    for w, row in enumerate(raw):
        path = row[MODES : 7 * MODES].reshape(MODES, 3, 2)
        roots = 5 * np.tanh(row[7 * MODES :] / 5).reshape(MODES, 3, 3)
        for k in range(MODES):
            for n in range(STEPS):
                share = (n + 1) / STEPS
                mean, spread = np.zeros(2), FLOOR**2 * np.eye(2)
                for power in range(3):
                    a, b, c = roots[k, power]
                    root = np.diag(np.exp([a - 2, b - 2])) @ np.array([[1.0, 0.0], [c, 1.0]])
                    one = root @ root.T
                    one = certain[w] * one + (1 - certain[w]) * np.trace(one) / 2 * np.eye(2)
                    spread += LENGTH**2 * share ** (power + 1) * one
                    mean += LENGTH * np.sqrt(certain[w]) * share ** (power + 1) * path[k, power]
                density[w, k, n] = multivariate_normal(mean, spread).logpdf(residual[w, n])
    return weight, density


def test_likelihood_equals_scipy():
    raw, certain, residual = outputs()
    weight, density = by_scipy(raw, certain, residual)
    wanted = -logsumexp(weight + density.mean(axis=2), axis=1)
    ours = loss(np, raw, certain, residual, MODES, LENGTH, FLOOR)
    np.testing.assert_allclose(ours, wanted, rtol=1e-10)


def test_loss_bounds_the_marginal_likelihood_and_equals_it_for_one_step():
    for seed in range(5):
        raw, certain, residual = outputs(seed, 20)
        for steps in (STEPS, 1):
            given = raw, certain, residual[:, :steps]
            weight, path, growth = decode(np, raw, certain, MODES, LENGTH)
            density = log_densities(np, given[2], path, growth, FLOOR)
            marginal = -logsumexp(weight[..., None] + density, axis=1).mean(axis=1)
            ours = loss(np, *given, MODES, LENGTH, FLOOR)
            assert (ours >= marginal - 1e-12).all()
        np.testing.assert_allclose(ours, marginal, rtol=1e-12)


def test_gradient_by_jax_equals_differences_in_numpy():
    import jax
    import jax.numpy as jnp

    rng = np.random.default_rng(3)
    layers = [
        (rng.standard_normal((4, 5)), rng.standard_normal(5)),
        (0.5 * rng.standard_normal((5, output_count(MODES))), rng.standard_normal(48)),
    ]
    inputs = rng.standard_normal((7, 4))
    _, certain, residual = outputs(4, 7)

    def total(xp, layers):
        raw = forward(xp, layers, inputs)
        return loss(xp, raw, certain, residual, MODES, LENGTH, FLOOR).sum()

    with jax.enable_x64(True):
        slopes = jax.jit(jax.grad(lambda given: total(jnp, given)))(layers)
    for which, (weight, _) in enumerate(layers):
        for place in [(0, 0), (3, 2), (1, 4)]:
            step = np.zeros_like(weight)
            step[place] = 1e-6
            sides = []
            for sign in (1, -1):
                moved = list(layers)
                moved[which] = (weight + sign * step, layers[which][1])
                sides.append(total(np, moved))
            slope = (sides[0] - sides[1]) / 2e-6
            assert float(slopes[which][0][place]) == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_the_forecast_is_what_the_training_scored():
    """World frame and own frame, predictor and training: one and the same density."""
    rng = np.random.default_rng(5)
    positions = DT * np.cumsum(1.0 + 0.4 * rng.standard_normal((160, 13, 2)), axis=1)
    windows = cut_windows(scene_of(positions), 8, STEPS)
    fitted = MixtureDensity(predicted=STEPS, rounds=1).fit([scene_of(positions)])
    data, net = Material.of([windows]), fitted.fitted
    seen = data.examples(data.past, data.future)
    raw = forward(np, net.arrays, seen.inputs)
    weight, path, growth = decode(np, raw, seen.certain, MODES, net.scale * net.horizon)
    density = log_densities(np, seen.residual, path, growth, FLOOR)
    wanted = -logsumexp(weight[..., None] + density, axis=1)
    forecast = fitted.predict(windows.tracks, STEPS)
    ours = negative_log_likelihood(
        forecast.mean, forecast.covariance, forecast.weight, windows.future, 1e-9
    )
    np.testing.assert_allclose(ours, wanted, atol=1e-8)


@pytest.fixture(scope="module")
def corner():
    positions, _, _ = corner_world(1500, np.random.default_rng(6))
    return MixtureDensity(observed=6, predicted=8, modes=2, rounds=16).fit([scene_of(positions)])


def test_both_ways_round_a_corner_are_found(corner):
    positions, speed, heading = corner_world(1000, np.random.default_rng(7))
    forecast = corner.predict(scene_of(positions[:, :6]), 8)
    np.testing.assert_allclose(forecast.weight, 0.5, atol=0.08)
    reach = 8 * DT * speed
    for side in (-1.0, 1.0):
        end = reach[:, None] * unit(heading + side * TURN)[:, 0]
        gap = np.linalg.norm(forecast.mean[:, :, -1] - end[:, None], axis=2).min(axis=1)
        assert gap.max() < 0.25  # of ends that are 4 to 7 m apart


def test_likelihood_of_the_corner_is_near_its_entropy(corner):
    positions, speed, heading = corner_world(4000, np.random.default_rng(8))
    forecast = corner.predict(scene_of(positions[:, :6]), 8)
    truth = positions[:, 6:]
    ours = negative_log_likelihood(
        forecast.mean, forecast.covariance, forecast.weight, truth, 1e-9
    )
    times = DT * np.arange(1, 9)[:, None]
    sides = [speed[:, None] * unit(heading + side * TURN)[:, 0] for side in (-1.0, 1.0)]
    mean = np.stack([times * side[:, None] for side in sides], axis=1)
    spread = np.broadcast_to((DRIFT * times[..., None]) ** 2 * np.eye(2), (len(truth), 2, 8, 2, 2))
    best = negative_log_likelihood(mean, spread, np.full((len(truth), 2), 0.5), truth, 1e-9)
    # the true law itself scores log 2 + log(2 pi e sigma^2) where its modes are apart
    entropy = np.log(2) + 1 + np.log(2 * np.pi * (DRIFT * times[-1, 0]) ** 2)
    assert best[:, -1].mean() == pytest.approx(entropy, abs=5 / np.sqrt(len(truth)))
    # the floor of the training and of the forecast, 1 cm each, weigh on the first steps alone
    assert 0.0 < (ours - best)[:, 2:].mean() < 0.15


def test_fitted_keeps_the_laws(corner):
    check_predictor(corner, dataset=())


def test_same_seed_same_network_and_the_unfitted_stays(monkeypatch):
    monkeypatch.setattr(adam, "UPDATES", 5)
    positions, _, _ = corner_world(200, np.random.default_rng(9))
    predictor = MixtureDensity(observed=6, predicted=8, rounds=2)
    first, second, other = (
        replace(predictor, seed=seed).fit([scene_of(positions)]).fitted for seed in (1, 1, 2)
    )
    assert first == second != other
    assert repr(first) == repr(second)
    assert predictor.fitted is None


def test_every_scene_has_a_say_and_held_out_windows_are_never_drawn():
    small, large = (
        cut_windows(scene_of(corner_world(count, np.random.default_rng(count))[0]), 6, 8)
        for count in (100, 900)
    )
    data = Material.of([small, large])
    assert data.share[:100].sum() == pytest.approx(10 / 40)  # square roots of 100 and 900
    np.testing.assert_array_equal(np.flatnonzero(data.held[:100]), np.arange(87, 100))
    assert data.held[100:].sum() == 113
    marked = replace(data, past=np.where(data.held[:, None, None], np.nan, data.past))
    drawn = marked.draw(np.random.default_rng(0), 5000)
    assert np.isfinite(drawn.inputs).all()


def test_what_cannot_be_learnt_from_is_refused():
    few = scene_of(corner_world(99, np.random.default_rng(0))[0])
    predictor = MixtureDensity(observed=6, predicted=8)
    with pytest.raises(WideberthError, match=r"99 windows of 6 \+ 8 consecutive samples"):
        predictor.fit([few])
    more = scene_of(corner_world(50, np.random.default_rng(0))[0], dt=0.5)
    with pytest.raises(WideberthError, match=r"0\.4 s, 0\.5 s"):
        predictor.fit([few, more])
    space = scene_of(np.random.default_rng(0).standard_normal((120, 14, 3)))
    with pytest.raises(WideberthError, match="3 coordinates"):
        predictor.fit([space])


def test_standing_crowd_and_exact_lines_do_not_break_the_training(monkeypatch):
    monkeypatch.setattr(adam, "UPDATES", 5)
    still = scene_of(np.tile(np.arange(150.0)[:, None, None], (1, 14, 2)))
    fitted = MixtureDensity(observed=6, predicted=8, rounds=2).fit([still])
    forecast = fitted.predict(still.select([3]), 4)
    np.testing.assert_allclose(forecast.mean[0], 3.0, atol=1e-9)


def test_single_gaussian_has_the_mixtures_moments():
    positions, _, _ = corner_world(3, np.random.default_rng(11))
    base = MixtureDensity()
    tracks = scene_of(positions[:, :6])
    several = base.predict(tracks, 8)
    merged = SingleGaussian(base).predict(tracks, 8)
    count = 40_000
    draws = several.sample(np.random.default_rng(12), count).reshape(count, 3, 16)
    deviation = np.sqrt(np.diagonal(merged.joint[:, 0], axis1=1, axis2=2))
    error = (draws.mean(axis=0) - merged.mean[:, 0].reshape(3, 16)) / deviation
    assert np.abs(error).max() < 5 / np.sqrt(count)
    apart = (draws - merged.mean[:, 0].reshape(3, 16)) / deviation[None]
    moment = np.einsum("coi,coj->oij", apart, apart) / count
    wanted = merged.joint[:, 0] / (deviation[:, :, None] * deviation[:, None])
    assert np.abs(moment - wanted).max() < 10 / np.sqrt(count)
    blocks = merged.joint[:, 0].reshape(3, 8, 2, 8, 2)[:, np.arange(8), :, np.arange(8)]
    np.testing.assert_allclose(blocks.swapaxes(0, 1), merged.covariance[:, 0], atol=1e-12)


def test_single_gaussian_fits_its_base(corner, monkeypatch):
    monkeypatch.setattr(adam, "UPDATES", 5)
    scene = scene_of(corner_world(200, np.random.default_rng(13))[0])
    base = MixtureDensity(observed=6, predicted=8, rounds=2)
    fitted = SingleGaussian(base).fit([scene])
    assert fitted.base == base.fit([scene])
    check_predictor(SingleGaussian(corner), dataset=())
    assert SingleGaussian(Static()).fit([scene]) == SingleGaussian(Static())
