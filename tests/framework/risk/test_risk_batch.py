"""The batched risk against NumPy and golden values; gradient and bounds against oracles."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.oracles.risk_batch import (
    collision_probability_batch,
    collision_probability_gradient,
    collision_probability_gradient_batch,
    sampled_collision_probability,
)
from wideberth.tests.oracles.risk_bounds import (
    box_bound,
    centre_line_bound,
    centre_point_value,
    half_plane_bound,
    highest_density_bound,
)

Pairs = tuple[np.ndarray, np.ndarray, np.ndarray]


def pairs(rng: np.random.Generator, count: int, dimension: int = 2, thin: float = 3.0) -> Pairs:
    """Draw covariances with axis ratios up to 10^thin, at places within their reach."""
    turn = np.linalg.qr(rng.standard_normal((count, dimension, dimension)))[0]
    longest = 10 ** rng.uniform(-2, 1.5, (count, 1))
    spread = longest * 10 ** rng.uniform(-thin, 0, (count, dimension))
    root = turn * spread[:, None, :]
    covariance = root @ np.swapaxes(root, 1, 2)
    radius = rng.uniform(0.05, 2.0, count)
    normal = rng.standard_normal((count, dimension))
    rim = normal / np.linalg.norm(normal, axis=1)[:, None] * radius[:, None]
    reach = np.einsum("nij,nj->ni", root, 2.0 * rng.standard_normal((count, dimension)))
    return rim * rng.uniform(0, 1.2, (count, 1)) + reach, covariance, radius


@pytest.mark.parametrize(("dimension", "count"), [(2, 5000), (3, 2000)])
def test_batch_agrees_with_numpy(dimension: int, count: int) -> None:
    given = pairs(np.random.default_rng(0), count, dimension)
    want = collision_probability(*given)
    got = collision_probability_batch(*given)
    known = want > 1e-12
    assert known.mean() > 0.5
    assert np.abs(got / np.where(known, want, 1.0) - 1.0)[known].max() < 1e-9
    assert np.abs(got - want).max() < 1e-11


def test_batch_against_golden_values(golden_path: Path) -> None:
    checked = 0
    for case in json.loads(golden_path.read_text(encoding="utf-8"))["cases"]:
        given, want = case["inputs"], case["expected"]
        if case["func"] == "collision_probability":
            sigma = np.diag([given["sigma1"] ** 2, given["sigma2"] ** 2])
            got = collision_probability_batch([given["dx"], given["dy"]], sigma, given["R"])
        elif case["func"] == "collision_probability_3d":
            sigma = np.diag(np.square(given["sigma"]))
            got = collision_probability_batch(given["d"], sigma, given["R"])
        elif case["func"] == "region_case" and want["collision_probability"] is not None:
            difference = np.subtract(given["mu"], given["point"], dtype=float)
            radius, want = given["r"] + given["r_d"], want["collision_probability"]
            got = collision_probability_batch(difference, given["Sigma"], radius)
        else:
            continue
        checked += 1
        assert float(got) == pytest.approx(want, rel=1e-9, abs=1e-12), case["id"]
    assert checked


def test_bounds_against_golden_values(golden_path: Path) -> None:
    bounds = {
        "dutoit": centre_point_value,
        "park": highest_density_bound,
        "zhu_halfplane": centre_line_bound,
        "whitened_box_bound": box_bound,
    }
    for case in json.loads(golden_path.read_text(encoding="utf-8"))["cases"]:
        if case["func"] != "region_case":
            continue
        given = case["inputs"]
        difference = np.subtract(given["mu"], given["point"], dtype=float)
        sigma, radius = np.array(given["Sigma"], dtype=float), given["r"] + given["r_d"]
        for field, bound in bounds.items():
            want = case["expected"].get(field)
            if want is not None:
                got = float(bound(difference, sigma, radius))
                assert got == pytest.approx(want, rel=1e-8, abs=1e-300), (case["id"], field)


def test_batch_shapes_chunks_and_limits() -> None:
    difference, covariance, radius = pairs(np.random.default_rng(1), 23)
    whole = collision_probability_batch(difference, covariance, radius)
    small = collision_probability_batch(difference, covariance, radius, chunk=4)
    assert np.allclose(whole, small, rtol=1e-13, atol=0.0)
    grid = collision_probability_batch(difference[:, None], covariance[:3], 1.0)
    assert grid.shape == (23, 3)
    assert np.allclose(grid, collision_probability(difference[:, None], covariance[:3], 1.0))
    assert collision_probability_batch(np.zeros((0, 2)), np.eye(2), 1.0).shape == (0,)
    line = np.diag([1.0, 0.0])
    chord = math.sqrt(1.5**2 - 0.4**2)
    want = special.ndtr(chord - 2.0) - special.ndtr(-chord - 2.0)
    assert float(collision_probability_batch([2.0, 0.4], line, 1.5)) == pytest.approx(want)
    assert float(collision_probability_batch([1.0, 0.5], np.zeros((2, 2)), 1.5)) == 1.0
    assert float(collision_probability_batch([1.0, 1.5], np.zeros((2, 2)), 1.5)) == 0.0
    assert float(collision_probability_batch([0.0, 0.0], np.eye(2), 0.0)) == 0.0


def test_double_precision_stays_inside() -> None:
    import jax

    before = jax.config.jax_enable_x64
    collision_probability_batch([1.0, 0.5], np.eye(2), 1.5)
    assert jax.config.jax_enable_x64 == before
    assert jax.numpy.zeros(1).dtype == ("float64" if before else "float32")


@pytest.mark.parametrize("dimension", [2, 3])
def test_random_draws_agree(dimension: int) -> None:
    given = pairs(np.random.default_rng(2), 30, dimension)
    draws = 100_000
    share = sampled_collision_probability(*given, np.random.default_rng(3), draws)
    again = sampled_collision_probability(*given, np.random.default_rng(3), draws)
    assert (share == again).all()
    exact = collision_probability_batch(*given)
    error = np.sqrt(exact * (1.0 - exact) / draws)
    score = np.abs(share - exact)[error > 1e-6] / error[error > 1e-6]
    assert len(score) > 15 and score.max() < 4.0 and (score < 3.0).mean() > 0.9


def test_gradient_against_finite_differences() -> None:
    difference, covariance, radius = pairs(np.random.default_rng(4), 60, thin=1.5)
    gradient = collision_probability_gradient(difference, covariance, radius)
    size = np.sqrt(np.linalg.eigvalsh(covariance)[:, 0])
    for axis in range(2):
        step = 1e-3 * size[:, None] * np.eye(2)[axis]
        # The robot moves by +step, so the difference by -step; fourth order.
        value = [
            collision_probability(difference - k * step, covariance, radius)
            for k in (-2, -1, 1, 2)
        ]
        slope = (value[0] - 8 * value[1] + 8 * value[2] - value[3]) / (12 * 1e-3 * size)
        # The probabilities are known to about 1e-12, their quotients by the step to 1e-9.
        slack = 1e-6 * np.abs(gradient).max(axis=1) * size + 2e-9
        assert (np.abs(slope - gradient[:, axis]) * size < slack).all()


def test_gradient_of_a_round_covariance() -> None:
    """R / s^2 I1(R d / s^2) exp(-(R^2 + d^2) / (2 s^2)), the Rice distribution by its shift."""
    distance, radius, deviation = 2.0, 1.5, 0.7
    got = collision_probability_gradient([0.0, distance], deviation**2 * np.eye(2), radius)
    product = radius * distance / deviation**2
    exponent = -0.5 * (radius**2 + distance**2) / deviation**2
    want = radius / deviation**2 * special.i1(product) * math.exp(exponent)
    # Towards the obstacle, which is at +y, the risk grows.
    assert got == pytest.approx([0.0, want], rel=1e-12, abs=1e-15)


def test_gradient_batch_is_one_by_one() -> None:
    difference, covariance, radius = pairs(np.random.default_rng(5), 4, thin=1.0)
    grid = collision_probability_gradient(difference[:, None], covariance[:2], radius[:2])
    assert grid.shape == (4, 2, 2)
    for i, j in np.ndindex(4, 2):
        one = collision_probability_gradient(difference[i], covariance[j], radius[j])
        assert np.allclose(grid[i, j], one, rtol=1e-10)
    assert (collision_probability_gradient([1.0, 0.0], np.eye(2), 0.0) == 0.0).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_bounds_hold(dimension: int) -> None:
    given = pairs(np.random.default_rng(6), 400, dimension)
    exact = collision_probability(*given)
    line, best = centre_line_bound(*given), half_plane_bound(*given)
    outside = np.linalg.norm(given[0], axis=1) > given[2]
    assert (best <= line * (1 + 1e-9) + 1e-300)[outside].all()
    for bound in (highest_density_bound(*given), line, box_bound(*given)):
        assert (exact <= bound * (1 + 1e-6) + 1e-12).all()


def test_bounds_in_closed_form() -> None:
    sigma = 0.25 * np.eye(2)
    d, radius = np.array([1.2, 1.6]), 1.5
    assert float(centre_line_bound(d, sigma, radius)) == pytest.approx(special.ndtr(-1.0))
    density = stats.multivariate_normal(np.zeros(2), sigma)
    area = math.pi * radius**2
    assert float(centre_point_value(d, sigma, radius)) == pytest.approx(area * density.pdf(d))
    nearest = density.pdf(d * (0.5 / 2.0))  # the disc's point nearest to the mean
    assert float(highest_density_bound(d, sigma, radius)) == pytest.approx(area * nearest)
    assert float(centre_line_bound([0.0, 0.0], np.eye(2), 1.0)) == pytest.approx(special.ndtr(1.0))
    flat = np.diag([1.0, 0.0])
    assert float(centre_line_bound([0.0, 2.0], flat, 1.5)) == 0.0
    assert float(box_bound([0.0, 2.0], flat, 1.5)) == 0.0


def test_bad_input_is_named() -> None:
    flat = np.diag([1.0, 0.0])
    for bound in (centre_point_value, highest_density_bound):
        with pytest.raises(WideberthError, match="singular"):
            bound([1.0, 1.0], flat, 1.0)
    with pytest.raises(WideberthError, match="singular or too thin"):
        collision_probability_gradient([1.0, 1.0], flat, 1.0)
    with pytest.raises(WideberthError, match="singular or too thin"):
        collision_probability_gradient_batch([1.0, 1.0], flat, 1.0)
    with pytest.raises(WideberthError, match="singular or too thin"):
        collision_probability_gradient([1.0, 0.0, 0.0], np.zeros((3, 3)), 1.0)
    with pytest.raises(WideberthError, match="radius is -1"):
        collision_probability_batch([1.0, 1.0], np.eye(2), -1.0)
    with pytest.raises(WideberthError, match="nodes"):
        collision_probability_batch([1.0, 1.0], np.eye(2), 1.0, nodes=0)
    with pytest.raises(WideberthError, match="draws"):
        rng = np.random.default_rng(0)
        sampled_collision_probability([1.0, 1.0], np.eye(2), 1.0, rng, draws=0)
