"""The functional constant: its closed form against a grid, what it promises, and its forecast."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pytest

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.metrics.episode import squared_mahalanobis
from wideberth.predictors.functional_constant import (
    FunctionalConstant,
    of_everyone,
    of_those_seen,
)
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static

DT, STEPS, TAIL = 0.4, 4, 0.2


def field(places: Array, people: Array) -> Array:
    """Distance of each place (G, D) from the nearest person (K, D); NaN are not there."""
    there = people[np.isfinite(people).all(axis=1)]
    return np.asarray(np.linalg.norm(places[:, None] - there, axis=2).min(axis=1))


def forecast_of(mean: Array, weight: Array | None = None) -> Forecast:
    count, modes, _, size = mean.shape
    covariance = np.broadcast_to(np.eye(size), (*mean.shape, size))
    weight = np.full((count, modes), 1.0 / modes) if weight is None else weight
    return Forecast(mean, covariance, weight, DT, (None,) * count)


@pytest.mark.parametrize("seed", range(6))
def test_the_closed_form_is_the_sup_over_a_dense_grid(seed: int) -> None:
    """On grids of 2 cm the sup is met to a cell's diagonal, and never exceeded."""
    rng = np.random.default_rng(seed)
    predicted, true = rng.uniform(-2, 2, (3, 2, 1, 2)), rng.uniform(-2, 2, (4, 1, 2))
    true[3] = np.nan if seed % 2 else true[3]  # who has left
    found = float(np.sqrt(of_everyone(forecast_of(predicted), np.arange(3), true)[0, 0]))
    axis = np.arange(-4.0, 4.0, 0.02)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    places = np.concatenate([grid, true[np.isfinite(true[:, 0, 0]), 0]])
    gaps = field(places, predicted.reshape(-1, 2)) - field(places, true[:, 0])
    assert gaps.max() == pytest.approx(found, abs=1e-9)
    assert found - 0.06 < gaps[: len(grid)].max() <= found + 1e-9


def test_newcomers_count_and_light_modes_do_not() -> None:
    mean = np.zeros((1, 2, 1, 2))
    mean[0, 1] = (6.0, 0.0)
    future = np.array([[[0.0, 1.0]], [[6.0, 2.0]]])  # the second was not there before
    both = forecast_of(mean, np.array([[0.9, 0.1]]))
    assert of_everyone(both, np.arange(1), future)[0, 0] == pytest.approx(4.0)
    light = forecast_of(mean, np.array([[0.999, 0.001]]))
    assert of_everyone(light, np.arange(1), future)[0, 0] == pytest.approx(40.0)
    seen = of_those_seen(both, np.arange(1), future)
    assert seen[0, 0] == pytest.approx(1.0)
    nobody = np.full((2, 1, 2), np.nan)
    assert of_everyone(both, np.arange(1), nobody)[0, 0] == 0.0


