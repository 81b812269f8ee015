"""Split conformal calibration: the guarantee, what it learns from, and what it leaves alone."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.calibration import largest, moments
from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.plugins.registry import names
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.calibrations.joint_plan import JointPlan
from wideberth.predictors.conformal import Conformal, _halves
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.calibration import (
    Scales,
    replayed,
    scaled,
    scored,
    seen_at,
    squared_distances,
)
from wideberth.predictors.data.windows import cut_windows
from wideberth.predictors.empirical import Empirical
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static

DT, OBSERVED, STEPS = 0.5, 2, 4


@final
@dataclass(frozen=True)
class Walk(Predictor):
    """Exact for a random walk of 1 m per step and axis; modes lie ``apart`` to both sides."""

    apart: float = 0.0

    def predict(self, tracks, steps, scene=None):
        count, size = len(tracks), tracks.dimension
        growth = np.arange(1.0, steps + 1)
        modes = 1 + (self.apart > 0)
        mean = np.repeat(tracks.positions[:, None, -1:], steps, axis=2)
        mean = np.repeat(mean, modes, axis=1)
        mean[:, :, :, 0] += self.apart * np.array([-1.0, 1.0][-modes:])[:, None] * (modes > 1)
        covariance = np.broadcast_to(growth[:, None, None] * np.eye(size), (*mean.shape, size))
        each = np.minimum(growth[:, None], growth)
        joint = np.tile(np.kron(each, np.eye(size)), (count, modes, 1, 1))
        weight = np.full((count, modes), 1 / modes)
        return Forecast(mean, covariance, weight, tracks.dt, (None,) * count, joint)


def tracks_of(positions, dt=DT):
    count, _, size = positions.shape
    spread = np.tile(1e-4 * np.eye(size), (count, 1, 1))
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, dt, ids, np.full(count, 0.3), spread)


def walkers(count, rng, freedom=None, size=2):
    """Random walks of one window each; Student's t with some degrees of freedom, or normal."""
    shape = (count, OBSERVED + STEPS, size)
    steps = rng.standard_normal(shape) if freedom is None else rng.standard_t(freedom, shape)
    return tracks_of(steps.cumsum(axis=1))


def distances(predictor, scene):
    forecast = predictor.predict(
        replace(scene, positions=scene.positions[:, :OBSERVED]),
        scene.positions.shape[1] - OBSERVED,
    )
    parts = forecast.mean, forecast.covariance, forecast.weight
    return squared_distances(*parts, scene.positions[:, OBSERVED:])


def calibrated(scene, base=None, **settings):
    base = Walk() if base is None else base
    return Conformal(base, observed=OBSERVED, steps=STEPS, **settings).fit([scene])


@pytest.mark.parametrize("count", [39, 45])
def test_coverage_is_guaranteed_whatever_the_errors(count):
    rng = np.random.default_rng(3)
    rates = []
    for _ in range(150):
        predictor = calibrated(walkers(count, rng, freedom=2))
        inside = distances(predictor, walkers(200, rng, freedom=2)) <= chi2.ppf(0.95, 2)
        rates.append(inside.mean(axis=0))
    # The coverage of one calibration is Beta(k, n + 1 - k) distributed: mean k / (n + 1).
    wanted = np.ceil((count + 1) * 0.95) / (count + 1)
    mean, spread = np.mean(rates, axis=0), np.std(rates, axis=0) / np.sqrt(len(rates))
    assert wanted >= 0.95
    assert (np.abs(mean - wanted) < 4 * spread).all()


def test_a_true_model_is_left_as_it_is():
    predictor = calibrated(walkers(8000, np.random.default_rng(4)))
    # Standard error of a quantile: sqrt(p (1 - p) / n) / density; density of chi^2_2 is tail / 2.
    error = np.sqrt(0.05 * 0.95 / 8000) / (0.05 / 2) / chi2.ppf(0.95, 2)
    assert np.abs(np.array(predictor.fitted.scale) - 1.0).max() < 4 * error


def test_the_scale_is_that_order_statistic():
    scene = walkers(57, np.random.default_rng(5), size=3)
    predictor = calibrated(scene, tail=0.2)
    rank = int(np.ceil(58 * 0.8))
    wanted = np.sort(distances(Walk(), scene), axis=0)[rank - 1] / chi2.ppf(0.8, 3)
    assert np.allclose(predictor.fitted.scale, wanted, rtol=1e-12)
    assert predictor.fitted.groups == 57


