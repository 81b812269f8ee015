"""On simulated people whose model is known, every rung is missed as often as it promises.

People walk as `Kalman` assumes: white acceleration, measured with noise. What is drawn here is
all they do; fits and forecasts are those of the package.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Self, final

import numpy as np
import pytest

from wideberth.controllers.levels.risk_allocation import RiskAllocation
from wideberth.framework.calibration import Calibration
from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.coverage import Event
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.episode import inside_content, squared_mahalanobis
from wideberth.predictors.calibrations.boole import Boole
from wideberth.predictors.calibrations.joint_person import JointPerson
from wideberth.predictors.calibrations.joint_plan import JointPlan
from wideberth.predictors.calibrations.per_step import PerStep
from wideberth.predictors.calibrations.sample_and_discard import SampleAndDiscard
from wideberth.predictors.calibrations.task import WholeTask
from wideberth.predictors.conformal import Conformal
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.predictors.kalman import Kalman
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse

DT, OBSERVED, STEPS, PEOPLE = 0.4, 8, 4, 4
TASK = 3
"""Rows of a task."""
NOISE = 0.05
DRAWS = 102_400
"""People who are tried, of 25 600 moments."""
MODEL = Kalman(acceleration_density=0.1)


@final
@dataclass(frozen=True)
class Exact(Predictor):
    """The model that people walk by; nothing is fitted."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return MODEL.predict(tracks, steps, scene)


