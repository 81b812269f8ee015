"""When truth falls due for the online calibration, and where it was then."""

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from wideberth.framework.values.measurements import Measurements
from wideberth.framework.values.tracks import Tracks, resolution
from wideberth.predictors.adaptive_conformal import (
    BRIDGE,
    LIMIT,
    AdaptiveConformal,
    Online,
    Stated,
    _missed,
    _quantile,
    _starts,
    _truth,
)
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.static import Static


def tracks_of(positions: np.ndarray, stamp: float) -> Tracks:
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count))
    return Tracks(positions, 0.5, names, np.full(count, 0.3), np.zeros((count, size, size)), stamp)


def looks_at(rows, times, mean=None, kind=None, step=None) -> Stated:
    """Return forecasts of one mode and unit variance that have fallen due."""
    count = len(rows)
    mean = np.zeros((count, 2)) if mean is None else np.asarray(mean)
    unit = np.tile(np.eye(2), (count, 1, 1, 1))
    zero = np.zeros(count, dtype=np.int64)
    kind, step = (zero if part is None else np.asarray(part) for part in (kind, step))
    rows, times = np.asarray(rows), np.asarray(times, dtype=float)
    return Stated(rows, times, kind, step, mean[:, None], unit, np.ones((count, 1)))


def places_at(tracks: Tracks, time: float) -> np.ndarray:
    """Return where each obstacle was, (O, D)."""
    count = len(tracks)
    return _truth(tracks, looks_at(np.arange(count), np.full(count, time)))


def test_truth_is_looked_up_between_two_samples() -> None:
    """And is not known before the first sample, and after the newest."""
    seen = tracks_of(np.array([[[0.0, 0.0], [2.0, 4.0], [6.0, 4.0]]]), stamp=10.0)
    for time, wanted in (
        (9.0, (0, 0)),
        (9.125, (0.5, 1)),
        (9.5, (2, 4)),
        (9.75, (4, 4)),
        (10, (6, 4)),
    ):
        np.testing.assert_allclose(places_at(seen, time), [wanted], err_msg=str(time))
    assert np.isnan(places_at(seen, 8.9)).all()
    np.testing.assert_array_equal(places_at(seen, 10.0 + 1e-9), [[6.0, 4.0]])
    alone = tracks_of(seen.positions[:, -1:], stamp=10.0)
    np.testing.assert_array_equal(places_at(alone, 10.0), [[6.0, 4.0]])
    assert np.isnan(places_at(alone, 9.9)).all()


def test_truth_is_on_the_line_over_a_pause_of_two_steps_and_a_half() -> None:
    """Of sightings, and of the samples of a grid; not beyond, but for the instants themselves."""
    for pause, known in ((1.0, True), (1.25, True), (1.26, False), (3.0, False)):
        seen = sighted([10.0 - pause, 10.0], [(0.0, 0.0), (8.0, 4.0)])
        middle = places_at(seen, 10.0 - 0.25 * pause)
        wanted = [[6.0, 3.0]] if known else [[np.nan, np.nan]]
        np.testing.assert_allclose(middle, wanted, err_msg=str(pause))
        np.testing.assert_array_equal(places_at(seen, 10.0), [[8.0, 4.0]])
        np.testing.assert_array_equal(places_at(seen, 10.0 - pause), [[0.0, 0.0]])
    for gap, known in ((1, True), (2, False)):
        positions = np.full((1, 4, 2), np.nan)
        positions[0, -1], positions[0, -2 - gap] = (6.0, 4.0), (0.0, 0.0)
        middle = places_at(tracks_of(positions, stamp=10.0), 10.0 - 0.25 * (gap + 1))
        assert np.isfinite(middle).all() == known
        if known:
            np.testing.assert_allclose(middle, [[3.0, 2.0]])


