"""Rectangles: their levels, their content, and how they stand."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import special

from wideberth.regions import gaussian
from wideberth.regions.box import box_content
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.tests.helpers.region_samples import COVARIANCE, RECTANGLES, packed


def test_sidak_and_bonferroni_levels() -> None:
    sidak, bonferroni = EigenRectangle(), EigenRectangle("bonferroni")
    assert sidak.level(0.1) == pytest.approx(1.9488218625070588, rel=1e-12)
    assert bonferroni.level(0.1) == pytest.approx(1.9599639845400543, rel=1e-12)
    for dimension in (2, 3):
        for tail in (0.9, 0.3, 1e-3, 1e-14):
            z = sidak.level(tail, dimension)
            assert sidak.tail(z, dimension) == pytest.approx(tail, rel=1e-9)
            assert z <= bonferroni.level(tail, dimension)
        assert (1 - sidak.tail(1.5, dimension)) == pytest.approx(
            math.erf(1.5 / math.sqrt(2)) ** dimension, rel=1e-13
        )
    assert sidak.tail(0.0) == sidak.tail(-1.0) == bonferroni.tail(0.0) == 1.0


def test_golden_rectangles(golden_path: Path) -> None:
    checked = 0
    for case in json.loads(golden_path.read_text(encoding="utf-8"))["cases"]:
        if case["func"] != "forecast_rectangle" or case["inputs"]["rho"] != 0.0:
            continue
        region = EigenRectangle(case["inputs"]["variant"])
        want, tail = case["expected"], 1.0 - case["inputs"]["p"]
        z = region.level(tail)
        assert z == pytest.approx(want["z"], rel=1e-10)
        ellipse = np.pi * gaussian.ellipse_level(tail) ** 2
        numbers = packed(region, COVARIANCE, 0.0)
        area = float(region.area(numbers, np.asarray(z))) / math.sqrt(np.linalg.det(COVARIANCE))
        assert area / ellipse == pytest.approx(want["area_over_ellipse_area"], rel=1e-10)
        assert (1 - 2 * special.ndtr(-z)) ** 2 == pytest.approx(want["coverage"], rel=1e-10)
        checked += 1
    assert checked


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("region", RECTANGLES, ids=repr)
def test_content_by_monte_carlo(region: Any, dimension: int) -> None:
    rng = np.random.default_rng(18)
    root, count, tail = rng.standard_normal((dimension, dimension)), 40_000, 0.1
    numbers = packed(region, root @ root.T, 0.0)
    draws = np.arange(1.0, dimension + 1) + rng.standard_normal((count, dimension)) @ root.T
    share = region.contains(draws, numbers, np.asarray(region.level(tail, dimension))).mean()
    sigma = math.sqrt(tail * (1 - tail) / count)
    if isinstance(region, EigenRectangle):
        kept = 1 - tail if region.correction == "sidak" else (1 - tail / dimension) ** dimension
        assert share == pytest.approx(kept, abs=3 * sigma)
    else:
        assert share > 1 - tail - 3 * sigma


@pytest.mark.parametrize("rho", [0.0, 0.3, -0.5, 0.8, 0.95, 0.99])
def test_sidaks_inequality_on_the_world_axes(rho: float) -> None:
    half = np.full(2, LuetkepohlRectangle(correction="sidak").level(0.1))
    content = box_content(half, np.array([[1.0, rho], [rho, 1.0]]))
    assert content >= 0.9 - 1e-12
    assert content < box_content(
        np.full(2, LuetkepohlRectangle().level(0.1)), np.array([[1.0, rho], [rho, 1.0]])
    )


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("enlargement", ["disc", "box"])
def test_eigen_rectangle_turns_with_the_covariance(enlargement: Any, size: int) -> None:
    """It does wherever the eigenvalues differ; along the axes it is the other rectangle."""
    rng = np.random.default_rng(19)
    region, other = EigenRectangle("sidak", enlargement), LuetkepohlRectangle(enlargement, "sidak")
    variance, level = np.array([4.0, 1.0, 0.2])[:size], np.asarray(2.0)
    turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
    covariance = turn @ np.diag(variance) @ turn.T
    mean = np.arange(1.0, size + 1.0)
    points = rng.uniform(-6, 6, (2000, size))
    turned = packed(region, 0.5 * (covariance + covariance.T))
    straight = packed(other, np.diag(variance))
    got = region.signed_distance(mean + points @ turn.T, turned, level)
    np.testing.assert_allclose(
        got, other.signed_distance(mean + points, straight, level), atol=1e-9
    )
    normals = points / np.linalg.norm(points, axis=1)[:, None]
    reach = region.support(normals @ turn.T, turned, level) - (normals @ turn.T) @ mean
    wanted = other.support(normals, straight, level) - normals @ mean
    np.testing.assert_allclose(reach, wanted, atol=1e-9)
    assert region.area(turned, level) == pytest.approx(other.area(straight, level))
