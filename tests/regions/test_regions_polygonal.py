"""Regions that know bodies with corners, against shapely, brute force and Monte Carlo."""

from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Polygonal
from wideberth.framework.testing.region import check_region
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.regions import gaussian
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.tests.oracles.polygons import polygon_signed_distance

REGIONS: list[Any] = [SeparatingLine(), WhitenedBox()]
OUTLINES = [
    ((0.6, -0.25), (0.6, 0.25), (-0.4, 0.25), (-0.4, -0.25)),
    ((0.9, 0.0), (-0.3, 0.4), (-0.3, -0.4)),
    ((1.4, -0.02), (1.4, 0.02), (-0.1, 0.02), (-0.1, -0.02)),
]
COUNT = 1200
"""Poses per outline."""


def scenes(rng: np.random.Generator, outline: Any, count: int = COUNT) -> tuple[Any, Any, Any]:
    """Poses around obstacles with conditions up to 1e4, obstacles, margins (a third of them 0)."""
    turn = np.linalg.qr(rng.standard_normal((count, 2, 2)))[0]
    deviation = 10.0 ** np.stack([rng.uniform(-1.0, 0.3, count), np.zeros(count)], axis=-1)
    deviation[:, 1] = deviation[:, 0] * 10.0 ** rng.uniform(-2.0, 0.0, count)
    sigma = np.einsum("kij,kj,klj->kil", turn, deviation**2, turn)
    sigma = 0.5 * (sigma + np.swapaxes(sigma, 1, 2))
    mean, margin = rng.uniform(-3.0, 3.0, (count, 2)), rng.uniform(-0.3, 0.6, count).clip(0.0)
    along = rng.standard_normal((count, 2)) * (2.0 * deviation[:, :1] + 0.8)
    pose = Pose(tuple((mean + along).T), rng.uniform(-4.0, 4.0, count), outline)
    return pose, GaussianObstacle(mean, sigma), margin


def bodies(pose: Pose) -> Any:
    """Corners in the world, (K, V, 2)."""
    return np.stack([Pose(corner).points() for corner in pose.corners()], axis=1)


def ellipses(numbers: Any, level: float) -> Any:
    """The content ellipses as polygons of 4000 corners, which lie 3e-7 of the axis inside."""
    mean, vectors, deviations, _ = gaussian.unpack(numbers)
    angle = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ring = level * deviations[:, None] * circle
    return shapely.polygons(mean[:, None] + ring @ np.swapaxes(vectors, 1, 2))


def compiled(region: Polygonal, outline: Any) -> Any:
    """(x, y, heading), parameters, level, auxiliary -> smallest inequality and its gradient."""
    x, level = ca.SX.sym("x", 3), ca.SX.sym("level")
    p, extra = ca.SX.sym("p", region.parameter_count(2)), ca.SX.sym("a", len(region.auxiliary(2)))
    stated = region.constraint(Pose((x[0], x[1]), x[2], outline), p, level, extra)
    least = ca.mmin(ca.vertcat(*stated.inequalities))
    return ca.Function("least", [x, p, level, extra], [least, ca.gradient(least, x)])


def test_contract() -> None:
    check_region(SeparatingLine())


@pytest.mark.parametrize("outline", OUTLINES, ids=len)
def test_overlap_of_polygon_and_ellipse_is_exact(outline: Any) -> None:
    region, level = SeparatingLine(), 1.7
    pose, obstacle, margin = scenes(np.random.default_rng(1), outline)
    numbers = region.parameters(obstacle, margin)
    apart = shapely.distance(shapely.polygons(bodies(pose)), ellipses(numbers, level)) - margin
    got = region.overlaps(pose, numbers, np.asarray(level))
    clear = np.abs(apart) > 2e-6
    touching = (margin == 0.0) & (apart == 0.0)  # one body in the other has distance 0
    assert (got[clear] == (apart[clear] < 0.0)).all() and got[touching].all()
    assert 0.1 < got.mean() < 0.9 and clear.mean() > 0.8


