"""Regions against closed forms, published tables, brute force, shapely, IPOPT and Monte Carlo."""

import math
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import GaussianObstacle
from wideberth.framework.motion import Pose
from wideberth.framework.region import Convex, Region, Signed
from wideberth.framework.risk import collision_probability
from wideberth.framework.symbolic import ca
from wideberth.regions import gaussian, geometry, inflation
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle, box_content
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum

REGIONS = [
    MahalanobisEllipse(),
    MinkowskiSum(),
    LuetkepohlRectangle(),
    LuetkepohlRectangle(enlargement="box"),
]
COVARIANCE = np.array([[1.2, 0.5], [0.5, 0.4]])


def packed(region: Region, covariance: Any = COVARIANCE, margin: float = 0.7) -> Any:
    mean = np.arange(1.0, len(covariance) + 1.0)
    return region.parameters(GaussianObstacle(mean, np.asarray(covariance)), np.asarray(margin))


# levels


@pytest.mark.parametrize(
    ("tail", "dimension", "level"),
    [  # chi-square quantiles to the digits of the tables
        (0.1, 2, 2.145966026289347),
        (0.05, 2, 2.447746830680816),
        (1e-12, 2, math.sqrt(24.0 * math.log(10.0))),
        (0.1, 3, 2.500277711),
        (0.05, 3, 2.795483483),
        (0.01, 3, 3.368214175),
    ],
)
def test_ellipse_level(tail: float, dimension: int, level: float) -> None:
    assert MahalanobisEllipse().level(tail, dimension) == pytest.approx(level, rel=1e-9)
    assert MinkowskiSum().level(tail, dimension) == pytest.approx(level, rel=1e-9)


def test_three_dimensional_level_solves_its_equation() -> None:
    for tail in (0.5, 0.05, 1e-6):
        s = gaussian.ellipse_level(tail, 3)
        got = math.erfc(s / math.sqrt(2)) + math.sqrt(2 / math.pi) * s * math.exp(-(s**2) / 2)
        assert got == pytest.approx(tail, rel=1e-10)


def test_level_keeps_its_digits_at_both_ends() -> None:
    assert gaussian.ellipse_level_of_content(1e-12) == pytest.approx(math.sqrt(2e-12), rel=1e-12)
    assert gaussian.ellipse_level_of_content(0.4, 3) == pytest.approx(
        gaussian.ellipse_level(0.6, 3), rel=1e-12
    )
    for region in REGIONS:
        assert region.tail(region.level(1e-12)) == pytest.approx(1e-12, rel=1e-9)


def test_the_papers_level_is_not_quite_95_percent() -> None:
    assert 1 - MahalanobisEllipse().tail(math.sqrt(5.991)) == pytest.approx(0.9499884, abs=1e-7)


def test_bonferroni_level() -> None:
    region = LuetkepohlRectangle()
    assert region.level(0.1) == pytest.approx(1.959963984540054, rel=1e-12)
    assert region.level(0.05) == pytest.approx(2.241402727604945, rel=1e-12)
    assert region.tail(0.0) == 1.0


# content, by Monte Carlo and exactly


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_content_is_kept(region: Region, dimension: int) -> None:
    rng = np.random.default_rng(3)
    root = rng.standard_normal((dimension, dimension))
    covariance, count, tail = root @ root.T, 40_000, 0.1
    parameters = packed(region, covariance, margin=0.0)
    draws = np.arange(1.0, dimension + 1.0) + rng.standard_normal((count, dimension)) @ root.T
    level = np.asarray(region.level(tail, dimension))
    share = float(region.contains(draws, parameters, level).mean())
    sigma = math.sqrt(tail * (1 - tail) / count)
    if isinstance(region, LuetkepohlRectangle):
        assert share > 1 - tail - 3 * sigma
        assert share < 1 - 0.5 * tail  # Bonferroni wastes less than half
    else:
        assert share == pytest.approx(1 - tail, abs=3 * sigma)


@pytest.mark.parametrize(
    ("rho", "content"),
    [(0.0, 0.9025), (0.3, 0.904879), (0.5, 0.909254), (0.8, 0.921942), (0.95, 0.935429)],
)
def test_content_of_the_rectangle(rho: float, content: float) -> None:
    half = np.full(2, LuetkepohlRectangle().level(0.1))
    got = box_content(half * np.array([2.0, 0.5]), np.array([[4.0, rho], [rho, 0.25]]))
    assert got == pytest.approx(content, abs=6e-7)