def test_too_few_windows_for_the_tail():
    rng = np.random.default_rng(6)
    scene = walkers(19, rng)
    largest = distances(Walk(), scene).max(axis=0) / chi2.ppf(0.95, 2)
    assert np.allclose(calibrated(scene).fitted.scale, largest, rtol=1e-12)
    with pytest.raises(WideberthError, match=r"18 groups .* PerStep; wanted at least 19"):
        calibrated(scene.select(list(range(18))))
    with pytest.raises(WideberthError, match=r"0\.25 s, 0\.5 s"):
        Conformal(Walk()).fit([scene, replace(scene, dt=0.25)])


@final
@dataclass(frozen=True)
class Student(Fittable):
    """Remembers what it was fitted to."""

    learnt: tuple[str, ...] = ()

    def fit(self, dataset):
        return replace(self, learnt=tuple(ident for scene in dataset for ident in scene.ids))

    def predict(self, tracks, steps, scene=None):
        return Walk().predict(tracks, steps, scene)


def test_base_and_calibration_see_different_tracks():
    scene = walkers(101, np.random.default_rng(7))
    predictor = calibrated(scene, Student())
    assert predictor.base.learnt == scene.ids[::2]
    kept = distances(Walk(), scene.select(list(range(1, 101, 2))))
    wanted = np.sort(kept, axis=0)[int(np.ceil(51 * 0.95)) - 1] / chi2.ppf(0.95, 2)
    assert predictor.fitted.groups == 50
    assert np.allclose(predictor.fitted.scale, wanted, rtol=1e-12)


def test_the_nearest_mode_counts():
    scene = walkers(400, np.random.default_rng(8))
    split = Walk(apart=3.0)
    left, right = (distances(Shifted(side), scene) for side in (-3.0, 3.0))
    assert np.allclose(distances(split, scene), np.minimum(left, right), rtol=1e-12)
    inside = distances(calibrated(scene, split), walkers(4000, np.random.default_rng(9)))
    rate = (inside <= chi2.ppf(0.95, 2)).mean(axis=0)
    assert np.abs(rate - 0.95).max() < 5 * np.sqrt(0.05 * 0.95 / 400)


@final
@dataclass(frozen=True)
class Shifted(Predictor):
    side: float

    def predict(self, tracks, steps, scene=None):
        forecast = Walk().predict(tracks, steps)
        return replace(forecast, mean=forecast.mean + np.array([self.side, 0.0]))


def test_modes_of_no_weight_have_no_region():
    mean = np.array([[[[0.0, 0.0]], [[5.0, 0.0]]]])
    covariance = np.ones((1, 2, 1, 1, 1)) * np.eye(2)
    truth = np.array([[[5.0, 0.0]]])
    for weight, wanted in (([0.5, 0.5], 0.0), ([1.0, 0.0], 25.0), ([0.9995, 0.0005], 25.0)):
        got = squared_distances(mean, covariance, np.array([weight]), truth)
        assert np.allclose(got, wanted)


def test_scales_reach_the_joint_covariance_and_other_grids():
    scene = walkers(3, np.random.default_rng(10))
    forecast = scaled(Walk().predict(scene, 3), np.array([1.0, 4.0, 9.0]), DT, scene)
    blocks = forecast.joint[0, 0].reshape(3, 2, 3, 2)
    assert np.allclose(blocks[1, :, 1], forecast.covariance[0, 0, 1])
    assert np.allclose(blocks[1, :, 2], 2.0 * 3.0 * 2.0 * np.eye(2))
    predictor = Conformal(Walk(), fitted=Scales(DT, (1.0, 3.0), 99))
    plain = Walk().predict(replace(scene, dt=DT / 2), 6)
    ratio = predictor.predict(replace(scene, dt=DT / 2), 6).covariance / plain.covariance.clip(
        1e-9
    )
    assert np.allclose(ratio[0, 0, :, 0, 0], [1.0, 1.0, 2.0, 3.0, 3.0, 3.0])


def test_laws_hold_and_unfitted_it_is_the_base():
    rng = np.random.default_rng(11)
    predictor = Conformal(ConstantVelocity(), observed=OBSERVED, steps=STEPS)
    check_predictor(predictor, dataset=[walkers(40, rng)])
    scene = walkers(5, rng)
    plain, base = Conformal(Static()).predict(scene, 3), Static().predict(scene, 3)
    assert np.array_equal(plain.covariance, base.covariance)


def test_it_is_saved_with_its_base(tmp_path):
    base = Empirical(ConstantVelocity(window=1), 3, 3, speeds=2, jitters=1)
    predictor = Conformal(base, observed=3, steps=3).fit([walkers(60, np.random.default_rng(12))])
    again = load_plugin(save_plugin(tmp_path / "c.json", "predictor", predictor), "predictor")
    assert again == predictor == build("predictors", describe(predictor))
    assert again.base.fitted.windows == 30


