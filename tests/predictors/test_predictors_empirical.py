"""The empirical predictor: what it learns, where it stands aside, how it is carried on."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.config import build, describe, load_plugin, save_plugin
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.core.calibration import replayed, squared_distances
from wideberth.predictors.core.history import gather
from wideberth.predictors.data.windows import cut_windows
from wideberth.predictors.empirical import (
    FLOOR,
    SHRINKAGE,
    STILL,
    Empirical,
    ErrorTable,
    MotionClass,
    _nearest_error,
    learn_table,
)
from wideberth.predictors.static import Static

DT = 0.4
OBSERVED, STEPS = 4, 5
GROWTH = np.arange(1.0, STEPS + 1)
ALONG, ACROSS, STILL_SPREAD = 0.10 * GROWTH, 0.04 * GROWTH, 0.02 * GROWTH
"""m, true standard deviations per step: of those who walk, and of those who stand."""
STRAIGHT = ConstantVelocity(window=1)


def tracks_of(positions, dt=DT, ids=None):
    positions = np.asarray(positions, dtype=float)
    count, _, size = positions.shape
    names = tuple(f"o{i}" for i in range(count)) if ids is None else ids
    spread = np.tile(1e-4 * np.eye(size), (count, 1, 1))
    return Tracks(positions, dt, names, np.full(count, 0.3), spread)


def crowd(count, rng, size=2, jitter=0.0, correlation=0.0):
    """Half stand and half walk at 1 m/s; errors as stated above, correlated over the steps."""
    heading = rng.standard_normal((count, size))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    walks = np.arange(count) % 2 == 1
    speed = np.where(walks, 1.0 + 0.1 * rng.random(count), 0.05 * rng.random(count))
    velocity = speed[:, None] * heading
    time = DT * np.arange(1.0 - OBSERVED, STEPS + 1)
    paths = time[:, None] * velocity[:, None]
    shaken = rng.normal(scale=jitter * DT, size=(count, OBSERVED, size))
    paths[:, :OBSERVED] += shaken - shaken[:, -1:]
    steps = np.arange(STEPS)
    root = np.linalg.cholesky(
        correlation ** np.abs(steps[:, None] - steps) + 1e-12 * np.eye(STEPS)
    )
    unit = np.einsum("ij,wjd->wid", root, rng.standard_normal((count, STEPS, size)))
    forward = np.einsum("wnd,wd->wn", unit, heading)[..., None] * heading[:, None]
    moving = ALONG[:, None] * forward + ACROSS[:, None] * (unit - forward)
    paths[:, OBSERVED:] += np.where(walks[:, None, None], moving, STILL_SPREAD[:, None] * unit)
    return tracks_of(paths)


def fitted(scene, **settings):
    base = settings.pop("base", STRAIGHT)
    classes = {"speeds": 2, "jitters": 1, **settings}
    return Empirical(base, OBSERVED, STEPS, **classes).fit([scene])


@pytest.mark.parametrize("size", [2, 3])
def test_it_learns_the_spread_along_and_across(size):
    rng = np.random.default_rng(1)
    predictor = fitted(crowd(8000, rng, size))
    table = np.sqrt(np.array(predictor.fitted.variances))
    # A standard deviation from 4000 errors is right to 1 / sqrt(8000); shrinkage adds 1 %.
    assert np.allclose(table[1], np.stack([ALONG, ACROSS], axis=1), rtol=5 / 90 + 0.05, atol=0)
    assert np.allclose(table[0], STILL_SPREAD[:, None], rtol=0.12, atol=0)
    walker = tracks_of(np.arange(OBSERVED)[None, :, None] * DT * np.eye(size)[0])
    covariance = predictor.predict(walker, STEPS).covariance[0, 0]
    wanted = np.full((STEPS, size), table[1, :, 1:] ** 2)
    wanted[:, 0] = table[1, :, 0] ** 2
    assert np.allclose(covariance, (wanted + FLOOR**2)[:, None] * np.eye(size), atol=1e-15)


def test_it_is_calibrated_on_its_own_model():
    rng = np.random.default_rng(2)
    predictor = fitted(crowd(8000, rng))
    new = cut_windows(crowd(4000, rng), OBSERVED, STEPS)
    forecast = predictor.predict(new.tracks, STEPS)
    parts = forecast.mean, forecast.covariance, forecast.weight
    inside = squared_distances(*parts, new.future) < chi2.ppf(0.95, 2)
    for group in (inside[0::2], inside[1::2]):
        # 5 sigma of 2000 draws, and 1 % for what 4000 windows have not told.
        assert np.abs(group.mean(axis=0) - 0.95).max() < 5 * np.sqrt(0.05 * 0.95 / 2000) + 0.01


def test_steps_are_correlated_as_they_were():
    rng = np.random.default_rng(3)
    predictor = fitted(crowd(8000, rng, correlation=0.8))
    steps = np.arange(STEPS)
    wanted = 0.8 ** np.abs(steps[:, None] - steps)
    assert np.abs(np.array(predictor.fitted.along) - wanted).max() < 5 * 0.36 / np.sqrt(4000)
    walker = tracks_of(np.arange(OBSERVED)[None, :, None] * DT * np.array([0.6, 0.8]))
    for grid in (walker, replace(walker, dt=0.5 * DT)):
        forecast = predictor.predict(grid, 2 * STEPS + 3)
        joint = forecast.joint[0, 0]
        blocks = joint.reshape(2 * STEPS + 3, 2, 2 * STEPS + 3, 2)
        each = np.arange(2 * STEPS + 3)
        assert np.allclose(blocks[each, :, each], forecast.covariance[0, 0], rtol=1e-9)
        assert np.linalg.eigvalsh(joint).min() > -1e-9
    known = predictor.predict(walker, STEPS).joint[0, 0].reshape(STEPS, 2, STEPS, 2)
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    turned = np.einsum("ab,ibjc,dc->iajd", turn, known, turn)
    spread = np.sqrt(turned[steps, 0, steps, 0])
    assert np.abs(turned[:, 0, :, 0] / np.outer(spread, spread) - wanted).max() < 0.05
    assert np.abs(turned[:, 0, :, 1]).max() < 1e-12


def test_other_time_grids():
    predictor = fitted(crowd(2000, np.random.default_rng(4)))
    past = np.arange(OBSERVED)[None, :, None] * DT * np.array([1.0, 0.0])
    whole = np.sqrt(predictor.predict(tracks_of(past), STEPS + 4).covariance[0, 0, :, 0, 0])
    table = np.sqrt(np.array(predictor.fitted.variances)[1, :, 0])
    beyond = table[-1] + (table[-1] - table[-2]) * np.arange(1, 5)
    assert np.allclose(whole, np.hypot(np.concatenate([table, beyond]), FLOOR), rtol=1e-12)
    half = tracks_of(past / 2, dt=DT / 2)
    fine = np.sqrt(predictor.predict(half, 2 * STEPS).covariance[0, 0, :, 0, 0])
    assert np.allclose(fine[1::2], whole[:STEPS], rtol=1e-12)
    before = np.concatenate([[0.0], table[:-1]])
    assert np.allclose(fine[::2], np.hypot(0.5 * (before + table), FLOOR), rtol=1e-12)


def test_spread_grows_with_jitter_beyond_the_highest_edge():
    rng = np.random.default_rng(5)
    predictor = fitted(crowd(4000, rng, jitter=0.1), speeds=1, jitters=3)
    top = predictor.fitted.jitters[-1]
    zigzag = np.array([0.0, 1.0, 0.0, 1.0])
    spreads = []
    for times in (2.0, 6.0):
        path = np.zeros((1, OBSERVED, 2))
        # |v_j - v_{j-1}| is 2 |amplitude| / dT at every step.
        path[0, :, 0] = zigzag * 0.5 * times * top * DT
        spreads.append(
            np.sqrt(predictor.predict(tracks_of(path), STEPS).covariance[0, 0, :, 1, 1])
        )
    assert np.allclose(spreads[1], 3.0 * spreads[0], rtol=2e-3)


def test_who_was_not_seen_lately_is_forecast_from_then_on():
    predictor = fitted(crowd(2000, np.random.default_rng(6)))
    past = np.arange(OBSERVED + 2)[None, :, None] * DT * np.array([1.0, 0.0])
    lost = past.copy()
    lost[:, OBSERVED:] = np.nan
    early = predictor.predict(tracks_of(past[:, :OBSERVED]), STEPS + 2)
    late = predictor.predict(tracks_of(lost), STEPS)
    assert np.allclose(late.mean, early.mean[:, :, 2:], atol=1e-12)
    assert np.allclose(late.covariance, early.covariance[:, :, 2:], rtol=1e-12)
    assert np.allclose(late.joint, early.joint[:, :, 4:, 4:], rtol=1e-12)


def test_unfitted_or_too_short_it_is_the_base():
    scene = crowd(2000, np.random.default_rng(7))
    tracks = scene.select([0, 1])
    plain, base = Empirical(STRAIGHT).predict(tracks, STEPS), STRAIGHT.predict(tracks, STEPS)
    assert np.array_equal(plain.covariance, base.covariance)
    positions = tracks.positions.copy()
    positions[0, :-2] = np.nan
    positions[1, :-1] = np.nan
    short = replace(tracks, positions=positions)
    forecast, base = fitted(scene).predict(short, STEPS), STRAIGHT.predict(short, STEPS)
    assert forecast.fallback == ("empirical: 2 samples, needs 3", base.fallback[1])
    assert np.array_equal(forecast.covariance, base.covariance)
    assert np.array_equal(forecast.joint, base.joint)


def test_its_base_is_fitted_as_well():
    scene = crowd(2000, np.random.default_rng(7))
    base = Empirical(STRAIGHT, OBSERVED, STEPS, speeds=2, jitters=1)
    assert fitted(scene, base=base).base == base.fit([scene]) != base


def test_laws_hold_once_fitted():
    rng = np.random.default_rng(8)
    check_predictor(
        Empirical(STRAIGHT, OBSERVED, STEPS, 3, 3), dataset=[crowd(4000, rng, jitter=0.05)]
    )
    still = tracks_of(np.zeros((200, OBSERVED + STEPS, 2)))
    certain = fitted(still, speeds=3, jitters=3, base=Static())
    check_predictor(certain)
    spread = certain.predict(still.select([0]), STEPS).covariance[0, 0]
    assert np.allclose(spread, FLOOR**2 * np.eye(2), rtol=1e-9)


@dataclass(frozen=True)
class Counting(Predictor):
    """Puts everybody as far along x as there are obstacles."""

    def predict(self, tracks, steps, scene=None):
        count, size = len(tracks), tracks.dimension
        mean = np.zeros((count, steps, size))
        mean[..., 0] = count
        return Forecast.single(mean, np.ones((count, steps, 1, 1)) * np.eye(size), tracks.dt)


def test_a_base_is_asked_with_the_neighbours_of_the_time():
    positions = np.zeros((3, 12, 2))
    positions[1, 6:] = np.nan
    positions[2, :8] = np.nan
    scene = tracks_of(positions)
    windows = cut_windows(scene, 2, 1)
    mean, _, _ = replayed(Counting(), scene, windows)
    present = np.isfinite(positions[..., 0]).sum(axis=0)
    assert np.array_equal(mean[:, 0, 0, 0], present[windows.row])


def test_it_is_saved_and_described(tmp_path):
    predictor = fitted(crowd(500, np.random.default_rng(9)))
    again = load_plugin(save_plugin(tmp_path / "e.json", "predictor", predictor), "predictor")
    assert again == predictor == build("predictors", describe(predictor))
    tracks = crowd(5, np.random.default_rng(10))
    one, two = predictor.predict(tracks, 3), again.predict(tracks, 3)
    assert np.array_equal(one.covariance, two.covariance)


def test_bad_input():
    with pytest.raises(WideberthError, match=r"empirical\.observed is 2"):
        Empirical(observed=2)
    with pytest.raises(WideberthError, match=r"hold 5 windows of 4 \+ 5"):
        fitted(crowd(5, np.random.default_rng(11)))
    scene = crowd(200, np.random.default_rng(12))
    with pytest.raises(WideberthError, match=r"0\.2 s, 0\.4 s"):
        Empirical(STRAIGHT, OBSERVED, STEPS, 2, 1).fit([scene, replace(scene, dt=0.2)])
    table = fitted(scene).fitted
    for change in ({"speeds": ()}, {"along": ((1.0,),)}, {"variances": (((-1.0, 1.0),) * 5,) * 2}):
        with pytest.raises(WideberthError, match="table"):
            replace(table, **change)


def test_every_window_counts_alike_for_the_correlation():
    """Errors of the slow are of 1 m and stay; those of the fast are of 3 m and change."""
    rng = np.random.default_rng(14)
    count = 4000
    fast = np.arange(count) % 2
    motion = MotionClass(0.5 + fast, np.tile([1.0, 0.0], (count, 1)), np.zeros(count))
    fixed = np.repeat(rng.standard_normal((count, 1, 2)), 2, axis=1)
    free = rng.standard_normal((count, 2, 2))
    error = np.where(fast[:, None, None] == 1, 3.0 * free, fixed)
    table = learn_table(motion, error, 0.5, 2, 1)
    for found in (table.along, table.across):
        assert found[0][1] == pytest.approx(0.5, abs=0.05)


# against a second implementation, number by number


def test_motion_is_read_from_the_samples_that_there_are():
    positions = np.full((4, 5, 2), np.nan)
    positions[0] = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [2.0, 2.0], [2.6, 2.8]]
    positions[1, 2:] = [[5.0, 5.0], [5.0, 6.0], [6.0, 6.0]]
    positions[2, 3:] = 7.0
    positions[3, 4:] = 8.0
    found = MotionClass.of(gather(tracks_of(positions)), DT)
    for o in range(4):
        seen = positions[o][np.isfinite(positions[o, :, 0])]
        steps = np.diff(seen, axis=0) / DT
        speed = np.hypot(*steps[-1]) if len(steps) else 0.0
        assert found.speed[o] == pytest.approx(speed)
        wanted = steps[-1] / speed if speed else np.zeros(2)
        np.testing.assert_allclose(found.heading[o], wanted)
        change = np.diff(steps, axis=0)
        jitter = np.sqrt(np.sum(change**2) / len(change)) if len(change) else 0.0
        assert found.jitter[o] == pytest.approx(jitter)
    alone = MotionClass.of(gather(tracks_of(positions[:, -1:])), DT)
    assert not alone.speed.any() and not alone.jitter.any() and not alone.heading.any()


def motions(rng, count, size):
    heading = rng.standard_normal((count, size))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    speed = rng.random(count)
    speed[:3], heading[:3] = 0.0, 0.0
    return MotionClass(speed, heading, rng.random(count))


@pytest.mark.parametrize("size", [2, 3])
def test_a_table_holds_the_means_of_its_classes(size):
    rng = np.random.default_rng(31)
    motion, error = motions(rng, 90, size), rng.standard_normal((90, 4, size))
    table = learn_table(motion, error, 0.4, 3, 2)
    assert (table.dt, table.windows) == (0.4, 90)
    np.testing.assert_allclose(table.speeds, np.quantile(motion.speed, [1 / 3, 2 / 3]))
    np.testing.assert_allclose(table.jitters, [np.median(motion.jitter)])
    wide = np.maximum(motion.jitter / table.jitters[-1], 1.0) ** 2
    squares, parts = np.zeros((90, 4, 2)), []
    for w in range(90):
        ahead = error[w] @ motion.heading[w]
        side = error[w] - ahead[:, None] * motion.heading[w]
        axes = size - 1 if motion.speed[w] else size
        squares[w] = np.stack([ahead**2, (side**2).sum(axis=1) / axes], axis=1) / wide[w]
        parts.append((ahead, side))
    kinds = [
        2 * sum(v > edge for edge in table.speeds) + int(j > table.jitters[0])
        for v, j in zip(motion.speed, motion.jitter, strict=True)
    ]
    assert table.bins(motion).tolist() == kinds
    np.testing.assert_allclose(table.growth(motion), wide)
    known = np.zeros((6, 4, 2))
    for kind in range(6):
        mine = squares[np.array(kinds) == kind]
        known[kind] = (mine.sum(axis=0) + SHRINKAGE * squares.mean(axis=0)) / (
            len(mine) + SHRINKAGE
        )
    for kind in (0, 1):  # of the slow, in both columns the mean over the axes
        mean = (known[kind, :, 0] + (size - 1) * known[kind, :, 1]) / size
        known[kind] = mean[:, None]
    np.testing.assert_allclose(table.variances, known)
    for found, part in ((table.along, 0), (table.across, 1)):
        moment = STILL * np.eye(4)
        for w in range(90):
            scale = np.sqrt(known[kinds[w], :, part] * wide[w])
            one = parts[w][part].reshape(4, -1) / scale[:, None]
            moment += one @ one.T
        root = np.sqrt(np.diag(moment))
        np.testing.assert_allclose(found, moment / np.outer(root, root))


TABLE = ErrorTable(
    0.5,
    (0.4,),
    (0.3,),
    tuple(
        tuple((k + 0.1 * h * (1 if k < 3 else -0.4), 0.5 * k + 0.2 * h) for h in range(1, 4))
        for k in range(1, 5)
    ),
    ((1.0, 0.5, 0.2), (0.5, 1.0, 0.6), (0.2, 0.6, 1.0)),
    ((1.0, 0.1, 0.0), (0.1, 1.0, 0.3), (0.0, 0.3, 1.0)),
    7,
)
"""Errors that grow over the last step, and, in the two fast classes, shrink along the heading."""


def spread_at(motion, o, time, axis):
    """Linear between the steps, from 0; beyond the last as over the last, but no less."""
    kind = 2 * int(motion.speed[o] > 0.4) + int(motion.jitter[o] > 0.3)
    known = np.sqrt([0.0, *(row[axis] for row in TABLE.variances[kind])])
    place = time / TABLE.dt
    value = np.interp(place, range(4), known)
    value += max(place - 3.0, 0.0) * max(known[3] - known[2], 0.0)
    return np.hypot(value * max(motion.jitter[o] / 0.3, 1.0), FLOOR)


def test_spreads_and_correlations_at_any_time():
    rng = np.random.default_rng(32)
    motion = motions(rng, 12, 2)
    times = np.tile([0.1, 0.5, 0.8, 1.0, 1.5, 1.7, 2.9], (12, 1)) + 0.01 * np.arange(12)[:, None]
    spread = TABLE.spreads(motion, times)
    assert {int(k) for k in TABLE.bins(motion)} == {0, 1, 2, 3}
    for o in range(12):
        for h, time in enumerate(times[o]):
            wanted = [spread_at(motion, o, time, axis) for axis in (0, 1)]
            np.testing.assert_allclose(spread[o, h], wanted)
    for found, table in zip(TABLE.correlations(times), (TABLE.along, TABLE.across), strict=True):
        for o in range(12):
            shares = np.zeros((7, 3))
            for h, time in enumerate(times[o]):
                place = min(max(time / 0.5 - 1.0, 0.0), 2.0)
                below = min(int(place), 1)
                shares[h, below : below + 2] = below + 1 - place, place - below
            moment = shares @ np.array(table) @ shares.T
            root = np.sqrt(np.diag(moment))
            np.testing.assert_allclose(found[o], moment / np.outer(root, root), atol=1e-12)


def test_the_joint_covariance_turns_with_the_heading():
    """Blocks a_h a_j rho u u' + c_h c_j sigma (I - u u'); of who is short, the base's."""
    rng = np.random.default_rng(33)
    paths = rng.standard_normal((3, 4, 2)).cumsum(axis=1)
    paths[2, :2] = np.nan
    own = Empirical(STRAIGHT, observed=4, steps=3, fitted=TABLE)
    scene = tracks_of(paths, dt=0.5)
    forecast, base = own.predict(scene, 5), STRAIGHT.predict(scene, 5)
    motion = MotionClass.of(gather(scene, length=4), 0.5)
    times = 0.5 * np.arange(1.0, 6.0)
    along, across = TABLE.correlations(np.tile(times, (3, 1)))
    for o in range(2):
        u = np.outer(motion.heading[o], motion.heading[o])
        a, c = ([spread_at(motion, o, time, axis) for time in times] for axis in (0, 1))
        for h in range(5):
            for j in range(5):
                wanted = a[h] * a[j] * along[o, h, j] * u
                wanted = wanted + c[h] * c[j] * across[o, h, j] * (np.eye(2) - u)
                block = forecast.joint[o, 0, 2 * h : 2 * h + 2, 2 * j : 2 * j + 2]
                np.testing.assert_allclose(block, wanted, atol=1e-12)
                if h == j:
                    np.testing.assert_allclose(forecast.covariance[o, 0, h], wanted, atol=1e-12)
    assert forecast.fallback == (None, None, "empirical: 2 samples, needs 3")
    np.testing.assert_array_equal(forecast.joint[2], base.joint[2])
    np.testing.assert_array_equal(forecast.covariance[2], base.covariance[2])


