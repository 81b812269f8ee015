"""IPOPT projects points onto the boundary of a region by its constraint."""

from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Region
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.metrics import ellipses
from wideberth.regions import gaussian
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.tests.helpers.region_samples import (
    BY_RISK,
    OUTER,
    PAPER,
    packed,
    random_covariances,
)


@pytest.mark.parametrize("region", PAPER, ids=repr)
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
        near = ellipses.closest_point(inside, axes)
        start = mean + vectors @ (near + 0.2 * (near - inside))
        point = mean + vectors @ inside
        found = solver(x0=start, p=np.concatenate([numbers, point]), lbg=0.0, ubg=np.inf)
        assert solver.stats()["success"]
        length = float(np.linalg.norm(found["x"].full()[:, 0] - point))
        depth = -float(region.signed_distance(point, numbers, np.asarray(2.0)))
        assert length == pytest.approx(depth, rel=1e-5)


@pytest.mark.parametrize("region", BY_RISK, ids=repr)
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
