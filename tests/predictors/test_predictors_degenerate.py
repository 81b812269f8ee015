"""Degenerate histories, drawn by Hypothesis: every registered predictor stays sane."""

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth.framework.plugins.registry import load, names
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks

NAMES = names("predictors")
SLOW = {"game": 5, "social_force": 15}
"""Examples for predictors that simulate or solve; 50 for the others."""
NEEDS = {"constant_velocity": 2, "var": 20}
"""Samples below which these, with their defaults, cannot be what their name says."""
STEPS = 6
NAN = np.nan

KINDS = (
    "walk", "constant", "collinear", "constant velocity", "diagonal", "explosive", "jumping",
    "stopped", "circle", "tiny",
)  # fmt: skip


def history(kind: str, rows: int, size: int, rng: np.random.Generator) -> Array:
    """A history of a kind, (T, D), m."""
    count = np.arange(rows)[:, None]
    along = rng.normal(size=size)
    walk = np.cumsum(0.4 * along + 0.05 * rng.standard_normal((rows, size)), axis=0)
    if kind == "constant":
        return np.tile(along, (rows, 1))
    if kind == "collinear":
        return np.cumsum(rng.normal(0.3, 0.1, (rows, 1)), axis=0) * along
    if kind == "constant velocity":
        return 0.37 * count * along
    if kind == "diagonal":  # exact in floating point: no rounding hides a singular matrix
        return 0.5 * count * np.ones(size)
    if kind == "explosive":
        return walk + 0.01 * 1.5**count * along
    if kind == "jumping":
        return 50.0 * rng.standard_normal((rows, size))
    if kind == "stopped":
        return walk[np.minimum(count[:, 0], rows // 2)]
    if kind == "circle":
        turns = np.zeros((rows, size))
        turns[:, 0], turns[:, 1] = np.cos(0.8 * count[:, 0]), np.sin(0.8 * count[:, 0])
        return turns
    return 1e-9 * walk if kind == "tiny" else walk


@st.composite
def worlds(draw: Any) -> Tracks:
    size = draw(st.sampled_from([2, 2, 3]))
    rows = draw(st.sampled_from([1, 2, 3, 8, 9, 25, 40]))
    kinds = draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=3))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    positions = np.stack([history(kind, rows, size, rng) for kind in kinds])
    for place in positions:
        gone = draw(st.sampled_from(["nothing", "holes", "begins", "ends", "one left", "gap"]))
        low, high = sorted(rng.integers(0, rows + 1, 2))
        if gone == "holes":
            place[rng.random(rows) < 0.3, rng.integers(size)] = NAN
        elif gone == "begins":
            place[:high] = NAN
        elif gone == "ends":
            place[low:] = NAN
        elif gone == "one left":
            place[np.arange(rows) != rng.integers(rows)] = NAN
        elif gone == "gap":
            place[low:high] = NAN
    positions += draw(st.sampled_from([0.0, 0.0, 1e6]))
    dt = draw(st.sampled_from([0.4, 0.5, 0.1, 1e-3, 1e3]))
    noise = draw(st.sampled_from([0.0, 1e-6, 0.02, 1.0])) ** 2
    ids = tuple(f"{kind} {i}" for i, kind in enumerate(kinds))
    spread = np.tile(noise * np.eye(size), (len(ids), 1, 1))
    tracker = None
    if draw(st.booleans()):
        root = rng.standard_normal((len(ids), 2 * size, 1)) * draw(st.sampled_from([0.0, 0.1]))
        tracker = root @ root.swapaxes(1, 2)
    return Tracks(positions, dt, ids, np.full(len(ids), 0.3), spread, 5.0, tracker)


def hold(forecast: Forecast, tracks: Tracks, name: str) -> None:
    """Finite, PSD, and a reason where the named method cannot have been used."""
    assert forecast.mean.shape[0] == len(tracks) and forecast.steps == STEPS
    assert np.isfinite(forecast.mean).all() and np.isfinite(forecast.covariance).all()
    lowest = np.linalg.eigvalsh(forecast.covariance).min(axis=(1, 2, 3))
    largest = np.abs(forecast.covariance).max(axis=(1, 2, 3, 4))
    assert (lowest >= -1e-9 * largest).all()
    samples = np.isfinite(tracks.positions).all(axis=2).sum(axis=1)
    for count, reason in zip(samples, forecast.fallback, strict=True):
        assert reason is None or (reason and "nan" not in reason)
        assert reason is not None or count >= NEEDS.get(name, 1)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_upsets_a_predictor(name: str) -> None:
    predictor = load("predictors", name)()

    @settings(max_examples=SLOW.get(name, 50), derandomize=True, deadline=None, database=None)
    @given(worlds())
    def check(tracks: Tracks) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            hold(predictor.predict(tracks, STEPS), tracks, name)
            goals = np.nan_to_num(tracks.positions[:, -1]) + 3.0
            plan = np.zeros((STEPS, tracks.dimension))
            scene = Scene(plan=plan, goals=goals)
            hold(predictor.predict(tracks, STEPS, scene), tracks, name)
            if isinstance(predictor, Adaptive):
                updated = predictor.update(tracks)
                later = replace(tracks, stamp=tracks.stamp + tracks.dt)
                hold(updated.update(later).predict(later, STEPS), later, name)

    check()


