"""The collision probability against draws; its bounds, golden values and closed forms."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.errors import WideberthError
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


@pytest.mark.parametrize("dimension", [2, 3])
def test_random_draws_agree(dimension: int) -> None:
    given = pairs(np.random.default_rng(2), 30, dimension)
    draws = 100_000
    rng, share = np.random.default_rng(3), []
    for difference, covariance, radius in zip(*given, strict=True):
        root = np.linalg.cholesky(covariance)
        places = difference + rng.standard_normal((draws, dimension)) @ root.T
        share.append(np.mean((places**2).sum(axis=1) < radius**2))
    exact = collision_probability(*given)
    error = np.sqrt(exact * (1.0 - exact) / draws)
    score = np.abs(share - exact)[error > 1e-6] / error[error > 1e-6]
    assert len(score) > 15 and score.max() < 4.0 and (score < 3.0).mean() > 0.9


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
