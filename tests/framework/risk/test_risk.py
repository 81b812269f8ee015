"""Collision risk against closed forms, Monte Carlo, quadrature and the half-plane bound."""

import math

import numpy as np
import pytest
from scipy import integrate, special, stats

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.oracles.risk_bounds import half_plane_bound, half_plane_level


def turned(angle: float, first: float, second: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([first**2, second**2]) @ turn.T


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("deviation", [0.05, 0.7, 3.0])
def test_round_covariances(dimension: int, deviation: float) -> None:
    direction = np.ones(dimension) / math.sqrt(dimension)
    for distance in (0.0, 1.0, 1.52, 2.5, 4.0):
        got = collision_probability(distance * direction, deviation**2 * np.eye(dimension), 1.5)
        scaled = (1.5 / deviation) ** 2
        want = stats.ncx2.cdf(scaled, dimension, max((distance / deviation) ** 2, 1e-12))
        assert float(got) == pytest.approx(want, rel=1e-8, abs=1e-13)


@pytest.mark.parametrize("deviation", 10.0 ** np.arange(-8, 0))
def test_round_covariances_at_the_rim(deviation: float) -> None:
    """In 3-D the noncentral chi-square distribution is elementary."""
    for level in np.linspace(-5.0, 5.0, 11):
        distance = 1.0 + level * deviation
        near, far = (1.0 - distance) / deviation, (-1.0 - distance) / deviation
        density = math.exp(-0.5 * near**2) - math.exp(-0.5 * far**2)
        want = special.ndtr(near) - special.ndtr(far)
        want -= deviation / distance * density / math.sqrt(2 * math.pi)
        got = collision_probability([0.0, distance, 0.0], deviation**2 * np.eye(3), 1.0)
        assert float(got) == pytest.approx(want, rel=1e-9)


def test_one_difference_and_many_covariances() -> None:
    sigma = np.stack([scale * np.eye(2) for scale in (0.1, 0.4, 1.0, 2.0, 5.0)])
    found = collision_probability([1.0, 0.5], sigma, 0.6)
    one_by_one = [float(collision_probability([1.0, 0.5], one, 0.6)) for one in sigma]
    np.testing.assert_allclose(found, one_by_one, rtol=1e-12)


def test_thin_covariance_against_adaptive_quadrature() -> None:
    for x, y, first, second in (
        (3.0, 1.0, 1.0, 0.5),
        (0.4, 1.45, 2.0, 1e-3),
        (2.0, 1.6, 1.0, 0.1),
    ):

        def slice_(
            w: float, x: float = x, y: float = y, s: float = first, t: float = second
        ) -> float:
            chord = math.sqrt(max(2.25 - w * w, 0.0))
            inner = special.ndtr((chord - x) / s) - special.ndtr((-chord - x) / s)
            return float(inner * math.exp(-0.5 * ((w - y) / t) ** 2) / t / math.sqrt(2 * math.pi))

        low, high = max(-1.5, y - 12 * second), min(1.5, y + 12 * second)
        want, _ = integrate.quad(slice_, low, high, epsabs=1e-15, epsrel=1e-11, limit=400)
        got = collision_probability([x, y], turned(0.0, first, second), 1.5)
        assert float(got) == pytest.approx(want, rel=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_monte_carlo(dimension: int) -> None:
    rng = np.random.default_rng(0)
    count = 100_000
    for _ in range(4):
        root = rng.standard_normal((dimension, dimension))
        mean = rng.standard_normal(dimension)
        draws = mean + rng.standard_normal((count, dimension)) @ root.T
        share = float((np.linalg.norm(draws, axis=1) < 1.2).mean())
        got = float(collision_probability(mean, root @ root.T, 1.2))
        assert share == pytest.approx(got, abs=3 * math.sqrt(got * (1 - got) / count))


def test_degenerate_covariances_are_limits() -> None:
    zero = np.zeros((2, 2))
    assert float(collision_probability([1.0, 0.5], zero, 1.5)) == 1.0
    assert float(collision_probability([1.0, 1.5], zero, 1.5)) == 0.0
    assert float(collision_probability([0.1, 0.2, 0.3], np.zeros((3, 3)), 1.5)) == 1.0
    line = turned(0.3, 1.0, 0.0)
    for point in ([2.0, 0.4], [0.3, 0.1], [0.0, 3.0]):
        limit = float(collision_probability(point, line, 1.5))
        near = float(collision_probability(point, turned(0.3, 1.0, 1e-6), 1.5))
        assert limit == pytest.approx(near, rel=1e-5, abs=1e-12)
    chord = math.sqrt(1.5**2 - 0.4**2)
    want = special.ndtr(chord - 2.0) - special.ndtr(-chord - 2.0)
    got = collision_probability([2.0, 0.4], np.diag([1.0, 0.0]), 1.5)
    assert float(got) == pytest.approx(want, rel=1e-12)
    flat = collision_probability([2.0, 0.4, 0.0], np.diag([1.0, 0.0, 0.0]), 1.5)
    assert float(flat) == pytest.approx(want, rel=1e-12)
    assert float(collision_probability([0.0, 0.0], np.eye(2), 0.0)) == 0.0


def test_deep_tails_keep_their_digits() -> None:
    # Rotating a round covariance changes nothing, though the integration axis changes.
    want = stats.ncx2.cdf(1.5**2, 2, 12.0**2)
    for angle in (0.0, 0.4, math.pi / 2):
        point = [12 * math.cos(angle), 12 * math.sin(angle)]
        assert float(collision_probability(point, np.eye(2), 1.5)) == pytest.approx(want, rel=1e-6)


def test_more_nodes_change_nothing() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        first, ratio = 10 ** rng.uniform(-2, 1.5), 10 ** rng.uniform(-3, 0)
        covariance = turned(rng.uniform(0, 3), first, first * ratio)
        point = rng.standard_normal(2) * (first + 1.0)
        coarse = float(collision_probability(point, covariance, 1.0))
        fine = float(collision_probability(point, covariance, 1.0, nodes=200))
        assert coarse == pytest.approx(fine, rel=1e-9, abs=1e-18)


def test_batch_is_the_same_as_one_by_one() -> None:
    rng = np.random.default_rng(2)
    points, radii = rng.standard_normal((5, 4, 2)) * 2, rng.uniform(0.2, 2, 4)
    deviations = [1.0, 0.3, 0.0, 1e-3]
    covariances = np.stack([turned(0.5, 1.0, second) for second in deviations])
    batch = collision_probability(points, covariances, radii)
    level = half_plane_level(points, covariances, radii)
    assert batch.shape == level.shape == (5, 4)
    for i in range(5):
        for j in range(4):
            one = (points[i, j], covariances[j], radii[j])
            assert float(collision_probability(*one)) == pytest.approx(float(batch[i, j]))
            assert float(half_plane_level(*one)) == pytest.approx(float(level[i, j]))


def test_half_plane_bound_holds_and_is_the_best() -> None:
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2 * np.pi, 20001)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for _ in range(40):
        covariance = turned(rng.uniform(0, 3), 1.0, 10 ** rng.uniform(-2, 0))
        point, radius = rng.standard_normal(2) * 4, rng.uniform(0.0, 1.5)
        bound = float(half_plane_bound(point, covariance, radius))
        assert float(collision_probability(point, covariance, radius)) <= bound + 1e-15
        spread = np.sqrt(np.einsum("ni,ij,nj->n", normals, covariance, normals))
        scanned = float(((normals @ point - radius) / spread).max())
        if np.linalg.norm(point) > radius:
            got = float(half_plane_level(point, covariance, radius))
            assert got == pytest.approx(scanned, rel=1e-3)
            assert got >= scanned - 1e-9
        else:
            assert bound == 1.0


def test_half_plane_level_of_what_cannot_be_reached() -> None:
    line = np.diag([1.0, 0.0])
    assert math.isinf(float(half_plane_level([0.0, 2.0], line, 1.5)))
    assert float(half_plane_bound([0.0, 2.0], line, 1.5)) == 0.0
    # sqrt(1.5^2 - 0.9^2) = 1.2: the segment touches the disc from 3 - 1.2 on.
    tangent = float(half_plane_level([3.0, 0.8], line, 1.0))
    assert tangent == pytest.approx(2.4, rel=1e-9)
    assert math.isinf(float(half_plane_level([3.0, 0.8], np.zeros((2, 2)), 1.0)))
    # What has no size is not reached by what has no width, not even on the line itself.
    assert math.isinf(float(half_plane_level([2.0, 0.0], np.diag([0.25, 0.0]), 0.0)))


@pytest.mark.parametrize("scale", [1e-6, 1e-2, 1e3])
def test_the_unit_of_length_changes_nothing(scale: float) -> None:
    rng = np.random.default_rng(11)
    points, radii = 3.0 * rng.standard_normal((50, 2)), rng.uniform(0.0, 1.5, 50)
    spreads = np.stack([turned(rng.uniform(0, 3), 1.0, 10 ** rng.uniform(-2, 0)) for _ in points])
    for level in (half_plane_level, collision_probability):
        metres = level(points, spreads, radii)
        other = level(scale * points, scale**2 * spreads, scale * radii)
        np.testing.assert_allclose(other, metres, rtol=1e-9)


def test_bad_input_is_named() -> None:
    with pytest.raises(WideberthError, match="radius is -1"):
        collision_probability([0.0, 0.0], np.eye(2), -1.0)
    with pytest.raises(WideberthError, match="shape"):
        collision_probability([0.0], np.eye(2), 1.0)
    with pytest.raises(WideberthError, match="finite"):
        collision_probability([np.nan, 0.0], np.eye(2), 1.0)