@pytest.mark.parametrize("outline", [(), *OUTLINES], ids=len)
def test_the_start_is_the_best_angle(outline: Any) -> None:
    """No angle of a fine grid leaves more room, where the body is clear of the ellipse."""
    region, level = SeparatingLine(), 1.7
    pose, obstacle, margin = scenes(np.random.default_rng(2), outline, 150)
    numbers = region.parameters(obstacle, margin)
    start = region.auxiliary_start(pose, numbers, np.asarray(level))
    assert start.shape == (150, 1)
    grid = np.linspace(-np.pi, np.pi, 20001)

    def room(angle: Any) -> Any:
        n = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        corners = bodies(pose) - obstacle.mean[:, None]
        reach = np.sqrt(np.einsum("...i,...ij,...j->...", n, obstacle.covariance[:, None], n))
        return (n @ np.swapaxes(corners, 1, 2)).min(axis=-1) - level * reach

    found, best = room(start)[:, 0], np.concatenate(
        [room(np.broadcast_to(part, (150, len(part)))).max(axis=1)[:, None]
         for part in np.array_split(grid, 10)], axis=1,
    ).max(axis=1)  # fmt: skip
    outside = best > 1e-6
    assert outside.sum() > 30
    assert (found[outside] >= best[outside] - 1e-12).all()
    assert (found[~outside] <= 1e-6).all()


@pytest.mark.parametrize("outline", [(), *OUTLINES], ids=len)
@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_symbolic_equals_numeric(region: Any, outline: Any) -> None:
    rng = np.random.default_rng(3)
    function, level = compiled(region, outline), 1.7
    pose, obstacle, margin = scenes(rng, outline, 2500)
    numbers = region.parameters(obstacle, margin)
    start = region.auxiliary_start(pose, numbers, np.asarray(level))
    where = np.stack([*pose.position, pose.heading])
    value, slope = function(where, numbers.T, np.full((1, 2500), level), start.T)
    value, slope = value.full()[0], slope.full()
    inside = region.overlaps(pose, numbers, np.asarray(level))
    clear = np.abs(value) > 1e-9
    assert clear.mean() > 0.99
    assert ((value < 0.0) == inside)[clear].all()
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_points_are_bodies_with_one_corner(region: Any) -> None:
    pose, obstacle, margin = scenes(np.random.default_rng(4), ())
    numbers = region.parameters(obstacle, margin)
    got = region.overlaps(pose, numbers, np.asarray(1.5))
    assert (got == region.contains(pose.points(), numbers, np.asarray(1.5))).all()
    if isinstance(region, SeparatingLine):
        assert (got == MinkowskiSum().contains(pose.points(), numbers, np.asarray(1.5))).all()


@pytest.mark.parametrize("outline", OUTLINES, ids=len)
@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_a_polygon_needs_less_room_than_its_disc(region: Any, outline: Any) -> None:
    pose, obstacle, margin = scenes(np.random.default_rng(5), outline)
    level, reach = np.asarray(1.5), max(np.hypot(*corner) for corner in outline)
    body = region.overlaps(pose, region.parameters(obstacle, margin), level)
    disc = region.contains(pose.points(), region.parameters(obstacle, margin + reach), level)
    assert not (body & ~disc).any()
    assert (disc & ~body).sum() > 50


@pytest.mark.parametrize("outline", OUTLINES, ids=len)
@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_risk_of_polygons_at_the_boundary(region: Any, outline: Any) -> None:
    """Random headings, pushed away from the obstacle until just clear; risk by Monte Carlo."""
    rng, draws, risk = np.random.default_rng(6), 20_000, 0.05
    exact = isinstance(region, SeparatingLine)
    level = np.asarray(region.level_for_risk(risk) if exact else region.level(risk))
    pose, obstacle, margin = scenes(rng, outline, 40)
    numbers = region.parameters(obstacle, margin)
    ray = pose.points() - obstacle.mean
    ray /= np.hypot.reduce(ray, axis=1)[:, None]
    low, high = np.zeros(40), np.full(40, 20.0)
    for _ in range(50):
        middle = 0.5 * (low + high)
        at = Pose(tuple((obstacle.mean + middle[:, None] * ray).T), pose.heading, outline)
        inside = region.overlaps(at, numbers, level)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    at = Pose(tuple((obstacle.mean + high[:, None] * ray).T), pose.heading, outline)
    spread = 4.0 * np.sqrt(risk * (1.0 - risk) / draws)
    shares = [hits(rng, corners, obstacle, i, margin[i], draws)
              for i, corners in enumerate(bodies(at))]  # fmt: skip
    assert max(shares) < risk + spread
    assert max(shares) > 0.3 * risk  # the promise is not empty


