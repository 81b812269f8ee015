"""Obstacles that follow a predictor's own model collide as often as is computed: no more, no less.

The robot stands on the boundary of a region at a fixed level and does not move. Everything that
the obstacle does is drawn here, from the model as the predictor's docstring states it: its past,
the noise with which it was seen, and its future.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import binomtest

from wideberth.framework import names
from wideberth.framework.plugins.registry import load
from wideberth.framework.region import Guarantee
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import BUILT_IN, constant_velocity, static
from wideberth.predictors.constant_acceleration import ConstantAcceleration
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.history import gather
from wideberth.predictors.core.least_squares import fit_velocities
from wideberth.predictors.core.velocity_forecast import past_velocities
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.pooled_var import IsotropicProcess, PooledVectorAutoregression
from wideberth.predictors.static import Static
from wideberth.predictors.var import CONDITION, HISTORY, VectorAutoregression

DRAWS, DT, STEPS, SEEN = 10_000, 0.5, 8, 16
TAIL, MARGIN = 0.05, 0.8
SHOWN = (1, 4)
SIDES = (0, 5)
"""Which of 16 points of each boundary the robot is put on."""
ALPHA = 1e-2
"""Level of the whole test; each comparison is held at this over their number."""
NOISE = np.array([[0.004, 0.0015], [0.0015, 0.002]])
"""m^2, of one measured position; not round, so that regions differ."""

Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Mean (DRAWS, N, 2), covariance (N, 2, 2), the same for all, and truth (DRAWS, N, 2)."""


def measured(rng, places):
    """Places as they are seen, (DRAWS, T, 2)."""
    return places + rng.standard_normal(places.shape) @ np.linalg.cholesky(NOISE).T


def tracks_of(seen):
    count = len(seen)
    ids = tuple(map(str, range(count)))
    return Tracks(seen, DT, ids, np.full(count, 0.4), np.tile(NOISE, (count, 1, 1)))


def forecast_of(predictor, seen, truth) -> Drawn:
    """Ask the predictor; its covariance must not depend on what was seen."""
    forecast = predictor.predict(tracks_of(seen), STEPS)
    assert set(forecast.fallback) == {None}
    covariance = forecast.covariance[:, 0]
    np.testing.assert_allclose(covariance, np.broadcast_to(covariance[0], covariance.shape),
                               rtol=1e-9, atol=1e-12)  # fmt: skip
    return forecast.mean[:, 0], covariance[0], truth


def linear(rng, drift, density, start, count):
    """Positions of dx = A x dt + B dW on each axis, exact at the samples (Van Loan 1978)."""
    size = len(drift)
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size], block[size:, size:] = -drift, drift.T
    block[size - 1, 2 * size - 1] = density
    grown = expm(block * DT)
    transition = grown[size:, size:].T
    root = np.linalg.cholesky(transition @ grown[:size, size:] + 1e-15 * np.eye(size))
    state = np.sqrt(start) * rng.standard_normal((DRAWS, 2, size))
    places = np.empty((DRAWS, count, 2))
    for k in range(count):
        places[:, k] = state[..., 0]
        state = state @ transition.T + rng.standard_normal(state.shape) @ root.T
    return places


@pytest.fixture(autouse=True)
def stated_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    """The noise is what the tracks state, and no more."""
    for module in (constant_velocity, static):
        monkeypatch.setattr(module, "NOISE_FLOOR", 1e-6)


def split(places):
    return places[:, :SEEN], places[:, SEEN:]


def draw_kalman(rng) -> Drawn:
    predictor = Kalman(acceleration_density=0.05, speed=0.7, noise_floor=1e-6)
    drift = np.array([[0.0, 1.0], [0.0, 0.0]])
    past, truth = split(linear(rng, drift, 0.05, np.array([0.0, 0.49]), SEEN + STEPS))
    return forecast_of(predictor, measured(rng, past), truth)


