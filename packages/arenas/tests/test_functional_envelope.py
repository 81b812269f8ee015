"""The functional envelope: its parts against closed forms, and its promise on drawn fields."""

import numpy as np
import pytest
from numpy.random import RandomState

from wideberth.framework.values.coverage import Event
from wideberth.framework.values.errors import WideberthError
from wideberth_arenas.controllers.functional_envelope import (
    OUTSIDE,
    EnvelopeFit,
    FieldGrid,
    FunctionalEnvelope,
    distance_field,
    residual_fields,
)
from wideberth_arenas.controllers.gaussian_mixture import GaussianMixture

GRID = FieldGrid((1.0, -2.0), 8.0, 9)
TAIL = 0.1


def drawn(rng, rows, steps=1, people=3):
    """Predicted and true places (rows, steps, people, 2); the error grows with the step."""
    predicted = rng.uniform([-3.0, -6.0], [5.0, 2.0], (rows, steps, people, 2))
    spread = 0.4 * np.arange(1, steps + 1)[:, None, None]
    return predicted, predicted + spread * rng.standard_normal(predicted.shape)


def missed(envelope, predicted, actual):
    """Share of rows whose first field rises above the envelope anywhere on the grid."""
    points = envelope.grid.points()
    _, fields = residual_fields(envelope.grid, predicted[:, 0], actual[:, 0])
    return (fields > envelope.at(points, 0)).any(axis=1)


def test_grid_holds_the_points_and_knows_its_cells():
    points = np.array([[0.0, 0.0], [3.0, 1.0]])
    grid = FieldGrid.around(points, margin=2.0, cells=15)
    assert grid == FieldGrid((1.5, 0.5), 7.0, 15)
    cell, inside = grid.nearest(grid.points())
    assert inside.all() and (cell == np.arange(15**2)).all()
    assert grid.points()[1].tolist() == [-1.5, -3.0]  # along x first
    beyond = np.array([[5.01, 0.0], [1.5, -3.01]])
    assert not grid.nearest(beyond)[1].any()


def test_outside_of_the_grid_the_envelope_is_a_constant():
    envelope = FunctionalEnvelope(GRID, (tuple(np.arange(81.0)),), 0.4)
    assert envelope.at(np.array([[-2.9, -5.9], [100.0, 0.0]]), 0).tolist() == [0.0, OUTSIDE]
    assert envelope.at(np.array([5.0, 2.0]), 7) == 80.0  # the last step's beyond it


def test_distance_field_is_the_nearest_of_all():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(5, 2))
    places[2] = np.nan
    points = GRID.points()
    wanted = [
        min(np.hypot(*(point - place)) for place in places[[0, 1, 3, 4]]) for point in points
    ]
    np.testing.assert_allclose(distance_field(GRID, places), wanted)
    assert np.isinf(distance_field(GRID, places[2:3])).all()


def test_rows_without_anybody_have_no_field():
    predicted, actual = drawn(np.random.default_rng(1), 3)
    actual[1] = np.nan
    known, fields = residual_fields(GRID, predicted[:, 0], actual[:, 0])
    assert known.tolist() == [0, 2] and fields.shape == (2, 81)


