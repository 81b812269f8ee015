"""Regions against convex programs: projections and the smallest enclosing ellipse, with CVXPY.

Everything is handed to the solver in units of the set's own size and near the origin. The
projections agree to 1e-6 of that size. The semidefinite program of the smallest ellipse is
trustworthy for axes below 100 margins and conditions up to 1e4 alone: beyond that the entries of
its matrices spread over more than the eight digits the solver leaves, and it returns ellipses
that are wrong by up to half or none at all. The tests stay inside, and there the areas agree
to 2e-5.
"""

from typing import Any

import numpy as np
import pytest

from wideberth.framework.region import Convex, Region, Signed
from wideberth.framework.testing.region_cases import RegionCase, sphere
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.regions import gaussian
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_area import MinimumArea
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.tests.helpers.region_variants import draw_cases

COUNT = 30
SIZES = pytest.mark.parametrize("size", [2, 3])


def convex() -> Any:
    """CVXPY, imported late: it takes seconds."""
    import cvxpy

    return cvxpy


def outside(case: RegionCase, rng: np.random.Generator) -> Any:
    """One point per obstacle, most of them outside."""
    rays = case.rays(sphere(rng, len(case.mean), case.size))
    return case.mean + rays * rng.uniform(1.1, 4.0, (len(rays), 1))


class Projection:
    """min |x - y| over x in A u, |u| <= 1 in some norm: the distance from y to a linear image."""

    def __init__(self, size: int, norm: float) -> None:
        cvxpy = convex()
        self.image = cvxpy.Parameter((size, size))
        self.target = cvxpy.Parameter(size)
        unit = cvxpy.Variable(size)
        distance = cvxpy.norm2(self.image @ unit - self.target)
        self.problem = cvxpy.Problem(cvxpy.Minimize(distance), [cvxpy.norm(unit, norm) <= 1.0])

    def __call__(self, image: Any, target: Any) -> float:
        self.image.value, self.target.value = image, target
        return float(self.problem.solve(solver="CLARABEL"))


def check_distance(region: Any, images: Any, norm: float, case: RegionCase, points: Any) -> None:
    """Signed distance plus margin is the distance to the un-enlarged set, for points off it."""
    project, seen = Projection(case.size, norm), 0
    got = region.signed_distance(points, case.parameters, case.level) + case.margin
    for i in range(len(points)):
        scale = float(np.linalg.norm(points[i] - case.mean[i]))
        target = (points[i] - case.mean[i]) / scale
        want = project(images[i] / scale, target)
        if got[i] > 0.0:
            assert got[i] / scale == pytest.approx(want, abs=1e-6)
            seen += 1
        else:
            assert want == pytest.approx(0.0, abs=1e-6)
    assert seen > COUNT // 2


@SIZES
@pytest.mark.parametrize("region", [MinkowskiSum(), SeparatingLine()], ids=repr)
def test_ellipse_plus_disc(region: Region, size: int) -> None:
    if size not in region.dimensions:
        assert size == 3
        return
    rng = np.random.default_rng(51)
    case = draw_cases(region, size, COUNT, rng, condition=1e6)
    _, vectors, deviations, _ = gaussian.unpack(case.parameters)
    images = vectors * (case.level[:, None] * deviations)[:, None, :]
    check_distance(region, images, 2, case, outside(case, rng))


@SIZES
def test_ellipse_of_the_paper(size: int) -> None:
    """Its axes hold the margin, so nothing is added to the distance."""
    rng = np.random.default_rng(52)
    region = MahalanobisEllipse()
    case = draw_cases(region, size, COUNT, rng, condition=1e6)
    _, vectors, deviations, margin = gaussian.unpack(case.parameters)
    axes = case.level[:, None] * deviations + margin[:, None]
    points, project = outside(case, rng), Projection(size, 2)
    got = region.signed_distance(points, case.parameters, case.level)
    for i in range(COUNT):
        scale = float(np.linalg.norm(points[i] - case.mean[i]))
        want = project(vectors[i] * axes[i] / scale, (points[i] - case.mean[i]) / scale)
        assert max(got[i], 0.0) / scale == pytest.approx(want, abs=1e-6)


