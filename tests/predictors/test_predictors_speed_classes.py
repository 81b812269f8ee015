"""Calibration by class of speed, where it starts, and corrections learnt from recordings."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pytest

from wideberth.experiments.studies.crowd import DATA
from wideberth.framework.plugins.config import load_plugin, save_plugin
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.calibration import seen_at
from wideberth.predictors.corrected import Corrected, Corrections
from wideberth.predictors.data.recordings import read_tracks
from wideberth.predictors.data.windows import cut_windows
from wideberth.predictors.interacting_models import InteractingModels

DT, STEPS = 0.5, 4


@final
@dataclass(frozen=True)
class Straight(Predictor):
    """Goes on at the last step's velocity, with a deviation of 0.1 m per step."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        ahead = np.arange(1.0, steps + 1)[:, None]
        newest, before = (np.nan_to_num(tracks.positions[:, -k]) for k in (1, 2))
        mean = newest[:, None] + ahead * (newest - before)[:, None]
        spread = (0.1 * ahead[..., None]) ** 2 * np.eye(2)
        return Forecast.single(mean, np.tile(spread, (len(tracks), 1, 1, 1)), tracks.dt)


def tracks_of(positions: Array, dt: float = DT) -> Tracks:
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count))
    spread = np.tile(1e-6 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, names, np.full(count, 0.3), spread)


def drifting(
    rng: np.random.Generator, count: int, rows: int, speed: float, spread: float
) -> Array:
    """Constant speed on average, whose velocity wanders by ``spread`` in each step."""
    push = spread * rng.standard_normal((count, rows, 2))
    angle = rng.uniform(-np.pi, np.pi, count)
    velocity = speed * np.stack([np.cos(angle), np.sin(angle)], axis=1)[:, None] + push
    return np.cumsum(DT * velocity, axis=1)


def played(predictor: AdaptiveConformal, scene: Tracks) -> tuple[AdaptiveConformal, Array]:
    """Update row by row; coverage of every forecast of the last half."""
    held = []
    rows = scene.positions.shape[1]
    for row in range(4, rows):
        seen = seen_at(scene, row, 4)[0]
        predictor = predictor.update(seen)
        if rows // 2 < row < rows - STEPS:
            forecast = predictor.predict(seen, STEPS)
            gap = scene.positions[:, row + 1 : row + 1 + STEPS] - forecast.mean[:, 0]
            inverse = np.linalg.inv(forecast.covariance[:, 0])
            held.append(np.einsum("ond,ondi,oni->on", gap, inverse, gap) <= -2 * np.log(0.05))
    return predictor, np.array(held)


def test_who_stands_and_who_walks_are_covered_alike() -> None:
    """Standers move by centimetres, walkers by decimetres: one scale covers 100 and 90 %."""
    rng = np.random.default_rng(0)
    stand, walk = drifting(rng, 10, 400, 0.0, 0.03), drifting(rng, 10, 400, 1.2, 0.2)
    scene = tracks_of(np.concatenate([stand, walk]))
    covers = {}
    for speeds in ((), (0.4,)):
        made = AdaptiveConformal(Straight(), rate=0.2, observed=2, steps=STEPS, speeds=speeds)
        after, held = played(made, scene)
        assert after.state is not None and len(after.state.log_scale) == (len(speeds) + 2) * STEPS
        covers[speeds] = held[:, :10].mean(), held[:, 10:].mean()
    assert covers[()][0] > 0.995 and covers[()][1] < 0.92
    assert all(abs(cover - 0.95) < 0.015 for cover in covers[(0.4,)])
    scales = np.reshape(after.state.log_scale, (3, STEPS))
    assert (scales[0] < scales[1] - 2).all()