@dataclass(frozen=True)
class Three(Predictor):
    """Three modes, the last of no weight, at places that do not move."""

    def predict(self, tracks, steps, scene=None):
        places = np.array([[0.0, 0.0], [3.0, 0.0], [1.0, 1.0]])
        mean = np.tile(places[None, :, None], (len(tracks), 1, steps, 1))
        covariance = np.tile(np.eye(2), (len(tracks), 3, steps, 1, 1))
        weight = np.tile([0.5, 0.5, 0.0], (len(tracks), 1))
        return Forecast(mean, covariance, weight, tracks.dt, (None,) * len(tracks))


def test_an_error_is_that_of_the_mode_that_came_nearest_over_the_horizon():
    """By squares: a way that is far off once is farther than one that is a little off twice."""
    paths = np.zeros((3, 3, 2))
    paths[0, 1:] = [[0.4, 0.0], [2.9, 0.0]]  # 0.16 + 8.41 from the first, 6.76 + 0.01
    paths[1, 1:] = [[1.0, 1.0], [1.1, 1.0]]  # nearest to the one of no weight
    paths[2, 1:] = [[-3.0, 0.0], [2.0, 0.0]]
    scene = tracks_of(paths)
    found = _nearest_error(Three(), scene, cut_windows(scene, 1, 2))
    np.testing.assert_allclose(found[0], paths[0, 1:] - [3.0, 0.0])
    np.testing.assert_allclose(found[1], paths[1, 1:])
    np.testing.assert_allclose(found[2], paths[2, 1:])


@pytest.mark.parametrize("edges", ["speeds", "jitters"])
def test_edges_of_a_table_do_not_decrease(edges):
    rows = (TABLE.variances[0],) * 6
    for values, refused in (((0.3, 0.3), False), ((0.4, 0.3), True)):
        if refused:
            with pytest.raises(WideberthError, match="edges must not decrease"):
                replace(TABLE, variances=rows, **{edges: values})
        else:
            assert getattr(replace(TABLE, variances=rows, **{edges: values}), edges) == values
