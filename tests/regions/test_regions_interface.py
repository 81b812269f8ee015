"""What every region takes: batches, symbols of both kinds, degenerate shapes, and no bad input."""

from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Region
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.regions.bhattacharyya import Bhattacharyya
from wideberth.regions.du_toit import DuToit
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.park import Park
from wideberth.tests.helpers.region_samples import BY_RISK, PAPER, packed


@pytest.mark.parametrize("region", PAPER, ids=repr)
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
    for region in PAPER:
        for kind in (ca.SX, ca.MX):
            x, p, level = kind.sym("x", 2), kind.sym("p", region.parameter_count(2)), 2.0
            extra = kind.sym("t", len(region.auxiliary(2)))
            (value,) = region.constraint(Pose((x[0], x[1])), p, level, extra).inequalities
            function = ca.Function("f", [x, p, extra], [value])
            point = np.array([4.0, 5.0])
            start = region.auxiliary_start(Pose.of(point), packed(region), np.asarray(level))
            assert float(function(point, packed(region), start)) > 0


@pytest.mark.parametrize("region", PAPER, ids=repr)
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


def test_degenerate_shapes_are_drawn_and_tested_without_a_warning():
    point = GaussianObstacle(np.zeros(2), np.zeros((2, 2)))
    exact = MinkowskiSum()
    shape = exact.parameters(point, np.array(1.5))
    assert np.linalg.norm(exact.boundary(shape, 2.0, 90), axis=1) == pytest.approx(1.5)
    plane = HalfPlane()
    inside = plane.contains(np.array([1.0, 0.0]), plane.parameters(point, np.array(1.5)), 2.0)
    assert bool(inside)


@pytest.mark.parametrize("kind", [EigenRectangle, LuetkepohlRectangle])
def test_unknown_choices_are_refused(kind: Any) -> None:
    with pytest.raises(WideberthError, match="correction is 'holm'"):
        kind(correction="holm")
    with pytest.raises(WideberthError, match="enlargement is 'cone'"):
        kind(enlargement="cone")


@pytest.mark.parametrize("region", [DuToit(), Park(), Bhattacharyya()], ids=repr)
def test_singular_covariances_are_refused(region: Region) -> None:
    obstacle = GaussianObstacle(np.zeros(2), np.diag([1.0, 0.0]))
    with pytest.raises(WideberthError, match="singular covariance"):
        region.parameters(obstacle, np.float64(1.0))


@pytest.mark.parametrize("region", BY_RISK, ids=repr)
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