def draw_constant_acceleration(rng) -> Drawn:
    predictor = ConstantAcceleration(0.3, 0.8, speed=0.7, noise_floor=1e-6)
    drift = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1 / 0.8]])
    start = np.array([0.0, 0.49, 0.09])
    past, truth = split(linear(rng, drift, 2 * 0.09 / 0.8, start, SEEN + STEPS))
    return forecast_of(predictor, measured(rng, past), truth)


def draw_constant_velocity(rng) -> Drawn:
    predictor = ConstantVelocity(window=5, acceleration_density=0.05)
    drift = np.array([[0.0, 1.0], [0.0, 0.0]])
    past, truth = split(linear(rng, drift, 0.05, np.array([0.0, 0.49]), SEEN + STEPS))
    return forecast_of(predictor, measured(rng, past), truth)


def draw_static(rng) -> Drawn:
    velocity = 0.3 * rng.standard_normal((DRAWS, 1, 2))
    truth = DT * np.arange(1.0, STEPS + 1)[:, None] * velocity
    return forecast_of(Static(0.3), measured(rng, np.zeros((DRAWS, 1, 2))), truth)


def autoregressed(rng, lags, root, recent, steps):
    """Velocities after the two known ones, newest last, (DRAWS, 2, 2) -> (DRAWS, steps, 2)."""
    path = [recent[:, 0], recent[:, 1]]
    for _ in range(steps):
        shock = rng.standard_normal((DRAWS, 2)) @ root.T
        path.append(path[-1] @ lags[0].T + path[-2] @ lags[1].T + shock)
    return np.stack(path[2:], axis=1)


def draw_pooled_var(rng) -> Drawn:
    law = IsotropicProcess((1.0, -0.1), 0.01, DT)
    lags, root = np.array([np.eye(2), -0.1 * np.eye(2)]), 0.1 * np.eye(2)
    recent = 0.3 * rng.standard_normal((DRAWS, 2, 2))
    places = DT * np.cumsum(autoregressed(rng, lags, root, recent, SEEN + STEPS), axis=1)
    past, truth = split(places)
    predictor = PooledVectorAutoregression(noise_floor=1e-6, fitted=law)
    return forecast_of(predictor, measured(rng, past), truth)


def draw_var(rng) -> Drawn:
    """One history is fitted; its process is the model, and where it was seen is in error."""
    made = rng.standard_normal((1, 60, 2)) @ np.array([[0.2, 0.05], [0.0, 0.15]])
    for h in range(2, 60):
        made[0, h] += 0.9 * made[0, h - 1] - 0.1 * made[0, h - 2]
    seen = DT * np.cumsum(made, axis=1)
    predictor = VectorAutoregression(covariance="exact", noise_floor=0.0)
    forecast = predictor.predict(tracks_of(seen), STEPS)
    assert forecast.fallback == (None,)
    past = gather(tracks_of(seen), length=HISTORY)
    velocities, _ = past_velocities(past, DT, 2)
    fitted = fit_velocities(velocities, past.began, 2, CONDITION).process
    error = rng.standard_normal((DRAWS, 3, 2)) @ np.linalg.cholesky(NOISE).T
    places = seen[:, -3:] - error
    root = np.linalg.cholesky(fitted.innovation[0])
    ahead = autoregressed(rng, fitted.coefficients[0], root, np.diff(places, axis=1) / DT, STEPS)
    truth = places[:, -1:] + DT * np.cumsum(ahead, axis=1)
    mean = np.broadcast_to(forecast.mean[:, 0], (DRAWS, STEPS, 2))
    return mean, forecast.covariance[0, 0], truth


