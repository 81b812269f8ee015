"""Errors of an ellipse with lengthened axes against the exact sum, in closed form.

Symbols: a >= b are the largest and smallest semi-axis of the content ellipse, rho the margin (the
paper's r + r_d, in m), A = (a + b) / 2, H = 2ab / (a + b). All functions take arrays that
broadcast. In 3-D the same formulas hold with the largest and the smallest of three semi-axes.

Three notions of error are kept apart: the clearance lost (`clearance_error`), the gap along a ray
from the centre (`radial_error`) and the gap between supporting lines (`support_error`). All vanish
on the axes and for round ellipses; the largest clearance error equals the largest support error
and is `largest_clearance_error`; the radial one is larger and can exceed the margin.
"""

import numpy as np

from ..framework.numerics.geometry import sum_gauge
from ..framework.values.arrays import Array
from ..metrics.ellipses import distance_to_ellipse


def means(a: Array, b: Array) -> tuple[Array, Array]:
    """Arithmetic and harmonic mean A and H of the semi-axes, m; H = 0 where b = 0."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    product = np.divide(2.0 * a * b, a + b, out=np.zeros(np.shape(a + b)), where=a + b > 0)
    return 0.5 * (a + b), product


def largest_clearance_error(a: Array, b: Array, margin: Array) -> Array:
    """Hausdorff distance between exact sum and lengthened ellipse, m.

    rho (1 - sqrt((H + rho) / (A + rho))), written without cancellation; it falls from
    1 - 2 sqrt(ab) / (a + b) of the margin for small margins to (A - H) / 2 in m for large ones.
    """
    arithmetic, harmonic = means(a, b)
    margin = np.asarray(margin, dtype=np.float64)
    total = np.asarray(a) + np.asarray(b)
    gap = np.divide(
        (np.asarray(a) - np.asarray(b)) ** 2, 2.0 * total,
        out=np.zeros(np.shape(total)), where=total > 0,
    )  # fmt: skip  # A - H
    ratio = _share(harmonic + margin, arithmetic + margin)
    return np.asarray(margin * _share(gap, arithmetic + margin) / (1.0 + np.sqrt(ratio)))


def radial_error(a: Array, b: Array, margin: Array, angle: Array) -> Array:
    """Gap between exact sum and lengthened ellipse along the ray at a polar angle, m."""
    return exact_radius(a, b, margin, angle) - ellipse_radius(
        np.asarray(a) + margin, np.asarray(b) + margin, angle
    )


def clearance_error(a: Array, b: Array, margin: Array, angle: Array) -> Array:
    """Clearance lost at the boundary point of the lengthened ellipse at a polar angle, m."""
    radius = ellipse_radius(np.asarray(a) + margin, np.asarray(b) + margin, angle)
    point = radius[..., None] * _direction(angle)
    return np.asarray(margin - distance_to_ellipse(point, _axes(a, b)))


def exact_radius(a: Array, b: Array, margin: Array, angle: Array) -> Array:
    """Distance from the centre to the boundary of the exact sum at a polar angle, m."""
    return np.asarray(1.0 / sum_gauge(_direction(angle), _axes(a, b), np.asarray(margin)))


def ellipse_radius(a: Array, b: Array, angle: Array) -> Array:
    """Distance from the centre to an ellipse at a polar angle, m."""
    return np.asarray(1.0 / np.hypot(np.cos(angle) / a, np.sin(angle) / b))


def _share(upper: Array, lower: Array, empty: float = 1.0) -> Array:
    """Quotient, or ``empty`` where the divisor is 0."""
    upper, lower = np.broadcast_arrays(upper, lower)
    quotient = np.full(upper.shape, empty)
    return np.asarray(np.divide(upper, lower, out=quotient, where=lower > 0))


def _axes(a: Array, b: Array) -> Array:
    return np.stack(np.broadcast_arrays(a, b), axis=-1)


def _direction(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)
