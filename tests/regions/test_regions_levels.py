"""Levels of regions against tables and their own equation; content by Monte Carlo and exactly."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wideberth.framework.region import Region
from wideberth.regions import gaussian
from wideberth.regions.box import box_content
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.tests.helpers.region_samples import PAPER, packed
from wideberth.tests.oracles.region_levels import ellipse_level_of_content


@pytest.mark.parametrize(
    ("tail", "dimension", "level"),
    [  # chi-square quantiles to the digits of the tables
        (0.1, 2, 2.145966026289347),
        (0.05, 2, 2.447746830680816),
        (1e-12, 2, math.sqrt(24.0 * math.log(10.0))),
        (0.1, 3, 2.500277711),
        (0.05, 3, 2.795483483),
        (0.01, 3, 3.368214175),
    ],
)
def test_ellipse_level(tail: float, dimension: int, level: float) -> None:
    assert MahalanobisEllipse().level(tail, dimension) == pytest.approx(level, rel=1e-9)
    assert MinkowskiSum().level(tail, dimension) == pytest.approx(level, rel=1e-9)


def test_three_dimensional_level_solves_its_equation() -> None:
    for tail in (0.5, 0.05, 1e-6):
        s = gaussian.ellipse_level(tail, 3)
        got = math.erfc(s / math.sqrt(2)) + math.sqrt(2 / math.pi) * s * math.exp(-(s**2) / 2)
        assert got == pytest.approx(tail, rel=1e-10)


def test_level_keeps_its_digits_at_both_ends() -> None:
    assert ellipse_level_of_content(1e-12) == pytest.approx(math.sqrt(2e-12), rel=1e-12)
    assert ellipse_level_of_content(0.4, 3) == pytest.approx(
        gaussian.ellipse_level(0.6, 3), rel=1e-12
    )
    for region in PAPER:
        assert region.tail(region.level(1e-12)) == pytest.approx(1e-12, rel=1e-9)


def test_the_papers_level_is_not_quite_95_percent() -> None:
    assert 1 - MahalanobisEllipse().tail(math.sqrt(5.991)) == pytest.approx(0.9499884, abs=1e-7)


def test_bonferroni_level() -> None:
    region = LuetkepohlRectangle()
    assert region.level(0.1) == pytest.approx(1.959963984540054, rel=1e-12)
    assert region.level(0.05) == pytest.approx(2.241402727604945, rel=1e-12)
    assert region.tail(0.0) == 1.0


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("region", PAPER, ids=repr)
def test_content_is_kept(region: Region, dimension: int) -> None:
    rng = np.random.default_rng(3)
    root = rng.standard_normal((dimension, dimension))
    covariance, count, tail = root @ root.T, 40_000, 0.1
    parameters = packed(region, covariance, margin=0.0)
    draws = np.arange(1.0, dimension + 1.0) + rng.standard_normal((count, dimension)) @ root.T
    level = np.asarray(region.level(tail, dimension))
    share = float(region.contains(draws, parameters, level).mean())
    sigma = math.sqrt(tail * (1 - tail) / count)
    if isinstance(region, LuetkepohlRectangle):
        assert share > 1 - tail - 3 * sigma
        assert share < 1 - 0.5 * tail  # Bonferroni wastes less than half
    else:
        assert share == pytest.approx(1 - tail, abs=3 * sigma)


@pytest.mark.parametrize(
    ("rho", "content"),
    [(0.0, 0.9025), (0.3, 0.904879), (0.5, 0.909254), (0.8, 0.921942), (0.95, 0.935429)],
)
def test_content_of_the_rectangle(rho: float, content: float) -> None:
    half = np.full(2, LuetkepohlRectangle().level(0.1))
    got = box_content(half * np.array([2.0, 0.5]), np.array([[4.0, rho], [rho, 0.25]]))
    assert got == pytest.approx(content, abs=6e-7)


@pytest.mark.parametrize(
    ("rho", "ratio"), [(0.0, 1.0621), (0.5, 1.2264), (0.8, 1.7701), (0.95, 3.4014)]
)
def test_rectangle_is_larger_than_the_ellipse(rho: float, ratio: float) -> None:
    covariance = [[1.0, rho], [rho, 1.0]]
    box, ellipse = LuetkepohlRectangle(), MahalanobisEllipse()
    areas = [
        float(one.area(packed(one, covariance, 0.0), np.asarray(one.level(0.1))))
        for one in (box, ellipse)
    ]
    assert areas[0] / areas[1] == pytest.approx(ratio, abs=6e-5)


def enlarged(region: Region, covariance: np.ndarray, margin: float, tail: float) -> float:
    """Area of a region of content 1 - tail, enlarged by the margin."""
    return float(region.area(packed(region, covariance, margin), np.asarray(region.level(tail))))


@given(
    logs=st.tuples(*[st.floats(-3.0, 3.0)] * 2),
    rho=st.floats(-0.999, 0.999),
    margin=st.floats(0.0, 1e3),
    tail=st.floats(1e-6, 0.9),
    correction=st.sampled_from(["bonferroni", "sidak"]),
)
@settings(max_examples=200, deadline=None)
def test_enlarged_rectangle_is_larger_than_the_papers_enlarged_ellipse(
    logs: tuple[float, float], rho: float, margin: float, tail: float, correction: Any
) -> None:
    """Every term of its area is; of the exact sum it has more than z / s, where z < s."""
    deviation = 10.0 ** np.array(logs)
    covariance = np.outer(deviation, deviation) * np.array([[1.0, rho], [rho, 1.0]])
    box, exact = LuetkepohlRectangle(correction=correction), MinkowskiSum()
    area = enlarged(box, covariance, margin, tail)
    assert area > enlarged(MahalanobisEllipse(), covariance, margin, tail)
    share = min(1.0, box.level(tail) / exact.level(tail))
    assert area > share * enlarged(exact, covariance, margin, tail)


def test_rectangle_holds_more_than_the_ellipse_at_every_level() -> None:
    """4 z^2 > pi s^2, the only step of the proof that depends on the level."""
    tails = np.geomspace(1e-12, 0.999, 400)
    box, ellipse = LuetkepohlRectangle(), MahalanobisEllipse()
    z = np.array([box.level(tail) for tail in tails])
    s = np.array([ellipse.level(tail) for tail in tails])
    assert (4.0 * z**2 > 1.0619 * np.pi * s**2).all()
    assert (z / s).min() == pytest.approx(0.9133, abs=5e-5)


@pytest.mark.parametrize(
    ("second", "margin", "ratio"), [(0.1, 1.5, 0.9974), (1e-3, 0.2, 0.9212), (1e-6, 1e-3, 0.9136)]
)
def test_enlarged_rectangle_can_be_smaller_than_the_exact_sum(
    second: float, margin: float, ratio: float
) -> None:
    covariance = np.diag([1.0, second**2])
    area = enlarged(LuetkepohlRectangle(), covariance, margin, 0.1)
    exact = enlarged(MinkowskiSum(), covariance, margin, 0.1)
    assert area / exact == pytest.approx(ratio, abs=6e-5)