@SIZES
@pytest.mark.parametrize("correction", ["bonferroni", "sidak"])
def test_box_plus_disc(correction: Any, size: int) -> None:
    rng = np.random.default_rng(53)
    world, eigen = LuetkepohlRectangle("disc", correction), EigenRectangle(correction, "disc")
    case = draw_cases(world, size, COUNT, rng, condition=1e6)
    half = case.level[:, None] * np.sqrt(np.diagonal(case.covariance, axis1=1, axis2=2))
    check_distance(world, half[:, None, :] * np.eye(size), np.inf, case, outside(case, rng))
    case = draw_cases(eigen, size, COUNT, rng, condition=1e6)
    _, vectors, deviations, _ = gaussian.unpack(case.parameters)
    images = vectors * (case.level[:, None] * deviations)[:, None, :]
    check_distance(eigen, images, np.inf, case, outside(case, rng))


@SIZES
def test_support_is_a_maximum_over_two_cones(size: int) -> None:
    """Max n . x over ellipse plus disc, each of them a cone."""
    cvxpy = convex()
    rng = np.random.default_rng(54)
    case = draw_cases(MinkowskiSum(), size, COUNT, rng, condition=1e6)
    _, vectors, deviations, margin = gaussian.unpack(case.parameters)
    normals = sphere(rng, COUNT, size)
    along, normal = cvxpy.Parameter(size), cvxpy.Parameter(size)
    radius = cvxpy.Parameter(nonneg=True)
    unit, ball = cvxpy.Variable(size), cvxpy.Variable(size)
    cones = [cvxpy.norm2(unit) <= 1.0, cvxpy.norm2(ball) <= radius]
    problem = cvxpy.Problem(cvxpy.Maximize(along @ unit + normal @ ball), cones)
    assert isinstance(case.region, Convex) and isinstance(case.region, Signed)
    got = case.region.support(normals, case.parameters, case.level)
    for i in range(COUNT):
        scale = case.extents[i, 0]
        along.value = normals[i] @ vectors[i] * (case.level[i] * deviations[i]) / scale
        radius.value, normal.value = margin[i] / scale, normals[i]
        want = scale * problem.solve(solver="CLARABEL") + normals[i] @ case.mean[i]
        assert got[i] == pytest.approx(want, abs=1e-6 * scale)


class SmallestEllipse:
    """max log det T such that {x : x^T T x <= 1} holds the sum of two ellipses, by S-procedure.

    With x = y + z, y^T P y <= 1 and z^T z <= 1 (the margin is the unit of length), x^T T x <= 1
    follows from (y, z)^T [[T, T], [T, T]] (y, z) <= t_1 y^T P y + t_2 z^T z with t_1 + t_2 <= 1.
    """

    def __init__(self, size: int) -> None:
        cvxpy = convex()
        self.inverse = cvxpy.Parameter((size, size), PSD=True)
        self.shape = cvxpy.Variable((size, size), PSD=True)
        first, second = cvxpy.Variable(nonneg=True), cvxpy.Variable(nonneg=True)
        block = cvxpy.bmat(
            [
                [self.shape - first * self.inverse, self.shape],
                [self.shape, self.shape - second * np.eye(size)],
            ]
        )
        limits = [first + second <= 1.0, 0.5 * (block + block.T) << 0]
        self.problem = cvxpy.Problem(cvxpy.Maximize(cvxpy.log_det(self.shape)), limits)

    def axes(self, image: Any) -> Any:
        """Semi-axes in margins, from large to small, for the ellipse image u, |u| <= 1."""
        root = np.linalg.inv(image)
        self.inverse.value = root.T @ root
        self.problem.solve(solver="CLARABEL")
        assert self.problem.status == "optimal"
        return 1.0 / np.sqrt(np.linalg.eigvalsh(self.shape.value))


@SIZES
def test_minimum_area_is_the_smallest_of_all_ellipses(size: int) -> None:
    """Of all shapes and directions, for axes below 100 margins and conditions up to 1e4."""
    rng = np.random.default_rng(55)
    smallest = SmallestEllipse(size)
    for ratio in 10.0 ** rng.uniform(-1.5, 1.9, 15):
        share = np.array([1.0, *(10.0 ** rng.uniform(-2.0, 0.0, size - 1))])
        turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
        image = turn * (ratio * share)
        want = smallest.axes(image)
        obstacle = GaussianObstacle(np.zeros(size), image @ image.T)
        region = MinimumArea()
        got = region.axes(region.parameters(obstacle, np.asarray(1.0)), np.asarray(1.0))
        assert got.prod() == pytest.approx(want.prod(), rel=2e-5)
        np.testing.assert_allclose(got, want, rtol=2e-3)  # flat near its minimum
