"""Outer ellipses and rectangles against golden values, brute force, IPOPT and the planner."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import optimize, special

from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import GaussianObstacle
from wideberth.framework.motion import Pose, Twist
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.bodies import with_auxiliaries
from wideberth.framework.mpc.instance import Obstacles, fill
from wideberth.framework.mpc.levels.base import LevelPolicy
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.problem import Parameters, Problem
from wideberth.framework.mpc.reference import lay_reference
from wideberth.framework.mpc.rollout import steer
from wideberth.framework.mpc.solvers.fatrop import Fatrop
from wideberth.framework.mpc.solvers.ipopt import Ipopt
from wideberth.framework.mpc.transcription import Guess
from wideberth.framework.mpc.verify import violation
from wideberth.framework.path import Path as DrivenPath
from wideberth.framework.plan import Status
from wideberth.framework.region import Region
from wideberth.framework.symbolic import ca
from wideberth.regions import gaussian, geometry, inflation
from wideberth.regions.box import box_content
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minimum_trace import MinimumTrace
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.regions.repaired_level import RepairedLevel
from wideberth.regions.repaired_margin import RepairedMargin
from wideberth.regions.separating_line import SeparatingLine
from wideberth.robots.unicycle import Unicycle

OUTER: list[OuterEllipse] = [RepairedMargin(), RepairedLevel(), MinimumTrace(), MinimumArea()]
RECTANGLES: list[EigenRectangle | LuetkepohlRectangle] = [
    EigenRectangle("sidak", "disc"),
    EigenRectangle("bonferroni", "disc"),
    EigenRectangle("sidak", "box"),
    EigenRectangle("bonferroni", "box"),
    LuetkepohlRectangle("disc", "sidak"),
    LuetkepohlRectangle("box", "sidak"),
]
ALL: list[Any] = [*OUTER, *RECTANGLES]
COVARIANCE = np.array([[1.2, 0.5], [0.5, 0.4]])


def packed(region: Region, covariance: Any = COVARIANCE, margin: Any = 0.7) -> Any:
    covariance = np.asarray(covariance, dtype=float)
    mean = np.broadcast_to(np.arange(1.0, covariance.shape[-1] + 1.0), covariance.shape[:-1])
    return region.parameters(GaussianObstacle(mean, covariance), np.asarray(margin))


def random_covariances(rng: np.random.Generator, count: int, size: int) -> tuple[Any, Any]:
    """Covariances with deviations between 1e-4 m and 10 m, and margins of 1e-2 m to 10 m."""
    turn = np.linalg.qr(rng.standard_normal((count, size, size)))[0]
    variance = 10.0 ** (2 * rng.uniform(-4, 1, (count, size)))
    covariance = np.einsum("kij,kj,klj->kil", turn, variance, turn)
    return 0.5 * (covariance + np.swapaxes(covariance, 1, 2)), 10.0 ** rng.uniform(-2, 1, count)


# golden values

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
        s = gaussian.ellipse_level_of_content(given["p"])
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
    exact = float(geometry.sum_volume(np.array([a, b]), np.asarray(margin)))
    for region, ratio in zip((OUTER[0], OUTER[2], OUTER[3]), ratios, strict=True):
        numbers = packed(region, np.diag([float(a) ** 2, float(b) ** 2]), margin)
        area = float(region.area(numbers, np.asarray(1.0)))
        assert area / exact == pytest.approx(ratio, abs=6e-6)


# outer, and not larger than need be


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


# the symbol of the level


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("region", ALL, ids=repr)
def test_symbolic_follows_the_level(region: Any, size: int) -> None:
    """Same sign as contains(), same axes as in NumPy, finite derivatives, also at level 0."""
    rng = np.random.default_rng(15)
    x, level = ca.SX.sym("x", size), ca.SX.sym("level")
    p = ca.SX.sym("p", region.parameter_count(size))
    pose = Pose(tuple(x[i] for i in range(size)), 0.0)
    (value,) = region.constraint(pose, p, level, ca.SX(0, 1)).inequalities
    variables = ca.vertcat(x, level)
    curved, slope = ca.hessian(value, variables)
    stated = ca.Function("stated", [x, level, p], [value, slope, curved])
    covariance, margin = random_covariances(rng, 25, size)
    covariance[:3] = [np.zeros((size, size)), np.eye(size), np.eye(size)]
    for numbers in packed(region, covariance, margin):
        mean = gaussian.unpack(numbers)[0] if isinstance(region, OuterEllipse) else numbers[:size]
        for s in (-1.0, 0.0, 1e-6, 0.3, 1.7, 3.1, 5.0):
            at = np.asarray(s)
            point = mean + 2.0 * rng.standard_normal(size)
            got, gradient, hessian = (np.asarray(o.full()) for o in stated(point, s, numbers))
            assert np.isfinite(gradient).all() and np.isfinite(hessian).all()
            if isinstance(region, OuterEllipse):
                square = gauge(region, point, numbers, at) ** 2
                wanted = 0.5 * math.log((square + gaussian.CENTRE) / (1 + gaussian.CENTRE))
                assert got[0, 0] == pytest.approx(wanted, rel=1e-9, abs=1e-10)
                assert gradient[-1, 0] <= 0.0  # a larger level is a larger region
            elif s >= 0.0 and abs(region.signed_distance(point, numbers, at)) > 1e-6:
                assert (got[0, 0] < 0.0) == region.contains(point, numbers, at)


def gauge(region: OuterEllipse, point: Any, numbers: Any, level: Any) -> float:
    mean, vectors, _, _ = gaussian.unpack(numbers)
    x = gaussian.local(point, mean, vectors)
    return float(np.hypot.reduce(x / region.axes(numbers, level)))


@pytest.mark.parametrize("region", OUTER, ids=repr)
def test_slope_in_the_level_is_the_difference_quotient(region: OuterEllipse) -> None:
    x, level = ca.SX.sym("x", 2), ca.SX.sym("level")
    numbers = packed(region)
    (value,) = region.constraint(Pose((x[0], x[1])), ca.DM(numbers), level, None).inequalities
    slope = ca.Function("slope", [x, level], [ca.jacobian(value, level)])
    for s in (1e-3, 0.5, 2.0, 5.0):
        point, step = np.array([3.0, 2.5]), 1e-5
        squares = [gauge(region, point, numbers, np.asarray(s + h)) ** 2 for h in (-step, step)]
        ends = [0.5 * math.log(square + gaussian.CENTRE) for square in squares]
        assert float(slope(point, s)) == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-6)


# limits


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


# projection


@pytest.mark.parametrize("region", OUTER, ids=repr)
def test_projection_with_ipopt(region: OuterEllipse) -> None:
    """From inside to the nearest point of the boundary, started outside of where it lies."""
    rng = np.random.default_rng(17)
    x, p, target = ca.SX.sym("x", 2), ca.SX.sym("p", 9), ca.SX.sym("target", 2)
    (value,) = region.constraint(Pose((x[0], x[1])), p, ca.SX(2.0), None).inequalities
    nlp = {"x": x, "p": ca.vertcat(p, target), "f": ca.sumsqr(x - target), "g": value}
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}
    solver = ca.nlpsol("project", "ipopt", nlp, quiet)
    covariance, margin = random_covariances(rng, 40, 2)
    covariance = covariance + 0.01 * np.eye(2)
    for numbers in packed(region, covariance, margin):
        mean, vectors, _, _ = gaussian.unpack(numbers)
        axes = region.axes(numbers, np.asarray(2.0))
        inside = np.sqrt(rng.uniform(0.2, 0.95)) * gaussian.circle(7, vectors)[rng.integers(7)]
        inside = inside * axes
        near = geometry.closest_point(inside, axes)
        start = mean + vectors @ (near + 0.2 * (near - inside))
        point = mean + vectors @ inside
        found = solver(x0=start, p=np.concatenate([numbers, point]), lbg=0.0, ubg=np.inf)
        assert solver.stats()["success"]
        length = float(np.linalg.norm(found["x"].full()[:, 0] - point))
        depth = -float(region.signed_distance(point, numbers, np.asarray(2.0)))
        assert length == pytest.approx(depth, rel=1e-5)


# in the planner


def set_up(region: Region, level: LevelPolicy) -> tuple[Problem, Parameters, Guess]:
    """One obstacle stands near the robot's straight path, as in test_problem.py."""
    robot, steps, dt = Unicycle(), 15, 0.5
    start = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
    reference = lay_reference(DrivenPath(np.array([[0.0, 0.0], [20.0, 0.0]])), 0.0, 0.5, steps, dt)
    mean = np.tile([4.0, 0.4], (steps, 1, 1))
    covariance = np.tile([[0.04, 0.01], [0.01, 0.02]], (steps, 1, 1, 1))
    obstacles = Obstacles(mean, covariance, np.array([0.4]), ("a",))
    parameters = fill(start, reference, obstacles, region, level, robot.radius, 1)
    problem = assemble(robot, region, level, horizon=steps, dt=dt, capacity=1)
    states, inputs = steer(robot, start, Twist((0.4, 0.0), -0.05), steps, dt)
    scale = region.level(level.tail) if level.shared else float("nan")
    guess = Guess.bare(states, inputs, scale)
    guess = with_auxiliaries(robot, region, parameters, guess)
    return problem, replace(parameters, auxiliaries=guess.auxiliaries), guess


@pytest.mark.parametrize("level", [Fixed(0.05), Relaxed(0.05, weight=100.0)], ids=repr)
@pytest.mark.parametrize("region", [*ALL, SeparatingLine()], ids=repr)
def test_the_planner_solves(region: Region, level: LevelPolicy) -> None:
    costs = []
    for solver in (Ipopt(), Fatrop()):
        problem, parameters, guess = set_up(region, level)
        (solution,) = solver.solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED, (solver, solution.message)
        assert violation(problem, parameters, solution.point).worst < 1e-4
        costs.append(solution.cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)


# rectangles


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


@pytest.mark.parametrize("kind", [EigenRectangle, LuetkepohlRectangle])
def test_unknown_choices_are_refused(kind: Any) -> None:
    with pytest.raises(WideberthError, match="correction is 'holm'"):
        kind(correction="holm")
    with pytest.raises(WideberthError, match="enlargement is 'cone'"):
        kind(enlargement="cone")
