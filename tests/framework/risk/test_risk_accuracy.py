"""Collision probability to 1e-9 everywhere: one complex integral against cut quadrature."""

from typing import Any

import numpy as np
import pytest
from scipy import special
from scipy.stats import norm

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.risk.inversion import log_probability

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(24)
STEPS = np.arange(-12, 13)
LARGE_DIGITS = np.finfo(np.longdouble).eps < 1e-18
LEAST = 1e-9 if LARGE_DIGITS else 1e-6
"""Smallest deviation at which the oracle, which works in long double, knows its own digits."""
DECADES = np.arange(-5, 3)


def cases(rng: np.random.Generator, size: int, count: int) -> tuple[Any, Any]:
    """Draw places and deviations (n, D) in the eigenframe, large to small, for radius 1.

    Every decade of the largest deviation from 1e-5 to 1e3 with conditions up to 1e8; places
    around the rim and elsewhere, half of them close to an axis, out to 7 deviations.
    """
    largest = 10.0 ** (rng.integers(-5, 3, count) + rng.random(count))
    s = np.clip(largest[:, None] * 10.0 ** -rng.uniform(0, 4, (count, size)), LEAST, None)
    s[:, 0] = largest
    s = -np.sort(-s, axis=1)
    ray = rng.standard_normal((count, size))
    ray *= np.where(rng.random(count) < 0.5, 1.0, 0.0)[:, None] + 10.0 ** rng.uniform(
        -6, 0, (count, size)
    )
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    ray *= np.where(rng.random(count) < 0.6, 1.0, rng.uniform(0, 1.6, count))[:, None]
    spread = rng.uniform(0, 5, (count, 1))
    return np.abs(ray + s * rng.standard_normal((count, size)) * spread), s


def panels(cuts: Any) -> tuple[Any, Any, Any]:
    """Nodes f and weights, between all cuts of sin f in [-1, 1], and cos f, in long double."""
    edges = np.unique(np.arcsin(np.clip(cuts, -1, 1)))
    half = 0.5 * np.diff(edges)[:, None]
    f = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * POINTS
    return np.sin(f), np.cos(f), (half * WEIGHTS).astype(float)


def heights(chords: Any) -> Any:
    """Both places sin f at which half the chord is as given, and the ends and the middle."""
    inside = chords[(chords > 0) & (chords < 1)]
    height = np.sqrt((1 - inside) * (1 + inside))
    return np.concatenate([height, -height, [-1, 0, 1]])


def quadrature(place: Any, deviations: Any) -> float:
    """P by cuts at every deviation of each coordinate.

    Outer variable along the small deviation, inner one in closed form; between two cuts no
    argument of the integrand changes by more than about one deviation, so that 24 nodes
    leave nothing.
    """
    (x, y), (s1, s2) = (np.asarray(value, np.longdouble) for value in (place, deviations))
    chords = np.concatenate([x + STEPS * s1, -x + STEPS * s1])
    height, chord, weight = panels(np.concatenate([y + STEPS * s2, heights(chords)]))
    offset = ((height - y) / s2).astype(float)
    ahead, behind = (((sign * chord - x) / s1).astype(float) for sign in (1, -1))
    density = np.exp(-0.5 * offset**2) / np.sqrt(2 * np.pi)
    step = weight * (chord / s2).astype(float)
    # Seen from the side on which both are tails, the difference keeps its digits.
    between = special.ndtr(ahead) - special.ndtr(behind)
    return float((density * step * between).sum())


def layers(place: Any, deviations: Any) -> float:
    """P of a ball by cut quadrature over the discs it is made of, each by the 2-D function."""
    y, s = np.longdouble(place[2]), np.longdouble(deviations[2])
    ladder = 2.0 ** np.arange(-2, np.log2(12 * deviations[0] / deviations[1]) + 1)
    offsets = np.concatenate([-ladder, ladder]) * deviations[1]
    chords = np.longdouble(np.hypot(*place[:2])) + np.append(offsets, 0.0)
    height, chord, weight = panels(np.concatenate([y + STEPS * s, heights(chords)]))
    offset = ((height - y) / s).astype(float)
    density = np.exp(-0.5 * offset**2) / np.sqrt(2 * np.pi) * (chord / s).astype(float)
    inner = collision_probability(place[:2], np.diag(deviations[:2] ** 2), chord.astype(float))
    return float((density * weight * inner).sum())


def per_decade(error: Any, deviations: Any) -> str:
    """Worst error for each decade of the largest deviation over the radius."""
    decade = np.floor(np.log10(deviations[:, 0]))
    worst = {int(k): error[decade == k].max(initial=0.0) for k in DECADES}
    return ", ".join(f"1e{k}: {value:.1e}" for k, value in worst.items())


def squared(deviations: Any) -> Any:
    return deviations[..., None] ** 2 * np.eye(deviations.shape[-1])


def test_against_cut_quadrature() -> None:
    x, s = cases(np.random.default_rng(5), 2, 4000)
    want = np.array([quadrature(*one) for one in zip(x, s, strict=True)])
    likely = want > 1e-12
    assert likely.mean() > 0.8
    error = np.abs(collision_probability(x, squared(s), 1.0)[likely] / want[likely] - 1.0)
    assert error.max() < 1e-9, per_decade(error, s[likely])


def test_ball_against_layers() -> None:
    x, s = cases(np.random.default_rng(6), 3, 400)
    want = np.array([layers(*one) for one in zip(x, s, strict=True)])
    likely = want > 1e-12
    assert likely.mean() > 0.7
    error = np.abs(collision_probability(x, squared(s), 1.0)[likely] / want[likely] - 1.0)
    assert error.max() < 1e-9, per_decade(error, s[likely])


def test_one_thick_direction_among_thin_ones() -> None:
    """Across the rim: inside, the normal distribution along the thick direction; outside, falling.

    With deviations of 1, 1e-8 and 1e-9 radii Newton's method took all its steps to cross the part
    between the two scales, and the integrand overflowed.
    """
    along, angle = 1.8, 0.07
    log_risks = []
    for off in (0.9, 0.999, 1.0 + 1e-6, 1.0 + 3.5e-5, 1.001, 1.5):
        place = [np.array(part) for part in (along, off * np.sin(angle), -off * np.cos(angle))]
        spreads = [np.array(part) for part in (1.0, 1e-8, 1e-9)]
        with np.errstate(all="raise", under="ignore"):
            log_risks.append(float(log_probability(place, spreads, np.array(1.0), 64)))
        if off < 1.0:
            half = np.sqrt(1.0 - off**2)
            wanted = norm.cdf(half - along) - norm.cdf(-half - along)
            assert np.exp(log_risks[-1]) == pytest.approx(wanted, rel=1e-5)
    assert np.all(np.diff(log_risks) < 0.0)
