"""Closed forms of the enlarged ellipse that only tests need; symbols as in `regions.inflation`."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.regions.inflation import _axes, _direction, _share, means
from wideberth.regions.inflation import clearance_error as clearance_error
from wideberth.regions.inflation import ellipse_radius as ellipse_radius
from wideberth.regions.inflation import exact_radius as exact_radius
from wideberth.regions.inflation import largest_clearance_error as largest_clearance_error
from wideberth.regions.inflation import radial_error as radial_error


def effective_margin(a: Array, b: Array, margin: Array) -> Array:
    """Clearance to the content ellipse that the lengthened ellipse does keep, m."""
    arithmetic, harmonic = means(a, b)
    return np.asarray(margin * np.sqrt(_share(harmonic + margin, arithmetic + margin)))


def worst_normal_cosine(a: Array, b: Array, margin: Array) -> Array:
    """Squared cosine of the normal angle at which the clearance error is largest; a > 0."""
    total = np.asarray(a) + np.asarray(b)
    upper = 2.0 * np.asarray(b) * total + margin * (np.asarray(a) + 3.0 * np.asarray(b))
    return np.asarray(upper / (2.0 * total * (total + 2.0 * np.asarray(margin))))


def worst_polar_angle(a: Array, b: Array, margin: Array) -> Array:
    """Polar angle, rad, of the boundary point of the lengthened ellipse with that normal."""
    cosine = worst_normal_cosine(a, b, margin)
    upper = (np.asarray(b) + margin) ** 2 * np.sqrt(1.0 - cosine)
    return np.asarray(np.arctan2(upper, (np.asarray(a) + margin) ** 2 * np.sqrt(cosine)))


def support_error(a: Array, b: Array, margin: Array, angle: Array) -> Array:
    """Gap between the supporting lines with a normal angle, m."""
    n = _direction(angle)
    exact = np.hypot.reduce(_axes(a, b) * n, axis=-1) + margin
    longer = _axes(np.asarray(a) + margin, np.asarray(b) + margin)
    return np.asarray(exact - np.hypot.reduce(longer * n, axis=-1))


def smallest_margin(a: Array, b: Array, margin: Array) -> Array:
    """Smallest delta, m, for which axes a + delta, b + delta enclose the exact sum.

    The positive root of delta^3 + H delta^2 - rho^2 delta - rho^2 A = 0: the paper's "expanding
    the ellipse by more than r + r_d". Newton from the right is monotone (the cubic is convex).
    """
    arithmetic, harmonic = means(a, b)
    margin = np.asarray(margin, dtype=np.float64)
    bound = margin + 0.5 * (arithmetic - harmonic)
    scaled = margin * np.sqrt(_share(arithmetic, harmonic, empty=np.inf))
    start = np.where(margin > 0, np.minimum(bound, np.maximum(scaled, margin)), 0.0)
    return _cubic_root(1.0, harmonic, -(margin**2), -(margin**2) * arithmetic, start)


def smallest_level(sigma_1: Array, sigma_2: Array, level: Array, margin: Array) -> Array:
    """Smallest level s' at which axes s' sigma_i + margin enclose the exact sum of level s.

    The positive root of A1 H1 s'^3 + H1 rho s'^2 - s^2 A1 H1 s' - s^2 A1 rho = 0 with the means of
    the deviations: the paper's "choosing larger s". Infinite where sigma_2 = 0 < sigma_1.
    """
    arithmetic, harmonic = means(sigma_1, sigma_2)
    level, margin = np.asarray(level, dtype=np.float64), np.asarray(margin, dtype=np.float64)
    growth = np.sqrt(_share(arithmetic, harmonic, empty=np.inf))
    finite = np.isfinite(growth)
    start = level * np.where(finite, growth, 1.0)
    slope = -(level**2) * arithmetic * harmonic
    root = _cubic_root(
        arithmetic * harmonic, harmonic * margin, slope, -(level**2) * arithmetic * margin, start
    )
    pointlike = arithmetic == 0
    return np.asarray(np.where(pointlike, level, np.where(finite | (margin == 0), root, np.inf)))


def effective_level_ratio(a: Array, b: Array, margin: Array) -> Array:
    """Largest g for which the lengthened ellipse of level s encloses the exact sum of g s.

    sqrt((H / A) (A + rho) / (H + rho)): staying outside keeps the risk at Phi(-g s).
    """
    arithmetic, harmonic = means(a, b)
    margin = np.asarray(margin, dtype=np.float64)
    ratio = _share(harmonic, arithmetic, empty=1.0)
    return np.asarray(np.sqrt(ratio * _share(arithmetic + margin, harmonic + margin, empty=1.0)))


def outer_axes(a: Array, b: Array, margin: Array, beta: Array) -> Array:
    """Semi-axes, m, of the enclosing ellipse (1 + 1/beta) E + (1 + beta) B, (..., 2)."""
    beta = np.asarray(beta)[..., None]
    squares = _axes(a, b) ** 2 * (1.0 + 1.0 / beta)
    return np.asarray(np.sqrt(squares + (1.0 + beta) * np.asarray(margin)[..., None] ** 2))


def least_trace(a: Array, b: Array, margin: Array) -> Array:
    """Beta of the enclosing ellipse with the smallest sum of squared axes; margin > 0."""
    return np.asarray(np.hypot(a, b) / (np.sqrt(2.0) * np.asarray(margin)))


def least_area(a: Array, b: Array, margin: Array) -> Array:
    """Beta of the smallest enclosing ellipse, beta^3 + S beta^2 - S beta - u v = 0; margin > 0.

    u = a^2 / rho^2, v = b^2 / rho^2, S = (u + v) / 2.
    """
    u, v = (np.asarray(a) / margin) ** 2, (np.asarray(b) / margin) ** 2
    mean = 0.5 * (u + v)
    return _cubic_root(1.0, mean, -mean, -u * v, np.sqrt(u))


def _cubic_root(c3: Array | float, c2: Array, c1: Array, c0: Array, start: Array) -> Array:
    """Positive root by Newton from the right of it, where the cubic is convex and rises."""
    x = np.asarray(start, dtype=np.float64)
    for _ in range(100):
        value = ((c3 * x + c2) * x + c1) * x + c0
        slope = (3.0 * c3 * x + 2.0 * c2) * x + c1
        step = np.divide(value, slope, out=np.zeros(np.shape(value)), where=slope > 0)
        following = x - np.maximum(step, 0.0)  # rounding must not turn it back
        if np.array_equal(following, x):
            break
        x = following
    return np.asarray(x)
