"""Constraints at the centre of their region: finite curvature, and the boundary not moved by it.

A start on top of an obstacle puts the solver there. Where second derivatives grow without bounds,
fatrop looks for a shift that makes them definite for ever.
"""

from functools import cache
from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins import registry
from wideberth.framework.region import Region
from wideberth.framework.testing.numeric_constraint import compile_constraint
from wideberth.framework.testing.region_cases import RegionCase, sphere
from wideberth.framework.values.motion import Pose
from wideberth.regions.gaussian import CENTRE
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.separating_line import SeparatingLine
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.tests.helpers.region_variants import variants

REGISTERED = [
    one for name in registry.names("regions") for one in variants(registry.load("regions", name))
]
ELLIPSES = [one for one in REGISTERED if isinstance(one, MahalanobisEllipse | OuterEllipse)]
NO_GAUGE = (RiskContour, SeparatingLine, WhitenedBox)
"""Their constraints are no logarithm of a gauge; the others' are that of `gaussian.log_gauge`."""
GAUGES = [one for one in REGISTERED if not isinstance(one, NO_GAUGE)]
WIDE, SMALL = ((0.5, 0.3, 0.25), 1.0), ((0.02, 0.02, 0.02), 1.5)
"""Deviations and margin, m. At the centre of the small one a hit is certain to all digits."""
SHAPE = 5.0
"""Times 1 / c is the bound for these shapes, see `test_curvature_is_bounded`."""
DISTANCES = (0.0, 1e-8, 1e-4, 1e-2)
"""From the centre, in sizes of the region. The 1e-2 is where g^2 = c."""


def sized(regions: list[Region]) -> list[Any]:
    return [
        pytest.param(one, size, id=f"{one!r}-{size}D")
        for one in regions
        for size in one.dimensions
    ]


def plain(region: Region) -> bool:
    """Whether a region has no auxiliaries, whose units differ."""
    return not any(len(region.auxiliary(size)) for size in region.dimensions)


def obstacle(region: Region, size: int, shape: tuple[Any, float]) -> RegionCase:
    deviations, margin = np.array(shape[0])[:size], np.array(shape[1])
    mean = np.arange(1.0, size + 1.0)
    return RegionCase(region, mean, np.diag(deviations**2), margin, np.array(0.05))


@cache
def curvature(region: Region, size: int) -> Any:
    """Second derivatives in the position of every inequality, as a function of numbers."""
    x, level = ca.SX.sym("x", size), ca.SX.sym("level")
    numbers = ca.SX.sym("numbers", region.parameter_count(size))
    auxiliary = ca.SX.sym("auxiliary", len(region.auxiliary(size)))
    pose = Pose(tuple(x[i] for i in range(size)), 0.0 if size == 2 else None)
    stated = region.constraint(pose, numbers, level, auxiliary).inequalities
    hessians = ca.horzcat(*[ca.hessian(value, x)[0] for value in stated])
    return ca.Function("curvature", [x, numbers, level, auxiliary], [hessians])


def largest(case: RegionCase, point: Any, auxiliary: Any) -> float:
    """Spectral norm of the largest of the second derivatives; infinite if one is not finite."""
    function = curvature(case.region, case.size)
    found = np.asarray(function(point, case.parameters, case.level, auxiliary).full())
    if not np.isfinite(found).all():
        return np.inf
    parts = np.split(found, found.shape[1] // case.size, axis=1)
    return max(float(np.linalg.norm(part, 2)) for part in parts)


def worst(case: RegionCase) -> float:
    """Largest |h''| r^2 / (5 / c) at and near the centre, r the radius of a ball inside."""
    region, rays = case.region, sphere(np.random.default_rng(20), 24, case.size)
    radius = float(case.reach(rays)[0].min())
    declared, found = np.asarray(region.auxiliary(case.size).start), []
    for distance in DISTANCES:
        for ray in rays:
            point = case.mean + distance * radius * ray
            best = region.auxiliary_start(Pose.of(point), case.parameters, case.level)
            found += [largest(case, point, auxiliary) for auxiliary in (best, declared)]
    return max(found) * radius**2 * CENTRE / SHAPE


@pytest.mark.parametrize(("region", "size"), sized(REGISTERED))
def test_curvature_is_bounded(region: Region, size: int) -> None:
    """With h = log((g^2 + c) / (1 + c)) / 2, F = g^2 / 2 and the radius r of a ball inside,

        h'' = F'' / (g^2 + c) - 2 F' F'^T / (g^2 + c)^2,    |F'| <= g / r,

    where F'' is the same along a ray, so |h''| r^2 <= (K + 1/2) / c with K = r^2 max |F''|. An
    ellipse has K = 1 and |h''| r^2 <= 1 / c. For a set plus the disc of the margin, in a ball of
    radius R, K <= 1 + (r / margin) (R / r)^2, below 4.5 here.
    """
    assert worst(obstacle(region, size, WIDE)) <= 1.0


@pytest.mark.parametrize(("region", "size"), sized(REGISTERED))
def test_curvature_is_bounded_where_a_hit_is_certain(region: Region, size: int) -> None:
    """The same bound for what is no gauge: a probability varies within a deviation or more, and
    (r / deviation)^2 is below 1 / c.
    """
    assert worst(obstacle(region, size, SMALL)) <= 1.0


@pytest.mark.parametrize(("region", "size"), sized(ELLIPSES))
def test_an_ellipse_meets_the_bound_at_its_centre(region: Region, size: int) -> None:
    case = obstacle(region, size, WIDE)
    shortest = case.reach(np.eye(size))[0].min()
    found = largest(case, case.mean, np.zeros(0)) * shortest**2
    assert found == pytest.approx(1.0 / CENTRE, rel=1e-6)


@pytest.mark.parametrize(("region", "size"), sized(GAUGES))
def test_the_boundary_stays_where_it_is(region: Region, size: int) -> None:
    """At a multiple m of a boundary point log((m^2 + c) / (1 + c)) / 2, so 0 where m is 1."""
    case, twin = obstacle(region, size, WIDE), compile_constraint(region, size)
    rays = sphere(np.random.default_rng(21), 40, size)
    edge = case.reach(rays)[0][:, None] * rays
    for multiple in (0.01, 0.5, 0.999, 1.0, 1.001, 2.0):
        values, _, _ = twin(case.mean + multiple * edge, case.parameters, float(case.level))
        wanted = 0.5 * np.log((multiple**2 + CENTRE) / (1.0 + CENTRE))
        np.testing.assert_allclose(values, wanted, atol=2e-6)


@pytest.mark.parametrize(("region", "size"), sized([one for one in REGISTERED if plain(one)]))
def test_a_constraint_has_no_unit(region: Region, size: int) -> None:
    """All lengths in another unit: the same values, at the centre too."""
    here, rays = obstacle(region, size, WIDE), sphere(np.random.default_rng(22), 6, size)
    radius = float(here.reach(rays)[0].min())
    twin, factor = compile_constraint(region, size), 3.0
    there = RegionCase(
        region, factor * here.mean, factor**2 * here.covariance, factor * here.margin, here.tail
    )
    for distance in (*DISTANCES, 0.5, 2.0):
        points = here.mean + distance * radius * rays
        values, _, _ = twin(points, here.parameters, float(here.level))
        found, _, _ = twin(factor * points, there.parameters, float(there.level))
        np.testing.assert_allclose(found, values, rtol=1e-6, atol=1e-6)
