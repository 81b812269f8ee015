"""What plans promise and what becomes of it: closed forms, Monte Carlo, brute force."""

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.metrics import plan as metrics


def test_a_plan_that_is_kept_does_not_change() -> None:
    times = np.arange(6.0)
    plan = np.stack([times, np.zeros(6)], axis=1)
    later = times + 1.0
    assert metrics.plan_change(times, plan, later, plan + np.array([1.0, 0.0])) == pytest.approx(
        0.0
    )
    # Beside it by 0.3 m at all five instants that both cover; what one alone covers is left out.
    beside = plan + np.array([1.0, 0.3])
    beside[5] = 100.0
    assert metrics.plan_change(times, plan, later, beside) == pytest.approx(0.3)
    # Between two instants of the earlier plan it is a straight line.
    half = times + 0.5
    assert metrics.plan_change(times, plan, half, plan + np.array([0.5, 0.0])) == pytest.approx(
        0.0
    )
    assert np.isnan(metrics.plan_change(times, plan, times + 10.0, plan))


def test_the_area_of_a_region() -> None:
    disc = metrics.content_area(4.0 * np.eye(2), 0.05)
    assert disc == pytest.approx(np.pi * 4.0 * -2.0 * np.log(0.05))
    ball = metrics.content_area(np.diag([1.0, 4.0, 9.0]), 0.05)
    assert ball == pytest.approx(4.0 / 3.0 * np.pi * 7.814728**1.5 * 6.0, rel=1e-6)
    assert metrics.content_area(np.zeros((3, 2, 2)), 0.05).tolist() == [0.0] * 3


def mixture(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    mean = rng.uniform(-2.0, 2.0, (3, 2, 4, 2))
    root = rng.uniform(-0.5, 0.5, (3, 2, 4, 2, 2))
    weight = np.array([[0.3, 0.7], [1.0, 0.0], [0.5, 0.5]])
    return mean, root @ np.swapaxes(root, -1, -2), weight, np.array([0.5, 1.0, 0.7])


def test_the_risk_of_a_plan_against_draws() -> None:
    mean, covariance, weight, radii = mixture(1)
    plan = np.linspace(-1.0, 1.0, 8).reshape(4, 2)
    risk = metrics.plan_risk(plan, mean, covariance, weight, radii)
    rng = np.random.default_rng(2)
    count = 40_000
    for o in range(3):
        mode = rng.choice(2, size=count, p=weight[o])
        for n in range(4):
            places = np.array(
                [
                    rng.multivariate_normal(mean[o, m, n], covariance[o, m, n], count)
                    for m in (0, 1)
                ]
            )
            drawn = places[mode, np.arange(count)]
            share = np.mean(np.linalg.norm(drawn - plan[n], axis=1) < radii[o])
            sigma = np.sqrt(max(risk[n, o] * (1 - risk[n, o]), 1e-4) / count)
            assert share == pytest.approx(risk[n, o], abs=5.0 * sigma)


def test_what_is_left_out_as_far_is_nothing() -> None:
    """The short cut agrees with the integral everywhere to 1e-5 of it, or is below 1e-13."""
    rng = np.random.default_rng(3)
    mean, covariance = rng.uniform(-30, 30, (200, 1, 1, 2)), np.zeros((200, 1, 1, 2, 2))
    covariance[:, 0, 0] = np.eye(2) * rng.uniform(0.0, 4.0, 200)[:, None, None]
    radii = np.full(200, 1.0)
    found = metrics.plan_risk(np.zeros((1, 2)), mean, covariance, np.ones((200, 1)), radii)[0]
    exact = collision_probability(mean[:, 0, 0], covariance[:, 0, 0], radii)
    assert found == pytest.approx(exact, rel=2e-5, abs=1e-13)
    certain = metrics.plan_risk(
        np.zeros((1, 2)), np.array([[[[0.5, 0.0]]], [[[2.0, 0.0]]]]), np.zeros((2, 1, 1, 2, 2)),
        np.ones((2, 1)), np.ones(2),
    )  # fmt: skip
    assert certain.tolist() == [[1.0, 0.0]]


def test_at_least_one_of_several() -> None:
    assert metrics.either(np.array([0.5, 0.5, 0.0])) == pytest.approx(0.75)
    assert metrics.either(np.array([[0.1], [0.2]])).tolist() == pytest.approx([0.1, 0.2])
    assert metrics.either(np.zeros(0)) == 0.0
    assert metrics.either(np.array([1.0, 0.3])) == pytest.approx(1.0)
    assert metrics.either(np.array([1e-14, 1e-14])) == pytest.approx(2e-14, rel=1e-6)


def test_touches_of_a_plan() -> None:
    plan = np.array([[0.0, 0.0], [1.0, 0.0]])
    truth = np.array([[[0.4, 0.0], [5.0, 0.0]], [[np.nan, np.nan], [1.0, 0.5]]])
    found = metrics.touched(plan, truth, np.array([0.5, 0.5]))
    assert found.tolist() == [[True, False], [False, False]]  # at the rim is no touch


def test_outside_as_often_as_the_content_says() -> None:
    rng = np.random.default_rng(4)
    covariance = np.array([[2.0, 0.6], [0.6, 0.5]])
    truth = rng.multivariate_normal([1.0, 2.0], covariance, 20_000)
    mean, wide = (
        np.broadcast_to([1.0, 2.0], (20_000, 2)),
        np.broadcast_to(covariance, (20_000, 2, 2)),
    )
    for content in (0.3, 0.95):
        out = metrics.outside_content(mean, wide, truth, np.full(20_000, content))
        sigma = np.sqrt(content * (1 - content) / 20_000)
        assert out.mean() == pytest.approx(1 - content, abs=4 * sigma)
    ends = metrics.outside_content(mean[:2], wide[:2], truth[:2], np.array([0.0, 1.0]))
    assert ends.tolist() == [True, False]
    exact = metrics.outside_content(mean[:1], np.zeros((1, 2, 2)), mean[:1], np.array([0.0]))
    assert exact.tolist() == [False]  # a certain forecast that came true


def test_plans_that_have_one_instant_in_common() -> None:
    """Within a nanosecond, at either end."""
    times, plan = np.array([0.0, 1.0]), np.array([[0.0, 0.0], [1.0, 0.0]])
    for later in (1.0, 1.0 + 5e-10, -1.0, -1.0 - 5e-10):
        found = metrics.plan_change(times, plan, times + later, plan + np.array([0.0, 2.0]))
        apart = np.hypot(1.0, 2.0)  # the later one begins where it would have ended
        assert found == pytest.approx(apart, rel=1e-6)
    for later in (1.0 + 1e-7, -1.0 - 1e-7):
        assert np.isnan(metrics.plan_change(times, plan, times + later, plan))


def test_contents_are_those_of_as_many_coordinates_as_there_are() -> None:
    rng = np.random.default_rng(9)
    for size in (2, 3):
        shape = (4, 5, size)
        truth, content = rng.standard_normal(shape), rng.random((4, 5))
        covariance = np.tile(np.eye(size), (4, 5, 1, 1))
        found = metrics.outside_content(np.zeros(shape), covariance, truth, content)
        np.testing.assert_array_equal(found, chi2(size).cdf((truth**2).sum(axis=-1)) > content)
