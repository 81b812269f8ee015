"""Distances, outlines and supports of regions against closed forms, brute force and shapely."""

import math
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.region import Convex, Signed
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.metrics import ellipses
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.tests.helpers.region_samples import COVARIANCE, PAPER, packed
from wideberth.tests.oracles.polygons import max_face, polygon_signed_distance


def test_closest_point_is_no_farther_than_any_other() -> None:
    rng = np.random.default_rng(0)
    for size in (2, 3):
        axes = np.sort(10.0 ** rng.uniform(-2, 1, (40, size)))[:, ::-1]
        points = rng.standard_normal((40, size)) * axes * rng.uniform(0.1, 3, (40, 1))
        nearest = ellipses.closest_point(points, axes)
        np.testing.assert_allclose(((nearest / axes) ** 2).sum(axis=1), 1.0, rtol=1e-9)
        sphere = rng.standard_normal((4000, size))
        sphere /= np.linalg.norm(sphere, axis=1)[:, None]
        others = np.linalg.norm(points[:, None] - axes[:, None] * sphere, axis=2).min(axis=1)
        distance = np.abs(ellipses.distance_to_ellipse(points, axes))
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
    got = ellipses.distance_to_ellipse(np.array(point), np.array(axes))
    assert float(got) == pytest.approx(distance, abs=1e-12)


def test_perimeter_and_surface() -> None:
    assert float(ellipses.perimeter(np.array([2.0, 2.0]))) == pytest.approx(4 * math.pi)
    assert float(ellipses.perimeter(np.array([3.0, 0.0]))) == pytest.approx(12.0)
    assert float(ellipses.surface(np.array([2.0, 2.0, 2.0]))) == pytest.approx(16 * math.pi)
    assert float(ellipses.surface(np.array([2.0, 1.0, 0.0]))) == pytest.approx(4 * math.pi)
    assert float(ellipses.mean_support(np.array([2.0, 2.0, 2.0]))) == pytest.approx(2.0)


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


@pytest.mark.parametrize("region", PAPER, ids=repr)
def test_support_and_distance_on_the_boundary(region: Any) -> None:
    assert isinstance(region, Convex) and isinstance(region, Signed)
    parameters, level = packed(region), region.level(0.05)
    edge = region.boundary(parameters, level, 5000)
    angle = np.linspace(0, 2 * np.pi, 37)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    reach = (edge @ normals.T).max(axis=0)
    got = region.support(normals, parameters, np.asarray(level))
    np.testing.assert_allclose(got, reach, atol=1e-5)
    several = region.support(normals.reshape(1, 37, 1, 2), parameters, np.asarray(level))
    np.testing.assert_array_equal(several, got.reshape(1, 37, 1))
    gap = region.signed_distance(edge, parameters, np.asarray(level))
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)


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


def test_the_separating_line_is_measured_in_sizes_of_the_region() -> None:
    """(n . (corner - mean) - level sigma - margin) / (margin + sigma + reach of the body)."""
    region, side = SeparatingLine(), 0.2
    parameters = region.parameters(GaussianObstacle(np.zeros(2), np.diag([0.09, 0.01])), 0.5)
    outline = ((side, side), (-side, side), (-side, -side), (side, -side))
    for body, reach in (((), 0.0), (outline, math.hypot(side, side))):
        pose = Pose((3.0, 0.4), 0.0, body)
        found = region.constraint(pose, parameters, 2.0, (0.0,)).inequalities
        rooms = [3.0 + x - 2.0 * 0.3 - 0.5 for x, _ in body or ((0.0, 0.0),)]
        wanted = np.array(rooms) / (0.5 + 0.3 + reach)
        np.testing.assert_allclose(np.array(found, dtype=float).ravel(), wanted, rtol=1e-9)
