"""Values refuse what cannot be meant, in one sentence."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from wideberth.draw.forecasts import content_outlines
from wideberth.framework.tracking.history import History
from wideberth.framework.values.arrays import (
    Array,
    altered,
    checked,
    checked_covariance,
    positive,
    probability,
    whole,
)
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, GaussianObstacle, Scene, resample
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks


def forecast(steps: int = 4, dt: float = 0.5) -> Forecast:
    time = dt * np.arange(1, steps + 1)
    mean = np.stack([time, np.zeros(steps)], -1)[None]
    covariance = time[:, None, None] * np.eye(2)
    return Forecast.single(mean, covariance[None], dt)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0.0, 0.0]], "at least two"),
        ([[0.0, 0.0], [0.0, 0.0]], "repeats the point"),
        ([[0.0, 0.0], [np.nan, 1.0]], "finite"),
        ([[0.0], [1.0]], "columns"),
        ([["a", "b"], ["c", "d"]], "not an array of numbers"),
    ],
)
def test_bad_paths(points: list[list[float]], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Path(np.array(points))


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[1.0, 0.0], [0.0, -0.1]], "eigenvalue -0.1"),
        ([[1.0, 0.5], [0.0, 1.0]], "not symmetric"),
        ([[np.nan, 0.0], [0.0, 1.0]], "finite"),
        ([[1.0]], "shape"),
    ],
)
def test_bad_covariances(matrix: list[list[float]], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        checked_covariance("covariance", matrix, (2, 2))
    with pytest.raises(WideberthError):
        GaussianObstacle(np.zeros(2), np.array(matrix))


def test_one_matrix_is_judged_as_it_is_among_others() -> None:
    """One of 2 x 2 is checked number by number, several by NumPy."""
    entries = (-1.0, -1e-12, 0.0, 1e-300, 0.5, 1.0, 1e200, np.inf, np.nan)
    for numbers in product(entries, repeat=4):
        matrix = np.array(numbers).reshape(2, 2)
        assert judged(matrix) == judged(matrix[None]), matrix


def judged(matrix: Array) -> str:
    """Return the covariance, or in a word why it is none."""
    try:
        return str(checked_covariance("c", matrix, matrix.shape).ravel().tolist())
    except WideberthError as error:
        return next(word for word in ("finite", "symmetric", "eigenvalue") if word in str(error))


def test_bad_numbers() -> None:
    for value in (-1.0, np.nan, np.inf, 0.0, "x"):
        with pytest.raises(WideberthError, match="radius"):
            positive("radius", value)  # type: ignore[arg-type]
    for value in (0.0, 1.0, -0.1, 1.2):
        with pytest.raises(WideberthError, match="tail"):
            probability("tail", value)
    for count in (0, 1.5, True):
        with pytest.raises(WideberthError, match="horizon"):
            whole("horizon", count)  # type: ignore[arg-type]
    assert checked("x", [1, 2], (None,)).flags.writeable is False


def test_bad_tracks_and_observations() -> None:
    fine = np.zeros((1, 3, 2))
    noise = np.eye(2)[None]
    with pytest.raises(WideberthError, match="different identities"):
        Tracks(np.zeros((2, 3, 2)), 0.5, ("a", "a"), np.ones(2), np.eye(2)[None].repeat(2, 0))
    with pytest.raises(WideberthError, match="radius"):
        Tracks(fine, 0.5, ("a",), np.array([-1.0]), noise)
    with pytest.raises(WideberthError, match="infinity"):
        Tracks(fine + np.inf, 0.5, ("a",), np.ones(1), noise)
    with pytest.raises(WideberthError, match="dt"):
        Tracks(fine, 0.0, ("a",), np.ones(1), noise)
    # What a sensor may report at any time is no error, but named.
    assert Detection("a", np.zeros(2), np.eye(2), -0.5).flaw == "radius is -0.5"
    assert Observation(0.0, np.array([0.0, np.nan])).flaw == "state is [0.0, nan]"


def test_bad_forecasts() -> None:
    good = forecast()
    with pytest.raises(WideberthError, match="sum to 1"):
        Forecast(good.mean, good.covariance, np.array([[0.5]]), 0.5, (None,))
    two = Forecast.single(good.mean.repeat(2, 1)[0, :, None, 0], np.zeros((2, 1, 2, 2)), 0.5)
    for weight in ([[-0.5, 1.5]], [[0.5, 0.5 + 1e-8]]):
        with pytest.raises(WideberthError, match="sum to 1"):
            Forecast(
                two.mean.swapaxes(0, 1), np.zeros((1, 2, 1, 2, 2)), np.array(weight), 0.5, (None,)
            )
    with pytest.raises(WideberthError, match=r"forecast\.joint"):
        Forecast(good.mean, good.covariance, good.weight, 0.5, (None,), np.zeros((1, 1, 3, 3)))
    with pytest.raises(WideberthError, match="increase"):
        Scene(plan_times=np.array([1.0, 1.0]))
    with pytest.raises(WideberthError, match=r"scene\.plan_times"):
        Scene(plan=np.zeros((3, 2)), plan_times=np.array([1.0, 2.0]))
    for name in ("plan", "goals"):
        with pytest.raises(WideberthError, match=rf"scene\.{name}"):
            Scene(**{name: np.zeros(3)})
        assert getattr(Scene(**{name: [[1, 2]]}), name).dtype == np.float64
    assert Scene().plan_times is None and Scene(plan_times=np.array([1.0, 1.5])).radius == 0.0
    with pytest.raises(WideberthError, match="fallback"):
        Forecast(good.mean, good.covariance, good.weight, 0.5, ())
    with pytest.raises(WideberthError, match="predict more steps"):
        resample(good, np.zeros((1, 2)), np.eye(2)[None] * 0, np.array([1.0, 2.5]))


def test_resampling_interpolates_and_starts_at_the_newest_position() -> None:
    other = resample(forecast(), np.zeros((1, 2)), np.zeros((1, 2, 2)), np.array([0.25, 1.25]))
    assert other.mean[0, 0, :, 0] == pytest.approx([0.25, 1.25])
    assert other.covariance[0, 0, :, 0, 0] == pytest.approx([0.25, 1.25])
    same = resample(forecast(), np.zeros((1, 2)), np.eye(2)[None], 0.5 * np.arange(1, 5))
    assert np.array_equal(same.mean, forecast().mean)


def test_resampling_two_modes_of_two_obstacles_is_linear_between_the_steps() -> None:
    rng = np.random.default_rng(5)
    mean = rng.standard_normal((2, 2, 4, 2))
    root = rng.standard_normal((2, 2, 4, 2, 2))
    covariance = root @ root.swapaxes(-1, -2)
    weight = np.array([[0.3, 0.7], [1.0, 0.0]])
    reasons = ("a", None)
    own = Forecast(mean, covariance, weight, 0.5, reasons, np.tile(np.eye(8), (2, 2, 1, 1)))
    origin, spread = rng.standard_normal((2, 2)), np.tile(0.1 * np.eye(2), (2, 1, 1))
    for times in (
        [0.0, 0.3, 0.6],
        [0.5, 1.0, 1.5],
        [0.5, 1.0, 1.5, 2.0 - 1e-7],
        [1.9],
        [0.0, 2.0],
    ):
        asked = np.array(times)
        found = resample(own, origin, spread, asked)
        for o in range(2):
            for m in range(2):
                means = np.concatenate([origin[o][None], mean[o, m]])
                spreads = np.concatenate([spread[o][None], covariance[o, m]])
                grid = 0.5 * np.arange(5)
                for i in range(2):
                    wanted = np.interp(asked, grid, means[:, i])
                    np.testing.assert_allclose(found.mean[o, m, :, i], wanted, atol=1e-12)
                    for j in range(2):
                        wanted = np.interp(asked, grid, spreads[:, i, j])
                        got = found.covariance[o, m, :, i, j]
                        np.testing.assert_allclose(got, wanted, atol=1e-12)
        assert found.dt == pytest.approx(times[1] - times[0] if len(times) > 1 else 0.5)
        assert np.array_equal(found.weight, weight) and found.fallback == reasons
        assert found.joint is None
    grid = 0.5 * np.arange(1, 5)
    assert (
        resample(own, origin, spread, grid) is resample(own, origin, spread, grid + 1e-10) is own
    )
    ends = resample(own, origin, spread, np.array([-4e-10, 2.0 + 4e-10])).mean
    np.testing.assert_array_equal(ends[:, :, 1], mean[:, :, 3])
    np.testing.assert_array_equal(ends[:, 0, 0], origin)
    for time in (-1e-8, 2.0 + 1e-8):
        with pytest.raises(WideberthError, match="predict more steps"):
            resample(own, origin, spread, np.array([1.0, time]))


def test_samples_have_the_forecast_s_moments() -> None:
    count = 20_000
    draws = forecast().sample(np.random.default_rng(1), count)
    assert draws.shape == (count, 1, 4, 2)
    spread = draws[:, 0].var(axis=0)
    expected = 0.5 * np.arange(1, 5)[:, None]
    three_sigma = 3 * expected * np.sqrt(2 / count)
    assert (np.abs(spread - expected) < 1.5 * three_sigma).all()
    mixed = Forecast(
        np.array([[[[0.0, 0.0]], [[9.0, 0.0]]]]),
        np.zeros((1, 2, 1, 2, 2)),
        np.array([[0.25, 0.75]]),
        0.5,
        (None,),
    ).sample(np.random.default_rng(2), count)
    share = (mixed[:, 0, 0, 0] > 1).mean()
    assert abs(share - 0.75) < 3 * np.sqrt(0.75 * 0.25 / count)
    joint = np.ones((1, 1, 2, 2))
    linked = Forecast(
        np.zeros((1, 1, 2, 1)), np.ones((1, 1, 2, 1, 1)), np.ones((1, 1)), 0.5, (None,), joint
    ).sample(np.random.default_rng(3), 50)
    assert linked[:, 0, 0] == pytest.approx(linked[:, 0, 1], abs=1e-7)


def test_path_measures_projects_and_points() -> None:
    path = Path(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]))
    assert path.length == 7.0
    assert path.at(np.array([0.0, 5.0, 99.0])) == pytest.approx(np.array([[0, 0], [3, 2], [3, 4]]))
    assert path.direction(np.array([1.0, 4.0])) == pytest.approx(np.array([[1, 0], [0, 1]]))
    assert path.project(np.array([3.5, 2.0])) == pytest.approx(5.0)
    assert path.project(np.array([1.0, 1.0]), start=2.0) == pytest.approx(2.0)
    assert path.project(np.array([3.0, 4.0]), window=2.0) == pytest.approx(2.0)


@given(st.floats(0.0, 7.0), st.floats(-0.3, 0.3))
def test_projecting_a_path_point_gives_its_arc_length(arc: float, aside: float) -> None:
    path = Path(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]))
    left = np.array([[0, -1], [1, 0]]) @ path.direction(np.array(arc))
    near_corner = abs(arc - 3.0) < 0.31
    point = path.at(np.array(arc)) + (0.0 if near_corner else aside) * left
    assert path.project(point) == pytest.approx(arc, abs=1e-9)


def detection(ident: str, x: float, age: float = 0.0) -> Detection:
    return Detection(ident, np.array([x, 0.0]), 0.01 * np.eye(2), 0.3, age)


def test_history_lays_detections_on_a_grid() -> None:
    history = History(dt=0.5, samples=5, forget=2.0, gap=1.25)
    assert history.tracks() is None
    for k in range(13):
        if k != 6:
            history = history.add(0.25 * k, (detection("b", 0.25 * k), detection("a", 1.0)))
    tracks = history.tracks()
    assert tracks is not None
    assert tracks.ids == ("a", "b")
    assert tracks.positions[1, :, 0] == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0])


def test_history_marks_gaps_forgets_and_keeps_order() -> None:
    history = History(dt=0.5, samples=6, forget=2.0, gap=1.25)
    for time in (0.0, 0.5, 2.5):
        history = history.add(time, (detection("a", time),))
    history = history.add(2.5, (detection("a", 9.0, age=1.0),))
    tracks = history.tracks()
    assert tracks is not None
    seen = ~np.isnan(tracks.positions[0, :, 0])
    assert seen.tolist() == [True, True, False, False, False, True]
    history = history.add(4.0, (detection("c", 0.0, age=0.5),))
    late = history.tracks()
    assert late is not None
    assert late.stamp == 3.5
    assert np.isnan(late.positions[0, -1]).all()
    history = history.add(9.0, (detection("c", 0.0),))
    last = history.tracks()
    assert last is not None
    assert last.ids == ("c",)


@pytest.mark.parametrize(
    ("mean", "covariance", "words"),
    [
        (np.zeros(3), np.eye(2), r"\(2, 2\); wanted \(3, 3\): in 3 dimensions .* is 3 x 3$"),
        (np.zeros((4, 3)), np.zeros((4, 2, 2)), r"\(4, 2, 2\); wanted \(4, 3, 3\): in 3 dim"),
        (np.zeros(2), np.eye(3), r"\(3, 3\); wanted \(2, 2\): in 2 dimensions .* is 2 x 2$"),
        (np.zeros(3), 0.1, r"\(\); wanted \(3, 3\): in 3 dimensions"),
    ],
)
def test_covariances_of_another_dimension(
    mean: np.ndarray, covariance: np.ndarray, words: str
) -> None:
    with pytest.raises(WideberthError, match=rf"obstacle\.covariance has shape {words}"):
        GaussianObstacle(mean, covariance)
    with pytest.raises(WideberthError, match=r"\(2, 2\); wanted \(\.\.\., 3, 3\): in 3 dim"):
        checked_covariance("covariance", np.eye(2), 3)
    with pytest.raises(WideberthError, match=r"\(2, 2\); wanted \(3, 3\): in 3 dimensions"):
        Detection("a", np.zeros(3), np.eye(2), 0.3)


def test_a_wrong_shape_is_named_by_its_axes() -> None:
    ids, radius, noise = ("a",), np.ones(1), np.eye(2)[None]
    with pytest.raises(
        WideberthError, match=r"\(10, 2\); wanted 3 axes: obstacles, samples, coord"
    ):
        Tracks(np.zeros((10, 2)), 0.4, ids, radius, noise)
    with pytest.raises(WideberthError, match=r"\(4,\); wanted 2 axes: a row of coordinates per"):
        Path(np.array([0.0, 0.0, 1.0, 1.0]))
    with pytest.raises(
        WideberthError, match=r"wanted 4 axes: obstacles, modes, steps, coordinates"
    ):
        Forecast.single(np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)), 0.4, None)
    with pytest.raises(WideberthError, match=r"^it has shape \(\); wanted 1 axis$"):
        checked("it", 1.0, (None,))


def test_the_only_matrix_has_no_index() -> None:
    with pytest.raises(WideberthError, match=r"^noise has eigenvalue -1"):
        checked_covariance("noise", [[-1.0, 0.0], [0.0, 1.0]], 2)
    with pytest.raises(WideberthError, match=r"^noise is not symmetric"):
        checked_covariance("noise", [[1.0, 0.5], [0.0, 1.0]], 2)


@pytest.mark.parametrize("size", [2, 3])
def test_outlines_from_above_keep_to_the_two_dimensional_block(size: int) -> None:
    """(x - mu)^T S^-1 (x - mu) = q on each, S the block of x and y and q of all coordinates."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((2, 5, size, size))
    covariance = root @ root.swapaxes(2, 3) + 0.1 * np.eye(size)
    made = Forecast.single(rng.standard_normal((2, 5, size)), covariance, 0.5)
    for every, steps in ((1, [0, 1, 2, 3, 4]), (3, [1, 4])):
        found = content_outlines(made, 0.1, 24, every).reshape(2, len(steps), 24, 2)
        for o in range(2):
            for k, step in enumerate(steps):
                away = found[o, k] - made.mean[o, 0, step, :2]
                inverse = np.linalg.inv(covariance[o, step, :2, :2])
                square = np.einsum("ki,ij,kj->k", away, inverse, away)
                np.testing.assert_allclose(square, stats.chi2.ppf(0.9, size), rtol=1e-9)


def test_an_altered_value_keeps_its_other_fields_and_nothing_that_was_computed() -> None:
    forecast = Forecast.single(np.zeros((1, 3, 2)), np.tile(np.eye(2), (1, 3, 1, 1)), 0.5)
    joint = np.zeros((1, 1, 6, 6))
    assert forecast.joint is None  # and kept
    other = altered(forecast, joint_source=joint, dt=0.25)
    assert (other.dt, forecast.dt) == (0.25, 0.5)
    assert other.joint is joint
    assert other.mean is forecast.mean
    assert other.fallback == forecast.fallback