def sighted(times, places, stamp=10.0, ident="a") -> Tracks:
    """Return tracks of one obstacle with measurements at these times."""
    times, places = np.asarray(times, dtype=float), np.asarray(places, dtype=float)
    grid = np.full((1, 3, 2), np.nan)
    grid[0, -1] = places[-1]
    sightings = Measurements([times], [places], [np.zeros((len(times), 2, 2))], [4])
    noise = np.zeros((1, 2, 2))
    return Tracks(grid, 0.5, (ident,), [0.3], noise, stamp, sightings=sightings)


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
    newest = np.tile([0.0, 1.0], (3, 1))
    past, new = np.zeros(3, dtype=bool), np.ones(3, dtype=bool)
    for steps, times in ((1, [1.0]), (4, [1.0, 2.0, 9.0, 9.0])):
        mean = np.zeros((3, 2, steps, 2))
        for o, (one, two) in enumerate(((0.25, 0.5), (0.375, 0.875), (1.0, 3.0))):
            mean[o, :, :, 0] = np.array([[one], [two]]) * np.array(times)
        mean[..., 1] = 1.0
        weight = np.tile([0.75, 0.25], (3, 1))
        # Mean displacements 0.3125, 0.5 and 1.5 m in 0.5 s, and in 1 s.
        for dt, wanted in ((0.5, [1, 1, 2]), (1.0, [0, 1, 2]), (1.001, [0, 0, 1])):
            assert own._kinds(mean, weight, newest, past, dt).tolist() == wanted
            once = own._kinds(mean, weight, newest, new, dt).tolist()
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
        tracks = tracks_of(np.zeros((1, 2, 2)), stamp)
        assert resolution(tracks.dt, tracks.stamp) == wanted


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
    """Of a circle around its forecast; who is not known is neither."""
    places = [(2.0, 0.0), (13.0, 0.0), (20.0, 0.1), (np.nan, 0.0)]
    looks = looks_at([0, 1, 2, 3], np.zeros(4), [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0), (9.0, 9.0)],
                     [0, 1, 1, 2], [1, 1, 1, 1])  # fmt: skip
    assert _missed(looks, np.array(places), 0.05)[:3].tolist() == [0.0, 1.0, 0.0]
    own = AdaptiveConformal(Static(), tail=0.05, rate=0.2, steps=2, speeds=(0.5,))
    log_scale = np.reshape(own._weighed((0.0,) * 6, looks, np.array(places)), (3, 2))
    # Of the second class a miss and a hit; the one of the last class is not known.
    wanted = [[0.0, -0.2 * 0.05], [0.0, 0.2 * (1.0 - 0.1) / np.sqrt(2.0)], [0.0, 0.0]]
    np.testing.assert_allclose(log_scale, wanted, atol=1e-15)


def test_each_person_is_judged_once_its_own_measurement_reaches_the_step() -> None:
    """And only once; who is gone is waited for, as long as its measurements may still come."""
    step = np.array([1, 2, 0, 1, 2, 0, 1, 2])
    row = np.array([0, 0, 1, 1, 1, 2, 2, 2])
    waiting = looks_at(row, 5.0 + 0.5 * (step + 1.0), kind=row, step=step)
    state = Online(5.0, 0.5, (0.0,) * 9, 5.0, ("late", "gone", "now"), waiting)
    own = AdaptiveConformal(Static(), steps=3, speeds=(0.5,), state=state)
    times = [[4.9, 5.4, 5.9, 6.4], [5.0, 6.0, 6.5]]
    sightings = Measurements(times, [np.zeros((4, 2)), np.zeros((3, 2))],
                          [np.zeros((4, 2, 2)), np.zeros((3, 2, 2))])  # fmt: skip
    tracks = Tracks(np.zeros((2, 3, 2)), 0.5, ("late", "now"), np.full(2, 0.3),
                    np.zeros((2, 2, 2)), 6.5, sightings=sightings)  # fmt: skip
    after = state.about(tracks.ids)
    assert after.ids == ("late", "now", "gone")
    due, rest = own._due(after, tracks)
    # The first one is known up to 6.4 s: of its steps at 6 and 6.5 s the first is due.
    found = sorted(zip(due.row.tolist(), due.step.tolist(), due.time.tolist(), strict=True))
    assert found == [(0, 1, 6.0), (1, 0, 5.5), (1, 1, 6.0), (1, 2, 6.5)]
    assert due.kind.tolist() == [0 if row == 0 else 2 for row in due.row]
    left = sorted(zip(rest.row.tolist(), rest.step.tolist(), strict=True))
    assert left == [(0, 2), (2, 0), (2, 1), (2, 2)]
    due, again = own._due(replace(after, waiting=rest), tracks)
    assert not len(due.row) and len(again.row) == 4
    later = replace(tracks, stamp=5.0 + 0.5 * (3 + BRIDGE), sightings=None)
    assert not len(own._due(replace(after, waiting=rest), later)[1].row)


def test_forecasts_of_fewer_modes_wait_with_those_of_more() -> None:
    """With modes of weight 0 behind theirs."""
    one = looks_at([0], [1.0], [(1.0, 2.0)])
    two = replace(one, mean=np.ones((1, 2, 2)), covariance=np.ones((1, 2, 2, 2)),
                  weight=np.array([[0.3, 0.7]]))  # fmt: skip
    for first, second in ((one, two), (two, one)):
        both = first.joined(second)
        assert both.weight.tolist() == [
            [1.0, 0.0] if part is one else [0.3, 0.7] for part in (first, second)
        ]
        assert both.mean.shape == (2, 2, 2) and both.covariance.shape == (2, 2, 2, 2)
