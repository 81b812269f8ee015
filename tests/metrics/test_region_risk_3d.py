"""The risk meter in three dimensions: closed forms, the meridian, Monte Carlo, guarantees."""

import math
from typing import Any

import numpy as np
import pytest
from scipy import special

from wideberth.framework.numerics.geometry import sum_gauge
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.region import Guarantee
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.risk.level_for_risk import level_for_risk
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.metrics import region_risk
from wideberth.metrics.ellipses import sum_volume
from wideberth.metrics.region_risk import measure
from wideberth.regions.eigen_rectangle import EigenRectangle
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.oracles import inflation

SPATIAL = [name for name in names("regions") if 3 in build("regions", name).dimensions]
TURN = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
MEAN = np.array([1.0, -2.0, 0.5])


def obstacle(*deviations: float, turn: Any = TURN) -> GaussianObstacle:
    covariance = turn @ np.diag(np.square(deviations)) @ turn.T
    return GaussianObstacle(MEAN, 0.5 * (covariance + covariance.T))


def test_round_covariance_has_one_risk() -> None:
    region, margin = MinkowskiSum(), 1.5
    level = region.level(0.05, 3)
    found = measure(region, obstacle(0.7, 0.7, 0.7), margin, level)
    radius = 0.7 * level + margin
    want = float(collision_probability([radius, 0.0, 0.0], 0.49 * np.eye(3), margin))
    for risk in (found.risk_min, found.risk_mean, found.risk_max):
        assert risk == pytest.approx(want, rel=1e-9)
    assert found.tail == pytest.approx(0.05, rel=1e-9)
    assert found.promised_tail == pytest.approx(0.05, rel=1e-9)
    assert found.area == pytest.approx(4.0 / 3.0 * math.pi * radius**3)
    lengths = [found.clearance_lost, found.gap_min, found.gap_max, found.gap_mean]
    assert lengths == pytest.approx([0.0] * 4, abs=1e-9)


@pytest.mark.parametrize("deviations", [(1.0, 0.3, 0.3), (1.0, 1.0, 0.4)])
def test_lengthened_ellipsoid_by_its_meridian(deviations: tuple[float, float, float]) -> None:
    region, margin = MahalanobisEllipse(), 0.8
    level = region.level(0.05, 3)
    found = measure(region, obstacle(*deviations), margin, level)
    prolate = deviations[1] == deviations[2]
    # Semi-axes along the axis of symmetry and away from it.
    along, away = (deviations[0], deviations[2]) if prolate else (deviations[2], deviations[0])
    t = np.linspace(0.0, 0.5 * np.pi, 8001)
    axial, radial = (level * along + margin) * np.cos(t), (level * away + margin) * np.sin(t)
    points = np.stack([axial, radial, np.zeros_like(t)], axis=-1)
    risk = collision_probability(points, np.diag(np.square([along, away, away])), margin, 48)
    assert found.risk_max == pytest.approx(float(risk.max()), rel=1e-6)
    assert found.risk_min == pytest.approx(float(risk.min()), rel=1e-6)
    ring = radial * np.hypot(np.gradient(axial, t), np.gradient(radial, t))
    mean = np.trapezoid(ring * risk, t) / np.trapezoid(ring, t)
    assert found.risk_mean == pytest.approx(float(mean), rel=1e-4)
    long, short = sorted((level * along, level * away), reverse=True)
    room = (np.asarray(long), np.asarray(short), np.asarray(margin))
    lost = float(inflation.largest_clearance_error(*room))
    assert found.clearance_lost == pytest.approx(lost, rel=1e-8)
    polar = np.linspace(0.0, 0.5 * np.pi, 20001)  # from the long axis
    error = inflation.radial_error(*room, polar)
    assert found.gap_min == pytest.approx(-float(error.max()), rel=1e-6)
    assert found.gap_max == pytest.approx(0.0, abs=1e-9)
    solid = np.sin(polar) if prolate else np.cos(polar)
    assert found.gap_mean == pytest.approx(-float(np.trapezoid(solid * error, polar)), rel=1e-3)


