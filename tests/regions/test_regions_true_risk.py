"""Regions sized by a collision risk: what each promises, against the exact probability."""

import numpy as np
import pytest

from wideberth.framework.region import Guarantee, Region
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.regions.best_half_plane import BestHalfPlane
from wideberth.regions.bhattacharyya import Bhattacharyya
from wideberth.regions.du_toit import DuToit
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.park import Park
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.tests.helpers.region_samples import BY_RISK, random_obstacles
from wideberth.tests.oracles.region_levels import bhattacharyya_distance
from wideberth.tests.oracles.risk_bounds import (
    box_bound,
    centre_point_value,
    highest_density_bound,
)

PROMISING = [region for region in BY_RISK if region.guarantee is Guarantee.CONTENT]

# Area relative to the exact sum, least and largest true risk on the boundary, at eps = 0.05.
TABLE: dict[tuple[float, float], dict[type[Region], tuple[float, float, float]]] = {
    (1.0, 0.5): {
        HalfPlane: (0.7101, 1.751e-2, 4.247e-2),
        BestHalfPlane: (0.6791, 2.411e-2, 4.247e-2),
        DuToit: (0.3490, 9.017e-2, 3.791e-1),
        Park: (1.1404, 1.225e-3, 2.321e-3),
        WhitenedBox: (0.7261, 1.742e-2, 4.259e-2),
        RiskContour: (0.6118, 5e-2, 5e-2),
    },
    (1.0, 0.1): {
        HalfPlane: (0.8959, 7.066e-9, 4.966e-2),
        BestHalfPlane: (0.7517, 1.224e-2, 4.966e-2),
        DuToit: (0.1426, 3.636e-2, 8.556e-1),
        Park: (1.2791, 9.749e-5, 4.929e-4),
        WhitenedBox: (0.8408, 4.971e-3, 4.966e-2),
        RiskContour: (0.7241, 5e-2, 5e-2),
    },
    (0.3, 0.1): {
        HalfPlane: (0.8605, 2.372e-2, 4.888e-2),
        BestHalfPlane: (0.8470, 3.260e-2, 4.888e-2),
        DuToit: (0.0995, 9.115e-1, 1.000),
        Park: (1.2449, 7.404e-5, 1.314e-4),
        WhitenedBox: (1.0377, 7.012e-6, 4.888e-2),
        RiskContour: (0.8379, 5e-2, 5e-2),
    },
    (3.0, 1.0): {
        HalfPlane: (0.7330, 1.500e-3, 3.295e-2),
        BestHalfPlane: (0.5820, 1.170e-2, 3.295e-2),
        DuToit: (0.3373, 4.305e-2, 8.345e-2),
        Park: (0.7574, 4.996e-3, 1.493e-2),
        WhitenedBox: (0.4533, 3.274e-2, 4.155e-2),
        RiskContour: (0.3843, 5e-2, 5e-2),
    },
}


@pytest.mark.parametrize("deviations", TABLE, ids=str)
def test_true_risk_along_the_boundary(deviations: tuple[float, float]) -> None:
    """The published table of true risks, at the digits printed there."""
    sigma, margin = np.diag(np.square(deviations)), np.float64(1.5)
    obstacle = GaussianObstacle(np.zeros(2), sigma)
    packed = MinkowskiSum().parameters(obstacle, margin)
    whole = MinkowskiSum().area(packed, np.float64(MinkowskiSum().level(0.05)))
    for kind, (share, least, largest) in TABLE[deviations].items():
        region = kind()
        numbers, level = region.parameters(obstacle, margin), region.level(0.05)
        edge = region.boundary(numbers, level, 4000)
        risk = collision_probability(edge, sigma, margin)
        assert region.area(numbers, np.float64(level)) / whole == pytest.approx(share, abs=6e-5)
        assert risk.min() == pytest.approx(least, rel=5e-4), kind
        assert risk.max() == pytest.approx(largest, rel=5e-4), kind


