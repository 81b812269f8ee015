"""Constraints of outer ellipses and rectangles whose level is a symbol."""

import math
from typing import Any

import numpy as np
import pytest

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.values.motion import Pose
from wideberth.regions import gaussian
from wideberth.regions.outer_ellipse import OuterEllipse
from wideberth.tests.helpers.region_samples import OUTER, RECTANGLES, packed, random_covariances

ALL: list[Any] = [*OUTER, *RECTANGLES]


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
