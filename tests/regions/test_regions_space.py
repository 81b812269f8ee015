"""The regions in three dimensions, against closed forms, quadrature and Monte Carlo.

`check_region` holds every region to its contract in 3-D as well; here stand the numbers.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy import optimize, special, stats

from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.region import Guarantee, Region
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.testing.numeric_constraint import compile_constraint
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.metrics.ellipses import mean_cubed_support, mean_support
from wideberth.regions.bhattacharyya import Bhattacharyya
from wideberth.regions.du_toit import DuToit
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.park import Park
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.tests.oracles.region_levels import bhattacharyya_distance
from wideberth.tests.oracles.risk_bounds import (
    box_bound,
    centre_line_bound,
    centre_point_value,
    highest_density_bound,
)

SPATIAL = [name for name in names("regions") if 3 in build("regions", name).dimensions]
PROMISING = [n for n in SPATIAL if build("regions", n).guarantee is not Guarantee.NONE]


def covariances(rng: np.random.Generator, count: int) -> Any:
    """Deviations of 0.1 m to 2 m, the others down to 3 % of that."""
    turn = np.linalg.qr(rng.standard_normal((count, 3, 3)))[0]
    largest = 10.0 ** rng.uniform(-1.0, 0.3, (count, 1))
    variance = (largest * 10.0 ** rng.uniform(-1.5, 0.0, (count, 3))) ** 2
    sigma = np.einsum("kij,kj,klj->kil", turn, variance, turn)
    return 0.5 * (sigma + np.swapaxes(sigma, 1, 2))


def edges(region: Region, sigma: Any, margin: Any, level: float, rng: Any) -> Any:
    """A point of the boundary around 0 on one random ray for each covariance, (K, 3)."""
    numbers = region.parameters(GaussianObstacle(np.zeros((len(sigma), 3)), sigma), margin)
    ray = rng.standard_normal((len(sigma), 3))
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    low, high = np.zeros(len(sigma)), np.full(len(sigma), 100.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        inside = region.contains(middle[:, None] * ray, numbers, np.asarray(level))
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return high[:, None] * ray


def test_all_but_the_angle_form_know_three_dimensions() -> None:
    assert set(names("regions")) - set(SPATIAL) == {"separating_line"}


@pytest.mark.parametrize(
    ("region", "value"),
    [
        (DuToit(), centre_point_value),
        (Park(), highest_density_bound),
        (HalfPlane(), centre_line_bound),
        (WhitenedBox(), box_bound),
        (RiskContour(), collision_probability),
    ],
    ids=lambda one: type(one).__name__,
)
def test_each_boundary_is_where_its_measure_is_the_risk(region: Any, value: Any) -> None:
    """Against the functions of `tests.oracles.risk_bounds`, which know no regions."""
    rng = np.random.default_rng(1)
    sigma, margin, tail = covariances(rng, 40), 10.0 ** rng.uniform(-0.5, 0.5, 40), 1e-3
    edge = edges(region, sigma, margin, region.level(tail, 3), rng)
    there = np.linalg.norm(edge, axis=1) > 1e-9
    assert there.sum() > 25
    got = value(edge, sigma, margin)[there]
    np.testing.assert_allclose(got, tail, rtol=1e-6)


@pytest.mark.parametrize("name", PROMISING)
def test_guarantee_at_random_covariances(name: str) -> None:
    region = build("regions", name)
    rng, tail = np.random.default_rng(2), 0.02
    sigma, margin = covariances(rng, 60), 10.0 ** rng.uniform(-0.7, 0.5, 60)
    edge = edges(region, sigma, margin, region.level(tail, 3), rng)
    assert collision_probability(edge, sigma, margin, 48).max() <= tail * (1 + 1e-6)


@pytest.mark.parametrize("name", SPATIAL)
def test_symbolic_equals_numeric(name: str) -> None:
    rng, region = np.random.default_rng(3), build("regions", name)
    twin, sigma = compile_constraint(region, 3), covariances(rng, 4)
    for covariance, margin in zip(sigma, (0.3, 0.8, 1.5, 3.0), strict=True):
        numbers = region.parameters(GaussianObstacle(np.ones(3), covariance), np.asarray(margin))
        level = region.level(0.05, 3)
        points = 1.0 + rng.standard_normal((2500, 3)) * (margin + 1.5 * np.sqrt(covariance.max()))
        value, slope, _ = twin(points, numbers, level)
        inside = region.contains(points, numbers, np.asarray(level))
        clear = np.abs(value) > 1e-6
        assert clear.mean() > 0.995
        assert ((value < 0.0) == inside)[clear].all() and np.isfinite(slope).all()


@cache
def sphere(count: int) -> tuple[Any, Any]:
    """Directions and weights of a product rule on the sphere."""
    points, weights = np.polynomial.legendre.leggauss(count)
    angle = 2.0 * np.pi * (np.arange(2 * count) + 0.5) / (2 * count)
    height, turn = (grid.ravel() for grid in np.meshgrid(points, angle, indexing="ij"))
    ring = np.sqrt(1.0 - height**2)
    n = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=-1)
    return n, np.repeat(weights, 2 * count) / (4 * count)


@pytest.mark.parametrize("axes", [(1.0, 1.0, 1.0), (3.0, 1.0, 0.5), (2.0, 2.0, 0.1)])
def test_mean_powers_of_the_support(axes: Any) -> None:
    n, weight = sphere(120)
    h = np.hypot.reduce(n * np.array(axes), axis=-1)
    assert float(mean_support(np.array(axes))) == pytest.approx(weight @ h, rel=1e-5)
    assert float(mean_cubed_support(np.array(axes))) == pytest.approx(weight @ h**3, rel=1e-6)


def test_mean_cubed_support_of_flat_bodies() -> None:
    assert mean_cubed_support(np.array([2.0, 0.0, 0.0])) == pytest.approx(2.0)  # 8 E |n_1|^3
    assert mean_cubed_support(np.zeros(3)) == 0.0
    disc = mean_cubed_support(np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1e-9]]))
    assert disc == pytest.approx(np.full(2, 3.0 * np.pi / 16.0), rel=1e-8)  # E sin^3


def test_volume_of_the_half_plane_region() -> None:
    n, weight = sphere(200)
    region, sigma = HalfPlane(), covariances(np.random.default_rng(4), 5)
    numbers = region.parameters(GaussianObstacle(np.zeros((5, 3)), sigma), np.asarray(0.7))
    for one, covariance in zip(numbers, sigma, strict=True):
        reach = 0.7 + 1.9 * np.sqrt(np.einsum("ki,ij,kj->k", n, covariance, n))
        wanted = 4.0 / 3.0 * np.pi * (weight @ reach**3)
        assert float(region.area(one, np.asarray(1.9))) == pytest.approx(wanted, rel=1e-6)


def test_volumes_of_round_regions() -> None:
    """All are balls then; the radius of the contour follows from noncentral chi-square."""
    deviation, margin, tail = 0.5, 0.9, 0.01
    obstacle = GaussianObstacle(np.zeros(3), deviation**2 * np.eye(3))

    def excess(radius: float) -> float:
        return float(
            stats.ncx2.cdf((margin / deviation) ** 2, 3, (radius / deviation) ** 2) - tail
        )

    density = (2.0 * np.pi * deviation**2) ** -1.5 * 4.0 / 3.0 * np.pi * margin**3
    core = deviation * np.sqrt(2.0 * np.log(density / tail))
    z = -float(special.ndtri(tail))
    wanted = {
        RiskContour(): optimize.brentq(excess, 0.5, 5.0, xtol=1e-12),
        DuToit(): core,
        Park(): core + margin,
        HalfPlane(): margin + z * deviation,
    }
    for region, radius in wanted.items():
        numbers = region.parameters(obstacle, np.asarray(margin))
        volume = region.area(numbers, np.asarray(region.level(tail, 3)))
        assert float(volume) == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=1e-6)


@pytest.mark.parametrize("region", [RiskContour(), WhitenedBox()], ids=repr)
def test_volumes_by_another_rule(region: Region) -> None:
    """Rays in world directions and 60-fold bisection, with other nodes."""
    n, weight = sphere(48)
    sigma = np.diag([1.0, 0.49, 0.16])
    numbers = region.parameters(GaussianObstacle(np.zeros(3), sigma), np.asarray(0.8))
    level = np.asarray(region.level(0.02, 3))
    low, high = np.zeros(len(n)), np.full(len(n), 10.0)
    for _ in range(45):
        middle = 0.5 * (low + high)
        inside = region.contains(middle[:, None] * n, numbers, level)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    wanted = 4.0 / 3.0 * np.pi * (weight @ high**3)
    assert float(region.area(numbers, level)) == pytest.approx(wanted, rel=1e-5)


def test_an_empty_region_has_no_volume() -> None:
    obstacle = GaussianObstacle(np.zeros(3), np.diag([9.0, 4.0, 4.0]))
    for region in (DuToit(), Park(), WhitenedBox(), RiskContour()):
        numbers = region.parameters(obstacle, np.asarray(0.1))
        level = np.asarray(region.level(0.05, 3))
        assert float(region.area(numbers, level)) == 0.0
        assert not region.contains(np.zeros(3), numbers, level)


def test_bhattacharyya_ellipsoid_is_its_distance() -> None:
    rng, region = np.random.default_rng(5), Bhattacharyya(robot_deviation=0.5)
    sigma = covariances(rng, 10)
    for covariance in sigma:
        numbers = region.parameters(GaussianObstacle(np.zeros(3), covariance), np.asarray(0.0))
        tau = float(numbers[-1]) + 1.3
        edge = edges(region, covariance[None], np.asarray(0.0), tau, rng)[0]
        distance = bhattacharyya_distance(edge, covariance, 0.25 * np.eye(3))
        assert float(distance) == pytest.approx(tau, rel=1e-7)


def test_the_exact_sum_needs_the_level_of_a_line_for_a_risk() -> None:
    """Published pairs of content level s and line bound Phi(-s) in 3-D."""
    for content, s, bound in ((0.9, 2.500277711, 0.006205), (0.95, 2.795483483, 0.0025911)):
        region = MinkowskiSum()
        assert region.level(1.0 - content, 3) == pytest.approx(s, rel=1e-9)
        assert region.risk(s) == pytest.approx(bound, rel=2e-4)
