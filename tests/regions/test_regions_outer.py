"""Axes of the outer ellipses against golden values, brute force, and their limits."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.metrics import ellipses
from wideberth.regions import gaussian
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minimum_trace import MinimumTrace
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.regions.repaired_level import RepairedLevel
from wideberth.regions.repaired_margin import RepairedMargin
from wideberth.tests.helpers.region_samples import OUTER, packed, random_covariances
from wideberth.tests.oracles import inflation
from wideberth.tests.oracles.region_levels import ellipse_level_of_content

FIELDS: dict[str, Callable[[Any, Any, float], Any]] = {
    "brito_axes": lambda o, r, s: axes_of(RepairedMargin(), o, r, s),
    "axes_min_trace": lambda o, r, s: axes_of(MinimumTrace(), o, r, s),
    "axes_min_area": lambda o, r, s: axes_of(MinimumArea(), o, r, s),
    "delta_min": lambda o, r, s: added(RepairedMargin(), o, r, s, 1.0)[0],
    "s_req": lambda o, r, s: added(RepairedLevel(), o, r, s, 0.0)[1],
}


def axes_of(region: OuterEllipse, obstacle: Any, margin: Any, s: float) -> Any:
    return region.axes(region.parameters(obstacle, margin), np.asarray(s))


def added(region: OuterEllipse, obstacle: Any, margin: Any, s: float, kept: float) -> Any:
    """Margin that the axes show if the level is s, level that they show with that margin."""
    numbers = region.parameters(obstacle, margin)
    deviations, axes = gaussian.unpack(numbers)[2], region.axes(numbers, np.asarray(s))
    return axes[0] - kept * s * deviations[0], (axes[0] - margin) / max(deviations[0], 1e-300)


@pytest.mark.parametrize("field", FIELDS)
def test_golden_values(golden_path: Path, field: str) -> None:
    checked = 0
    for case in json.loads(golden_path.read_text(encoding="utf-8"))["cases"]:
        want = case["expected"].get(field) if case["func"] == "region_case" else None
        if want is None:
            continue
        given = case["inputs"]
        sigma = np.array(given["Sigma"], dtype=float)
        values = np.linalg.eigvalsh(sigma)
        loose = 0 < values[0] < 1.01e-8 * values[1]  # such eigenvalues have lost digits
        s = ellipse_level_of_content(given["p"])
        obstacle = GaussianObstacle(np.array(given["mu"], dtype=float), sigma)
        got = FIELDS[field](obstacle, np.asarray(given["r"] + given["r_d"]), s)
        np.testing.assert_allclose(got, want, rtol=1e-8 if loose else 1e-10, atol=2e-15)
        checked += 1
    assert checked >= 9


def test_golden_values_in_3d(golden_path: Path) -> None:
    cases = json.loads(golden_path.read_text(encoding="utf-8"))["cases"]
    cases = [case for case in cases if case["func"] == "ellipsoid_sum_3d"]
    assert cases
    for case in cases:
        axes = np.sort(case["inputs"]["axes"])[::-1]
        obstacle = GaussianObstacle(np.zeros(3), np.diag(axes**2))
        got = added(RepairedMargin(), obstacle, np.asarray(case["inputs"]["R"]), 1.0, 1.0)[0]
        assert got == pytest.approx(case["expected"]["delta_min"], rel=1e-10)


@pytest.mark.parametrize(
    ("a", "b", "margin", "ratios"),
    [
        (2, 1, 1, (1.01483, 1.01841, 1.01436)), (2, 1, 1.5, (1.01499, 1.01761, 1.01481)),
        (5, 1, 1, (1.08153, 1.15556, 1.06205)), (10, 1, 1, (1.17628, 1.40426, 1.09607)),
        (10, 0.1, 1, (1.55781, 2.13287, 1.37080)), (100, 1, 1, (1.90530, 3.77410, 1.13783)),
    ],
)  # fmt: skip
def test_areas_of_the_table(a: float, b: float, margin: float, ratios: Any) -> None:
    exact = float(ellipses.sum_volume(np.array([a, b]), np.asarray(margin)))
    for region, ratio in zip((OUTER[0], OUTER[2], OUTER[3]), ratios, strict=True):
        numbers = packed(region, np.diag([float(a) ** 2, float(b) ** 2]), margin)
        area = float(region.area(numbers, np.asarray(1.0)))
        assert area / exact == pytest.approx(ratio, abs=6e-6)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("region", OUTER, ids=repr)
def test_the_exact_sum_lies_inside(region: OuterEllipse, size: int) -> None:
    rng = np.random.default_rng(11)
    covariance, margin = random_covariances(rng, 10_000, size)
    level = rng.uniform(0.0, 5.0, 10_000)
    numbers = packed(region, covariance, margin)
    exact = MinkowskiSum()
    closest = np.full(10_000, np.inf)
    for _ in range(40):
        normals = rng.standard_normal((10_000, size))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        wanted = exact.support(normals, numbers, level)
        slack = region.support(normals, numbers, level) - wanted
        assert (slack > -1e-12 * (1.0 + np.abs(wanted))).all()
        closest = np.minimum(closest, slack / (np.abs(wanted) + 1.0))
    assert np.median(closest) < 0.1  # it is not a far larger set


@pytest.mark.parametrize("size", [2, 3])
def test_the_two_repairs_are_the_smallest(size: int) -> None:
    """Against the other implementation of both roots, over ten decades of thinness."""
    rng = np.random.default_rng(12)
    covariance, margin = random_covariances(rng, 5_000, size)
    level = rng.uniform(0.1, 5.0, 5_000)
    numbers = packed(RepairedMargin(), covariance, margin)
    deviations = gaussian.unpack(numbers)[2]
    a, b = level * deviations[:, 0], level * deviations[:, -1]
    longer = level[:, None] * deviations + inflation.smallest_margin(a, b, margin)[:, None]
    usual = a < 500.0 * margin
    got = RepairedMargin().axes(numbers, level)
    np.testing.assert_allclose(got[usual], longer[usual], rtol=1e-11)
    # Beyond that the fixed number of Newton steps errs on the large side.
    assert (got >= longer * (1 - 1e-12)).all() and (got <= longer * (1 + 1e-6)).all()
    larger = inflation.smallest_level(deviations[:, 0], deviations[:, -1], level, margin)
    wanted = larger[:, None] * deviations + margin[:, None]
    got = RepairedLevel().axes(numbers, level)
    assert (got >= wanted * (1 - 1e-11)).all()
    np.testing.assert_allclose(got, wanted, rtol=1e-9)


@pytest.mark.parametrize("size", [2, 3])
def test_minimum_trace_and_area_are_minimal(size: int) -> None:
    rng = np.random.default_rng(13)
    covariance, margin = random_covariances(rng, 150, size)
    numbers = packed(MinimumArea(), covariance, margin)
    squares = 4.0 * gaussian.unpack(numbers)[2] ** 2
    area = np.log(MinimumArea().axes(numbers, np.asarray(2.0))).sum(axis=1)
    trace = (MinimumTrace().axes(numbers, np.asarray(2.0)) ** 2).sum(axis=1)
    for i in range(len(margin)):

        def axes(exponent: float, i: int = i) -> Any:
            beta = np.exp(exponent)
            return (1 + 1 / beta) * squares[i] + (1 + beta) * margin[i] ** 2

        best = [
            optimize.minimize_scalar(of, bounds=(-25, 25), options={"xatol": 1e-9}).fun
            for of in (lambda t: 0.5 * np.log(axes(t)).sum(), lambda t: axes(t).sum())
        ]
        assert area[i] == pytest.approx(best[0], abs=1e-9)
        assert trace[i] == pytest.approx(best[1], rel=1e-9)


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("region", OUTER, ids=repr)
def test_axes_grow_with_level_and_margin(region: OuterEllipse, size: int) -> None:
    rng = np.random.default_rng(14)
    covariance, margin = random_covariances(rng, 10_000, size)
    level, more = rng.uniform(0.0, 5.0, 10_000), 10.0 ** rng.uniform(-3, 0, 10_000)
    first = region.axes(packed(region, covariance, margin), level) * (1 - 1e-12)
    assert (region.axes(packed(region, covariance, margin), level * (1 + more)) >= first).all()
    assert (region.axes(packed(region, covariance, margin * (1 + more)), level) >= first).all()


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("region", OUTER, ids=repr)
def test_limits(region: OuterEllipse, size: int) -> None:
    root = np.random.default_rng(16).standard_normal((size, size))
    numbers = packed(region, root @ root.T)
    for level in (0.0, -2.0):  # the disc of the margin
        np.testing.assert_allclose(region.axes(numbers, np.asarray(level)), 0.7, rtol=1e-12)
    point = packed(region, np.zeros((size, size)))
    np.testing.assert_allclose(region.axes(point, np.asarray(2.0)), 0.7, rtol=1e-12)
    bare = packed(region, root @ root.T, 0.0)
    wanted = 2.0 * np.sqrt(np.linalg.eigvalsh(root @ root.T)[::-1])
    np.testing.assert_allclose(region.axes(bare, np.asarray(2.0)), wanted, rtol=1e-12)
    round_ = packed(region, 0.25 * np.eye(size), 0.7)
    np.testing.assert_allclose(region.axes(round_, np.asarray(2.0)), 1.7, rtol=1e-12)
    assert region.risk(region.level_for_risk(0.01)) == pytest.approx(0.01)


def test_repaired_level_is_undefined_for_flat_covariances() -> None:
    region = RepairedLevel()
    flat = np.stack([np.eye(2), np.diag([1.0, 0.0])])
    with pytest.raises(WideberthError, match=r"1 of 2 covariances are singular.*repaired_margin"):
        packed(region, flat, 0.5)
    assert np.isfinite(packed(region, flat, 0.0)).all()
    assert not region.singular_covariances
