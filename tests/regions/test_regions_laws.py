"""Every registered region at scale: symbolic against numeric, limits, area against quadrature."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth.framework.plugins import registry
from wideberth.framework.region import Region
from wideberth.framework.testing.numeric_constraint import NumericConstraint, compile_constraint
from wideberth.framework.testing.region import Probe
from wideberth.framework.testing.region_cases import RegionCase, sphere, turned
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.region_variants import draw_cases, variants

KINDS = [registry.load("regions", name) for name in registry.names("regions")]
ALL = [(one, size) for kind in KINDS for one in variants(kind) for size in one.dimensions]
NAMES = [f"{one!r}-{size}D" for one, size in ALL]
every = pytest.mark.parametrize(("region", "size"), ALL, ids=NAMES)

EXAMPLES, RAYS = 10, 80
FACTORS = (0.0, 0.5, 0.999, 1.0 - 1e-5, 1.0 + 1e-5, 1.001, 1.5)
FACTORS_AT_RANDOM = 2
"""Per ray also this many multiples at random: 10 * 80 * (7 + 2) = 7200 points."""

compiled: Any = cache(compile_constraint)


@st.composite
def obstacles(draw: st.DrawFn) -> dict[str, Any]:
    """Covariances up to condition 1e8 and singular ones, margins with 0, tails to both ends."""
    widest = 10.0 ** draw(st.floats(-2.0, 1.0))
    thinness = draw(st.lists(st.sampled_from([0.0, -1.0, -2.5, -4.0]), min_size=2, max_size=2))
    flat = draw(st.sampled_from([0, 0, 0, 0, 1, 2, 3]))
    return {
        "deviations": widest * np.array([1.0, *(10.0**t for t in sorted(thinness)[::-1])]),
        "flat": flat,
        "margin": draw(st.one_of(st.just(0.0), st.floats(-2.0, 1.0).map(lambda e: 10.0**e))),
        "tail": draw(
            st.one_of(
                st.sampled_from([1e-15, 1e-12, 0.05, 0.5, 0.99, 1.0 - 1e-9]),
                st.floats(-15.0, -0.01).map(lambda e: 10.0**e),
            )
        ),
        "seed": draw(st.integers(0, 2**20)),
    }


def build(region: Region, size: int, given: dict[str, Any]) -> RegionCase | None:
    """The case; None where the region rightly says that it is undefined."""
    rng = np.random.default_rng(given["seed"])
    deviations = given["deviations"][[0, -1] if size == 2 else [0, 1, 2]].copy()
    flat = min(given["flat"], size)
    deviations[size - flat :] = 0.0
    covariance = turned(rng, deviations)
    numbers = [np.asarray(given[name]) for name in ("margin", "tail")]
    case = RegionCase(region, rng.uniform(-5.0, 5.0, size), covariance, *numbers)
    try:
        assert np.isfinite(case.parameters).all()
    except WideberthError as error:
        assert flat and not region.singular_covariances, error
        assert "singular" in str(error)
        return None
    return case


@every
def test_symbolic_equals_numeric(region: Region, size: int) -> None:
    """At 7200 points, most of them within 1e-5 to 1e-3 of the boundary."""
    constraint: NumericConstraint = compiled(region, size)

    @settings(max_examples=EXAMPLES, derandomize=True, deadline=None, database=None)
    @given(obstacles())
    def check(drawn: dict[str, Any]) -> None:
        case = build(region, size, drawn)
        if case is None:
            return
        rng = np.random.default_rng(drawn["seed"])
        rays = case.rays(sphere(rng, RAYS, size))
        reach = case.reach(rays)[1][:, None] * rays
        free = rng.uniform(0.0, 3.0, (FACTORS_AT_RANDOM, RAYS, 1)) * rays
        points = case.mean + np.concatenate([*(factor * reach[None] for factor in FACTORS), free])
        points = points.reshape(-1, size)
        probe = Probe(case, constraint, True, reach, points)
        probe.check_sides()
        probe.check_guesses(rng)

    check()


@every
def test_numbers_stay_finite(region: Region, size: int) -> None:
    """Area, boundary and constraint at the corners of what is allowed; levels and tails too."""
    rng = np.random.default_rng(21)
    corners = [(0.0, 1e-15), (1.0, 1e-300), (1.0, 1.0 - 1e-9), (0.0, 1.0 - 1e-15)]
    for thin in (1.0, 1e-4, 0.0):
        covariance = turned(rng, np.array([1.0, 0.5, thin])[[0, *range(4 - size, 3)]])
        for margin, tail in corners:
            numbers = np.asarray(margin), np.asarray(tail)
            case = RegionCase(region, np.zeros(size), covariance, *numbers)
            try:
                parameters = case.parameters
            except WideberthError:
                assert thin == 0.0 and not region.singular_covariances
                continue
            level = float(case.level)
            assert np.isfinite(level) and 0.0 <= region.tail(level, size) <= 1.0
            area = region.area(parameters, case.level)
            assert np.isfinite(area) and area >= 0.0
            if size == 2:
                assert np.isfinite(region.boundary(parameters, level, 16)).all()


def quadrature(size: int, count: int) -> tuple[Any, Any]:
    """Directions over the circle or the sphere, not along the axes; weights that add up to 1."""
    ring = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    circle = np.stack([np.cos(ring), np.sin(ring)], axis=-1)
    if size == 2:
        return circle, np.full(count, 1.0 / count)
    height, share = np.polynomial.legendre.leggauss(count // 2)
    flat = np.sqrt(1.0 - height**2)[:, None, None] * circle
    up = np.broadcast_to(height[:, None, None], (*flat.shape[:2], 1))
    directions = np.concatenate([flat, up], axis=-1).reshape(-1, 3)
    directions = directions @ np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0]
    return directions, np.repeat(0.5 * share / count, count)


def counted_area(case: RegionCase) -> float:
    """Area or volume from `contains` alone: the mean D-th power of the reach, over directions.

    Rays are spread evenly in the frame in which the region's own second moments are round; to
    once its size is known, a rough reach will do to find it.
    """
    size, ball = case.size, np.pi if case.size == 2 else 4.0 / 3.0 * np.pi
    spread = case.rays(np.eye(size)).T
    for count, halvings in ((16, 36), *[(16, 14)] * 3, (240 if size == 2 else 30, 20)):
        directions, weights = quadrature(size, count)
        multiples = case.reach(directions @ spread.T, halvings)[0]
        total = float((weights * multiples**size).sum())
        volume = ball * abs(np.linalg.det(spread)) * total
        if not total > 0.0:
            return 0.0
        outer = np.einsum("k,ki,kj->ij", weights * multiples ** (size + 2), directions, directions)
        values, vectors = np.linalg.eigh(outer / total)
        spread = spread @ (vectors * np.sqrt(values)) * np.sqrt(size + 2.0)
    return volume


@every
def test_area(region: Region, size: int) -> None:
    """Random obstacles up to condition 1e8, against a quadrature that shares no formula."""
    for seed in range(6 if size == 2 else 4):
        drawn = draw_cases(region, size, 1, np.random.default_rng([22, seed]))
        given = [getattr(drawn, name)[0] for name in ("mean", "covariance", "margin", "tail")]
        case = RegionCase(region, *given)
        area = float(region.area(case.parameters, case.level))
        # The steps of the directions squared, which is what corners cost; smooth ones are nearer.
        near = 5e-4 if size == 2 else 1e-2
        assert area == pytest.approx(counted_area(case), rel=near, abs=1e-18)
