"""Declared guarantees against the exact collision probability on the boundary, in bulk."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import special

from wideberth.framework.plugins import registry
from wideberth.framework.region import Guarantee, Region
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.risk.level_for_risk import level_for_risk
from wideberth.framework.testing.region_cases import RegionCase, sphere
from wideberth.regions.risk_contour import RiskContour
from wideberth.tests.helpers.region_variants import draw_cases, variants

KINDS = [registry.load("regions", name) for name in registry.names("regions")]
ALL = [(one, size) for kind in KINDS for one in variants(kind) for size in one.dimensions]


def which(*guarantees: Guarantee) -> Any:
    """Parametrise over the regions that declare one of these guarantees."""
    chosen = [(one, size) for one, size in ALL if one.guarantee in guarantees]
    names = [f"{one!r}-{size}D" for one, size in chosen]
    return pytest.mark.parametrize(("region", "size"), chosen, ids=names)


COUNT = {2: 4_000, 3: 800}
NEAR = 1e-6
"""Relative. At condition 1e8 the smallest eigenvalue keeps eight digits, and a tail of 1e-12
changes sixty times as much as it does."""


def boundary_risk(case: RegionCase, rng: np.random.Generator, asked: Any) -> Any:
    """True risk just outside the boundary over the one asked for, one ray per obstacle.

    The rays are random or principal axes.
    """
    rays = case.rays(sphere(rng, len(case.mean), case.size))
    offset = case.reach(rays)[1][:, None] * rays
    return collision_probability(offset, case.covariance, case.margin) / asked


def nested(place: Any, deviations: Any, radius: Any) -> Any:
    """Pr(|X| < radius) for X ~ N(place, diag(deviations^2)) by quadrature, last coordinate first.

    40 panels of 16 nodes over the part of the ball within 16 deviations; written down here,
    since `RiskContour` and the probability share their formula.
    """
    last, deviation = place[-1], deviations[-1]
    if len(place) == 1:
        ends = (np.array([1.0, -1.0])[:, None] * radius - abs(last)) / deviation
        return special.ndtr(ends[0]) - special.ndtr(ends[1])
    points, weights = np.polynomial.legendre.leggauss(16)
    low, high = np.clip(last + 16.0 * deviation * np.array([[-1.0], [1.0]]), -radius, radius)
    turn = np.arcsin(low / radius), np.arcsin(high / radius)
    width = (turn[1] - turn[0]) / 40.0
    angle = turn[0] + width * (np.arange(40)[:, None, None] + 0.5 + 0.5 * points[:, None])
    angle, share = angle.reshape(640, -1), np.tile(weights, 40)[:, None] * 0.5 * width
    density = np.exp(-0.5 * ((radius * np.sin(angle) - last) / deviation) ** 2)
    chord = radius * np.cos(angle)
    inner = nested(place[:-1], deviations[:-1], chord.ravel()).reshape(chord.shape)
    total = (share * density * chord * inner).sum(axis=0)
    return total / (np.sqrt(2.0 * np.pi) * deviation)


@which(Guarantee.CONTENT, Guarantee.RISK)
def test_no_risk_above_the_tail(region: Region, size: int) -> None:
    """Random covariances up to condition 1e8, tails of 1e-12 to 0.9, empty regions included."""
    rng = np.random.default_rng(41)
    case = draw_cases(region, size, COUNT[size], rng)
    share = boundary_risk(case, rng, case.tail)
    assert share.max() <= 1.0 + NEAR
    assert share.max() > 0.05  # not by being far too large for all of them


@pytest.mark.parametrize(("size", "count"), [(2, 60), (3, 12)])
def test_contour_by_nested_quadrature(size: int, count: int) -> None:
    """The true risk on the contour is the one asked for, by a formula that it does not use."""
    rng = np.random.default_rng(44)
    case = draw_cases(RiskContour(), size, count, rng, condition=1e5)
    rays = case.rays(sphere(rng, count, size))
    reach = case.reach(rays)[1]
    for i in np.flatnonzero(reach > 1e-6):  # empty where even at the mean the risk is smaller
        values, vectors = np.linalg.eigh(case.covariance[i])
        place = (vectors.T @ (reach[i] * rays[i]))[::-1]
        risk = nested(place, np.sqrt(values)[::-1], case.margin[i : i + 1])[0]
        shared = collision_probability(place, np.diag(values[::-1]), case.margin[i])
        assert risk == pytest.approx(float(shared), rel=1e-9)
        assert risk == pytest.approx(case.tail[i], rel=1e-6)  # the bracket of a far boundary


@which(Guarantee.RISK)
def test_level_for_risk(region: Region, size: int) -> None:
    """The level chosen for a risk keeps it, and is below the one that keeps the content."""
    rng = np.random.default_rng(42)
    case = draw_cases(region, size, COUNT[size], rng)
    case = replace(case, tail=0.55 * case.tail)  # a risk of 1/2 is kept by the disc alone
    plain, kept = case.level, [level_for_risk(region, float(t), size) for t in case.tail]
    assert (np.array(kept) < plain).all()
    content = np.array([region.tail(level, size) for level in kept])
    assert boundary_risk(replace(case, tail=content), rng, case.tail).max() <= 1.0 + NEAR


@which(Guarantee.CONTENT)
def test_a_tail_is_a_risk(region: Region, size: int) -> None:
    for risk in (1e-12, 1e-3, 0.4):
        assert level_for_risk(region, risk, size) == region.level(risk, size)


@which(Guarantee.NONE)
def test_none_is_honest(region: Region, size: int) -> None:
    """There are covariances at which the risk is ten times the tail and more."""
    rng = np.random.default_rng(43)
    case = draw_cases(region, size, 500, rng)
    assert boundary_risk(case, rng, case.tail).max() > 10.0