@pytest.mark.parametrize("region", PROMISING, ids=repr)
def test_guarantee_at_random_covariances(region: Region) -> None:
    """Points just outside, along one random ray per obstacle: no risk above the one asked for."""
    rng = np.random.default_rng(7)
    mean, sigma, margin = random_obstacles(rng, 2000)
    numbers = region.parameters(GaussianObstacle(mean, sigma), margin)
    angle = rng.uniform(0.0, 2.0 * np.pi, 2000)
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for tail in (0.2, 1e-4):
        level = np.float64(region.level(tail))
        low, high = np.zeros(2000), np.full(2000, 100.0)
        for _ in range(40):
            middle = 0.5 * (low + high)
            inside = region.contains(mean + middle[:, None] * ray, numbers, level)
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        risk = collision_probability(high[:, None] * ray, sigma, margin)
        assert risk.max() <= tail * (1 + 1e-8)


@pytest.mark.parametrize("region", [DuToit(), Bhattacharyya()], ids=repr)
def test_what_promises_nothing_breaks_the_promise(region: Region) -> None:
    """A small covariance and a large margin: the true risk is far above the tail."""
    sigma = np.diag([0.3, 0.1]) ** 2 if isinstance(region, DuToit) else np.diag([9e-6, 9e-6])
    margin = np.float64(1.5)
    numbers = region.parameters(GaussianObstacle(np.zeros(2), sigma), margin)
    edge = region.boundary(numbers, region.level(0.05), 100)
    assert collision_probability(edge, sigma, margin).max() > 0.1


def test_bounds_are_ordered_and_the_approximation_is_none() -> None:
    rng = np.random.default_rng(3)
    mean, sigma, margin = random_obstacles(rng, 2000)
    exact = collision_probability(mean, sigma, margin)
    for bound in (highest_density_bound, box_bound):
        assert (exact <= bound(mean, sigma, margin) * (1 + 1e-8) + 1e-300).all()
    centre = centre_point_value(mean, sigma, margin)
    assert (centre < 0.5 * exact).any() and (centre > 2.0 * exact).any()
    small = centre_point_value(mean, sigma, 1e-3 * np.sqrt(np.linalg.det(sigma)))
    truth = collision_probability(mean, sigma, 1e-3 * np.sqrt(np.linalg.det(sigma)))
    likely = truth > 1e-12
    np.testing.assert_allclose(small[likely], truth[likely], rtol=1e-2)  # exact in the limit


def test_contour_holds_exactly_what_is_riskier() -> None:
    """Area of the contour against counting points of a grid by the exact probability."""
    sigma = np.array([[0.5, 0.2], [0.2, 0.3]])
    region, margin = RiskContour(), np.float64(0.6)
    numbers = region.parameters(GaussianObstacle(np.zeros(2), sigma), margin)
    axis = np.linspace(-3.0, 3.0, 401)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    share = (collision_probability(grid, sigma, margin, 24) > 0.1).mean()
    cell = (401 / 400 * 6.0) ** 2
    area = region.area(numbers, np.float64(region.level(0.1)))
    assert area == pytest.approx(share * cell, rel=2e-3)


def test_bhattacharyya_ellipse_is_its_distance() -> None:
    """Without margin the boundary is where D_B is tau."""
    rng = np.random.default_rng(2)
    _, sigma, _ = random_obstacles(rng, 20)
    region = Bhattacharyya(robot_deviation=0.5)
    for covariance in sigma:
        numbers = region.parameters(GaussianObstacle(np.ones(2), covariance), np.float64(0.0))
        tau = numbers[-1] + 1.3
        edge = region.boundary(numbers, float(tau), 50) - 1.0
        distance = bhattacharyya_distance(edge, covariance, 0.25 * np.eye(2))
        np.testing.assert_allclose(distance, tau, rtol=1e-9)
