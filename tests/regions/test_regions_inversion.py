"""The collision probability by one complex integral, as the risk contour has it in the MPC."""

from typing import Any

import numpy as np
import pytest
from scipy import special, stats

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.risk.inversion import log_probability


def cases(rng: np.random.Generator, count: int, size: int) -> tuple[Any, Any, Any]:
    """Offsets and deviations in the eigenframe with conditions up to 1e6, radii."""
    largest = 10.0 ** rng.uniform(-1.5, 1.0, (count, 1))
    s = largest * 10.0 ** rng.uniform(-3.0, 0.0, (count, size))
    radius = 10.0 ** rng.uniform(-1.0, 0.7, count)
    ray = rng.standard_normal((count, size))
    ray *= (radius * rng.uniform(0.0, 1.6, count) / np.linalg.norm(ray, axis=1))[:, None]
    x = ray + s * rng.standard_normal((count, size)) * rng.uniform(0.0, 4.0, (count, 1))
    return x, s, radius


def risk(x: Any, s: Any, radius: Any, nodes: int) -> Any:
    return np.exp(log_probability(list(x.T), list(s.T), radius, nodes))


@pytest.mark.parametrize("size", [2, 3])
def test_few_nodes_against_many(size: int) -> None:
    """The other function, with 64 nodes, is held against quadrature in test_risk_accuracy."""
    x, s, radius = cases(np.random.default_rng(size), 3000, size)
    wanted = collision_probability(x, s[..., None] ** 2 * np.eye(size), radius)
    likely = wanted > 1e-15
    assert likely.mean() > 0.5
    for nodes, near in ((24, 1e-6), (40, 5e-9)):
        got = risk(x, s, radius, nodes)
        np.testing.assert_allclose(got[likely], wanted[likely], rtol=near)


@pytest.mark.parametrize("size", [2, 3])
def test_round_covariances_in_closed_form(size: int) -> None:
    """|D|^2 / sigma^2 is noncentral chi-square."""
    rng = np.random.default_rng(4)
    x, _, radius = cases(rng, 300, size)
    s = 10.0 ** rng.uniform(-1.0, 1.0, 300) * radius
    square = (x**2).sum(axis=1) / s**2
    wanted = stats.ncx2.cdf((radius / s) ** 2, size, square)
    likely = wanted > 1e-10  # SciPy's own digits end below
    got = risk(x, np.repeat(s[:, None], size, axis=1), radius, 40)
    np.testing.assert_allclose(got[likely], wanted[likely], rtol=1e-8)


def test_far_tails_and_limits() -> None:
    """Far out the nearest point of the disc decides; small discs see the density alone."""
    far = log_probability([np.float64(1000.0), np.float64(0.0)], [1.0, 1.0], 1.0, 24)
    assert far == pytest.approx(-0.5 * 999.0**2, rel=1e-4)
    small = log_probability([np.float64(0.7), np.float64(0.2)], [1.0, 0.5], 1e-9, 24)
    density = -0.5 * (0.7**2 + 0.4**2) - np.log(2.0 * np.pi * 0.5)
    assert small == pytest.approx(density + np.log(np.pi * 1e-18), rel=1e-9)
    # A known position is met or not; a flat Gaussian meets a chord.
    for offset, wanted in ((0.999999, 0.0), (0.5, 0.0), (0.0, 0.0)):
        got = log_probability([np.float64(0.0), np.float64(offset)], [1e-9, 1e-9], 1.0, 24)
        assert got == pytest.approx(wanted, abs=1e-6)
    assert log_probability([np.float64(0.0), np.float64(1.000001)], [1e-9, 1e-9], 1.0, 24) < -1e5
    flat = log_probability([np.float64(0.3), np.float64(0.6)], [1.0, 1e-9], 1.0, 40)
    chord = special.ndtr((0.8 - 0.3) / 1.0) - special.ndtr(-0.8 - 0.3)
    assert flat == pytest.approx(np.log(chord), abs=1e-7)


@pytest.mark.parametrize("size", [2, 3])
def test_symbols_follow_numbers(size: int) -> None:
    x, s, radius = cases(np.random.default_rng(8), 400, size)
    place, spread, room = ca.SX.sym("x", size), ca.SX.sym("s", size), ca.SX.sym("r")
    value = log_probability(
        [place[i] for i in range(size)], [spread[i] for i in range(size)], room, 24
    )
    slope = ca.gradient(value, place)
    function = ca.Function("log_p", [place, spread, room], [value, slope])
    got, gradient = (np.asarray(out.full()) for out in function(x.T, s.T, radius[None]))
    wanted = log_probability(list(x.T), list(s.T), radius, 24)
    np.testing.assert_allclose(got[0], wanted, rtol=1e-10, atol=1e-12)
    assert np.isfinite(gradient).all()
    step = 1e-6 * s[:, 0]
    ends = [log_probability([x[:, 0] + h, *x.T[1:]], list(s.T), radius, 40) for h in (-step, step)]
    assert gradient[0] * s[:, 0] == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-4, abs=1e-4)