def walked(count: int, rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Positions, true and as they are measured, each (count, rows, 2) m."""
    transition, process = white_acceleration(DT, MODEL.acceleration_density, 1)
    root = np.linalg.cholesky(process)
    state = rng.standard_normal((count, 2, 2)) * np.array([5.0, MODEL.speed])[:, None]
    true = np.empty((count, rows, 2))
    for row in range(rows):
        true[:, row] = state[:, 0]
        state = transition @ state + root @ rng.standard_normal((count, 2, 2))
    spread = np.hypot(NOISE, MODEL.noise_floor)
    return true, true + spread * rng.standard_normal(true.shape)


def tracks_of(positions: Array) -> Tracks:
    count = len(positions)
    noise = np.tile(NOISE**2 * np.eye(2), (count, 1, 1))
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, DT, ids, np.full(count, 0.3), noise)


def shares(outside: Array, limit: float = 4.5) -> tuple[Array, Array]:
    """Share of rows outside, by column, and how far binomial noise may take it."""
    share = outside.mean(axis=0)
    return share, limit * np.sqrt(np.maximum(share * (1 - share), 1e-9) / len(outside))


def levels_squared(policy: LevelPolicy, people: int) -> Array:
    return policy.levels(MahalanobisEllipse(), STEPS, people, 2)[:, 0] ** 2


@cache
def gaussian() -> tuple[Forecast, Array]:
    """A forecast of many people, and squared distances of their true futures from it."""
    true, seen = walked(DRAWS, OBSERVED + STEPS, np.random.default_rng(0))
    forecast = MODEL.predict(tracks_of(seen[:, :OBSERVED]), STEPS)
    square = squared_mahalanobis(
        forecast.mean[:, 0], forecast.covariance[:, 0], true[:, OBSERVED:]
    )
    return forecast, square


@pytest.mark.parametrize("tail", [0.05, 0.2])
def test_a_fixed_level_is_missed_by_its_tail_at_every_step(tail: float) -> None:
    share, error = shares(gaussian()[1] > levels_squared(Fixed(tail), PEOPLE))
    assert (np.abs(share - tail) < error).all()


@pytest.mark.parametrize("growth", [0.0, 1.0])
def test_an_allocated_risk_is_that_of_steps_and_bounds_that_of_plans(growth: float) -> None:
    policy = RiskAllocation(0.2, growth)
    outside = gaussian()[1] > levels_squared(policy, PEOPLE)
    share, error = shares(outside)
    tails = policy.tails(STEPS, PEOPLE)
    assert (np.abs(share - tails) < error).all()
    assert PEOPLE * tails.sum() == pytest.approx(0.2)
    each = outside.reshape(-1, PEOPLE, STEPS)
    share, error = shares(each.any(axis=1))
    assert (np.abs(share - (1 - (1 - tails) ** PEOPLE)) < error).all()
    plan, error = shares(each.any(axis=(1, 2))[:, None])
    assert plan[0] < 0.2 + error[0]
    assert plan[0] < 1 - np.prod(1 - tails) ** PEOPLE  # steps of one person resemble each other


def test_of_independent_steps_the_misses_multiply() -> None:
    forecast = gaussian()[0]
    few = Forecast(
        forecast.mean[:PEOPLE], forecast.covariance[:PEOPLE], forecast.weight[:PEOPLE], DT,
        (None,) * PEOPLE,
    )  # fmt: skip
    drawn = few.sample(np.random.default_rng(1), DRAWS)
    square = squared_mahalanobis(few.mean[:, 0], few.covariance[:, 0], drawn)
    policy = RiskAllocation(0.3)
    outside = square > levels_squared(policy, PEOPLE)
    share, error = shares(outside.any(axis=(1, 2))[:, None])
    wanted = 1 - np.prod(1 - policy.tails(STEPS, PEOPLE)) ** PEOPLE
    assert abs(share[0] - wanted) < error[0]


FIRST, ROWS = OBSERVED, 2 * OBSERVED
"""Row of the first forecast that calibrates, at half of the rows of a recording; four rows have a
whole horizon after them, of which one is a moment that counts, and three are a task."""


def recordings(count: int, rng: np.random.Generator, people: int) -> list[Tracks]:
    """Recordings of which the second half has one moment, or one task, that counts."""
    _, seen = walked(count * people, ROWS, rng)
    return [tracks_of(part) for part in seen.reshape(count, people, ROWS, 2)]


@cache
def novel(people: int) -> Array:
    """Squared distances from the base's forecasts of new people, (TASK, moments, people, N)."""
    _, seen = walked(DRAWS, FIRST + TASK + STEPS, np.random.default_rng(2))
    squares = []
    for row in range(FIRST, FIRST + TASK):
        past = tracks_of(seen[:, row + 1 - OBSERVED : row + 1])
        forecast = Exact().predict(past, STEPS)
        future = seen[:, row + 1 : row + 1 + STEPS]
        squares.append(squared_mahalanobis(forecast.mean[:, 0], forecast.covariance[:, 0], future))
    return np.reshape(squares, (TASK, -1, people, STEPS))


def missed(fitted: Conformal, event: Event) -> Array:
    """Share of the new events that are missed, of one step (N,) or of all (1,)."""
    assert fitted.fitted is not None
    sizes = np.array(fitted.fitted.scale) * content_bound(2, fitted.tail)
    outside = novel(PEOPLE) > sizes
    if event is Event.TASK:
        return outside.any(axis=(0, 2, 3)).mean(keepdims=True)
    if event is Event.PLAN:
        return outside[0].any(axis=(1, 2)).mean(keepdims=True)
    if event is Event.PERSON:
        return outside[0].any(axis=2).mean(keepdims=True)
    return np.asarray(outside[0].mean(axis=(0, 1)))


SPAN = WholeTask(seconds=TASK * DT)
CASES: list[tuple[Calibration, float, int]] = [
    (PerStep(), 0.1, 25),
    (PerStep(), 0.04, 25),
    (JointPerson(), 0.1, 14),
    (JointPlan(), 0.1, 19),
    (JointPlan(), 0.07, 14),
    (SPAN, 0.1, 14),
    (SampleAndDiscard(0.1), 0.2, 18),
    (Boole(), 0.2, 19),
]
FITS = 80


@pytest.mark.parametrize(("calibration", "tail", "count"), CASES)
def test_a_fitted_promise_is_kept(calibration: Calibration, tail: float, count: int) -> None:
    """Over many fits to few recordings, of new people: as ranks say, and the tail at most."""
    rng = np.random.default_rng(4)
    event, shares = calibration.coverage.event, []
    single = event in (Event.STEP, Event.PERSON)
    own = Conformal(Exact(), tail, calibration, OBSERVED, STEPS)
    for _ in range(FITS):
        if isinstance(calibration, PerStep):  # one whole window each
            scenes = [tracks_of(walked(count, OBSERVED + STEPS, rng)[1])]
        else:
            scenes = recordings(count, rng, 1 if single else PEOPLE)
        fitted = own.fit(scenes)
        assert fitted.fitted is not None and fitted.fitted.groups == count
        shares.append(missed(fitted, event))
    mean = np.mean(shares, axis=0)
    error = 3.5 * np.std(shares, axis=0) / np.sqrt(FITS) + 3.5 * np.sqrt(tail / DRAWS * PEOPLE)
    wanted = np.floor((count + 1) * tail + 1e-9) / (count + 1)
    if isinstance(calibration, SampleAndDiscard):
        wanted = (calibration.discarded(count, tail) + 1) / (count + 1)
        assert np.mean(np.array(shares) > tail) < calibration.beta + 4.5 * np.sqrt(0.09 / FITS)
    assert (mean < tail + error).all()
    if not isinstance(calibration, Boole):
        assert (np.abs(mean - wanted) < error).all() and (error < 1 / (count + 1)).all()


def test_the_forecast_has_the_regions_that_were_fitted() -> None:
    """What `missed` takes from the fit is what a planner is given."""
    rng = np.random.default_rng(5)
    fitted = Conformal(Exact(), 0.1, JointPlan(), OBSERVED, STEPS).fit(recordings(12, rng, PEOPLE))
    _, seen = walked(400, OBSERVED + STEPS, rng)
    past = tracks_of(seen[:, :OBSERVED])
    base, ours = Exact().predict(past, STEPS), fitted.predict(past, STEPS)
    future = seen[:, OBSERVED:]
    within = inside_content(ours.mean[:, 0], ours.covariance[:, 0], future, 0.1)
    assert fitted.fitted is not None
    sizes = np.array(fitted.fitted.scale) * content_bound(2, 0.1)
    square = squared_mahalanobis(base.mean[:, 0], base.covariance[:, 0], future)
    np.testing.assert_array_equal(within, square <= sizes)
    assert fitted.coverage is JointPlan.coverage


@final
@dataclass(frozen=True)
class Student(Fittable):
    """Remembers how many rows it was fitted to."""

    rows: tuple[int, ...] = ()

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        return replace(self, rows=tuple(one.positions.shape[1] for one in dataset))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        return MODEL.predict(tracks, steps, scene)


def test_a_base_gets_the_first_halves_and_the_second_ones_calibrate() -> None:
    rng = np.random.default_rng(6)
    scenes = recordings(12, rng, PEOPLE)
    own = Conformal(Student(), 0.1, JointPlan(), OBSERVED, STEPS)
    fitted = own.fit(scenes)
    assert fitted.base == Student((FIRST,) * 12)
    assert fitted.fitted == replace(own, base=Exact()).fit(scenes).fitted
    others = recordings(12, rng, PEOPLE)
    for part, same in ((slice(FIRST + 1 + STEPS, None), True), (slice(FIRST + 1, None), False)):
        changed = []  # after the one horizon that counts nothing matters, in it everything does
        for scene, other in zip(scenes, others, strict=True):
            positions = scene.positions.copy()
            positions[:, part] = other.positions[:, part]
            changed.append(replace(scene, positions=positions))
        assert (own.fit(changed).fitted == fitted.fitted) == same