def test_upper_is_the_largest_field_of_the_ellipsoids():
    """Sampled members of every ellipsoid never rise above, and come close everywhere."""
    from wideberth_arenas.controllers.functional_envelope import _support

    rng = np.random.default_rng(2)
    root = rng.normal(size=(2, 3, 3))
    mixture = GaussianMixture(
        np.array([0.3, 0.7]), rng.normal(size=(2, 3)), root @ np.swapaxes(root, 1, 2)
    )
    components, level = rng.normal(size=(3, 20)), mixture.log_peaks().min() - 2.0
    upper = _support(mixture, level, components)
    sphere = rng.normal(size=(60000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    best = np.full(20, -np.inf)
    for k in range(2):
        radius = np.sqrt(2.0 * (mixture.log_peaks()[k] - level))
        scores = mixture.mean[k] + radius * sphere @ np.linalg.cholesky(mixture.covariance[k]).T
        np.testing.assert_allclose(mixture.log_densities(scores)[:, k], level)
        best = np.maximum(best, (scores @ components).max(axis=0))
    assert (best <= upper + 1e-9).all()
    np.testing.assert_allclose(best, upper, rtol=5e-3)


def test_too_few_rows_are_refused():
    """Half of the tail is for the density: 19 rows bound 0.05, of 38 dealt to two halves."""
    fit = EnvelopeFit(TAIL, held_out=0.5)
    assert fit.fewest == 38
    fields = np.random.default_rng(7).standard_normal((38, 4))
    assert np.isfinite(fit.upper(fields)).all()
    with pytest.raises(WideberthError, match="18 rows to calibrate with; wanted at least 19"):
        fit.upper(fields[:36])


def test_states_its_promise():
    assert EnvelopeFit.coverage.event is Event.FIELD
    assert "at each step for itself" in str(EnvelopeFit.coverage)


def test_promise_holds_for_exchangeable_rows():
    rng, fits, rows = np.random.default_rng(3), 30, 100
    misses = []
    for seed in range(fits):
        fit = EnvelopeFit(TAIL, components=3, mixture=2, held_out=0.5, seed=seed)
        envelope = fit.envelope(GRID, *drawn(rng, 160), 0.4)
        misses.append(missed(envelope, *drawn(rng, rows)).mean())
    error = np.std(misses) / np.sqrt(fits)
    assert np.mean(misses) <= TAIL + 3.0 * error


def test_miss_of_single_numbers_is_exact():
    """Of one cell nothing is left out: the ellipsoid misses k / (n + 1), half of it above."""
    rng, runs, rows = np.random.default_rng(4), 4000, 18
    above = 0
    for seed in range(runs):
        fields = rng.standard_normal((rows + 1, 1))
        fit = EnvelopeFit(0.2, components=1, mixture=1, held_out=0.5, seed=seed)
        above += fields[-1, 0] > fit.upper(fields[:-1])[0] + 1e-9
    exact = 0.5 * 0.1  # the lowest of 9 densities, at half of the tail
    assert abs(above / runs - exact) < 3.0 * np.sqrt(exact * (1.0 - exact) / runs)


def test_as_published_the_slack_is_on_the_wrong_side():
    """Fields that rise in one cell, another one in each row, which no component follows."""
    rng = np.random.default_rng(5)
    fields = np.eye(300)[rng.permutation(300)] + 0.01 * rng.standard_normal((300, 300))
    share = {}
    for published in (True, False):
        fit = EnvelopeFit(TAIL, components=2, mixture=1, as_published=published)
        share[published] = (fields[200:] > fit.upper(fields[:200])).any(axis=1).mean()
    assert share[False] <= TAIL
    assert share[True] > 0.9


def test_as_published_rows_keep_the_field_of_the_step_before():
    predicted, actual = drawn(np.random.default_rng(5), 60, steps=2)
    actual[:30, 1] = np.nan
    whole = actual.copy()
    predicted_whole = predicted.copy()
    whole[:30, 1], predicted_whole[:30, 1] = whole[:30, 0], predicted[:30, 0]
    fit = EnvelopeFit(TAIL, components=2, mixture=2, as_published=True)
    first = fit.envelope(GRID, predicted, actual, 0.4)
    second = fit.envelope(GRID, predicted_whole, whole, 0.4)
    assert first == second


def test_same_seed_same_bytes():
    predicted, actual = drawn(np.random.default_rng(6), 80)
    fit = EnvelopeFit(TAIL, components=2, mixture=2, held_out=0.5)
    assert fit.envelope(GRID, predicted, actual, 0.4) == fit.envelope(GRID, predicted, actual, 0.4)


@pytest.mark.parametrize("settings", [{"tail": 0.0}, {"held_out": 1.0}, {"components": 0}])
def test_numbers_out_of_range_are_refused(settings):
    with pytest.raises(WideberthError):
        EnvelopeFit(**settings)


def test_envelope_without_steps_or_with_other_cells_is_refused():
    for upper in ((), ((0.0,),)):
        with pytest.raises(WideberthError, match=r"envelope\.upper"):
            FunctionalEnvelope(GRID, upper, 0.4)
    assert RandomState(0).permutation(5).tolist() == [2, 0, 1, 3, 4]  # as scikit-learn splits
