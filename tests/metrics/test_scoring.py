"""Scores of forecasts: closed forms, brute force, other libraries and Monte Carlo."""

from math import erf, exp, log, pi, sqrt

import numpy as np
import pytest
from scipy import stats

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.metrics.episode import inside_content
from wideberth.metrics.scoring import (
    NODES,
    covered,
    densest_area,
    displacement,
    energy_score,
    inside_throughout,
    joint_tail,
    last_known,
    log_density,
    mass_below,
    negative_log_likelihood,
    reached_tail,
    reason_kind,
    region_area,
    standard_nodes,
    trajectory_energy_score,
)

ONE = np.ones((1, 1))


def covariances(rng: np.random.Generator, *shape: int, size: int = 2) -> Array:
    roots = rng.standard_normal((*shape, size, size)) + 2 * np.eye(size)
    return np.asarray(roots @ np.swapaxes(roots, -1, -2))


def test_displacement_is_from_the_mean_of_the_mixture() -> None:
    mean = np.array([[[[0.0, 0.0], [0.0, 0.0]], [[4.0, 0.0], [8.0, 0.0]]]])
    truth = np.array([[[1.0, 0.0], [2.0, 4.0]]])
    found = displacement(mean, np.array([[0.75, 0.25]]), truth)
    np.testing.assert_allclose(found, [[0.0, 4.0]], atol=1e-15)
    aside = displacement(mean, np.array([[0.75, 0.25]]), truth + np.array([3.0, 0.0]))
    np.testing.assert_allclose(aside, [[3.0, 5.0]], atol=1e-15)


def test_final_error_is_the_last_known_one() -> None:
    values = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, np.nan], [np.nan, np.nan, np.nan]])
    np.testing.assert_array_equal(last_known(values), [3.0, 2.0, np.nan])
    for count in range(1, 5):
        one = np.array([[7.0, *[np.nan] * (count - 1)]])
        assert last_known(one)[0] == 7.0


@pytest.mark.parametrize("size", [2, 3])
def test_likelihood_equals_scipy(size: int) -> None:
    rng = np.random.default_rng(1)
    mean = rng.standard_normal((4, 3, 5, size))
    covariance = covariances(rng, 4, 3, 5, size=size)
    weight = rng.dirichlet(np.ones(3), size=4)
    weight[0] = [0.0, 0.4, 0.6]
    truth = rng.standard_normal((4, 5, size))
    truth[1, 2] = np.nan
    found = negative_log_likelihood(mean, covariance, weight, truth, 0.3)
    for k in range(4):
        for step in range(5):
            if (k, step) == (1, 2):
                assert np.isnan(found[k, step])
                continue
            wide = covariance[k, :, step] + 0.09 * np.eye(size)
            density = sum(
                weight[k, m]
                * stats.multivariate_normal(mean[k, m, step], wide[m]).pdf(truth[k, step])
                for m in range(3)
            )
            assert found[k, step] == pytest.approx(-log(density), rel=1e-10)


def test_likelihood_of_a_certain_forecast_is_that_of_the_floor() -> None:
    mean, truth = np.zeros((1, 1, 1, 2)), np.full((1, 1, 2), 0.01)
    found = negative_log_likelihood(mean, np.zeros((1, 1, 1, 2, 2)), ONE, truth, 0.01)
    assert found[0, 0] == pytest.approx(log(2 * pi * 1e-4) + 1.0, rel=1e-12)


def test_energy_score_has_the_closed_form_on_a_line() -> None:
    """CRPS of N(0, 1): x (2 Phi(x) - 1) + 2 phi(x) - 1/sqrt(pi) (Gneiting and Raftery)."""
    rng = np.random.default_rng(2)
    truth = np.array([[0.0], [0.7], [-2.0]])
    draws = rng.standard_normal((200_000, 3, 1))
    found = energy_score(draws, truth)
    for x, value in zip(truth[:, 0], found, strict=True):
        known = x * erf(x / sqrt(2)) + 2 * exp(-0.5 * x * x) / sqrt(2 * pi) - 1 / sqrt(pi)
        assert value == pytest.approx(known, abs=4 * 1.0 / sqrt(200_000))