@pytest.mark.parametrize(
    ("rho", "ratio"), [(0.0, 1.0621), (0.5, 1.2264), (0.8, 1.7701), (0.95, 3.4014)]
)
def test_rectangle_is_larger_than_the_ellipse(rho: float, ratio: float) -> None:
    covariance = [[1.0, rho], [rho, 1.0]]
    box, ellipse = LuetkepohlRectangle(), MahalanobisEllipse()
    areas = [
        float(one.area(packed(one, covariance, 0.0), np.asarray(one.level(0.1))))
        for one in (box, ellipse)
    ]
    assert areas[0] / areas[1] == pytest.approx(ratio, abs=6e-5)


def test_after_the_enlargement_the_rectangle_can_be_the_smaller_one() -> None:
    covariance = np.diag([1.0, 0.01])
    box, exact = LuetkepohlRectangle(), MinkowskiSum()
    areas = [
        float(one.area(packed(one, covariance, 1.5), np.asarray(one.level(0.1))))
        for one in (box, exact)
    ]
    assert areas[0] / areas[1] == pytest.approx(0.9974, abs=6e-5)


# geometry


def test_closest_point_is_no_farther_than_any_other() -> None:
    rng = np.random.default_rng(0)
    for size in (2, 3):
        axes = np.sort(10.0 ** rng.uniform(-2, 1, (40, size)))[:, ::-1]
        points = rng.standard_normal((40, size)) * axes * rng.uniform(0.1, 3, (40, 1))
        nearest = geometry.closest_point(points, axes)
        np.testing.assert_allclose(((nearest / axes) ** 2).sum(axis=1), 1.0, rtol=1e-9)
        sphere = rng.standard_normal((4000, size))
        sphere /= np.linalg.norm(sphere, axis=1)[:, None]
        others = np.linalg.norm(points[:, None] - axes[:, None] * sphere, axis=2).min(axis=1)
        distance = np.abs(geometry.distance_to_ellipse(points, axes))
        assert (distance <= others + 1e-12).all()
        # The offset is normal to the surface: parallel to x / axes^2.
        offset, normal = points - nearest, nearest / axes**2
        along = np.abs((offset * normal).sum(axis=1))
        product = np.linalg.norm(offset, axis=1) * np.linalg.norm(normal, axis=1)
        np.testing.assert_allclose(along, product, rtol=1e-9)


@pytest.mark.parametrize(
    ("point", "axes", "distance"),
    [
        ((0.0, 0.0), (2.0, 1.0), -1.0),
        ((0.0, 0.0), (1.0, 1.0), -1.0),
        ((0.5, 0.0), (1.0, 1.0), -0.5),
        ((0.5, 0.25), (1.0, 0.0), 0.25),  # beside a segment
        ((4.0, 4.0), (1.0, 0.0), 5.0),  # beyond its end
        ((3.0, 4.0), (0.0, 0.0), 5.0),  # a point
        ((1e-300, 1e-300), (2.0, 1.0), -1.0),
        ((0.0, 0.0, 0.0), (3.0, 2.0, 1.0), -1.0),
        ((0.1, 0.1, 2.0), (3.0, 2.0, 0.0), 2.0),  # above a flat disc
        ((6.0, 0.0, 4.0), (3.0, 2.0, 0.0), 5.0),
        ((0.0, 3.0, 4.0), (2.0, 0.0, 0.0), 5.0),
    ],
)
def test_distance_of_special_points(point: Any, axes: Any, distance: float) -> None:
    got = geometry.distance_to_ellipse(np.array(point), np.array(axes))
    assert float(got) == pytest.approx(distance, abs=1e-12)


def test_perimeter_and_surface() -> None:
    assert float(geometry.perimeter(np.array([2.0, 2.0]))) == pytest.approx(4 * math.pi)
    assert float(geometry.perimeter(np.array([3.0, 0.0]))) == pytest.approx(12.0)
    assert float(geometry.surface(np.array([2.0, 2.0, 2.0]))) == pytest.approx(16 * math.pi)
    assert float(geometry.surface(np.array([2.0, 1.0, 0.0]))) == pytest.approx(4 * math.pi)
    assert float(geometry.mean_support(np.array([2.0, 2.0, 2.0]))) == pytest.approx(2.0)