def test_means_of_three_different_axes_by_monte_carlo() -> None:
    """A point of the ellipsoid per direction, weighted with the area that it stands for."""
    region, margin, rng = MahalanobisEllipse(), 0.5, np.random.default_rng(1)
    deviations = np.array([1.0, 0.5, 0.2])
    level = region.level(0.1, 3)
    found = measure(region, obstacle(*deviations), margin, level)
    n = rng.standard_normal((20_000, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    axes = level * deviations + margin
    area = np.linalg.norm(n / axes, axis=1)
    risk = collision_probability(axes * n, np.diag(deviations**2), margin, 32)
    mean = float((area * risk).sum() / area.sum())
    spread = float(np.std(area * (risk - mean)) / area.mean() / np.sqrt(len(n)))
    assert abs(found.risk_mean - mean) < 4.0 * spread
    exact = 1.0 / sum_gauge(n, level * deviations, np.asarray(margin))
    gap = 1.0 / np.linalg.norm(n / axes, axis=1) - exact
    assert abs(found.gap_mean - gap.mean()) < 4.0 * gap.std() / np.sqrt(len(n))
    assert found.area == pytest.approx(4.0 / 3.0 * math.pi * axes.prod())
    whole = float(sum_volume(level * deviations, np.asarray(margin)))
    assert found.area_ratio == pytest.approx(found.area / whole)


def test_tails_of_boxes() -> None:
    """Independent components in closed form; correlated ones by a million draws."""
    own = EigenRectangle()
    found = measure(own, obstacle(1.0, 0.5, 0.2), 0.5, own.level(0.1, 3))
    assert found.tail == pytest.approx(0.1, rel=5e-4)
    region, thing = LuetkepohlRectangle(), obstacle(1.0, 0.5, 0.2)
    level = region.level(0.1, 3)
    found = measure(region, thing, 0.5, level)
    rng, count = np.random.default_rng(2), 1_000_000
    draws = rng.standard_normal((count, 3)) @ np.linalg.cholesky(thing.covariance).T
    half = level * np.sqrt(np.diagonal(thing.covariance))
    outside = float((np.abs(draws) > half).any(axis=1).mean())
    assert abs(found.tail - outside) < 4.0 * np.sqrt(0.1 / count)
    assert found.tail < found.promised_tail == pytest.approx(0.1)


def test_extremes_of_a_box_are_on_its_faces_and_corners() -> None:
    """The nearest face has the largest risk; sharp corners, all alike, the smallest."""
    region, deviations, margin = LuetkepohlRectangle("box"), np.array([1.0, 0.5, 0.2]), 0.6
    level = region.level(0.05, 3)
    found = measure(region, obstacle(*deviations, turn=np.eye(3)), margin, level)
    half = level * deviations + margin
    faces = collision_probability(np.diag(half), np.diag(deviations**2), margin)
    corner = collision_probability(half, np.diag(deviations**2), margin)
    assert found.risk_max == pytest.approx(float(faces.max()), rel=1e-8)
    assert found.risk_min == pytest.approx(float(corner), rel=1e-3)
    assert found.risk_min >= float(corner) * (1 - 1e-9)
    assert found.area == pytest.approx(8.0 * half.prod())


def test_turning_the_scene_turns_the_region(monkeypatch: pytest.MonkeyPatch) -> None:
    """With few points: they turn along, so that no rule needs to be exact for this."""
    monkeypatch.setattr(region_risk, "_STEPS", 16)
    monkeypatch.setattr(region_risk, "_TAIL_STEPS", 16)
    region = MahalanobisEllipse()
    level = region.level(0.05, 3)
    first, second = (
        measure(region, obstacle(1.0, 0.5, 0.2, turn=turn), 0.9, level)
        for turn in (TURN, np.eye(3))
    )
    for name in ("tail", "risk_min", "risk_max", "risk_mean", "area", "clearance_lost", "gap_min"):
        assert getattr(first, name) == pytest.approx(getattr(second, name), rel=1e-6), name


@pytest.mark.parametrize("name", SPATIAL)
def test_guarantees_hold_in_the_report(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the level for a tail and at that for a risk, with few points."""
    monkeypatch.setattr(region_risk, "_STEPS", 12)
    monkeypatch.setattr(region_risk, "_TAIL_STEPS", 16)
    monkeypatch.setattr(region_risk, "_CLOSE", 1e-2)
    region, thing = build("regions", name), obstacle(1.0, 0.4, 0.15)
    promises = region.guarantee is not Guarantee.NONE
    level = level_for_risk(region, 0.03, 3) if promises else region.level(0.03, 3)
    found = measure(region, thing, 0.9, level)
    assert 0.0 <= found.risk_min <= found.risk_mean <= found.risk_max * (1 + 1e-12) <= 1.0
    assert found.gap_min <= found.gap_mean <= found.gap_max + 1e-12
    assert found.area == float(region.area(region.parameters(thing, np.asarray(0.9)), level))
    assert found.tail > 0.0
    if promises:
        assert found.risk_max <= 0.03 * (1 + 1e-6)
    if region.guarantee is Guarantee.CONTENT:
        assert found.risk_max <= found.promised_tail * (1 + 1e-6)


def test_singular_and_zero_covariances() -> None:
    region = MinkowskiSum()
    level = region.level(0.05, 3)
    for deviations in ((1.0, 0.0, 0.0), (1.0, 0.5, 0.0), (0.0, 0.0, 0.0)):
        found = measure(region, obstacle(*deviations, turn=np.eye(3)), 0.8, level)
        assert found.area_ratio == pytest.approx(1.0)
        worst = special.ndtr(-level) if deviations[0] > 0.0 else 1.0
        assert 0.0 <= found.risk_min <= found.risk_max <= worst
        assert abs(found.gap_min) < 1e-9 and abs(found.gap_max) < 1e-9
        assert math.isnan(found.tail)


def test_bad_input_is_named() -> None:
    region = MinkowskiSum()
    with pytest.raises(WideberthError, match="is empty"):
        measure(region, obstacle(0.0, 0.0, 0.0), 0.0, 2.0)
    with pytest.raises(WideberthError, match="lower it"):
        measure(region, obstacle(1.0, 1.0, 1.0), 1.0, 60.0)
    with pytest.raises(WideberthError, match="margin"):
        measure(region, obstacle(1.0, 1.0, 1.0), -1.0, 2.0)