def test_energy_score_is_unbiased_with_two_draws() -> None:
    """Many scores from two draws each average to the score from very many draws."""
    rng = np.random.default_rng(3)
    spread = np.diag([1.0, 0.3])
    few = energy_score(rng.standard_normal((2, 100_000, 2)) @ spread, np.zeros((100_000, 2)))
    many = energy_score(rng.standard_normal((400_000, 1, 2)) @ spread, np.zeros((1, 2)))
    error = few.std() / sqrt(len(few)) + 1.5 / sqrt(400_000)
    assert few.mean() == pytest.approx(many[0], abs=4 * error)


def test_energy_score_of_trajectories_sees_whether_steps_belong_together() -> None:
    """Same marginals, but the truth drifts: the forecast that knows it scores better."""
    rng = np.random.default_rng(4)
    count, steps = 2000, 6
    drift = rng.standard_normal((count, 1, 2))
    truth = np.repeat(drift, steps, axis=1)
    together = np.repeat(rng.standard_normal((50, count, 1, 2)), steps, axis=2)
    apart = rng.standard_normal((50, count, steps, 2))
    right = trajectory_energy_score(together, truth)
    wrong = trajectory_energy_score(apart, truth)
    gap = wrong - right
    assert gap.mean() > 5 * gap.std() / sqrt(count)
    each = energy_score(together, truth).mean() - energy_score(apart, truth).mean()
    assert abs(each) < 0.02  # step by step there is no telling


def test_energy_score_of_trajectories_leaves_unknown_steps_out() -> None:
    rng = np.random.default_rng(5)
    draws, truth = rng.standard_normal((20, 3, 6, 2)), rng.standard_normal((3, 6, 2))
    cut = truth.copy()
    cut[:, 4:] = np.nan
    expected = trajectory_energy_score(draws[:, :, :4], truth[:, :4])
    np.testing.assert_allclose(trajectory_energy_score(draws, cut), expected, rtol=1e-12)


def test_tail_of_one_gaussian_in_the_plane() -> None:
    """With two coordinates the tail is exp(-d^2 / 2)."""
    rng = np.random.default_rng(6)
    mean, covariance = rng.standard_normal((3, 1, 4, 2)), covariances(rng, 3, 1, 4)
    truth = rng.standard_normal((3, 4, 2))
    found = reached_tail(mean, covariance, np.ones((3, 1)), truth)
    for k in range(3):
        for step in range(4):
            gap = truth[k, step] - mean[k, 0, step]
            square = gap @ np.linalg.solve(covariance[k, 0, step], gap)
            assert found[k, step] == pytest.approx(exp(-0.5 * square), rel=1e-10)
    for tail in (0.05, 0.3):
        inside = inside_content(mean[:, 0], covariance[:, 0], truth, tail)
        np.testing.assert_array_equal(covered(found, tail) == 1, inside)


@pytest.mark.parametrize("modes", [1, 2, 3])
@pytest.mark.parametrize("size", [2, 3])
def test_a_right_forecast_is_covered_at_every_content(modes: int, size: int) -> None:
    """Truths drawn from the mixture: coverage within four standard errors."""
    rng = np.random.default_rng(7)
    count = 4000
    centre = 3 * rng.standard_normal((1, modes, 1, size))
    mean = np.repeat(centre, count, axis=0)
    covariance = np.repeat(covariances(rng, 1, modes, 1, size=size), count, axis=0)
    weight = np.tile(rng.dirichlet(np.full(modes, 3.0)), (count, 1))
    forecast = Forecast(mean, covariance, weight, 0.4, (None,) * count)
    truth = forecast.sample(rng, 1)[0]
    tails = reached_tail(mean, covariance, weight, truth)
    for tail in (0.05, 0.1, 0.5, 0.9):
        error = sqrt(tail * (1 - tail) / count)
        assert covered(tails, tail).mean() == pytest.approx(1 - tail, abs=4 * error)


def test_coverage_is_of_the_densest_region_of_a_mixture() -> None:
    """Between two modes far apart the mean of the mixture lies outside of every region."""
    mean = np.array([[[[-9.0, 0.0]], [[9.0, 0.0]]]])
    covariance, weight = np.tile(np.eye(2), (1, 2, 1, 1, 1)), np.array([[0.5, 0.5]])
    middle = reached_tail(mean, covariance, weight, np.zeros((1, 1, 2)))
    peak = reached_tail(mean, covariance, weight, np.array([[[9.0, 0.0]]]))
    assert middle[0, 0] == 0.0 and peak[0, 0] > 0.99