def appearing(rng: np.random.Generator, rows: int) -> Tracks:
    """Ten who stand, and at every second row one who walks in and is seen for six rows."""
    stand = drifting(rng, 10, rows, 0.0, 0.03)
    walks = np.full((rows // 2, rows, 2), np.nan)
    for one, walk in enumerate(walks):
        walk[2 * one : 2 * one + 6] = drifting(rng, 1, 6, 1.2, 0.1)[0, : rows - 2 * one]
    return tracks_of(np.concatenate([stand, walks]))


@final
@dataclass(frozen=True)
class OnceSeen(Predictor):
    """Stays where it is, with the deviation of a walker if seen once, else of one who stands."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        known = np.isfinite(tracks.positions).all(axis=2)
        wide = np.where(known.sum(axis=1) == 1, 0.3, 0.1)[:, None] * np.arange(1.0, steps + 1)
        mean = np.repeat(np.nan_to_num(tracks.positions[:, -1:]), steps, axis=1)
        return Forecast.single(mean, (wide**2)[..., None, None] * np.eye(2), tracks.dt)


def test_who_has_just_appeared_has_a_scale_of_his_own() -> None:
    """He shows no speed: with those who stand, who hardly move, he would lose his region."""
    scene = appearing(np.random.default_rng(5), 600)
    predictor = AdaptiveConformal(OnceSeen(), rate=0.1, steps=2, speeds=(5.0,))
    inside = []
    for row in range(600 - 2):
        seen, present = seen_at(scene, row, 8)
        predictor = predictor.update(seen)
        new = np.isfinite(seen.positions).all(axis=2).sum(axis=1) == 1
        if row > 200 and new.any():
            forecast = predictor.predict(seen, 2)
            gap = scene.positions[present, row + 1] - forecast.mean[:, 0, 0]
            square = np.sum(gap[new] ** 2, axis=1) / forecast.covariance[new, 0, 0, 0, 0]
            inside += (square <= -2 * np.log(0.05)).tolist()
    assert len(inside) > 190
    assert abs(np.mean(inside) - 0.95) < 0.03


def test_a_fit_starts_where_the_recordings_are_covered() -> None:
    rng = np.random.default_rng(1)
    both = [drifting(rng, 20, 60, 0.0, 0.01), drifting(rng, 20, 60, 1.2, 0.2)]
    scenes = [tracks_of(np.concatenate(both)), tracks_of(drifting(rng, 9, 60, 1.2, 0.2))]
    unfitted = AdaptiveConformal(Straight(), observed=2, steps=STEPS, speeds=(0.4, 3.0))
    fitted = unfitted.fit(scenes)
    assert fitted.start is not None and fitted.start_dt == DT
    start = np.reshape(fitted.start, (4, STEPS))
    windows = cut_windows(scenes[0], 2, STEPS)
    forecast = fitted.predict(windows.tracks, STEPS)
    gap = windows.future - forecast.mean[:, 0]
    square = np.einsum("ond,ondi,oni->on", gap, np.linalg.inv(forecast.covariance[:, 0]), gap)
    stands = windows.obstacle < 20
    for own in (stands, ~stands):
        assert abs((square[own] <= -2 * np.log(0.05)).mean(axis=0) - 0.95).max() < 0.02
    for none in (2, 3):  # none is that fast, and all have been seen twice
        assert np.allclose(start[none], _pooled(unfitted, scenes), atol=1e-9)
    learnt = fitted.update(windows.tracks.select([0]))
    assert learnt.state is not None and np.allclose(learnt.state.log_scale, fitted.start)


def _pooled(predictor: AdaptiveConformal, scenes: list[Tracks]) -> Array:
    return np.reshape(replace(predictor, speeds=()).fit(scenes).start, (2, STEPS))[0]


def test_a_start_is_saved(tmp_path) -> None:  # type: ignore[no-untyped-def]
    made = AdaptiveConformal(Straight(), steps=1, speeds=(), start=(0.5, 0.6), start_dt=0.4)
    plain = replace(made, base=ConstantVelocity())
    save_plugin(tmp_path / "a.json", "predictor", plain)
    assert load_plugin(tmp_path / "a.json", "predictor") == plain
    for bad, words in (
        ({"start_dt": None}, "belong together"),
        ({"start": (1.0, 2.0, 3.0)}, r"adaptive_conformal\.start"),
        ({"speeds": (0.5, 0.1)}, "increasing"),
    ):
        with pytest.raises(WideberthError, match=words):
            replace(made, **bad)  # type: ignore[arg-type]


def turning(rng: np.random.Generator, count: int, rows: int) -> Array:
    """At 1 m/s, straight or on a circle of 5 m to the left or the right, for ever."""
    rate = rng.choice([-0.2, 0.0, 0.2], count)
    angle = rng.uniform(-np.pi, np.pi, count)[:, None] + rate[:, None] * DT * np.arange(rows)
    return np.cumsum(DT * np.stack([np.cos(angle), np.sin(angle)], axis=2), axis=1)


def test_who_turns_is_learnt_to_turn() -> None:
    """The correction halves the error on other tracks, to either side, and turns with them."""
    rng = np.random.default_rng(2)
    scenes = [tracks_of(turning(rng, 30, 40)) for _ in range(2)]
    fitted = Corrected(Straight(), steps=STEPS).fit(scenes)
    assert Corrected(Straight(), steps=STEPS).fit(scenes[:1]).fitted is None, "nothing to prove it"
    windows = cut_windows(tracks_of(turning(rng, 60, 20)), 8, STEPS)
    means = [one.predict(windows.tracks, STEPS).mean[:, 0] for one in (Straight(), fitted)]
    errors = [np.linalg.norm(mean - windows.future, axis=2).mean() for mean in means]
    assert errors[1] < 0.5 * errors[0]
    check_predictor(Corrected(ConstantVelocity(), steps=STEPS, fitted=fitted.fitted))
    assert fitted.fitted is not None
    assert np.allclose(fitted.predict(windows.tracks, STEPS).covariance[:, 0],
                       Straight().predict(windows.tracks, STEPS).covariance[:, 0])  # fmt: skip


def test_what_does_not_carry_over_is_not_kept() -> None:
    """Who turns goes on turning in one recording and turns back in the other."""
    rng = np.random.default_rng(3)
    there = turning(rng, 40, 30)
    ahead = there[:, 7:8] - there[:, 6:7]
    side = np.stack([-ahead[..., 1], ahead[..., 0]], axis=2)
    off = there[:, 8:12] - there[:, 7:8] - np.arange(1, 5)[:, None] * ahead
    back = there[:, :12].copy()
    square = np.sum(side**2, axis=2, keepdims=True)
    back[:, 8:12] -= 2 * np.sum(off * side, axis=2, keepdims=True) * side / square
    scenes = [tracks_of(np.tile(part, (7, 1, 1))) for part in (there[:, :12], back)]
    assert Corrected(Straight(), steps=STEPS, observed=8).fit(scenes).fitted is None


def test_corrections_on_another_grid_are_linear_in_time_and_stay_beyond() -> None:
    table = Corrections(0.5, ((), (), ()), (((1.0, 0.0), (3.0, -1.0)),))
    got = table.at(np.zeros(1, dtype=np.int64), np.array([[0.25, 0.5, 0.75, 1.0, 9.0]]))
    assert np.allclose(got[0], [[0.5, 0], [1, 0], [2, -0.5], [3, -1], [3, -1]])


def test_the_default_is_fitted_to_the_shipped_people() -> None:
    """The recommended predictor keeps the laws, fitted and not, and its JSON is all of it."""
    scenes = [read_tracks(DATA / name, dt=0.4).scene() for name in ("crowd.txt", "plaza.txt")]
    made = AdaptiveConformal(Corrected(InteractingModels(), classes=2))
    assert type(AdaptiveConformal().base) is type(made.base)
    fitted = made.fit(scenes)
    assert isinstance(fitted.base, Corrected) and fitted.start is not None
    check_predictor(fitted, dataset=())  # the laws of `fit` are those of what is not fitted