MODELS: dict[str, Callable[[np.random.Generator], Drawn]] = {
    "constant_acceleration": draw_constant_acceleration,
    "constant_velocity": draw_constant_velocity,
    "kalman": draw_kalman,
    "pooled_var": draw_pooled_var,
    "static": draw_static,
    "var": draw_var,
}
WITHOUT = {
    "adaptive_conformal": "scales what another one says by its own errors",
    "bayesian_var": "its posterior is widened to first order only",
    "cascade": "hands on what its stages say",
    "conformal": "scales what another one says by recorded errors",
    "corrected": "moves the mean of another one by recorded errors",
    "coordinated_turn": "its model is not linear: the covariance is that of a linearisation",
    "empirical": "states recorded errors, no process",
    "functional_constant": "discs that hold what errors were recorded, no process",
    "game": "a game's solution with a stated spread, no process",
    "imm": "mixtures are merged at every sample, which is an approximation",
    "mixture_density": "a learnt network",
    "oracle": "the future itself",
    "reacting_people": "rolled out, a mixture of models that are not linear",
    "single_gaussian": "merges what another one says",
    "smoothed": "hands on what another one says of smoothed tracks",
    "social_force": "rolled out, not linear",
    "turning": "modes stand for sets of turns, which is not linear",
}
"""Registered predictors that state no linear Gaussian process, and why."""
REGIONS = {
    name: load("regions", name)()
    for name in names("regions")
    if load("regions", name).guarantee is not Guarantee.NONE
    and 2 in load("regions", name).dimensions
}


@cache
def drawn(name: str) -> Drawn:
    return MODELS[name](np.random.default_rng([17, len(name)]))


@cache
def compared(name: str, region_name: str, scale: float) -> list[tuple[int, float]]:
    """Observed collisions of DRAWS and their computed probability, at every step and side."""
    region = REGIONS[region_name]
    mean, covariance, truth = drawn(name)
    found = []
    for step in SHOWN:
        stated = scale * covariance[step - 1]
        obstacle = GaussianObstacle(np.zeros(2), stated)
        parameters = region.parameters(obstacle, np.asarray(MARGIN))
        edge = region.boundary(parameters, region.level(TAIL), 16)
        for side in SIDES:
            computed = float(collision_probability(-edge[side], stated, MARGIN))
            away = truth[:, step - 1] - (mean[:, step - 1] + edge[side])
            found.append((int((np.hypot(*away.T) < MARGIN).sum()), computed))
    return found


def p_values(name: str, region_name: str, scale: float = 1.0) -> list[float]:
    pairs = compared(name, region_name, scale)
    return [binomtest(hits, DRAWS, computed).pvalue for hits, computed in pairs]


def each_alpha() -> float:
    """Bonferroni's level of one comparison: they all share draws, which it does not mind."""
    return ALPHA / (len(MODELS) * len(REGIONS) * len(SHOWN) * len(SIDES))


def test_every_registered_predictor_is_here_or_says_why_not():
    assert {*MODELS, *WITHOUT} == set(BUILT_IN) and not MODELS.keys() & WITHOUT.keys()


def test_enough_regions_promise_something():
    assert {"minkowski_sum", "minimum_trace", "half_plane", "luetkepohl_rectangle"} <= set(REGIONS)


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("model", MODELS)
def test_observed_collisions_are_those_computed(model, region):
    assert min(p_values(model, region)) > each_alpha()


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("model", MODELS)
def test_the_promise_is_kept(model, region):
    for hits, computed in compared(model, region, 1.0):
        assert computed <= TAIL * (1 + 1e-9)
        assert binomtest(hits, DRAWS, TAIL, alternative="greater").pvalue > each_alpha()


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("model", MODELS)
def test_a_quarter_of_the_covariance_is_found_out(model, region):
    """So the test above has the power to fail: at every step on its own, in fact."""
    values = np.array(p_values(model, region, 0.25)).reshape(len(SHOWN), len(SIDES))
    assert (values.min(axis=1) < each_alpha()).all()


@pytest.mark.parametrize("scale", [0.8, 1.25])
def test_both_sides_are_tested(scale):
    """Too wide is found out as well as too narrow."""
    assert min(p_values("kalman", "minkowski_sum", scale)) < each_alpha()