def test_exact_sum_against_a_buffered_polygon() -> None:
    region, margin = MinkowskiSum(), 0.7
    parameters, level = packed(region), region.level(0.05)
    ellipse = region.boundary(packed(region, margin=0.0), level, 4000)
    outline = shapely.Polygon(ellipse).buffer(margin, quad_segs=512)
    assert float(region.area(parameters, np.asarray(level))) == pytest.approx(
        outline.area, rel=1e-5
    )
    points = np.random.default_rng(1).uniform(-4, 7, (200, 2))
    # Inside the sum the signed distance to it is the one to the ellipse less the margin.
    edge = shapely.LinearRing(ellipse)
    solid = shapely.Polygon(ellipse)
    want = [
        (-1 if solid.contains(place) else 1) * edge.distance(place) - margin
        for place in map(shapely.Point, points)
    ]
    got = region.signed_distance(points, parameters, np.asarray(level))
    np.testing.assert_allclose(got, want, atol=1e-5)
    inside = shapely.contains_xy(outline, *points.T)
    assert (region.contains(points, parameters, np.asarray(level)) == inside).all()


@pytest.mark.parametrize("enlargement", ["disc", "box"])
def test_rectangle_against_a_buffered_box(enlargement: Any) -> None:
    region, margin = LuetkepohlRectangle(enlargement), 0.7
    parameters, level = packed(region), region.level(0.05)
    half = level * np.sqrt(np.diagonal(COVARIANCE))
    box = shapely.box(1 - half[0], 2 - half[1], 1 + half[0], 2 + half[1])
    style = "round" if enlargement == "disc" else "mitre"
    outline = box.buffer(margin, quad_segs=512, join_style=style)
    area = float(region.area(parameters, np.asarray(level)))
    assert area == pytest.approx(outline.area, rel=1e-5)
    points = np.random.default_rng(1).uniform(-4, 7, (200, 2))
    ring = outline.exterior
    want = [
        (-1 if outline.contains(place) else 1) * ring.distance(place)
        for place in map(shapely.Point, points)
    ]
    got = region.signed_distance(points, parameters, np.asarray(level))
    np.testing.assert_allclose(got, want, atol=1e-5)


def test_signed_distance_and_gauge_agree_in_sign() -> None:
    rng = np.random.default_rng(2)
    region = MinkowskiSum()
    for covariance in (COVARIANCE, np.zeros((2, 2)), np.diag([1.0, 0.0])):
        parameters, level = packed(region, covariance), np.asarray(2.4)
        points = rng.uniform(-4, 7, (500, 2))
        outside = region.signed_distance(points, parameters, level) >= 0
        assert ((region.gauge(points, parameters, level) >= 1) == outside).all()


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_support_and_distance_on_the_boundary(region: Any) -> None:
    assert isinstance(region, Convex) and isinstance(region, Signed)
    parameters, level = packed(region), region.level(0.05)
    edge = region.boundary(parameters, level, 5000)
    angle = np.linspace(0, 2 * np.pi, 37)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reach = (edge @ normals.T).max(axis=0)
    got = region.support(normals, parameters, np.asarray(level))
    np.testing.assert_allclose(got, reach, atol=1e-5)
    gap = region.signed_distance(edge, parameters, np.asarray(level))
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)


# what the enlargement costs


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
    total = float(geometry.sum_volume(np.array([a, b]), np.asarray(margin)))
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


# collision risk on the boundary


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


