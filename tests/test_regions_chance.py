"""Regions sized by a collision risk: what each promises, against the exact probability."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from scipy import special

from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import GaussianObstacle
from wideberth.framework.motion import Pose
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.mpc.verify import violation
from wideberth.framework.plan import Status
from wideberth.framework.region import Guarantee, Region
from wideberth.framework.risk import collision_probability
from wideberth.framework.risk_bounds import (
    box_bound,
    centre_point_value,
    highest_density_bound,
)
from wideberth.framework.symbolic import ca
from wideberth.framework.testing.twin import compile_twin
from wideberth.regions import normal
from wideberth.regions.best_half_plane import BestHalfPlane
from wideberth.regions.bhattacharyya import Bhattacharyya, bhattacharyya_distance
from wideberth.regions.du_toit import DuToit
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.park import Park
from wideberth.regions.polygons import max_face, polygon_signed_distance
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.separating_line import SeparatingLine
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.robots.unicycle import Unicycle


def _set_up(*arguments: Any, **named: Any) -> Any:
    """The planning problem of the tests of the assembly."""
    path = Path(__file__).with_name("test_problem.py")
    spec = importlib.util.spec_from_file_location("problem_tests", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.set_up(*arguments, **named)


REGIONS: list[Region] = [
    HalfPlane(),
    BestHalfPlane(),
    DuToit(),
    Park(),
    Bhattacharyya(),
    WhitenedBox(),
    RiskContour(),
]
PROMISING = [region for region in REGIONS if region.guarantee is Guarantee.CONTENT]


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


def _random(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, covariances up to condition 1e4, margins."""
    angle = rng.uniform(0.0, np.pi, count)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = np.moveaxis(turn, -1, 0)
    deviations = 10.0 ** rng.uniform(-1.5, 0.5, (count, 1)) * np.stack(
        [np.ones(count), 10.0 ** rng.uniform(-2.0, 0.0, count)], axis=-1
    )
    sigma = turn @ (deviations[..., None] ** 2 * np.swapaxes(turn, -1, -2))
    sigma = 0.5 * (sigma + np.swapaxes(sigma, -1, -2))
    return rng.uniform(-3.0, 3.0, (count, 2)), sigma, 10.0 ** rng.uniform(-1.0, 0.7, count)


@pytest.mark.parametrize("region", PROMISING, ids=repr)
def test_guarantee_at_random_covariances(region: Region) -> None:
    """Points just outside, along one random ray per obstacle: no risk above the one asked for."""
    rng = np.random.default_rng(7)
    mean, sigma, margin = _random(rng, 2000)
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
    mean, sigma, margin = _random(rng, 2000)
    exact = collision_probability(mean, sigma, margin)
    for bound in (highest_density_bound, box_bound):
        assert (exact <= bound(mean, sigma, margin) * (1 + 1e-8) + 1e-300).all()
    centre = centre_point_value(mean, sigma, margin)
    assert (centre < 0.5 * exact).any() and (centre > 2.0 * exact).any()
    small = centre_point_value(mean, sigma, 1e-3 * np.sqrt(np.linalg.det(sigma)))
    truth = collision_probability(mean, sigma, 1e-3 * np.sqrt(np.linalg.det(sigma)))
    likely = truth > 1e-12
    np.testing.assert_allclose(small[likely], truth[likely], rtol=1e-2)  # exact in the limit


def _value(region: Region) -> Callable[..., float]:
    x, p, level = ca.SX.sym("x", 2), ca.SX.sym("p", region.parameter_count(2)), ca.SX.sym("l")
    (value,) = region.constraint(Pose((x[0], x[1])), p, level, ca.SX(0, 1)).inequalities
    return ca.Function("value", [x, p, level], [value, ca.gradient(value, x)])  # type: ignore


