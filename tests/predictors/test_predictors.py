"""Static, constant velocity, Kalman and oracle, and the laws of all predictors."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.registry import load
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.testing.predictor_cases import draw_recordings
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Truth
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors import BUILT_IN, constant_velocity
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.oracle import Oracle
from wideberth.predictors.static import Static
from wideberth.predictors.var import VectorAutoregression
from wideberth.tests.helpers.contracts import Contract

DT = 0.5
NAN = np.nan


def tracks_of(positions, noise=0.02, dt=DT, stamp=0.0):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    spread = np.tile(noise**2 * np.eye(size), (count, 1, 1))
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), spread, stamp)


def line(samples, velocity=(0.5, -0.2), offset=(3.0, 1.0)):
    time = DT * np.arange(samples)[:, None]
    return np.asarray(offset) + time * np.asarray(velocity)


TRAINED_ELSEWHERE = ("MixtureDensity", "SingleGaussian")
"""Trainings are long; test_predictors_mixture* fit these once and hold the copies to the laws."""

SLOW_FITS = ("BayesianVectorAutoregression", "Corrected", "FallbackChain")


@cache
def few_people():
    """Half of the people whom the check draws by default."""
    return [one.select(range(6)) for one in draw_recordings(2, np.random.default_rng(0))]


def built_in_laws(predictor):
    name = type(predictor).__name__
    known = {**dict.fromkeys(TRAINED_ELSEWHERE, ()), **dict.fromkeys(SLOW_FITS, few_people())}
    return check_predictor.laws(predictor, dataset=known.get(name))


CONTRACT = Contract({name: load("predictors", name) for name in BUILT_IN}, built_in_laws)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_every_built_in_keeps_the_laws(name, law):
    CONTRACT.check(name, law)


SETTINGS = Contract.of(
    [
        Static(spread_rate=1.0),
        ConstantVelocity(window=1),
        Kalman(acceleration_density=1e-4),
        Oracle(fallback=Static()),
        VectorAutoregression(gate=False, minimum_history=4),
        VectorAutoregression(covariance="paper", integration="trapezoid"),
        VectorAutoregression(covariance="paper-literal", order=1, fallback=ConstantVelocity()),
    ],
    lambda one: check_predictor.laws(one, dimensions=(2,), rng=np.random.default_rng(8)),
)


@pytest.mark.parametrize(("predictor", "law"), SETTINGS.cases())
def test_settings_keep_the_laws(predictor, law):
    SETTINGS.check(predictor, law)


def test_same_answer_on_a_straight_line():
    tracks = tracks_of([line(80)], noise=1e-3)
    wanted = line(90)[80:]
    for predictor, tolerance in (
        (ConstantVelocity(), 1e-12),
        (Kalman(), 1e-6),
        (VectorAutoregression(), 1e-6),
    ):
        mean = predictor.predict(tracks, 10).mean[0, 0]
        assert np.abs(mean - wanted).max() < tolerance


def test_same_answer_of_a_true_var_fit_and_the_others():
    rng = np.random.default_rng(0)
    tracks = tracks_of([line(80) + 1e-6 * rng.standard_normal((80, 2))], noise=1e-3)
    forecast = VectorAutoregression().predict(tracks, 10)
    assert forecast.fallback == (None,)
    others = [p.predict(tracks, 10).mean for p in (Kalman(), ConstantVelocity())]
    for other in others:
        # One micrometre of noise, differenced and summed over ten steps.
        assert np.abs(forecast.mean - other).max() < 5e-5


@pytest.mark.parametrize("predictor", [Kalman(), ConstantVelocity(), Static(spread_rate=0.5)])
def test_late_forecasts_drop_the_steps_gone_by(predictor):
    path = line(10) + 0.02 * np.random.default_rng(1).standard_normal((10, 2))
    early = predictor.predict(tracks_of([path]), 8)
    late = predictor.predict(tracks_of([np.concatenate([path, np.full((3, 2), NAN)])]), 5)
    np.testing.assert_allclose(late.mean, early.mean[:, :, 3:], atol=1e-12)
    np.testing.assert_allclose(late.joint, early.joint[:, :, 6:, 6:], atol=1e-15)


def test_static_spreads_as_an_unknown_velocity():
    forecast = Static(spread_rate=0.4).predict(tracks_of([line(4)]), 5)
    np.testing.assert_allclose(forecast.mean[0, 0], np.tile(line(4)[-1], (5, 1)))
    times = DT * np.arange(1, 6)
    wanted = 0.02**2 + 0.01**2 + 0.16 * np.outer(times, times)
    np.testing.assert_allclose(forecast.joint[0, 0], np.kron(wanted, np.eye(2)), atol=1e-15)


def simulated_drift(runs, samples, steps, density, noise, rng):
    """True and measured positions of bodies under white acceleration, (runs, T, 2)."""
    transition, process = white_acceleration(DT, density, 2)
    root = np.linalg.cholesky(process)
    state = np.concatenate([np.zeros((runs, 2)), rng.normal(0, 1.0, (runs, 2))], axis=1)
    path = np.empty((runs, samples + steps, 2))
    for k in range(samples + steps):
        path[:, k] = state[:, :2]
        state = state @ transition.T + rng.standard_normal((runs, 4)) @ root.T
    return path, path + noise * rng.standard_normal(path.shape)


@pytest.mark.parametrize("window", [1, 4])
def test_constant_velocity_covariance_against_simulation(window, monkeypatch):
    monkeypatch.setattr(constant_velocity, "NOISE_FLOOR", 1e-9)
    rng, runs, density, noise = np.random.default_rng(0), 3000, 0.05, 0.05
    truth, seen = simulated_drift(runs, 8, 6, density, noise, rng)
    predictor = ConstantVelocity(window, density)
    forecast = predictor.predict(tracks_of(seen[:, :8], noise), 6)
    error = (truth[:, 8:] - forecast.mean[:, 0]).reshape(runs, -1)
    joint = forecast.joint[0, 0]
    spread = np.sqrt((np.outer(np.diag(joint), np.diag(joint)) + joint**2) / runs)
    outside = np.abs(error.T @ error / runs - joint) > 3 * spread
    assert outside.mean() < 0.02


def test_constant_velocity_with_gaps_uses_observed_samples_alone():
    path = line(8)
    path[[2, 3]] = NAN
    path[0] += 5.0  # would be used if the missing ones were passed over too far
    forecast = ConstantVelocity(window=4).predict(tracks_of([path]), 3)
    np.testing.assert_allclose(forecast.mean[0, 0], line(11)[8:], atol=1e-12)


def test_one_sample_is_taken_as_standing():
    forecast = ConstantVelocity(speed=2.0).predict(tracks_of([line(1)]), 4)
    assert forecast.fallback == ("constant_velocity: 1 sample, needs 2",)
    np.testing.assert_allclose(forecast.mean[0, 0], np.tile(line(1), (4, 1)))
    assert forecast.covariance[0, 0, 3, 0, 0] > 2.0**2 * (4 * DT) ** 2


@pytest.mark.parametrize("missing", [[], [2, 3, 6]])
def test_kalman_equals_conditioning_of_the_joint_gaussian(missing):
    density, noise, samples, steps = 0.07, 0.05, 9, 4
    _, seen = simulated_drift(1, samples, 0, density, noise, np.random.default_rng(3))
    seen[0, missing] = NAN
    predictor = Kalman(density, speed=1.3, noise_floor=0.02)
    forecast = predictor.predict(tracks_of(seen, noise), steps)

    # All positions in one Gaussian, conditioned on what was seen: no recursion at all.
    spread = noise**2 + 0.02**2
    transition, process = white_acceleration(DT, density, 1)
    prior = np.diag([spread, 1.3**2])
    powers = [np.linalg.matrix_power(transition, k) for k in range(samples + steps)]
    shocks = [powers[0], *powers]
    count = samples + steps
    joint = np.zeros((count, count))
    for j in range(count):
        for h in range(count):
            total = powers[j] @ prior @ powers[h].T
            for k in range(1, min(j, h) + 1):
                total = total + shocks[j - k + 1] @ process @ shocks[h - k + 1].T
            joint[j, h] = total[0, 0]
    known = [k for k in range(1, samples) if k not in missing]
    ahead = list(range(samples, count))
    gain = joint[np.ix_(ahead, known)] @ np.linalg.inv(
        joint[np.ix_(known, known)] + spread * np.eye(len(known))
    )
    mean = seen[0, 0] + gain @ (seen[0, known] - seen[0, 0])
    wanted = joint[np.ix_(ahead, ahead)] - gain @ joint[np.ix_(known, ahead)]
    np.testing.assert_allclose(forecast.mean[0, 0], mean, atol=1e-10)
    np.testing.assert_allclose(forecast.joint[0, 0], np.kron(wanted, np.eye(2)), atol=1e-10)


def test_kalman_is_calibrated_on_its_own_model():
    rng, runs = np.random.default_rng(4), 400
    truth, seen = simulated_drift(runs, 10, 6, 0.05, 0.05, rng)
    forecast = Kalman(0.05, speed=1.0, noise_floor=1e-6).predict(tracks_of(seen[:, :10], 0.05), 6)
    error = truth[:, 10:] - forecast.mean[:, 0]
    inverse = np.linalg.inv(forecast.covariance[:, 0])
    inside = np.einsum("oni,onij,onj->on", error, inverse, error) < chi2.ppf(0.9, 2)
    assert (np.abs(inside.mean(axis=0) - 0.9) < 3 * np.sqrt(0.09 / runs)).all()


def truth_of(tracks, seconds, ids):
    times = tracks.stamp + np.arange(-2.0, seconds + 1e-9, 0.2)
    path = np.stack([times - tracks.stamp, (times - tracks.stamp) ** 2], axis=1)
    return Truth(times, {ident: path for ident in ids})


def test_oracle_reads_the_truth_on_its_own_clock():
    tracks = tracks_of([line(5), line(5)], stamp=100.0)
    scene = Scene(truth=truth_of(tracks, 5.0, ["o1"]), goals=np.array([[1.0, 2.0], [3.0, 4.0]]))
    forecast = Oracle(spread=0.01).predict(tracks, 6, scene)
    times = DT * np.arange(1, 7)
    np.testing.assert_allclose(forecast.mean[1, 0, :, 0], times, atol=1e-12)
    np.testing.assert_allclose(forecast.mean[1, 0, :, 1], times**2, atol=0.2**2 / 4 + 1e-12)
    np.testing.assert_allclose(forecast.covariance[1, 0], np.tile(1e-4 * np.eye(2), (6, 1, 1)))
    assert forecast.fallback == ("oracle: the truth does not hold o0", None)
    filtered = Kalman().predict(tracks, 6)
    np.testing.assert_array_equal(forecast.mean[0], filtered.mean[0])


def test_oracle_says_why_it_cannot_know():
    tracks = tracks_of([line(5)], stamp=10.0)
    assert Oracle().predict(tracks, 4).fallback == ("oracle: no truth given",)
    scene = Scene(truth=truth_of(tracks, 1.0, ["o0"]))
    reason = Oracle().predict(tracks, 4, scene).fallback[0]
    assert reason == "oracle: the truth spans 8 to 11 s, needs 10.5 to 12 s"
    unknown = Truth(np.arange(3.0), {"o0": np.full((3, 2), NAN)})
    reason = Oracle().predict(tracks, 4, Scene(truth=unknown)).fallback[0]
    assert reason == "oracle: the truth spans nothing, needs 10.5 to 12 s"


@dataclass(frozen=True)
class TwoModes(Predictor):
    """Left or right; insists on one goal per obstacle."""

    def predict(self, tracks, steps, scene=None):
        assert scene.goals.shape == (len(tracks), 2)
        mean = np.stack([scene.goals, -scene.goals], axis=1)[:, :, None].repeat(steps, axis=2)
        spread = np.tile(np.eye(2), (len(tracks), 2, steps, 1, 1))
        weight = np.tile([0.25, 0.75], (len(tracks), 1))
        return Forecast(mean, spread, weight, tracks.dt, (None,) * len(tracks))


def test_a_fallback_may_have_several_modes():
    tracks = tracks_of([line(5)] * 3)
    goals = np.arange(6.0).reshape(3, 2)
    scene = Scene(truth=truth_of(tracks, 5.0, ["o1"]), goals=goals)
    forecast = Oracle(fallback=TwoModes()).predict(tracks, 3, scene)
    np.testing.assert_array_equal(forecast.weight, [[0.25, 0.75], [1, 0], [0.25, 0.75]])
    np.testing.assert_array_equal(forecast.mean[2, :, 0], [goals[2], -goals[2]])
    assert forecast.joint is None


def test_never_observed_is_a_reason_and_a_wide_finite_spread():
    forecast = Kalman().predict(tracks_of([np.full((4, 2), NAN)]), 3)
    assert forecast.fallback == ("kalman: never observed",)
    np.testing.assert_array_equal(forecast.covariance[0, 0, 2], 1e6 * np.eye(2))


@pytest.mark.parametrize(
    ("maker", "words"),
    [
        (lambda: Static(spread_rate=-1.0), "static.spread_rate is -1"),
        (lambda: ConstantVelocity(window=0), "constant_velocity.window is 0"),
        (lambda: Kalman(acceleration_density=0.0), "kalman.acceleration_density is 0"),
        (lambda: Kalman(speed=0.0), "kalman.speed is 0"),
        (lambda: Oracle(spread=0.0), "oracle.spread is 0"),
    ],
)
def test_bad_settings_are_refused_by_name(maker, words):
    with pytest.raises(WideberthError, match=words):
        maker()


@dataclass(frozen=True)
class Broken(Predictor):
    """Static, with one law broken."""

    law: str

    def predict(self, tracks, steps, scene=None):
        good = Static().predict(tracks, steps, scene)
        if self.law == "never raises" and not np.isfinite(tracks.positions[:, -1]).all():
            raise ValueError("cannot handle NaN")
        if self.law == "shape":
            return replace(Static().predict(tracks, steps + 1, scene))
        if self.law == "pure" and len(tracks):
            shake = np.random.default_rng().standard_normal()
            return replace(good, mean=good.mean + shake)
        if self.law == "translation":
            return replace(good, mean=good.mean * 1.01)
        if self.law == "step 4 of track 'stopped'":
            moved = good.mean.copy()
            if "stopped" in tracks.ids:
                moved[tracks.ids.index("stopped"), :, 3] += np.random.default_rng().random()
            return replace(good, mean=moved)
        if self.law == "rotation":
            return replace(good, mean=good.mean + np.eye(tracks.dimension)[0])
        if self.law == "order":
            # Direction and size follow the track, but only the first in the list is moved.
            step = np.diff(tracks.positions[:1, -9:-7], axis=1)
            shifted = good.mean.copy()
            shifted[:1] += np.nan_to_num(step)[:, None]
            return replace(good, mean=shifted)
        return good


@pytest.mark.parametrize(
    ("broken", "law", "message"),
    [
        ("never raises", "shapes, finite, symmetric, PSD", "^predict raised ValueError"),
        (
            "step 4 of track 'stopped'",
            "pure",
            "^a second call gives another .* step 4 of track 's",
        ),
        ("step 4 of track 'stopped'", "translation equivariant", "^step 4 of track 'stopped'"),
        ("shape", "shapes, finite, symmetric, PSD", "^shape of mean"),
        ("pure", "pure", "^a second call gives another forecast"),
        ("translation", "translation equivariant", "^step 1 of .* mean differs by"),
        ("rotation", "rotation equivariant", "^step 1 of .* mean differs by"),
        ("order", "order independent", "^step 1 of .* mean differs by"),
    ],
)
def test_the_check_finds_each_broken_law(broken, law, message):
    found = {one.name: one for one in check_predictor.laws(Broken(broken), dimensions=(2,))}
    with pytest.raises(AssertionError, match=message):  # which does not say the law once more
        found[law].check()


def test_the_check_names_the_track_that_raises():
    with pytest.raises(AssertionError, match=r"cannot handle NaN.*track 'not seen lately'"):
        check_predictor(Broken("never raises"), dimensions=(2,))


def test_the_check_names_the_broken_laws():
    check_predictor(Broken("none"), dimensions=(2,))
    with pytest.raises(AssertionError) as caught:
        check_predictor(Broken("translation"), dimensions=(2,))
    broken = {line.partition(":")[0] for line in str(caught.value).splitlines()}
    assert "translation equivariant" in broken
    assert not broken & {"pure", "rotation equivariant", "order independent"}