def wanderers(rows, rng, people=3):
    """A recording of people who come and go, in random walks."""
    positions = rng.standard_normal((people, rows, 2)).cumsum(axis=1)
    positions[0, ::7] = np.nan
    return tracks_of(positions)


CALIBRATIONS = [
    *({"type": name} for name in names("calibrations") if name != "task"),
    {"type": "task", "seconds": 2.0},
    {"type": "boole", "growth": 0.5},
    {"type": "sample_and_discard", "beta": 0.2},
]


@pytest.mark.parametrize("calibration", CALIBRATIONS)
def test_it_is_saved_with_its_calibration(tmp_path, calibration):
    rng = np.random.default_rng(15)
    config = {"type": "conformal", "base": "kalman", "tail": 0.3, "calibration": calibration}
    own = build("predictors", config | {"observed": OBSERVED, "steps": STEPS})
    fitted = own.fit([wanderers(200, rng) for _ in range(2)])
    again = build(
        "predictors", {"saved": str(save_plugin(tmp_path / "c.json", "predictor", fitted))}
    )
    assert again == fitted and again.calibration == build("calibrations", calibration)
    scene = wanderers(20, rng)
    finer = fitted.predict(replace(scene, dt=DT / 2), 2 * STEPS)
    base = fitted.base.predict(replace(scene, dt=DT / 2), 2 * STEPS)
    ratio = finer.covariance[1, 0, 1::2, 0, 0] / base.covariance[1, 0, 1::2, 0, 0]
    assert np.allclose(ratio, fitted.fitted.scale)


def test_of_all_people_the_nearest_mode_counts():
    """The scores of a forecast with modes are those of its nearest one, person by person."""
    rng = np.random.default_rng(16)
    scenes = [wanderers(200, rng) for _ in range(2)]
    settings = {"tail": 0.2, "calibration": JointPlan(), "observed": OBSERVED, "steps": STEPS}
    split, one = (Conformal(Walk(apart), **settings).fit(scenes) for apart in (0.5, 0.0))
    spans = [range(100, 200)] * 2
    parts = [scored(Shifted(side), scenes, spans, OBSERVED, STEPS).squares for side in (-0.5, 0.5)]
    both = scored(Walk(0.5), scenes, spans, OBSERVED, STEPS)
    np.testing.assert_allclose(both.squares, np.minimum(*parts), rtol=1e-9)
    assert split.fitted.groups == one.fitted.groups == 2 * 24
    worst = largest(both.squares / np.array(split.fitted.scale), moments(both)).max(axis=1)
    rank = int(np.ceil(49 * 0.8))
    assert np.sort(worst)[rank - 1] == pytest.approx(chi2.ppf(0.8, 2))


def test_a_person_who_was_not_there_before_or_leaves_counts_while_seen():
    scene = wanderers(40, np.random.default_rng(17), people=2)
    positions = scene.positions.copy()
    positions[1, :19] = np.nan
    positions[1, 22:] = np.nan
    found = scored(Walk(), [replace(scene, positions=positions)], [range(10, 40)], 8, 4)
    (mine,) = np.flatnonzero((found.track == 1) & (found.row == 9))  # row 19, its first
    assert np.isfinite(found.squares[mine]).tolist() == [True, True, False, False]
    assert not found.whole[mine] and found.rows == (26,)
    assert ((found.track == 1) & (found.row == 11)).sum() == 0  # row 21, seen no more after it


def test_bad_input():
    for settings in ({"tail": 0.0}, {"tail": 1.0}, {"steps": 0}, {"observed": 0}):
        with pytest.raises(WideberthError, match=r"conformal\."):
            Conformal(Static(), **settings)
    for scale in ((), (1.0, 0.0), (np.nan,)):
        with pytest.raises(WideberthError, match=r"scales\.scale"):
            Scales(DT, scale, 1)


def test_somebody_late_gets_the_scales_of_the_time_since_he_was_seen():
    scene = walkers(2, np.random.default_rng(12))
    gone = scene.positions.copy()
    gone[1, -2:] = np.nan
    predictor = Conformal(Kalman(), fitted=Scales(DT, (1.0, 2.0, 3.0, 4.0, 5.0), 99))
    late = predictor.predict(replace(scene, positions=gone), 3)
    plain = Kalman().predict(replace(scene, positions=gone), 3)
    ratio = late.covariance[:, 0, :, 0, 0] / plain.covariance[:, 0, :, 0, 0]
    np.testing.assert_allclose(ratio, [[1.0, 2.0, 3.0], [3.0, 4.0, 5.0]])
    blocks = late.joint[1, 0].reshape(3, 2, 3, 2)
    np.testing.assert_allclose(blocks[2, :, 2], late.covariance[1, 0, 2])