@pytest.mark.parametrize("region", [RiskContour(), WhitenedBox()], ids=repr)
def test_symbolic_tails_against_numpy(region: Region) -> None:
    """The constraint is sqrt(-2 log P) - level down to P = 1e-250, the gradient its slope."""
    rng = np.random.default_rng(5)
    mean, sigma, margin = _random(rng, 400)
    function = _value(region)
    truth = collision_probability if isinstance(region, RiskContour) else box_bound
    numbers = region.parameters(GaussianObstacle(np.zeros_like(mean), sigma), margin)
    wanted = truth(mean, sigma, margin)
    for point, packed, risk in zip(mean, numbers, wanted, strict=True):
        value, slope = (np.asarray(out.full()) for out in function(point, packed, 0.0))
        assert np.isfinite(slope).all()
        if 1e-250 < risk < 0.9999:
            near = 6e-4 if risk > 1e-14 else 4e-3 * abs(np.log(risk))
            near = near if isinstance(region, RiskContour) else 1e-8 * (1 + abs(np.log(risk)))
            assert value.item() ** 2 == pytest.approx(-2.0 * np.log(risk), rel=0.0, abs=near)
            step = 1e-5 * slope[:, 0] / max(np.hypot.reduce(slope[:, 0]) ** 2, 1e-12)
            ends = [float(function(point + h * step, packed, 0.0)[0]) for h in (-1.0, 1.0)]
            if np.hypot.reduce(slope[:, 0]) > 1e-2:
                assert ends[1] - ends[0] == pytest.approx(2e-5, rel=1e-3)


@pytest.mark.parametrize("region", [RiskContour(), WhitenedBox()], ids=repr)
def test_slope_deep_inside(region: Region) -> None:
    """A disc of 20 deviations: P is 1 to all digits, the constraint still points outwards."""
    function = _value(region)
    obstacle = GaussianObstacle(np.zeros(2), 0.05**2 * np.eye(2))
    numbers = region.parameters(obstacle, np.float64(1.0))
    for point in np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2)):
        value, slope = (np.asarray(out.full()) for out in function(point, numbers, 2.0))
        assert value.item() < 0.0
        assert slope[:, 0] == pytest.approx(point / np.hypot.reduce(point), abs=2e-2)
    assert function(np.zeros(2), numbers, 0.0)[0] >= 0.0  # level 0 stands for an empty region


def test_scaled_complementary_error_function() -> None:
    x = np.concatenate([np.linspace(0.0, 20.0, 501), np.logspace(1.0, 10.0, 50)])
    symbol = ca.SX.sym("x")
    function = ca.Function("erfcx", [symbol], [normal.erfcx(symbol)])
    got = np.array([float(function(v)) for v in x])
    np.testing.assert_allclose(got, special.erfcx(x), rtol=1e-11)


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


@pytest.mark.parametrize("region", [DuToit(), Park(), WhitenedBox(), RiskContour()], ids=repr)
def test_an_empty_region_forbids_nothing(region: Region) -> None:
    """A small disc in a wide Gaussian: even at the mean the risk is below the one asked for."""
    obstacle = GaussianObstacle(np.zeros(2), np.diag([9.0, 4.0]))
    numbers, level = region.parameters(obstacle, np.float64(0.1)), np.float64(region.level(0.05))
    points = np.random.default_rng(0).uniform(-5.0, 5.0, (200, 2))
    points[0] = 0.0
    assert not region.contains(points, numbers, level).any()
    assert region.area(numbers, level) == 0.0
    np.testing.assert_array_equal(region.boundary(numbers, float(level), 8), np.zeros((8, 2)))
    values, _, _ = compile_twin(region, 2)(points, numbers, float(level))
    assert (values >= 0.0).all()


@pytest.mark.parametrize("region", [DuToit(), Park(), Bhattacharyya()], ids=repr)
def test_singular_covariances_are_refused(region: Region) -> None:
    obstacle = GaussianObstacle(np.zeros(2), np.diag([1.0, 0.0]))
    with pytest.raises(WideberthError, match="singular covariance"):
        region.parameters(obstacle, np.float64(1.0))


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_bad_input(region: Region) -> None:
    obstacle = GaussianObstacle(np.zeros(2), np.eye(2))
    with pytest.raises(WideberthError, match="margin"):
        region.parameters(obstacle, np.float64(-1.0))
    with pytest.raises(WideberthError, match="tail"):
        region.level(1.0)
    with pytest.raises(WideberthError, match="4 coordinates"):
        region.parameters(GaussianObstacle(np.zeros(4), np.eye(4)), np.float64(1.0))


def test_bad_fields() -> None:
    with pytest.raises(WideberthError, match="robot_deviation"):
        Bhattacharyya(robot_deviation=0.0)