def single(path: Array, dt: float = 0.5) -> Tracks:
    size = path.shape[1]
    return Tracks(path[None], dt, ("one",), np.array([0.3]), 1e-4 * np.eye(size)[None], 9.0)


def walk(rows: int = 40) -> Array:
    rng = np.random.default_rng(3)
    return np.cumsum([0.4, -0.2] + 0.03 * rng.standard_normal((rows, 2)), axis=0)


PLAIN = [
    name
    for name in NAMES
    if name
    not in {"conformal", "adaptive_conformal", "empirical", "reacting_people", "social_force"}
]
"""The tables of the others count steps from the newest row, not from the newest observed sample;
and so do roll-outs, which begin when everybody is where they are now."""


@pytest.mark.parametrize("name", NAMES)
def test_rows_before_a_track_begins_say_nothing(name: str) -> None:
    predictor = load("predictors", name)()
    path = walk(25)
    padded = np.concatenate([np.full((30, 2), NAN), path])
    first, second = (predictor.predict(single(one), STEPS) for one in (path, padded))
    assert np.allclose(first.mean, second.mean, rtol=0, atol=1e-9)
    assert np.allclose(first.covariance, second.covariance, rtol=1e-9, atol=1e-12)
    assert first.fallback == second.fallback


@pytest.mark.parametrize("name", PLAIN)
def test_a_track_that_ended_is_forecast_from_where_it_ended(name: str) -> None:
    """Three unseen rows cost three steps: the forecast is the tail of the one made then."""
    predictor = load("predictors", name)()
    ended = np.concatenate([walk(), np.full((3, 2), NAN)])
    then = predictor.predict(single(walk()), STEPS + 3)
    now = predictor.predict(single(ended), STEPS)
    assert np.allclose(now.mean, then.mean[:, :, 3:], rtol=0, atol=1e-9)
    assert np.allclose(now.covariance, then.covariance[:, :, 3:], rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_who_has_stopped_is_not_sent_on(name: str) -> None:
    """Twelve samples after a stop: the mean stays within 0.5 m for 3 s."""
    path = walk()
    path[-12:] = path[-13]
    forecast = load("predictors", name)().predict(single(path), STEPS)
    mean = np.einsum("om,omnd->ond", forecast.weight, forecast.mean)
    assert np.linalg.norm(mean[0] - path[-1], axis=1).max() < 0.5


@dataclass(frozen=True)
class Leaky(Predictor):
    """Breaks one law: it names none of its failures."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = load("predictors", "static")().predict(tracks, steps)
        return replace(forecast, fallback=(None,) * len(tracks))


@dataclass(frozen=True)
class Noisy(Predictor):
    """Breaks another: NumPy warns."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        np.sqrt(np.array([-1.0]))
        return load("predictors", "static")().predict(tracks, steps)  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Torn(Predictor):
    """Breaks a third: the joint covariance is that of something else."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = load("predictors", "static")().predict(tracks, steps)
        return replace(forecast, joint_source=2.0 * forecast.joint)


@dataclass(frozen=True)
class Forgetful(Adaptive):
    """Breaks a fourth: an update changes the copy that it was made from."""

    seen: list[int]

    def update(self, tracks: Tracks, scene: Scene | None = None) -> "Forgetful":  # type: ignore[override]
        self.seen.append(len(tracks))
        return self

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = load("predictors", "static")().predict(tracks, steps)
        return replace(forecast, covariance=(1 + len(self.seen)) * forecast.covariance,
                       joint_source=None)  # fmt: skip


@pytest.mark.parametrize(
    ("predictor", "law"),
    [
        (Leaky(), "a reason for an obstacle never observed"),
        (Noisy(), "predict raised RuntimeWarning"),
        (Torn(), "step 1 of track 'ordinary', .*: joint covariance differs by"),
        (Forgetful([]), "a second call gives another forecast: step 1 of .*, after updates"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_the_check_finds_each_broken_law(predictor: Predictor, law: str) -> None:
    with pytest.raises(AssertionError, match=law):
        check_predictor(predictor, dimensions=(2,))