@pytest.mark.parametrize(("size", "ball"), [(2, pi), (3, 4 * pi / 3)])
def test_area_of_an_ellipse(size: int, ball: float) -> None:
    rng = np.random.default_rng(9)
    covariance = covariances(rng, 1, 1, 1, size=size)
    mean = np.zeros((1, 1, 1, size))
    found = region_area(mean, covariance, ONE, 0.05)
    radius = sqrt(stats.chi2(size).ppf(0.95))
    known = ball * radius**size * sqrt(np.linalg.det(covariance[0, 0, 0]))
    assert found[0, 0] == pytest.approx(known, rel=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_nodes_stand_for_a_standard_normal_distribution(size: int) -> None:
    nodes = standard_nodes(size)
    np.testing.assert_allclose(nodes.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(nodes.T @ nodes / len(nodes), np.eye(size), atol=0.02)


def test_area_of_a_mixture() -> None:
    """Two equal modes far apart have twice the area of one; two in one place have the same."""
    covariance, weight = np.tile(np.eye(2), (1, 2, 1, 1, 1)), np.array([[0.5, 0.5]])
    for tail in (0.05, 0.1, 0.5):
        ellipse = pi * stats.chi2(2).ppf(1 - tail)
        for gap, factor in ((50.0, 2.0), (0.0, 1.0)):
            mean = np.array([[[[0.0, 0.0]], [[gap, 0.0]]]])
            found = region_area(mean, covariance, weight, tail)
            assert found[0, 0] == pytest.approx(factor * ellipse, rel=0.01)


def test_joint_tail_is_of_all_coordinates_together() -> None:
    rng = np.random.default_rng(11)
    joint = covariances(rng, 2, 1, size=6)
    mean, truth = rng.standard_normal((2, 1, 3, 2)), rng.standard_normal((2, 3, 2))
    truth[1, 2] = np.nan
    draws = np.zeros((2, 2, 3, 2))
    found = joint_tail(mean, joint, np.ones((2, 1)), truth, draws, 0.1)
    gap = (truth[0] - mean[0, 0]).ravel()
    square = gap @ np.linalg.solve(joint[0, 0] + 0.01 * np.eye(6), gap)
    assert found[0] == pytest.approx(stats.chi2(6).sf(square), rel=1e-9)
    assert np.isnan(found[1])


def test_joint_coverage_of_a_right_mixture() -> None:
    rng = np.random.default_rng(12)
    count, floor = 3000, 0.1
    roots = rng.standard_normal((1, 2, 4, 4))
    joint = np.repeat(roots @ np.swapaxes(roots, -1, -2), count, axis=0)
    blocks = np.stack([joint[..., :2, :2], joint[..., 2:, 2:]], axis=2)
    mean = np.repeat(rng.standard_normal((1, 2, 2, 2)), count, axis=0)
    weight = np.tile([0.3, 0.7], (count, 1))
    draws = Forecast(mean, blocks, weight, 0.4, (None,) * count, joint).sample(rng, 100)
    draws = draws + floor * rng.standard_normal(draws.shape)
    tails = joint_tail(mean, joint, weight, draws[0], draws[1:], floor)
    for tail in (0.05, 0.5):
        error = sqrt(tail * (1 - tail) / count)
        assert covered(tails, tail).mean() == pytest.approx(1 - tail, abs=4 * error)


def test_staying_inside_throughout() -> None:
    tails = np.array([[0.2, 0.06], [0.2, 0.04], [0.2, np.nan], [0.01, np.nan]])
    np.testing.assert_array_equal(inside_throughout(tails, 0.05), [1, 0, np.nan, np.nan])
    np.testing.assert_array_equal(covered(tails, 0.05)[2], [1, np.nan])
    assert covered(np.array([[0.05]]), 1.0 - 0.95)[0, 0] == 1  # 0.05000000000000004
    assert covered(np.array([[0.05 * (1 - 1e-6)]]), 0.05)[0, 0] == 0


def test_reasons_are_of_one_kind_whatever_their_numbers() -> None:
    kinds = {
        reason_kind(f"var: {n} samples, needs 20; radius {n}.5e-3 above 1.0") for n in (3, 12)
    }
    assert kinds == {"var: # samples, needs #; radius # above #"}
    assert reason_kind("imm2: stands (inf)") == "imm2: stands (#)"  # a name is no number


def test_bad_settings_are_named() -> None:
    mean, covariance, truth = (
        np.zeros((1, 1, 1, 2)),
        np.eye(2)[None, None, None],
        np.zeros((1, 1, 2)),
    )
    with pytest.raises(WideberthError, match="floor is 0"):
        negative_log_likelihood(mean, covariance, ONE, truth, 0.0)
    with pytest.raises(WideberthError, match="tail is 1"):
        covered(np.zeros((1, 1)), 1.0)
    with pytest.raises(WideberthError, match="tail is 0"):
        region_area(mean, covariance, ONE, 0.0)
    two = np.repeat(mean, 2, axis=1), np.repeat(covariance, 2, axis=1), np.full((1, 2), 0.5)
    with pytest.raises(WideberthError, match=r"tail is 1\.5"):
        region_area(*two, 1.5)
    with pytest.raises(WideberthError, match="floor is 0"):
        joint_tail(mean, covariance[:, :, 0], ONE, truth, np.zeros((2, 1, 1, 2)), 0.0)


def test_energy_scores_against_their_definitions() -> None:
    """Pairs of neighbours around the circle of draws; trajectories by their known steps."""
    rng = np.random.default_rng(21)
    draws, truth = rng.standard_normal((5, 3, 4, 2)), rng.standard_normal((3, 4, 2))
    found = energy_score(draws, truth)
    for k in range(3):
        for n in range(4):
            error = np.mean([np.hypot(*(one[k, n] - truth[k, n])) for one in draws])
            pairs = [np.hypot(*(draws[s, k, n] - draws[s - 1, k, n])) for s in range(5)]
            assert found[k, n] == pytest.approx(error - 0.5 * np.mean(pairs))
    truth[1, 2:] = np.nan
    whole = trajectory_energy_score(draws, truth)
    for k, steps in enumerate((4, 2, 4)):
        flat, aim = draws[:, k, :steps].reshape(5, -1), truth[k, :steps].ravel()
        error = np.mean([np.linalg.norm(one - aim) for one in flat])
        pairs = np.mean([np.linalg.norm(flat[s] - flat[s - 1]) for s in range(5)])
        assert whole[k] == pytest.approx((error - 0.5 * pairs) / sqrt(steps))


@pytest.mark.parametrize("size", [2, 3])
def test_coverage_of_an_overconfident_mixture_has_no_bias(size: int) -> None:
    """Against ranks among 50 000 draws. Ranks among 99 would let 0.005 too many be inside."""
    rng, count, gaps = np.random.default_rng(13), 2000, []
    for _ in range(12):
        mean = 1.5 * rng.standard_normal((1, 3, 1, size))
        covariance = covariances(rng, 1, 3, 1, size=size)
        weight = rng.dirichlet(np.ones(3), size=1)
        wide = Forecast(mean, 2.0 * covariance, weight, 0.4, (None,))
        truth = wide.sample(rng, count)[:, 0]
        draws = Forecast(mean, covariance, weight, 0.4, (None,)).sample(rng, 50_000)
        drawn = np.sort(log_density(mean, covariance, weight, draws), axis=None)
        density = log_density(mean, covariance, weight, truth[:, None])[:, 0, 0]
        below = np.searchsorted(drawn, density) / len(drawn)
        many = (np.repeat(one, count, axis=0) for one in (mean, covariance, weight))
        found = reached_tail(*many, truth)[:, 0]
        near = below < 0.3
        assert np.sqrt(np.mean((found - below)[near] ** 2)) < 0.006
        shares = [covered(one, 0.05).mean() for one in (found, below)]
        assert shares[1] < 0.93  # overconfident
        gaps.append(shares[0] - shares[1])
    assert np.mean(gaps) == pytest.approx(0.0, abs=0.003)


def test_energy_score_of_a_trajectory_known_at_one_step_is_that_of_the_step() -> None:
    """A step of which one coordinate is known is not known."""
    rng = np.random.default_rng(22)
    draws, truth = rng.standard_normal((5, 1, 4, 2)), np.full((1, 4, 2), np.nan)
    truth[0, 2], truth[0, 1, 0] = (0.3, -0.4), 0.5
    found = trajectory_energy_score(draws, truth)
    assert found[0] == pytest.approx(float(energy_score(draws[:, 0, 2], truth[0, 2])), rel=1e-12)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_nodes_are_the_quantiles_of_chi_in_turning_directions(size: int) -> None:
    """Point by point, as they are described."""
    nodes = standard_nodes(size)
    assert nodes.shape == (NODES, size)
    plastic = np.roots([1.0, 0.0, -1.0, -1.0])[0].real  # g^3 = g + 1
    for j in (0, 1, 2, 17, NODES - 1):
        radius = stats.chi(size).ppf((j + 0.5) / NODES)
        if size == 1:
            wanted = [-radius if j % 2 == 0 else radius]
        elif size == 2:
            turn = pi + 2.0 * pi * j * 0.5 * (sqrt(5.0) - 1.0)
            wanted = [radius * np.cos(turn), radius * np.sin(turn)]
        else:
            turn, height = pi + 2.0 * pi * j / plastic**2, 1.0 - 2.0 * ((0.5 + j / plastic) % 1.0)
            flat = sqrt(1.0 - height**2)
            wanted = [radius * flat * np.cos(turn), radius * flat * np.sin(turn), radius * height]
        np.testing.assert_allclose(nodes[j], wanted, atol=1e-9)


@pytest.mark.parametrize("size", [2, 3])
def test_mass_and_area_are_sums_over_the_nodes_of_every_mode(size: int) -> None:
    """The density at each node from `log_density`, which is held against scipy's."""
    rng = np.random.default_rng(23)
    modes = 5 - size
    mean, covariance = (
        rng.standard_normal((2, modes, 2, size)),
        covariances(rng, 2, modes, 2, size=size),
    )
    weight = rng.dirichlet(np.ones(modes), size=2)
    limits, tail = np.array([[-4.0, -5.0], [-3.0, np.nan]]), 0.2
    mass, area = (
        mass_below(mean, covariance, weight, limits),
        densest_area(mean, covariance, weight, tail),
    )
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(values)[..., None, :]
    places = mean[..., None, :] + np.einsum("kmnij,pj->kmnpi", roots, standard_nodes(size))
    density = np.stack(
        [log_density(mean, covariance, weight, places[:, m].transpose(2, 0, 1, 3))
         for m in range(modes)]
    )  # fmt: skip
    for k in range(2):
        for n in range(2):
            found = np.concatenate(list(density[:, :, k, n]))
            share = np.repeat(weight[k] / NODES, NODES)
            wanted = share[found < limits[k, n]].sum() if np.isfinite(limits[k, n]) else np.nan
            assert mass[k, n] == pytest.approx(wanted, rel=1e-9, nan_ok=True)
            total, below = 0.0, 0.0
            for i in np.argsort(found):
                below += share[i]
                total += min(max(below - tail, 0.0), share[i]) * exp(-found[i])
            assert area[k, n] == pytest.approx(total, rel=1e-9)


def test_joint_tail_of_a_mixture_is_a_rank_among_draws() -> None:
    rng = np.random.default_rng(24)
    mean, joint = rng.standard_normal((2, 3, 2, 2)), covariances(rng, 2, 3, size=4)
    weight = rng.dirichlet(np.ones(3), size=2)
    draws, truth = rng.standard_normal((9, 2, 2, 2)), rng.standard_normal((2, 2, 2))
    truth[1, 0, 1] = np.nan
    found = joint_tail(mean, joint, weight, truth, draws, 0.3)

    def density(point: Array) -> float:
        return float(sum(
            w * stats.multivariate_normal(m.ravel(), c + 0.09 * np.eye(4)).pdf(point.ravel())
            for w, m, c in zip(weight[0], mean[0], joint[0], strict=True)
        ))  # fmt: skip

    below = sum(density(one) < density(truth[0]) for one in draws[:, 0])
    assert 0 < below < 9 and found[0] == below / 10 and np.isnan(found[1])
