"""What it costs to make axes longer by the margin: clearance, area, and risk on the boundary."""

import math
from typing import Any

import numpy as np
import pytest

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.metrics import ellipses
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.helpers.region_samples import COVARIANCE, packed
from wideberth.tests.oracles import inflation


@pytest.mark.parametrize(
    ("condition", "share", "error"),
    [
        (1, 1.0, 0.0), (2, 1.0, 0.00808), (4, 5.0, 0.05028), (10, 2.0, 0.11546),
        (25, 0.5, 0.14365), (100, 1.0, 0.34154), (1e4, 0.1, 0.55501), (1e8, 0.1, 0.95106),
    ],
)  # fmt: skip
def test_largest_clearance_error(condition: float, share: float, error: float) -> None:
    b, margin = share * 1.5, 1.5
    got = inflation.largest_clearance_error(b * math.sqrt(condition), b, margin) / margin
    assert float(got) == pytest.approx(error, abs=6e-6)


def test_largest_errors_by_brute_force() -> None:
    rng = np.random.default_rng(4)
    angle = np.linspace(0, np.pi / 2, 20001)
    for _ in range(10):
        b, margin = np.asarray(rng.uniform(0.1, 2)), np.asarray(rng.uniform(0.1, 2))
        a = b * rng.uniform(1, 5)
        closed = float(inflation.largest_clearance_error(a, b, margin))
        support = inflation.support_error(a, b, margin, angle)
        clearance = inflation.clearance_error(a, b, margin, angle)
        assert support.max() == pytest.approx(closed, abs=1e-7)
        assert clearance.max() == pytest.approx(closed, abs=1e-7)
        assert float(inflation.effective_margin(a, b, margin)) == pytest.approx(margin - closed)
        normal = np.arccos(np.sqrt(inflation.worst_normal_cosine(a, b, margin)))
        assert angle[support.argmax()] == pytest.approx(float(normal), abs=1e-3)
        polar = float(inflation.worst_polar_angle(a, b, margin))
        assert angle[clearance.argmax()] == pytest.approx(polar, abs=1e-3)
        assert (inflation.radial_error(a, b, margin, angle) >= clearance - 1e-12).all()


@pytest.mark.parametrize(
    ("a", "b", "margin", "exact", "ratios", "delta"),
    [
        (2, 1, 1, 19.11323, (0.98620, 1.01483, 1.01841, 1.01436), 1.03459),
        (5, 1, 1, 39.85960, (0.94580, 1.08153, 1.15556, 1.06205), 1.20977),
        (3, 0.3, 1.5, 28.18390, (0.90289, 1.13679, 1.20258, 1.13309), 1.2114),
        (100, 1, 1, 717.41069, (0.88457, 1.90530, 3.77410, 1.13783), 3.2154),
    ],
)
def test_areas(a: float, b: float, margin: float, exact: float, ratios: Any, delta: float) -> None:
    total = float(ellipses.sum_volume(np.array([a, b]), np.asarray(margin)))
    assert total == pytest.approx(exact, rel=1e-6)
    larger = float(inflation.smallest_margin(a, b, margin))
    assert larger / margin == pytest.approx(delta, abs=6e-5)
    trace = inflation.outer_axes(a, b, margin, inflation.least_trace(a, b, margin))
    area = inflation.outer_axes(a, b, margin, inflation.least_area(a, b, margin))
    products = (
        (a + margin) * (b + margin),
        (a + larger) * (b + larger),
        trace.prod(),
        area.prod(),
    )
    np.testing.assert_allclose(np.pi * np.array(products) / total, ratios, atol=6e-6)


def test_both_repairs_and_the_effective_level_are_tight() -> None:
    angle = np.linspace(0, np.pi / 2, 20001)
    rng = np.random.default_rng(5)
    for _ in range(10):
        s, margin, narrow = rng.uniform(0.5, 3), rng.uniform(0.1, 2), rng.uniform(0.1, 1)
        wide = narrow * rng.uniform(1.1, 6)
        a, b = s * wide, s * narrow
        exact = np.hypot(a * np.cos(angle), b * np.sin(angle)) + margin

        def reach(one: float, other: float) -> Any:
            return np.hypot(one * np.cos(angle), other * np.sin(angle))

        delta = float(inflation.smallest_margin(a, b, margin))
        assert (reach(a + delta, b + delta) - exact).min() == pytest.approx(0.0, abs=1e-7)
        higher = float(inflation.smallest_level(wide, narrow, s, margin))
        grown = reach(higher * wide + margin, higher * narrow + margin)
        assert (grown - exact).min() == pytest.approx(0.0, abs=1e-7)
        share = float(inflation.effective_level_ratio(a, b, margin))
        small = np.hypot(share * a * np.cos(angle), share * b * np.sin(angle)) + margin
        assert (reach(a + margin, b + margin) - small).min() == pytest.approx(0.0, abs=1e-7)
    assert math.isinf(float(inflation.smallest_level(1.0, 0.0, 2.0, 1.0)))
    assert float(inflation.smallest_level(0.0, 0.0, 2.0, 1.0)) == 2.0


def test_exact_sum_guarantees_the_risk() -> None:
    region = MinkowskiSum()
    for covariance in (COVARIANCE, np.diag([4.0, 1e-4])):
        level = region.level_for_risk(0.05)
        assert region.risk(level) == pytest.approx(0.05)
        edge = region.boundary(packed(region, covariance), level, 400)
        risk = collision_probability(np.array([1.0, 2.0]) - edge, covariance, 0.7)
        assert risk.max() <= 0.05


def test_the_papers_ellipse_does_not() -> None:
    region = MahalanobisEllipse()
    margin, covariance = 1.0, np.diag([0.01, 0.0001])  # condition 100, sigma_1 = 0.1 margin
    edge = region.boundary(packed(region, covariance, margin), region.level(0.05), 4000)
    risk = collision_probability(np.array([1.0, 2.0]) - edge, covariance, margin)
    assert risk.max() / 0.05 == pytest.approx(1.38, abs=0.006)