@final
@dataclass(frozen=True)
class Stay(Predictor):
    """Everyone stays."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        mean = np.repeat(tracks.positions[:, None, -1:], steps, axis=2)
        return forecast_of(mean)


def world(rng: np.random.Generator, rows: int, people: int = 3) -> Tracks:
    """Random walks; the last person comes or goes at a random row, or is there throughout."""
    steps = 0.2 * rng.standard_normal((people, rows, 2))
    positions = 4.0 * np.arange(people)[:, None, None] + steps.cumsum(axis=1)
    turn, comes = rng.integers(rows), rng.random() < 0.5
    positions[-1, (np.arange(rows) < turn) == comes] = np.nan
    ids = tuple(f"o{i}" for i in range(people))
    noise = np.tile(1e-4 * np.eye(2), (people, 1, 1))
    return Tracks(positions, DT, ids, np.full(people, 0.3), noise)


def fitted(tail: float, *scenes: Tracks, newcomers: bool = True) -> FunctionalConstant:
    return FunctionalConstant(Stay(), tail, newcomers, observed=2, steps=STEPS).fit(scenes)


def radii(predictor: FunctionalConstant) -> Array:
    assert predictor.fitted is not None
    return np.sqrt(np.array(predictor.fitted.scale) * content_bound(2, predictor.tail))


ROWS = 2 * STEPS + 2
"""Of a recording with one row to calibrate with, which has one horizon after it."""


def missed(predictor: FunctionalConstant, scene: Tracks) -> bool:
    """Whether anyone is outside of all discs at some step after the middle row."""
    row = ROWS // 2
    now = replace(scene, positions=scene.positions[:, row - 1 : row + 1])
    present = np.flatnonzero(np.isfinite(now.positions[:, -1, 0]))
    forecast = predictor.predict(now.select(present.tolist()), STEPS)
    limit = content_bound(2, predictor.tail)
    outside = False
    for step in range(STEPS):
        truth = scene.positions[:, row + 1 + step]
        truth = truth if predictor.newcomers else truth[present]
        truth = truth[np.isfinite(truth[:, 0])]
        square = squared_mahalanobis(
            forecast.mean[:, 0, step], forecast.covariance[:, 0, step], truth[:, None]
        )
        outside |= bool((square.min(axis=1) > limit).any())
    return outside


@pytest.mark.parametrize(
    ("tail", "count", "newcomers"), [(0.2, 12, True), (0.08, 12, False), (0.3, 6, False)]
)
def test_the_promise_is_kept_by_what_planners_see(
    tail: float, count: int, newcomers: bool
) -> None:
    """New worlds leave the discs as often as ranks say, and a rank less would be seen."""
    rng = np.random.default_rng(3)
    shares = []
    for _ in range(200):
        scenes = (world(rng, ROWS) for _ in range(count))
        predictor = fitted(tail, *scenes, newcomers=newcomers)
        assert predictor.fitted is not None and predictor.fitted.groups == count
        shares.append(np.mean([missed(predictor, world(rng, ROWS)) for _ in range(20)]))
    wanted = np.floor((count + 1) * tail) / (count + 1)
    error = 4.0 * np.std(shares) / np.sqrt(len(shares))
    assert abs(np.mean(shares) - wanted) < error < 1 / (count + 1)


def test_discs_of_the_learnt_radius_on_any_grid_of_time() -> None:
    rng = np.random.default_rng(5)
    predictor = fitted(TAIL, world(rng, 400))
    now = world(rng, 8).select([0, 1])
    forecast = predictor.predict(now, STEPS)
    squares = np.array(predictor.fitted.scale if predictor.fitted else ())
    wanted = squares[:, None, None] * np.eye(2)
    np.testing.assert_allclose(forecast.covariance[0, 0], wanted)
    assert forecast.joint is None and (np.diff(radii(predictor)) > 0).all()
    finer = predictor.predict(replace(now, dt=DT / 2), 2 * STEPS).covariance[0, 0, :, 0, 0]
    np.testing.assert_allclose(finer[1::2], squares)
    np.testing.assert_allclose(finer[2::2], (squares[1:] + squares[:-1]) / 2)
    assert predictor.predict(now.select([]), STEPS).mean.shape[0] == 0


def test_it_keeps_the_laws_and_is_saved(tmp_path: object) -> None:
    check_predictor(FunctionalConstant(tail=0.1, newcomers=True), dimensions=(2,))
    scenes = [world(np.random.default_rng(6), 200)]
    predictor = FunctionalConstant(Kalman(), TAIL, True, observed=4, steps=STEPS).fit(scenes)
    path = save_plugin(f"{tmp_path}/c.json", "predictor", predictor)
    again = load_plugin(path, "predictor")
    assert again == predictor == build("predictors", describe(predictor))
    assert predictor.base == Kalman().fit(
        [replace(scenes[0], positions=scenes[0].positions[:, :100])]
    )


def test_too_few_moments_and_bad_settings_are_refused() -> None:
    scene = world(np.random.default_rng(7), 40)
    with pytest.raises(WideberthError, match=r"functional_constant\.fit: .* 4 groups .* 19 at a"):
        fitted(0.05, scene)
    for settings in ({"tail": 0.0}, {"steps": 0}, {"observed": 0}):
        with pytest.raises(WideberthError, match=r"functional_constant\."):
            FunctionalConstant(Static(), **settings)
    plain = FunctionalConstant(Static()).predict(scene, 3)
    assert np.array_equal(plain.covariance, Static().predict(scene, 3).covariance)
