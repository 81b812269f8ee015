"""Constraints of regions sized by a risk: tails by symbols, deep inside, and where it is empty."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import special

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.region import Region
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.testing.numeric_constraint import compile_constraint
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose
from wideberth.regions import log_normal_probability as normal
from wideberth.regions.du_toit import DuToit
from wideberth.regions.park import Park
from wideberth.regions.risk_contour import RiskContour
from wideberth.regions.whitened_box import WhitenedBox
from wideberth.tests.helpers.region_samples import random_obstacles
from wideberth.tests.oracles.risk_bounds import box_bound


def compiled_value(region: Region) -> Callable[..., float]:
    x, p, level = ca.SX.sym("x", 2), ca.SX.sym("p", region.parameter_count(2)), ca.SX.sym("l")
    (value,) = region.constraint(Pose((x[0], x[1])), p, level, ca.SX(0, 1)).inequalities
    return ca.Function("value", [x, p, level], [value, ca.gradient(value, x)])  # type: ignore


@pytest.mark.parametrize("region", [RiskContour(), WhitenedBox()], ids=repr)
def test_symbolic_tails_against_numpy(region: Region) -> None:
    """The constraint is sqrt(-2 log P) - level down to P = 1e-250, the gradient its slope."""
    rng = np.random.default_rng(5)
    mean, sigma, margin = random_obstacles(rng, 400)
    function = compiled_value(region)
    truth = collision_probability if isinstance(region, RiskContour) else box_bound
    numbers = region.parameters(GaussianObstacle(np.zeros_like(mean), sigma), margin)
    wanted = truth(mean, sigma, margin)
    for point, packed, risk in zip(mean, numbers, wanted, strict=True):
        value, slope = (np.asarray(out.full()) for out in function(point, packed, 0.0))
        assert np.isfinite(slope).all()
        if 1e-250 < risk < 0.9999:
            near = 6e-4 if risk > 1e-14 else 4e-3 * abs(np.log(risk))
            near = near if isinstance(region, RiskContour) else 1e-8 * (1 + abs(np.log(risk)))
            assert value.item() ** 2 == pytest.approx(-2.0 * np.log(risk), rel=0.0, abs=near)
            step = 1e-5 * slope[:, 0] / max(np.hypot.reduce(slope[:, 0]) ** 2, 1e-12)
            ends = [float(function(point + h * step, packed, 0.0)[0]) for h in (-1.0, 1.0)]
            if np.hypot.reduce(slope[:, 0]) > 1e-2:
                assert ends[1] - ends[0] == pytest.approx(2e-5, rel=1e-3)


@pytest.mark.parametrize("region", [RiskContour(), WhitenedBox()], ids=repr)
def test_slope_deep_inside(region: Region) -> None:
    """A disc of 20 deviations: P is 1 to all digits, the constraint still points outwards."""
    function = compiled_value(region)
    obstacle = GaussianObstacle(np.zeros(2), 0.05**2 * np.eye(2))
    numbers = region.parameters(obstacle, np.float64(1.0))
    for point in np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2)):
        value, slope = (np.asarray(out.full()) for out in function(point, numbers, 2.0))
        assert value.item() < 0.0
        assert slope[:, 0] == pytest.approx(point / np.hypot.reduce(point), abs=2e-2)
    assert function(np.zeros(2), numbers, 0.0)[0] >= 0.0  # level 0 stands for an empty region
    slopes = [function(np.array([0.3, 0.0]), numbers, level)[1] for level in (0.049, 0.051)]
    assert [float(slope[0]) for slope in slopes] == pytest.approx([0.0, 1.0], abs=2e-2)


def test_scaled_complementary_error_function() -> None:
    x = np.concatenate([np.linspace(0.0, 20.0, 501), np.logspace(1.0, 10.0, 50)])
    symbol = ca.SX.sym("x")
    function = ca.Function("erfcx", [symbol], [normal.erfcx(symbol)])
    got = np.array([float(function(v)) for v in x])
    np.testing.assert_allclose(got, special.erfcx(x), rtol=1e-11)


def test_coefficients_of_the_scaled_complementary_error_function() -> None:
    """Those that Chebyshev's nodes give of SciPy's function."""
    nodes = np.polynomial.chebyshev.chebpts1(len(normal._COEFFICIENTS))
    x = 3.0 * (1.0 + nodes) / (1.0 - nodes)
    values = (1.0 + 2.0 * x) * special.erfcx(x)
    fitted = np.polynomial.chebyshev.chebfit(nodes, values, len(nodes) - 1)
    np.testing.assert_allclose(normal._COEFFICIENTS, fitted, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("region", [DuToit(), Park(), WhitenedBox(), RiskContour()], ids=repr)
def test_an_empty_region_forbids_nothing(region: Region) -> None:
    """A small disc in a wide Gaussian: even at the mean the risk is below the one asked for."""
    obstacle = GaussianObstacle(np.zeros(2), np.diag([9.0, 4.0]))
    numbers, level = region.parameters(obstacle, np.float64(0.1)), np.float64(region.level(0.05))
    points = np.random.default_rng(0).uniform(-5.0, 5.0, (200, 2))
    points[0] = 0.0
    assert not region.contains(points, numbers, level).any()
    assert region.area(numbers, level) == 0.0
    np.testing.assert_array_equal(region.boundary(numbers, float(level), 8), np.zeros((8, 2)))
    values, _, _ = compile_constraint(region, 2)(points, numbers, float(level))
    assert (values >= 0.0).all()
