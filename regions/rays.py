"""Boundary and area of a region without a closed form, by search along rays from its centre.

The region is symmetric in each coordinate of the eigenframe and star-shaped around its mean. The
rays are those of a circle or sphere stretched by the region's own half-widths, so that thin
regions are sampled as evenly as round ones.
"""

from collections.abc import Callable

import numpy as np

from ..framework.values.arrays import Array
from ..metrics.ellipses import UNIT_BALL
from . import gaussian

_HALVINGS = 18
_SECANTS = 3
_STEPS = {2: 128, 3: 32}
"""Of the angle, and nodes along the third axis, when areas are integrated."""

Field = Callable[[Array], Array]
"""Points in the eigenframe (..., D), m -> (...): below 0 inside, growing along every ray."""


def radius(field: Field, rays: Array, upper: Array) -> Array:
    """Multiple of each ray (..., D) at which the field reaches 0; 0 where the region is empty.

    Bisection, which needs no scale, and then the chord of the bracket, which gives the digits.

    Parameters
    ----------
    field : see `Field`.
    rays : (..., D), m, not of unit length.
    upper : (...), multiples at which the field is not below 0.
    """
    centre = field(np.zeros_like(rays))
    low, high = np.zeros(rays.shape[:-1]), np.broadcast_to(upper, rays.shape[:-1]).copy()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = field(middle[..., None] * rays) < 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    below, above = field(low[..., None] * rays), field(high[..., None] * rays)
    guess = high
    for _ in range(_SECANTS):
        gap = above - below
        share = np.divide(-below, gap, out=np.ones_like(gap), where=gap > 0.0)
        guess = low + np.clip(share, 0.0, 1.0) * (high - low)
        value = field(guess[..., None] * rays)
        inside = value < 0.0
        low, below = np.where(inside, guess, low), np.where(inside, value, below)
        high, above = np.where(inside, high, guess), np.where(inside, above, value)
    return np.asarray(np.where(centre < 0.0, guess, 0.0))


def outline(field: Field, upper: Field, directions: Array) -> tuple[Array, Array]:
    """Half-widths w (..., D) m and the multiples (..., K) of w * n on the boundary.

    Parameters
    ----------
    field : see `Field`; takes (..., K, D).
    upper : (..., K, D) rays -> (..., K), multiples that lie outside.
    directions : (K, D), unit vectors n.
    """
    size = directions.shape[-1]
    axes = np.eye(size)
    batch = field(np.zeros((1, size))).shape[:-1]
    widths = radius(field, np.broadcast_to(axes, (*batch, size, size)), upper(axes))
    solid = np.where(widths > 0.0, widths, 1.0)
    rays = solid[..., None, :] * directions
    return widths, radius(field, rays, upper(rays))


def boundary(field: Field, upper: Field, parameters: Array, count: int) -> Array:
    """Points on the boundary of one region with packed parameters, (count, 2), m."""
    mean, vectors, _, _ = gaussian.unpack(parameters)
    circle = gaussian.circle(count, vectors)
    widths, multiples = outline(field, upper, circle)
    return np.asarray(mean + (multiples[..., None] * widths * circle) @ vectors.T)


def area(field: Field, upper: Field, dimension: int) -> Array:
    """Area or volume: w_1 .. w_D times that of the unit ball times the mean D-th power, (...).

    The mean of multiple^D over directions, in one quadrant or octant by symmetry.
    """
    directions, weights = _quadrature(dimension)
    widths, multiples = outline(field, upper, directions)
    mean = (weights * multiples**dimension).sum(axis=-1)
    return np.asarray(UNIT_BALL[dimension] * widths.prod(axis=-1) * mean)


def _quadrature(dimension: int) -> tuple[Array, Array]:
    """Directions (K, D) of all positive coordinates, and weights (K) that add up to 1.

    Midpoints of equal steps of the angle: spectral accuracy, since the integrand is smooth,
    periodic and even about the axes. In 3-D times Gauss-Legendre along the third axis.
    """
    steps = _STEPS[dimension]
    angle = 0.5 * np.pi * (np.arange(steps) + 0.5) / steps
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if dimension == 2:
        return circle, np.full(steps, 1.0 / steps)
    points, weights = np.polynomial.legendre.leggauss(steps)
    height = np.repeat(0.5 + 0.5 * points, steps)
    around = np.tile(circle, (steps, 1)) * np.sqrt(1.0 - height**2)[:, None]
    return np.column_stack([around, height]), np.repeat(0.5 * weights / steps, steps)
