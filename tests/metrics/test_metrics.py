"""Metrics against closed forms and Monte Carlo."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.metrics import episode as metrics
from wideberth.tests.oracles.episode_ends import deadlock_time, time_to_goal

STRAIGHT = Path(np.array([[0.0, 0.0], [10.0, 0.0]]))


def test_closest_approach_lies_between_the_samples():
    """Two discs pass within one interval: d(u)^2 has its minimum at u = 1/2."""
    one = np.array([[-1.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    two = np.array([[1.0, 0.4], [-1.0, 0.4], [-5.0, 0.4]])
    assert metrics.closest_approach(one, two) == (pytest.approx(0.4), 0)
    assert metrics.clearance(one, two, 0.3) == pytest.approx(0.1)
    assert not metrics.collided(one, two, 0.3)
    assert metrics.collided(one, two, 0.5)


def test_closest_approach_against_brute_force():
    rng = np.random.default_rng(1)
    one, two = rng.standard_normal((2, 50, 2)).cumsum(axis=1)
    u = np.linspace(0, 1, 2001)[:, None, None]
    relative = one - two
    dense = np.linalg.norm((1 - u) * relative[:-1] + u * relative[1:], axis=-1)
    assert metrics.approach(one, two) == pytest.approx(dense.min(axis=0), abs=2e-3)
    assert (metrics.approach(one, two) <= dense.min(axis=0) + 1e-12).all()


def test_absent_agents_do_not_count():
    one = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    two = np.array([[np.nan, np.nan], [3.0, 0.0], [2.0, 0.0]])
    assert metrics.closest_approach(one, two) == (2.0, 1)
    assert metrics.closest_approach(one, np.full((3, 2), np.nan)) == (np.inf, -1)


def test_deadlock_needs_all_and_long():
    times = np.arange(0.0, 30.0, 0.5)
    still, moving = np.zeros(60), np.full(60, 0.5)
    never = np.zeros((2, 60), bool)
    assert deadlock_time(times, np.array([still, still]), never) == 10.5
    assert np.isnan(deadlock_time(times, np.array([still, moving]), never))
    # One at its goal does not keep the other from being stuck; both there is no deadlock.
    assert deadlock_time(times, np.array([still, still]), np.array([~never[0], never[0]]))
    assert np.isnan(deadlock_time(times, np.array([still, still]), ~never))
    twitch = still.copy()
    twitch[15::15] = 0.03
    assert np.isnan(deadlock_time(times, twitch[None], never[:1]))


def test_time_and_length_of_a_straight_drive():
    times = np.linspace(0, 20, 41)
    positions = np.stack([0.5 * times, np.zeros(41)], axis=1)
    assert metrics.path_length(positions) == pytest.approx(10.0)
    assert metrics.free_time(STRAIGHT, 0.5) == 20.0
    assert time_to_goal(times, positions, STRAIGHT.goal, 0.25) == 19.5
    assert np.isnan(time_to_goal(times, positions + 1.0, STRAIGHT.goal, 0.25))


def test_progress_and_deviation_along_a_bent_path():
    bent = Path(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]))
    arc, aside = metrics.along_and_aside(np.array([[1.0, 0.5], [4.5, 2.0], [-1.0, 0.0]]), bent)
    assert arc == pytest.approx([1.0, 6.0, 0.0])
    assert aside == pytest.approx([0.5, 0.5, 1.0])
    assert metrics.lateral_deviation(np.array([[1.0, 0.5], [4.5, 2.0]]), bent) == 0.5
    for point in ([1.0, 0.5], [4.5, 2.0], [3.0, 2.9]):
        assert metrics.along_and_aside(np.array([point]), bent)[0][0] == pytest.approx(
            bent.project(np.array(point))
        )


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(("begin", "end"), [(1.0, 2.0), (-2.0, -1.0)])
def test_paths_that_end_before_or_begin_behind_the_other_do_not_cross(begin, end, swapped):
    level, upright = Path([(0.0, 0.0), (4.0, 0.0)]), Path([(2.0, begin), (2.0, end)])
    pair = (upright, level) if swapped else (level, upright)
    assert metrics.crossing_point(*pair) is None


def test_crossing_point_and_passing_time():
    upright = Path(np.array([[4.0, -3.0], [4.0, -1.0], [4.0, 9.0]]))
    assert metrics.crossing_point(STRAIGHT, upright) == pytest.approx((4.0, 3.0))
    assert metrics.crossing_point(STRAIGHT, Path(STRAIGHT.points + np.array([0.0, 1.0]))) is None
    times = np.array([0.0, 10.0, 20.0])
    positions = np.array([[0.0, 0.1], [5.0, 0.1], [10.0, 0.1]])
    assert metrics.passing_time(times, positions, STRAIGHT, 4.0) == pytest.approx(8.0)
    assert metrics.passing_time(times, positions, STRAIGHT, 0.0) == 0.0
    assert np.isnan(metrics.passing_time(times, positions[:2], STRAIGHT, 8.0))


def test_shares_and_counts():
    assert metrics.tally(["brake", "optimal", "optimal"]) == {"brake": 1, "optimal": 2}
    assert metrics.share_named([(None, "too short"), (None, None), ()]) == 0.75
    assert np.isnan(metrics.share_named([()]))
    stamps = np.array([0.0, 0.5, 1.0])
    assert metrics.deadline_misses(stamps, stamps + np.array([0.1, 0.5, 0.7]), 0.5) == 1


def test_time_statistics():
    found = metrics.time_statistics(np.arange(101) / 100)
    assert found == pytest.approx({"median": 0.5, "p95": 0.95, "p99": 0.99, "max": 1.0})
    assert all(np.isnan(v) for v in metrics.time_statistics([]).values())


@pytest.mark.parametrize("size", [2, 3])
def test_coverage_of_a_calibrated_forecast(size):
    """20 000 truths drawn from the forecast itself: 95 % inside, within three sigma."""
    rng = np.random.default_rng(2)
    count, steps = 10_000, 2
    root = rng.standard_normal((steps, size, size))
    covariance = np.broadcast_to(root @ root.swapaxes(-1, -2), (count, steps, size, size))
    mean = rng.standard_normal((count, steps, size))
    noise = rng.standard_normal((count, steps, size))
    truth = mean + np.einsum("nij,cnj->cni", root, noise)
    share, number = metrics.coverage(mean, covariance, truth, 0.05)
    assert (number == count).all()
    assert np.abs(share - 0.95).max() < 3 * np.sqrt(0.95 * 0.05 / count)


def test_coverage_ignores_what_is_unknown():
    mean = np.zeros((2, 1, 2))
    covariance = np.broadcast_to(np.eye(2), (2, 1, 2, 2))
    truth = np.array([[[9.0, 0.0]], [[np.nan, np.nan]]])
    assert metrics.coverage(mean, covariance, truth, 0.05) == ([0.0], [1.0])
    share, number = metrics.coverage(mean[1:], covariance[1:], truth[1:], 0.05)
    assert np.isnan(share[0]) and number[0] == 0


def test_plane_quantile_is_the_closed_form():
    """In the plane q = -2 ln(tail): the ellipse's boundary at 95 % is at 2.4477 sigma."""
    edge = np.sqrt(-2 * np.log(0.05))
    points = np.array([[edge - 1e-9, 0.0], [edge + 1e-9, 0.0]])
    inside = metrics.inside_content(np.zeros((2, 2)), np.eye(2)[None].repeat(2, 0), points, 0.05)
    assert inside.tolist() == [True, False]
    with pytest.raises(WideberthError, match="tail"):
        metrics.inside_content(np.zeros((2, 2)), np.eye(2)[None], points, 0.0)


def test_paths_of_several_parts_cross_in_any_of_them():
    bent = Path(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 5.0]]))
    other = Path(np.array([[-1.0, 9.0], [-1.0, 3.0], [6.0, 3.0]]))
    assert metrics.crossing_point(bent, other) == pytest.approx((5.0, 9.0))
    assert metrics.crossing_point(other, bent) == pytest.approx((9.0, 5.0))