def test_a_base_that_adapts_is_refused():
    with pytest.raises(WideberthError, match=r"base is AdaptiveConformal, which adapts"):
        Conformal(AdaptiveConformal())
    for name in ("var", "bayesian_var", "pooled_var", "mixture_density", "oracle"):
        with pytest.raises(WideberthError, match=f"{name}.fallback is AdaptiveConformal"):
            build("predictors", {"type": name, "fallback": "adaptive_conformal"})


def test_scenes_of_one_track_are_dealt_to_both_halves():
    rng = np.random.default_rng(4)
    walks = rng.normal(scale=0.1, size=(4, 1, 120, 2)).cumsum(axis=2)
    noise = np.full((1, 1, 1), 1e-4) * np.eye(2)
    scenes = [Tracks(walk, 0.5, ("robot",), np.full(1, 0.3), noise) for walk in walks]
    base = Kalman()
    fitted = Conformal(base=base, observed=8, steps=4).fit(scenes)
    assert fitted.base == base.fit(scenes[::2])
    assert fitted.fitted.groups == 2 * (120 - 11)


@dataclass(frozen=True)
class AsManyModes(Predictor):
    """As many modes as there are obstacles, of equal weight, i metres apart."""

    def predict(self, tracks, steps, scene=None):
        count, size = len(tracks), tracks.dimension
        mean = np.zeros((count, count, steps, size))
        mean[..., 0] = np.arange(count)[:, None]
        covariance = np.tile(np.eye(size), (count, count, steps, 1, 1))
        weight = np.full((count, count), 1.0 / count)
        return Forecast(mean, covariance, weight, tracks.dt, (None,) * count)


def test_rows_of_fewer_modes_are_filled_with_modes_of_no_weight():
    positions = np.zeros((2, 6, 2))
    positions[1, :2] = np.nan
    scene = tracks_of(positions)
    windows = cut_windows(scene, 2, 1)
    mean, covariance, weight = replayed(AsManyModes(), scene, windows)
    assert mean.shape == (len(windows), 2, 1, 2) and covariance.shape == (len(windows), 2, 1, 2, 2)
    many = np.isfinite(positions[:, :, 0]).sum(axis=0)[windows.row]
    assert set(many.tolist()) == {1, 2}
    for own, places, count in zip(weight, mean[:, :, 0, 0], many, strict=True):
        assert own.tolist() == ([1.0, 0.0] if count == 1 else [0.5, 0.5])
        assert places.tolist() == ([0.0, 0.0] if count == 1 else [0.0, 1.0])


def test_a_mode_counts_that_plans_heed():
    """The heaviest, and every one of a weight of 0.01 at least."""
    mean = np.array([0.0, 5.0, 9.0])[None, :, None, None] * np.ones((1, 3, 1, 2))
    covariance = np.tile(np.eye(2), (1, 3, 1, 1, 1))
    for weight, wanted in (((0.6, 0.39, 0.01), 0.0), ((0.6, 0.391, 0.009), 32.0)):
        found = squared_distances(mean, covariance, np.array([weight]), np.full((1, 1, 2), 9.0))
        assert found[0, 0] == pytest.approx(wanted)
    light = np.full((1, 3), 0.001)
    light[0, 1] = 0.002
    found = squared_distances(mean, covariance, light, np.full((1, 1, 2), 9.0))
    assert found[0, 0] == pytest.approx(32.0)


def test_what_had_been_seen_carries_the_stamp_of_its_row():
    scene = replace(tracks_of(np.zeros((2, 7, 2))), stamp=100.0)
    for row in (0, 3, 6):
        now, present = seen_at(scene, row, 4)
        assert now.stamp == pytest.approx(100.0 - DT * (6 - row))
        assert now.positions.shape == (2, min(row + 1, 4), 2) and present.tolist() == [0, 1]


def test_tracks_are_dealt_in_turn_over_all_scenes():
    scenes = [tracks_of(np.zeros((count, 2, 2))) for count in (3, 2, 1)]
    assert _halves(scenes) == ([[0, 2], [1], []], [[1], [0], [0]])


def test_a_scene_without_a_window_is_passed_over():
    rng = np.random.default_rng(14)
    scene, brief = walkers(60, rng), tracks_of(np.zeros((1, 2, 2)))
    own = Conformal(Walk(), observed=OBSERVED, steps=STEPS)
    assert own.fit([brief, scene]).fitted == own.fit([scene]).fitted
