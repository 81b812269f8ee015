"""The risk meter against closed forms, the published table, Monte Carlo and its own guarantees."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy import special

from wideberth.framework import names
from wideberth.framework.plugins.config import build
from wideberth.framework.region import Guarantee
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.risk.level_for_risk import level_for_risk
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.metrics.region_risk import RiskReport, along_boundary, measure
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.tests.oracles import inflation


def obstacle(first: float, second: float, angle: float = 0.0) -> GaussianObstacle:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    covariance = turn @ np.diag([first**2, second**2]) @ turn.T
    return GaussianObstacle(np.array([1.0, -2.0]), 0.5 * (covariance + covariance.T))


def at(region: Any, first: float, second: float, margin: float, tail: float = 0.05) -> RiskReport:
    return measure(region, obstacle(first, second, 0.0), margin, region.level(tail))


@pytest.mark.parametrize(
    ("case", "published"),
    [
        ((1.0, 0.5, 1.5), [(0.986, 3.1e-3, 6.0e-3), (1, 3.1e-3, 5.9e-3), (1.088, 4e-4, 1.03e-2)]),
        ((1.0, 0.1, 1.5), [(0.907, 1.6e-3, 3.2e-2), (1, 1.6e-3, 7.1e-3), (1.0, 2e-4, 1.24e-2)]),
        ((0.3, 0.1, 1.5), [(0.977, 4.3e-3, 1.26e-2), (1, 4.3e-3, 7e-3), (1.041, 5e-4, 1.2e-2)]),
        ((3.0, 1.0, 1.5), [(0.974, 1.5e-3, 4.8e-3), (1, 1.5e-3, 4.8e-3), (1.076, 2e-4, 8.4e-3)]),
    ],
)
def test_published_table(case: tuple[float, float, float], published: Any) -> None:
    regions = (MahalanobisEllipse(), MinkowskiSum(), LuetkepohlRectangle())
    for region, (area, low, high) in zip(regions, published, strict=True):
        found = at(region, *case)
        assert found.area_ratio == pytest.approx(area, abs=1e-3)
        assert found.risk_min == pytest.approx(low, rel=0.15)  # printed with one or two digits
        assert found.risk_max == pytest.approx(high, rel=0.05)
        assert found.risk_min < found.risk_mean < found.risk_max


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_lengthened_ellipse_in_closed_form(angle: float) -> None:
    region, margin = MahalanobisEllipse(), 0.8
    s = region.level(0.1)
    found = measure(region, obstacle(1.0, 0.2, angle), margin, s)
    a, b = np.asarray(s), np.asarray(0.2 * s)
    lost = float(inflation.largest_clearance_error(a, b, np.asarray(margin)))
    assert found.clearance_lost == pytest.approx(lost, rel=1e-8)
    polar = np.linspace(0.0, np.pi / 2, 20001)
    radial = inflation.radial_error(a, b, np.asarray(margin), polar)
    assert found.gap_min == pytest.approx(-float(radial.max()), rel=1e-6)
    assert found.gap_max == pytest.approx(0.0, abs=1e-12)
    mean = float(np.trapezoid(radial, polar) / (np.pi / 2))
    assert found.gap_mean == pytest.approx(-mean, rel=1e-4)
    assert found.tail == pytest.approx(0.1, rel=1e-9)
    assert found.content == pytest.approx(0.9)
    assert found.area == pytest.approx(math.pi * (s + margin) * (0.2 * s + margin))
    ratio = float(inflation.effective_level_ratio(a, b, np.asarray(margin)))
    assert found.effective_level >= ratio * s  # P_max <= Phi(-g s)


def test_exact_sum_loses_nothing_and_keeps_its_promise() -> None:
    region = MinkowskiSum()
    for first, second, margin in ((1.0, 0.5, 0.0), (1.0, 1.0, 1.0), (2.0, 0.02, 0.5)):
        found = at(region, first, second, margin)
        assert found.area_ratio == pytest.approx(1.0, rel=1e-12)
        lengths = [found.clearance_lost, found.gap_min, found.gap_max, found.gap_mean]
        assert lengths == pytest.approx([0.0] * 4, abs=1e-9)
        assert found.effective_level >= region.level(0.05) - 1e-9


def test_round_covariance_has_one_risk() -> None:
    found = at(MinkowskiSum(), 0.7, 0.7, 1.5)
    radius = 0.7 * MinkowskiSum().level(0.05) + 1.5
    want = float(collision_probability([radius, 0.0], 0.49 * np.eye(2), 1.5))
    for risk in (found.risk_min, found.risk_mean, found.risk_max):
        assert risk == pytest.approx(want, rel=1e-9)


def test_refinement_beats_a_dense_scan() -> None:
    region, thing, margin = MahalanobisEllipse(), obstacle(1.0, 0.1, 0.4), 1.5
    level = region.level(0.05)
    found = measure(region, thing, margin, level)
    edge = region.boundary(region.parameters(thing, np.asarray(margin)), level, 50_001)
    risk = collision_probability(thing.mean - edge, thing.covariance, margin)
    assert found.risk_max == pytest.approx(float(risk.max()), rel=1e-7)
    assert found.risk_max >= float(risk.max()) * (1 - 1e-12)
    assert found.risk_min == pytest.approx(float(risk.min()), rel=1e-7)
    assert found.risk_min <= float(risk.min()) * (1 + 1e-12)


def test_straight_sides_are_walked() -> None:
    """The largest risk of a rectangle is in the middle of a side."""
    region = LuetkepohlRectangle()
    found = at(region, 1.0, 0.5, 1.5)
    half = 0.5 * region.level(0.05) + 1.5
    sides = [[1.0 * region.level(0.05) + 1.5, 0.0], [0.0, half]]
    risks = collision_probability(sides, np.diag([1.0, 0.25]), 1.5)
    assert found.risk_max == pytest.approx(float(risks.max()), rel=1e-9)


def test_tail_of_a_rectangle_is_that_of_its_intervals() -> None:
    region = LuetkepohlRectangle()
    found = measure(region, obstacle(1.0, 0.3), 0.5, region.level(0.1))
    assert found.tail == pytest.approx(1.0 - 0.95**2, abs=1e-6)
    assert found.promised_tail == pytest.approx(0.1)


def test_walk_lies_on_the_boundary() -> None:
    region, thing = MinkowskiSum(), obstacle(1.0, 0.2, 1.1)
    level = region.level(0.2)
    edge = along_boundary(region, thing, 0.6, level, 50)
    numbers = region.parameters(thing, np.asarray(0.6))
    distance = region.signed_distance(edge.points, numbers, np.asarray(level))
    assert np.abs(distance).max() < 1e-11
    assert (np.diff(edge.angles) > 0).all()
    assert edge.clearance == pytest.approx(np.full(len(edge.angles), 0.6))


def test_singular_and_zero_covariances() -> None:
    for region, first in ((MinkowskiSum(), 1.0), (MahalanobisEllipse(), 0.0)):
        found = at(region, first, 0.0, 1.0)
        assert found.area_ratio == pytest.approx(1.0)
        # A known position is met or not: on the rim of the disc rounding decides.
        worst = special.ndtr(-region.level(0.05)) if first > 0.0 else 1.0
        assert 0.0 <= found.risk_min <= found.risk_max <= worst
        assert math.isnan(found.tail)


@pytest.mark.parametrize("name", names("regions"))
def test_guarantees_hold_at_the_level_for_a_risk(name: str) -> None:
    region = build("regions", name)
    if region.guarantee is Guarantee.NONE:
        with pytest.raises(WideberthError, match="minkowski_sum"):
            level_for_risk(region, 0.01)
        return
    if 2 not in region.dimensions:
        return
    found = measure(region, obstacle(1.0, 0.15, 0.3), 0.9, level_for_risk(region, 0.03))
    assert found.risk_max <= 0.03 * (1 + 1e-6)


def test_level_for_risk() -> None:
    assert level_for_risk(MinkowskiSum(), 0.05) == pytest.approx(1.6448536269514722)
    assert level_for_risk(MinkowskiSum(), 0.05) < MinkowskiSum().level(0.05)
    rectangle = LuetkepohlRectangle()
    assert level_for_risk(rectangle, 0.05) == rectangle.level(0.05)
    assert level_for_risk(rectangle, 0.05, 3) == rectangle.level(0.05, 3)
    with pytest.raises(WideberthError, match="risk"):
        level_for_risk(rectangle, 1.0)


@dataclass(frozen=True)
class Endless:
    """A region without a boundary, told by the methods that the meter uses."""

    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def parameters(self, obstacle: GaussianObstacle, margin: Any) -> Any:
        return np.zeros(1)

    def contains(self, points: Any, parameters: Any, level: Any) -> Any:
        return np.ones(np.shape(points)[:-1], dtype=bool)

    def boundary(self, parameters: Any, level: float, count: int) -> Any:
        return np.stack([np.cos(np.arange(count)), np.sin(np.arange(count))], axis=1)

    def tail(self, level: float, dimension: int = 2) -> float:
        return 0.5


def test_bad_input_is_named() -> None:
    region = MahalanobisEllipse()
    endless: Any = Endless()
    with pytest.raises(WideberthError, match="one obstacle in two"):
        measure(region, GaussianObstacle(np.zeros((2, 2)), np.stack([np.eye(2)] * 2)), 1.0, 2.0)
    with pytest.raises(WideberthError, match="one obstacle in two"):
        measure(region, GaussianObstacle(np.zeros(4), np.eye(4)), 1.0, 2.0)
    with pytest.raises(WideberthError, match="one obstacle in two"):
        measure(SeparatingLine(), GaussianObstacle(np.zeros(3), np.eye(3)), 1.0, 2.0)
    with pytest.raises(WideberthError, match="along in two"):
        along_boundary(region, GaussianObstacle(np.zeros(3), np.eye(3)), 1.0, 2.0)
    with pytest.raises(WideberthError, match="margin"):
        measure(region, obstacle(1.0, 1.0), -1.0, 2.0)
    with pytest.raises(WideberthError, match="lower it"):
        measure(region, obstacle(1.0, 1.0), 1.0, 60.0)
    with pytest.raises(WideberthError, match="is empty"):
        measure(MinkowskiSum(), obstacle(0.0, 0.0), 0.0, 2.0)
    with pytest.raises(WideberthError, match="no boundary"):
        measure(endless, obstacle(1.0, 1.0), 1.0, 2.0)
    with pytest.raises(WideberthError, match="count"):
        along_boundary(region, obstacle(1.0, 1.0), 1.0, 2.0, 1)