def hits(rng: Any, corners: Any, obstacle: Any, i: int, margin: float, draws: int) -> float:
    places = rng.multivariate_normal(obstacle.mean[i], obstacle.covariance[i], draws)
    return float((polygon_signed_distance(places, corners) < margin).mean())


@pytest.mark.parametrize("outline", OUTLINES, ids=len)
def test_box_is_a_bound_at_any_pose(outline: Any) -> None:
    """The bound exceeds the share of hits by Monte Carlo, less 4 deviations of it."""
    rng, draws, region = np.random.default_rng(7), 4000, WhitenedBox()
    pose, obstacle, margin = scenes(rng, outline, 150)
    numbers = region.parameters(obstacle, margin)
    shares = np.array([hits(rng, corners, obstacle, i, margin[i], draws)
                       for i, corners in enumerate(bodies(pose))])  # fmt: skip
    sure = shares - 4.0 * np.sqrt(shares * (1.0 - shares) / draws) - 8.0 / draws
    told = sure > 0.0
    assert told.sum() > 20
    level = np.sqrt(-2.0 * np.log(np.where(told, sure, 0.5)))
    assert region.overlaps(pose, numbers, level)[told].all()


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_ipopt_moves_a_body_clear(region: Any) -> None:
    """And turns it, for the separating line; the box has kinks where it turns."""
    outline, level = OUTLINES[0], region.level(0.2)
    x, p = ca.SX.sym("x", 3), ca.SX.sym("p", region.parameter_count(2))
    auxiliary = region.auxiliary(2)
    extra, goal = ca.SX.sym("a", len(auxiliary)), ca.SX.sym("goal", 3)
    stated = region.constraint(Pose((x[0], x[1]), x[2], outline), p, level, extra)
    problem = {
        "x": ca.vertcat(x, extra),
        "p": ca.vertcat(p, goal),
        "f": ca.sumsqr(x - goal) + auxiliary.regularisation * ca.sumsqr(extra),
        "g": ca.vertcat(*stated.inequalities),
    }
    quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    solver = ca.nlpsol("clear", "ipopt", problem, quiet)
    rng, fixed = np.random.default_rng(8), isinstance(region, WhitenedBox)
    numbers = region.parameters(
        GaussianObstacle(np.zeros(2), np.array([[0.3, 0.1], [0.1, 0.1]])), np.asarray(0.2)
    )
    for _ in range(15):
        target = np.append(rng.uniform(-0.4, 0.4, 2), rng.uniform(-3.0, 3.0))
        start = target + np.append(rng.choice([-1.5, 1.5], 2), 0.0)
        pose = Pose((start[0], start[1]), start[2], outline)
        first = region.auxiliary_start(pose, numbers, np.asarray(level))
        found = solver(
            x0=[*start, *first],
            p=np.concatenate([numbers, target]),
            lbg=0.0,
            lbx=[-np.inf, -np.inf, target[2] if fixed else -np.inf, *auxiliary.lower],
            ubx=[np.inf, np.inf, target[2] if fixed else np.inf, *auxiliary.upper],
        )["x"].full()[:, 0]
        assert solver.stats()["success"]
        for grown, inside in ((-1e-3, False), (1e-3, True)):
            at = Pose((found[0], found[1]), found[2], outline)
            assert bool(region.overlaps(at, numbers, np.asarray(level + grown))) == inside
