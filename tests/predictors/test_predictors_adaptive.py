"""Online conformal calibration: its bound, its bookkeeping, and no look into the future."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Truth
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import LIMIT, AdaptiveConformal
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.calibration import seen_at
from wideberth.predictors.empirical import Empirical
from wideberth.predictors.oracle import Oracle

DT, OBSERVED, STEPS, TAIL, RATE = 0.5, 2, 3, 0.1, 0.2
SIZE = chi2.ppf(1 - TAIL, 2)


@final
@dataclass(frozen=True)
class Stay(Predictor):
    """Stays where it is, with a standard deviation of ``spread`` times sqrt(step)."""

    spread: float = 1.0

    def predict(self, tracks, steps, scene=None):
        count, size = len(tracks), tracks.dimension
        mean = np.repeat(np.nan_to_num(tracks.positions[:, -1:]), steps, axis=1)
        variance = self.spread**2 * np.arange(1.0, steps + 1)[:, None, None] * np.eye(size)
        return Forecast.single(mean, np.tile(variance, (count, 1, 1, 1)), tracks.dt)


def tracks_of(positions, stamp=0.0, dt=DT, ids=None):
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count)) if ids is None else ids
    spread = np.tile(1e-4 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, names, np.full(count, 0.3), spread, stamp)


def adaptive(base=None, **settings):
    given = {"tail": TAIL, "rate": RATE, "observed": OBSERVED, "steps": STEPS, "speeds": ()}
    given |= settings
    return AdaptiveConformal(Stay() if base is None else base, **given)


def recording(rng, count=6, rows=60):
    """Random walks that come, go and come back."""
    positions = rng.standard_normal((count, rows, 2)).cumsum(axis=1)
    positions[0, 20:33] = np.nan
    positions[1, :15] = np.nan
    positions[2, 40:] = np.nan
    positions[rng.random((count, rows)) < 0.1] = np.nan
    return tracks_of(positions, stamp=DT * (rows - 1))


def played(predictor, scene, rows=None):
    """Update row by row; log scales after each, of the only class of speed."""
    log = []
    for row in range(scene.positions.shape[1] if rows is None else rows):
        predictor = predictor.update(seen_at(scene, row, OBSERVED)[0])
        log.append(predictor.state.log_scale[:STEPS])
    return predictor, np.array(log)


def by_hand(scene, spread):
    """Compute the same scales from the definition, one obstacle at a time."""
    positions = scene.positions
    rows = positions.shape[1]
    log = np.zeros((rows, STEPS))
    stated = np.zeros((rows, STEPS))
    for row in range(rows):
        scale = log[row - 1].copy() if row else np.zeros(STEPS)
        for step in range(1, min(STEPS, row) + 1):
            start, misses = row - step, []
            for one in positions[:, : row + 1]:
                if start < OBSERVED - 1 or np.isnan(one[start - OBSERVED + 1 : start + 1]).any():
                    continue
                if not np.isnan(one[row]).any():
                    error = np.sum((one[row] - one[start]) ** 2)
                    limit = SIZE * spread**2 * step * np.exp(stated[start, step - 1])
                    misses.append(float(error > limit))
            if misses:
                change = np.sum(np.array(misses) - TAIL) / np.sqrt(len(misses))
                scale[step - 1] += RATE * change
        log[row] = stated[row] = scale
    return log


@pytest.mark.parametrize("spread", [0.3, 1.0, 3.0])
def test_scales_follow_the_definition(spread):
    scene = recording(np.random.default_rng(1))
    _, log = played(adaptive(Stay(spread)), scene)
    assert np.allclose(log, by_hand(scene, spread), rtol=0, atol=1e-12)


@pytest.mark.parametrize("spread", [0.2, 5.0])
def test_the_long_run_rate_of_misses_is_bounded(spread):
    rng = np.random.default_rng(2)
    rows = 1500
    positions = rng.standard_normal((1, rows, 2)).cumsum(axis=1)
    positions[:, 700:] *= 3.0  # the world changes
    scene = tracks_of(positions, stamp=DT * (rows - 1))
    predictor, misses = adaptive(Stay(spread)), [[] for _ in range(STEPS)]
    log = []
    for row in range(rows):
        now = seen_at(scene, row, OBSERVED)[0]
        predictor = predictor.update(now)
        log.append(predictor.state.log_scale[:STEPS])
        if row < OBSERVED - 1:
            continue
        forecast = predictor.predict(now, STEPS)
        for step in range(min(STEPS, rows - 1 - row)):
            error = np.sum((positions[0, row + 1 + step] - forecast.mean[0, 0, step]) ** 2)
            misses[step].append(error > SIZE * forecast.covariance[0, 0, step, 0, 0])
    reach = np.ptp(np.array(log), axis=0)
    for step in range(STEPS):
        bound = (reach[step] + RATE) / (RATE * len(misses[step]))
        assert abs(np.mean(misses[step]) - TAIL) <= bound
        assert bound < 0.04


def test_a_true_model_keeps_its_scale():
    rng = np.random.default_rng(3)
    scene = tracks_of(rng.standard_normal((40, 300, 2)).cumsum(axis=1), stamp=DT * 299)
    predictor = adaptive(rate=0.05)
    _, log = played(predictor, scene)
    # The quantile is exp(0) exactly; the stationary spread of a log scale is below sqrt(rate).
    assert np.abs(log[100:].mean(axis=0)).max() < 0.05
    assert np.abs(log).max() < np.sqrt(0.05)


@final
@dataclass(frozen=True)
class Fork(Predictor):
    """Two modes of unit variance, 2.4 m apart, left and right of where it is."""

    def predict(self, tracks, steps, scene=None):
        aside = np.array([[-1.2, 0.0], [1.2, 0.0]])[:, None]
        mean = np.repeat(np.nan_to_num(tracks.positions[:, None, -1:]), 2, axis=1) + aside
        mean = np.repeat(mean, steps, axis=2)
        spread = np.broadcast_to(np.eye(2), (*mean.shape, 2))
        weight = np.tile([0.8, 0.2], (len(tracks), 1))
        return Forecast(mean, spread, weight, tracks.dt, (None,) * len(tracks))


def test_a_true_mixture_keeps_its_scale():
    """The region of highest density is calibrated: the union of both ellipses holds more."""
    rng = np.random.default_rng(11)
    aside = np.where(rng.random((40, 300)) < 0.8, -1.2, 1.2)
    moves = rng.standard_normal((40, 300, 2)) + np.stack([aside, 0 * aside], axis=2)
    scene = tracks_of(moves.cumsum(axis=1), stamp=DT * 299)
    _, log = played(adaptive(Fork(), rate=0.05, steps=1), scene)
    assert abs(log[100:].mean()) < 0.05


def test_rows_to_come_change_nothing():
    rng = np.random.default_rng(4)
    scene = recording(rng)
    other = scene.positions.copy()
    other[:, 30:] = 1e3 * rng.standard_normal(other[:, 30:].shape)
    one, first = played(adaptive(), scene, rows=30)
    two, second = played(adaptive(), replace(scene, positions=other), rows=30)
    assert np.array_equal(first, second)
    now = seen_at(scene, 29, OBSERVED)[0]
    same = one.predict(now, STEPS).covariance == two.predict(now, STEPS).covariance
    assert same.all()


def test_truth_is_used_once_and_only_when_due():
    positions = np.zeros((1, 12, 2))
    positions[:, 5:] = 100.0
    scene = tracks_of(positions, stamp=DT * 11)
    predictor, log = played(adaptive(), scene, rows=7)
    hit, miss = -RATE * TAIL, RATE * (1 - TAIL)
    # The first forecast is made at row 1, the jump is seen at row 5 by one forecast per step.
    assert np.allclose(log[1], 0.0)
    assert np.allclose(log[4], hit * np.array([3, 2, 1]))
    assert np.allclose(log[5], hit * np.array([3, 2, 1]) + miss)
    assert np.allclose(log[6], hit * np.array([4, 2, 1]) + miss * np.array([1, 2, 2]))
    again = predictor.update(seen_at(scene, 6, OBSERVED)[0])
    assert again.state.log_scale == predictor.state.log_scale
    assert len(again.state.waiting.row) == len(predictor.state.waiting.row)


def test_updates_between_the_steps_of_the_tracks():
    rng = np.random.default_rng(5)
    velocity = rng.standard_normal((5, 1, 2))

    def at(stamp):
        time = stamp + DT * np.arange(-3.0, 1.0)
        return tracks_of(time[:, None] * velocity, stamp)

    often, seldom = adaptive(Stay(0.5)), adaptive(Stay(0.5))
    for tick in range(80):
        often = often.update(at(0.125 * tick))
        if tick % 4 == 0:
            seldom = seldom.update(at(0.125 * tick))
            assert np.allclose(often.state.log_scale, seldom.state.log_scale, atol=1e-12)
            assert len(often.state.waiting.row) == len(seldom.state.waiting.row)
            assert len(set(often.state.waiting.time)) <= STEPS
    uneven = adaptive(Stay(0.5))
    for tick in range(20):
        uneven = uneven.update(at(0.7 * tick))
    assert max(uneven.state.log_scale) > 3 * RATE


def test_it_starts_anew_where_the_clock_or_the_step_says_so():
    scene = recording(np.random.default_rng(6))
    learnt, log = played(adaptive(Stay(0.3)), scene, rows=30)
    assert np.abs(log[-1]).min() > 0
    early = seen_at(scene, 3, OBSERVED)[0]
    now = seen_at(scene, 30, OBSERVED)[0]
    for other in (early, replace(now, dt=0.4)):
        anew = learnt.update(other)
        assert anew.state.log_scale == (0.0,) * 2 * STEPS
        assert anew.state.stated == other.stamp
        assert anew.state.waiting.time.min() == other.stamp + other.dt
    empty = learnt.update(now.select([]))
    assert empty.state.log_scale == learnt.state.log_scale
    away = replace(now, stamp=now.stamp + 1000 * DT)
    assert learnt.update(away).state.waiting.time.min() == away.stamp + DT
    assert learnt.update(away).state.log_scale == learnt.state.log_scale


@pytest.mark.parametrize("dt", [0.02, 0.05, 0.1, 0.2, 0.4, 0.5])
def test_a_clock_of_seconds_since_1970_learns_the_same(dt):
    rng = np.random.default_rng(9)
    walk = 0.3 * rng.standard_normal((4, 60, 2)).cumsum(axis=1)
    learnt = []
    for epoch in (0.0, 1.7e9):
        predictor = adaptive(Stay(0.3))
        for row in range(OBSERVED, 60):
            past = walk[:, row - OBSERVED : row]
            predictor = predictor.update(tracks_of(past, stamp=epoch + dt * row, dt=dt))
        learnt.append(predictor.state.log_scale)
    assert np.abs(learnt[0]).max() > 0
    np.testing.assert_allclose(learnt[0], learnt[1], atol=1e-12)


def test_forecasts_are_judged_as_the_scene_makes_them():
    walk = 0.3 * np.random.default_rng(10).standard_normal((2, 60, 2)).cumsum(axis=1)
    truth = Truth(DT * np.arange(60), {"o0": walk[0], "o1": walk[1]})
    told, untold = adaptive(Oracle(spread=0.1)), adaptive(Oracle(spread=0.1))
    for row in range(OBSERVED, 50):
        now = tracks_of(walk[:, row - OBSERVED : row], stamp=DT * (row - 1))
        told, untold = told.update(now, Scene(truth=truth)), untold.update(now)
    hits = 50 - OBSERVED - np.arange(1, STEPS + 1)  # what the oracle says comes true
    np.testing.assert_allclose(told.state.log_scale[:STEPS], -RATE * TAIL * np.sqrt(2) * hits)
    assert max(untold.state.log_scale) > 0


def test_what_is_kept_is_bounded():
    still = np.zeros((2, OBSERVED, 2))
    predictor = adaptive(rate=100.0)
    for row in range(30):
        predictor = predictor.update(tracks_of(still, stamp=DT * row))
        assert len(predictor.state.waiting.row) <= 2 * STEPS * (STEPS + 1) // 2
    assert predictor.state.log_scale == (-LIMIT,) * STEPS + (0.0,) * STEPS
    assert np.linalg.eigvalsh(predictor.predict(tracks_of(still), 2).covariance).min() > 0


@final
@dataclass(frozen=True)
class Counter(Adaptive):
    seen: int = 0

    def update(self, tracks, scene=None):
        return replace(self, seen=self.seen + 1)

    def predict(self, tracks, steps, scene=None):
        return Stay().predict(tracks, steps)


def test_fit_and_update_are_handed_on():
    base = Empirical(ConstantVelocity(window=1), 3, 3, speeds=1, jitters=1)
    walks = np.random.default_rng(7).standard_normal((30, 8, 2)).cumsum(axis=1)
    scene = tracks_of(walks)
    learnt, _ = played(adaptive(base), scene)
    fitted = learnt.fit([scene])
    assert fitted.base == base.fit([scene])
    assert fitted.state is None
    assert adaptive(Counter()).update(scene).update(scene).base.seen == 2
    assert adaptive(Counter()).update(scene).fit([scene]).state is None


def test_a_scene_too_short_to_learn_from_is_passed_over():
    scene = recording(np.random.default_rng(9))
    short = tracks_of(np.zeros((2, OBSERVED + STEPS - 1, 2)))
    assert adaptive().fit([scene, short]) == adaptive().fit([scene])


def test_laws_hold_and_nothing_changes_in_place(tmp_path):
    scene = recording(np.random.default_rng(8))
    start = adaptive(ConstantVelocity())
    learnt, _ = played(start, scene)
    assert start.state is None
    check_predictor(learnt)
    state = learnt.state
    learnt.update(seen_at(scene, 59, OBSERVED)[0])
    assert learnt.state is state
    again = load_plugin(save_plugin(tmp_path / "a.json", "predictor", learnt), "predictor")
    assert describe(again) == describe(learnt)
    now = replace(seen_at(scene, 59, OBSERVED)[0], stamp=DT * 60)
    assert again.update(now).state.log_scale == learnt.update(now).state.log_scale
    assert build("predictors", describe(start)) == start


def test_bad_input():
    for settings in (
        {"speeds": (np.inf,)},
        {"tail": 0.0},
        {"rate": 0.0},
        {"steps": 0},
        {"observed": 0},
    ):
        with pytest.raises(WideberthError, match=r"adaptive_conformal\."):
            adaptive(**settings)
    with pytest.raises(WideberthError, match=r"adaptive_conformal\.start"):
        adaptive(start=(1.0,) * (2 * STEPS + 1), start_dt=DT)
    with pytest.raises(WideberthError, match=r"adaptive_conformal\.start_dt"):
        adaptive(start=(1.0,) * 2 * STEPS, start_dt=0.0)
    assert adaptive(start=(1.0,) * 2 * STEPS, start_dt=DT).start_dt == DT
