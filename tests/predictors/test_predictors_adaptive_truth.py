"""When truth falls due for the online calibration, and where it was then."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import (
    LIMIT,
    AdaptiveConformal,
    Online,
    Pending,
    _position,
    _quantile,
    _slack,
    _starts,
)
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.history import gather
from wideberth.predictors.static import Static


def tracks_of(positions: np.ndarray, stamp: float) -> Tracks:
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, 0.5, names, np.full(count, 0.3), np.zeros((count, size, size)), stamp)


def test_truth_is_looked_up_between_two_samples() -> None:
    """And is not known before the first sample, after the newest, or where either is missing."""
    seen = tracks_of(np.array([[[0.0, 0.0], [2.0, 4.0], [6.0, 4.0]]]), stamp=10.0)
    for time, wanted in (
        (9.0, (0, 0)),
        (9.125, (0.5, 1)),
        (9.5, (2, 4)),
        (9.75, (4, 4)),
        (10, (6, 4)),
    ):
        np.testing.assert_allclose(_position(seen, time), [wanted], err_msg=str(time))
    assert np.isnan(_position(seen, 8.9)).all() and np.isnan(_position(seen, -np.inf)).all()
    np.testing.assert_array_equal(_position(seen, 10.0 + 1e-9), [[6.0, 4.0]])
    seen.positions.setflags(write=True)
    seen.positions[0, 1] = np.nan
    near, far = (_position(seen, 10.0 - 0.5 * share * 1e-6) for share in (0.8, 1.2))
    np.testing.assert_array_equal(near, [[6.0, 4.0]])
    assert np.isnan(far).all()
    seen.positions[0, 1] = 2.0, 4.0
    alone = tracks_of(seen.positions[:, -1:], stamp=10.0)
    np.testing.assert_array_equal(_position(alone, 10.0), [[6.0, 4.0]])
    assert np.isnan(_position(alone, 9.9)).all()
    assert np.isnan(_position(tracks_of(seen.positions[:, :0], stamp=10.0), 10.0)).all()


def test_a_fit_takes_the_class_of_speed_from_the_newest_sample_on() -> None:
    """Who stands in a forecast of one step is of the slowest class, however fast he came."""
    rng = np.random.default_rng(12)
    walks = 0.01 * rng.standard_normal((20, 20, 2)).cumsum(axis=1)
    walks[10:, :, 0] += 0.5 * np.arange(20.0)
    scene = tracks_of(walks, stamp=9.5)
    both = AdaptiveConformal(Static(), observed=4, steps=1, speeds=(0.5,)).fit([scene])
    whole = AdaptiveConformal(Static(), observed=4, steps=1, speeds=()).fit([scene])
    assert whole.start is not None and both.start == whole.start[:1] * 3


def test_the_weighted_quantile_against_its_definition() -> None:
    rng = np.random.default_rng(3)
    for count in (1, 2, 7, 40):
        values, weights = rng.standard_normal(count), rng.random(count)
        for share in (0.0, 0.05, 0.5, 0.95, 1.0, 1.0 + 1e-9):
            held = [weights[values <= one].sum() >= share * weights.sum() for one in values]
            wanted = min(values[held], default=values.max())
            assert _quantile(values, weights, share) == wanted


def test_a_class_starts_by_its_own_windows_where_it_has_a_hundred() -> None:
    for few in (99, 100):
        kinds = np.repeat([0, 1], [few, 300])
        ratio = np.where(kinds == 0, 4.0, 1.0)[:, None] * np.array([1.0, 2.0])
        found = _starts(ratio, kinds, np.ones(len(kinds)), 3, 0.7)
        own = 4.0 if few == 100 else 1.0
        np.testing.assert_allclose(found, np.log([own, 2.0 * own, 1.0, 2.0, 1.0, 2.0]))
    bounds = _starts(np.array([[0.0, 1e30]]), np.zeros(1, dtype=int), np.ones(1), 1, 0.5)
    np.testing.assert_allclose(bounds, [np.maximum(np.log(1e-12), -LIMIT), LIMIT])


def test_the_class_is_that_of_the_mean_speed_of_the_forecast() -> None:
    own = AdaptiveConformal(Static(), speeds=(0.5, 1.5))
    past, new = (gather(tracks_of(np.array([[[0.0, 1.0]] * n] * 3), 0.0)) for n in (2, 1))
    for steps, times in ((1, [1.0]), (4, [1.0, 2.0, 9.0, 9.0])):
        mean = np.zeros((3, 2, steps, 2))
        for o, (one, two) in enumerate(((0.25, 0.5), (0.375, 0.875), (1.0, 3.0))):
            mean[o, :, :, 0] = np.array([[one], [two]]) * np.array(times)
        mean[..., 1] = 1.0
        weight = np.tile([0.75, 0.25], (3, 1))
        # Mean displacements 0.3125, 0.5 and 1.5 m in 0.5 s, and in 1 s.
        for dt, wanted in ((0.5, [1, 1, 2]), (1.0, [0, 1, 2]), (1.001, [0, 0, 1])):
            assert own._kinds(mean, weight, past, dt).tolist() == wanted
            once = own._kinds(mean, weight, new, dt).tolist()
            assert once == [3, 3, 3], "of a single sample no speed is known"


def test_a_start_is_the_quantile_of_the_distances_over_that_of_chi_square() -> None:
    """Every recording counts alike, however many windows it has."""
    rng = np.random.default_rng(13)
    walks = [rng.standard_normal((count, 8, 2)).cumsum(axis=1) for count in (30, 90)]
    walks[0] *= 3.0
    scenes = [tracks_of(one, stamp=3.5) for one in walks]
    base = Static()
    made = AdaptiveConformal(base, tail=0.3, observed=4, steps=4, speeds=()).fit(scenes)
    assert made.start_dt == 0.5 and made.start is not None
    squares, weights = [], []
    for one, scene in zip(walks, scenes, strict=True):
        past = tracks_of(one[:, :4], stamp=1.5)
        spread = base.predict(past, 4).covariance[:, 0]
        error = one[:, 4:] - one[:, 3:4]
        squares.append(np.einsum("oni,onij,onj->on", error, np.linalg.inv(spread), error))
        weights += [1.0 / len(scene)] * len(scene)
    for step, column in enumerate(np.concatenate(squares).T):
        wanted = np.log(_quantile(column, np.array(weights), 0.7) / chi2(2).ppf(0.7))
        np.testing.assert_allclose(made.start[step], np.clip(wanted, -LIMIT, LIMIT), rtol=1e-9)


def test_a_clock_of_large_numbers_is_coarse() -> None:
    for stamp, wanted in ((10.0, 0.5e-6), (1.7e9, 4.0 * 2.0**-22)):
        assert _slack(tracks_of(np.zeros((1, 2, 2)), stamp)) == wanted


def test_scales_are_those_learnt_last_else_those_of_the_fit() -> None:
    """exp(l) of each step and class; on another grid those between."""
    scene = tracks_of(np.zeros((2, 4, 2)), stamp=1.5)
    scene.positions.setflags(write=True)
    scene.positions[1, :, 0] = 2.0 * np.arange(4.0)
    walking = ConstantVelocity(window=1)
    base = walking.predict(scene, 3).covariance[:, 0]
    start = (0.1, 0.2, 0.3, 1.1, 1.2, 1.3, 2.1, 2.2, 2.3)
    fit = AdaptiveConformal(walking, steps=3, speeds=(0.5,), start=start, start_dt=0.5)
    other = Online(1.5, 0.5, tuple(2.0 * value for value in start))
    for own, factor in ((fit, 1.0), (replace(fit, state=other), 2.0)):
        found = own.predict(scene, 3).covariance[:, 0]
        scale = np.exp(factor * np.reshape(start, (3, 3))[:2])
        np.testing.assert_allclose(found, base * scale[..., None, None])
    plain = AdaptiveConformal(walking, steps=3, speeds=(0.5,))
    np.testing.assert_array_equal(plain.predict(scene, 3).covariance[:, 0], base)
    assert plain.first(0.5) == (0.0,) * 9 and fit.first(0.5) == start
    later, sooner = np.array([0.15, 0.3, 0.3]), np.array([0.1, 0.12, 0.18])
    np.testing.assert_allclose(np.reshape(fit.first(0.75), (3, 3)), later + np.arange(3)[:, None])
    np.testing.assert_allclose(np.reshape(fit.first(0.3), (3, 3)), sooner + np.arange(3)[:, None])


def test_who_is_known_when_a_step_falls_due_is_inside_or_outside() -> None:
    """Of a unit circle around its forecast, at the second step; who is partly seen is not."""
    mean = np.zeros((4, 1, 3, 2))
    mean[:, 0, 1, 0] = 10.0 * np.arange(4.0)
    pending = Pending(
        5.0, ("o0", "o1", "gone", "o2"), (0, 1, 1, 2), mean,
        np.tile(np.eye(2), (4, 1, 3, 1, 1)), np.ones((4, 1)),
    )  # fmt: skip
    places = np.zeros((3, 3, 2))
    places[:, 1] = [[2.0, 0.0], [10.0 + 3.0, 0.0], [30.0, np.nan]]
    seen = tracks_of(places, stamp=6.5)
    own = AdaptiveConformal(Static(), tail=0.05)
    found = own._missed(pending, 1, seen, {"o0": 0, "o1": 1, "o2": 2})
    assert found[0].tolist() == [0, 1] and found[1].tolist() == [0.0, 1.0]