def test_bhattacharyya_ellipse_is_its_distance() -> None:
    """Without margin the boundary is where D_B is tau."""
    rng = np.random.default_rng(2)
    _, sigma, _ = _random(rng, 20)
    region = Bhattacharyya(robot_deviation=0.5)
    for covariance in sigma:
        numbers = region.parameters(GaussianObstacle(np.ones(2), covariance), np.float64(0.0))
        tau = numbers[-1] + 1.3
        edge = region.boundary(numbers, float(tau), 50) - 1.0
        distance = bhattacharyya_distance(edge, covariance, 0.25 * np.eye(2))
        np.testing.assert_allclose(distance, tau, rtol=1e-9)


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_projection(region: Region) -> None:
    """IPOPT finds the nearest point outside from starts outside; distance against the boundary."""
    rng = np.random.default_rng(11)
    sigma = np.array([[0.5, 0.2], [0.2, 0.3]])
    numbers = region.parameters(GaussianObstacle(np.zeros(2), sigma), np.float64(1.0))
    level = region.level(0.05)
    x, q, t = ca.SX.sym("x", 2), ca.SX.sym("q", 2), ca.SX.sym("t", len(region.auxiliary(2)))
    stated = region.constraint(Pose((x[0], x[1])), ca.DM(numbers), level, t)
    extra = region.auxiliary(2)
    problem = {
        "x": ca.vertcat(x, t),
        "p": q,
        "f": ca.sumsqr(x - q),
        "g": ca.vertcat(*stated.inequalities),
    }
    quiet = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes"}
    solver = ca.nlpsol("projection", "ipopt", problem, quiet)
    edge = region.boundary(numbers, level, 4000)
    for _ in range(10):
        target = rng.uniform(-0.3, 0.3, 2)
        start = edge[rng.integers(4000)] * 1.3
        helper = region.auxiliary_start(Pose.of(start), numbers, np.float64(level))
        found = solver(
            x0=[*start, *helper],
            p=target,
            lbg=0.0,
            lbx=[-np.inf] * 2 + list(extra.lower),
            ubx=[np.inf] * 2 + list(extra.upper),
        )
        assert solver.stats()["success"]
        point = np.asarray(found["x"].full())[:2, 0]
        gap = np.hypot.reduce(edge - point, axis=1).min()
        assert gap < 5e-3  # on the boundary
        nearby = np.hypot.reduce(edge - point, axis=1) < 0.2
        least = np.hypot.reduce(edge[nearby] - target, axis=1).min()
        assert np.hypot.reduce(point - target) <= least + 1e-3  # and nearest among those nearby


@pytest.mark.parametrize("region", [*REGIONS, SeparatingLine()], ids=repr)
def test_drives_the_planner(region: Region) -> None:
    problem, parameters, guess = _set_up(Unicycle(), region, Fixed(0.05), 1, y=1.3)
    (solution,) = Ipopt().solve(problem, parameters, [guess])
    assert solution.status is Status.SOLVED, solution.message
    assert violation(problem, parameters, solution.point).worst < 1e-4
    place = np.stack(Unicycle().pose(tuple(solution.point.states[1:].T)).position, -1)
    level = parameters.level[:, 0] * (1 - 1e-4) - 1e-4
    assert not region.contains(place, parameters.regions[:, 0], level).any()
    if region.guarantee is Guarantee.CONTENT:
        risk = collision_probability(
            place - [4.0, 1.3], [[0.04, 0.01], [0.01, 0.02]], 0.4 + Unicycle().radius
        )
        assert risk.max() <= 0.05 * 1.01


def test_polygon_distances_against_shapely() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-3.0, 3.0, (500, 2))
    convex = np.array([[2.0, 0.0], [1.0, 1.5], [-1.0, 1.0], [-1.5, -1.0], [0.5, -1.2]])
    star = np.array([[2.0, 0.0], [0.3, 0.3], [0.0, 2.0], [-0.3, 0.3], [-2.0, 0.0], [0.0, -2.0]])
    for vertices in (convex, star, star[::-1]):
        polygon = shapely.Polygon(vertices)
        there = shapely.points(points)
        inside = shapely.contains(polygon, there)
        outline = shapely.distance(polygon.exterior, there)
        wanted = np.where(inside, -outline, outline)
        got = polygon_signed_distance(points, vertices)
        np.testing.assert_allclose(got, wanted, atol=1e-12)
    face, true = max_face(points, convex), polygon_signed_distance(points, convex)
    assert (face <= true + 1e-12).all()
    np.testing.assert_allclose(face[true < 0], true[true < 0], atol=1e-12)
