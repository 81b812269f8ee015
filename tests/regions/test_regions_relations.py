"""Declared relations at 10 000 random covariances: inner, exact, outer, none; no violation."""

from typing import Any

import numpy as np
import pytest
import shapely
from scipy import optimize

from wideberth.framework.plugins import registry
from wideberth.framework.region import Convex, Region, Relation, Signed
from wideberth.framework.testing.region_cases import RegionCase, sphere
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.helpers.region_variants import draw_cases, variants

KINDS = [registry.load("regions", name) for name in registry.names("regions")]
ALL = [(one, size) for kind in KINDS for one in variants(kind) for size in one.dimensions]


def which(*relations: Relation) -> Any:
    """Parametrise over the regions that declare one of these relations."""
    chosen = [(one, size) for one, size in ALL if one.relation in relations]
    names = [f"{one!r}-{size}D" for one, size in chosen]
    return pytest.mark.parametrize(("region", "size"), chosen, ids=names)


COUNT = 10_000
SHARP = 1e-9
"""Share of a ray by which points are moved off the exact boundary."""


def exact(case: RegionCase) -> tuple[MinkowskiSum, Any, Any]:
    """The exact set of the same content for the same obstacles: its parameters and level."""
    other = RegionCase(MinkowskiSum(), case.mean, case.covariance, case.margin, case.tail)
    return MinkowskiSum(), other.parameters, other.level


def on_exact_boundary(case: RegionCase, rng: np.random.Generator) -> Any:
    """One point per obstacle on the exact boundary, on a random ray or a principal axis."""
    rays = case.rays(sphere(rng, len(case.mean), case.size))
    truth, numbers, level = exact(case)
    return rays / truth.gauge(case.mean + rays, numbers, level)[:, None]


# the exact set itself


@pytest.mark.parametrize("size", [2, 3])
def test_gauge_is_the_best_ratio_over_normals(size: int) -> None:
    """gauge(x) = max over n of n . (x - mu) / h(n), h written out here."""
    rng = np.random.default_rng(31)
    case = draw_cases(MinkowskiSum(), size, 40, rng, condition=1e4)
    points = case.mean + case.rays(sphere(rng, 40, size)) * rng.uniform(0.2, 3.0, (40, 1))
    gauge = MinkowskiSum().gauge(points, case.parameters, case.level)
    for i in range(40):
        offset, covariance = points[i] - case.mean[i], case.covariance[i]

        def ratio(n: Any, i: int = i, x: Any = offset, covariance: Any = covariance) -> float:
            spread = np.sqrt(n @ covariance @ n)
            height = case.level[i] * spread + case.margin[i] * np.sqrt(n @ n)
            return -float(n @ x / height)

        scale = case.level[i] ** 2 * covariance + case.margin[i] ** 2 * np.eye(size)
        best = optimize.minimize(ratio, np.linalg.solve(scale, offset), tol=1e-14).fun
        assert gauge[i] == pytest.approx(-best, rel=1e-7)
        assert gauge[i] == pytest.approx(case.gauge(points)[i], rel=1e-12)


def test_exact_set_against_a_buffered_polygon() -> None:
    rng = np.random.default_rng(32)
    case = draw_cases(MinkowskiSum(), 2, 15, rng, condition=1e4)
    angle = np.linspace(0.0, 2.0 * np.pi, 8000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for i in range(15):
        values, vectors = np.linalg.eigh(case.covariance[i])
        ellipse = case.mean[i] + case.level[i] * (circle * np.sqrt(values)) @ vectors.T
        ring, solid = shapely.LinearRing(ellipse), shapely.Polygon(ellipse)
        rays = case.rays(sphere(rng, 15, 2))[i] * np.linspace(0.05, 3.0, 40)[:, None]
        places = shapely.points(case.mean[i] + rays)
        inside = shapely.contains(solid, places)
        want = np.where(inside, -1.0, 1.0) * shapely.distance(ring, places) - case.margin[i]
        got = MinkowskiSum().signed_distance(
            case.mean[i] + rays, case.parameters[i], case.level[i]
        )
        np.testing.assert_allclose(got, want, atol=1e-6 * case.extents[i, 0])


# what is declared


@which(Relation.INNER, Relation.EXACT)
def test_inner_holds_no_point_outside(region: Region, size: int) -> None:
    """Star-shaped around the mean, so a ray leaves it where the exact set ends or before."""
    rng = np.random.default_rng(33)
    case = draw_cases(region, size, COUNT, rng)
    edge = on_exact_boundary(case, rng)
    for step in (SHARP, 1e-6, 1e-3, 0.1, 1.0):
        assert not case.contains(case.mean + (1.0 + step) * edge).any()


@which(Relation.OUTER, Relation.EXACT)
def test_outer_leaves_out_no_point_inside(region: Region, size: int) -> None:
    rng = np.random.default_rng(34)
    case = draw_cases(region, size, COUNT, rng)
    edge = on_exact_boundary(case, rng)
    for step in (SHARP, 1e-6, 1e-3, 0.1, 0.9):
        assert case.contains(case.mean + (1.0 - step) * edge).all()


@which(Relation.INNER, Relation.EXACT, Relation.OUTER)
def test_support_and_distance_agree(region: Region, size: int) -> None:
    """The same order by support functions in one direction and by signed distances."""
    rng = np.random.default_rng(35)
    case = draw_cases(region, size, COUNT, rng)
    truth, numbers, level = exact(case)
    sign = {Relation.INNER: -1.0, Relation.OUTER: 1.0, Relation.EXACT: 0.0}[region.relation]
    near = 1e-11 * (1.0 + case.extents[:, 0])
    if isinstance(region, Convex):
        normals = sphere(rng, COUNT, size)
        ahead = region.support(normals, case.parameters, case.level)
        ahead = ahead - truth.support(normals, numbers, level)
        assert (sign * ahead > -near).all() and (sign != 0.0 or (np.abs(ahead) < near).all())
    if isinstance(region, Signed):
        places = case.mean + case.rays(sphere(rng, COUNT, size)) * rng.uniform(
            0.5, 2.0, (COUNT, 1)
        )
        ahead = truth.signed_distance(places, numbers, level)
        ahead = ahead - region.signed_distance(places, case.parameters, case.level)
        assert (sign * ahead > -near).all() and (sign != 0.0 or (np.abs(ahead) < near).all())


@which(Relation.NONE)
def test_none_is_honest(region: Region, size: int) -> None:
    """Somewhere it reaches beyond the exact set and somewhere it falls short."""
    rng = np.random.default_rng(36)
    case = draw_cases(region, size, COUNT, rng)
    edge = on_exact_boundary(case, rng)
    assert case.contains(case.mean + 1.01 * edge).any()
    assert not case.contains(case.mean + 0.99 * edge).all()


@which(Relation.INNER, Relation.OUTER)
def test_the_declaration_is_no_weaker_than_the_truth(region: Region, size: int) -> None:
    """An inner or outer region is not the exact set."""
    rng = np.random.default_rng(37)
    case = draw_cases(region, size, 1000, rng)
    inside = case.contains(case.mean + on_exact_boundary(case, rng) * 0.999)
    outside = case.contains(case.mean + on_exact_boundary(case, rng) * 1.001)
    assert outside.any() if region.relation is Relation.OUTER else not inside.all()