# use


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_ipopt_finds_the_boundary_from_inside(region: Any) -> None:
    x, auxiliary = ca.SX.sym("x", 2), region.auxiliary(2)
    extra, goal = ca.SX.sym("extra", len(auxiliary)), ca.SX.sym("goal", 2)
    p, level = ca.SX.sym("p", region.parameter_count(2)), region.level(0.05)
    stated = region.constraint(Pose((x[0], x[1]), 0.0), p, level, extra)
    problem = {
        "x": ca.vertcat(x, extra),
        "p": ca.vertcat(p, goal),
        "f": ca.sumsqr(x - goal) + auxiliary.regularisation * ca.sumsqr(extra),
        "g": ca.vertcat(*stated.inequalities),
    }
    quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "calc_lam_p": False}
    solver = ca.nlpsol("project", "ipopt", problem, quiet)
    rng = np.random.default_rng(6)
    parameters = packed(region)
    for _ in range(30):
        start = parameters[:2] + rng.standard_normal(2) * 3
        target = parameters[:2] + rng.standard_normal(2) * 0.4
        first = region.auxiliary_start(Pose.of(start), parameters, np.asarray(level))
        solution = solver(
            x0=np.concatenate([start, first]),
            p=np.concatenate([parameters, target]),
            lbx=[-np.inf, -np.inf, *auxiliary.lower],
            ubx=[np.inf, np.inf, *auxiliary.upper],
            lbg=0.0,
            ubg=np.inf,
        )
        assert solver.stats()["success"]
        found = solution["x"].full()[:2, 0]
        gap = float(region.signed_distance(found, parameters, np.asarray(level)))
        assert gap == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_batches(region: Region) -> None:
    rng = np.random.default_rng(7)
    mean, root = rng.standard_normal((3, 4, 2)), rng.standard_normal((3, 4, 2, 2))
    obstacle = GaussianObstacle(mean, root @ np.swapaxes(root, -1, -2))
    margin = rng.uniform(0.1, 1, (3, 1))
    parameters = region.parameters(obstacle, margin)
    assert parameters.shape == (3, 4, region.parameter_count(2))
    level = rng.uniform(0.5, 2, (3, 4))
    area = region.area(parameters, level)
    points = mean + rng.standard_normal((3, 4, 2))
    inside = region.contains(points, parameters, level)
    start = region.auxiliary_start(Pose.of(points), parameters, level)
    assert start.shape == (3, 4, len(region.auxiliary(2)))
    one = region.parameters(GaussianObstacle(mean[1, 2], obstacle.covariance[1, 2]), margin[1, 0])
    np.testing.assert_allclose(parameters[1, 2], one)
    assert float(region.area(one, level[1, 2])) == pytest.approx(float(area[1, 2]))
    assert bool(region.contains(points[1, 2], one, level[1, 2])) == bool(inside[1, 2])


def test_symbols_of_both_kinds_are_accepted() -> None:
    for region in REGIONS:
        for kind in (ca.SX, ca.MX):
            x, p, level = kind.sym("x", 2), kind.sym("p", region.parameter_count(2)), 2.0
            extra = kind.sym("t", len(region.auxiliary(2)))
            (value,) = region.constraint(Pose((x[0], x[1])), p, level, extra).inequalities
            function = ca.Function("f", [x, p, extra], [value])
            point = np.array([4.0, 5.0])
            start = region.auxiliary_start(Pose.of(point), packed(region), np.asarray(level))
            assert float(function(point, packed(region), start)) > 0


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_bad_input_is_named(region: Region) -> None:
    obstacle = GaussianObstacle(np.zeros(2), np.eye(2))
    with pytest.raises(WideberthError, match="margin is -1"):
        region.parameters(obstacle, np.asarray(-1.0))
    with pytest.raises(WideberthError, match="4 coordinates"):
        region.parameters(GaussianObstacle(np.zeros(4), np.eye(4)), np.asarray(1.0))
    with pytest.raises(WideberthError, match="strictly in"):
        region.level(1.0)


def test_unknown_enlargement_is_named() -> None:
    with pytest.raises(WideberthError, match="'circle'"):
        LuetkepohlRectangle("circle")  # type: ignore[arg-type]


def test_example_runs(capsys):
    example = Path(__file__).parents[1] / "examples" / "my_region.py"
    assert len(example.read_text().splitlines()) <= 30
    runpy.run_path(str(example), run_name="__main__")
    assert "keeps every law" in capsys.readouterr().out


def test_degenerate_shapes_are_drawn_and_tested_without_a_warning():
    point = GaussianObstacle(np.zeros(2), np.zeros((2, 2)))
    exact = MinkowskiSum()
    shape = exact.parameters(point, np.array(1.5))
    assert np.linalg.norm(exact.boundary(shape, 2.0, 90), axis=1) == pytest.approx(1.5)
    plane = HalfPlane()
    inside = plane.contains(np.array([1.0, 0.0]), plane.parameters(point, np.array(1.5)), 2.0)
    assert bool(inside)
