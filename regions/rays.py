"""Boundary and area of a region that has no closed form, by search along rays from its centre.

The region is symmetric in each coordinate of the eigenframe and star-shaped around its mean. The
rays run in equal steps of the eccentric angle of the ellipse with the region's own half-widths, so
that thin regions are sampled as evenly as round ones.
"""

from collections.abc import Callable

import numpy as np

from ..framework.arrays import Array
from . import gaussian

_HALVINGS = 18
_SECANTS = 3

Field = Callable[[Array], Array]
"""Points in the eigenframe (..., 2), m -> (...): below 0 inside, growing along every ray."""


def radius(field: Field, rays: Array, upper: Array) -> Array:
    """Multiple of each ray (..., 2) at which the field reaches 0; 0 where the region is empty.

    Bisection, which needs no scale, and then the chord of the bracket, which gives the digits.

    Parameters
    ----------
    field : see `Field`.
    rays : (..., 2), m, not of unit length.
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


def outline(field: Field, upper: Field, circle: Array) -> tuple[Array, Array]:
    """Half-widths (..., 2) m and multiples (..., K) of (w_1 cos t, w_2 sin t) on the boundary.

    Parameters
    ----------
    field : see `Field`; takes (..., K, 2).
    upper : (..., K, 2) rays -> (..., K), multiples that lie outside.
    circle : (K, 2), unit vectors.
    """
    axes = np.eye(2)
    widths = radius(field, np.broadcast_to(axes, (*_batch(field), 2, 2)), upper(axes))
    solid = np.where(widths > 0.0, widths, 1.0)
    rays = solid[..., None, :] * circle
    return widths, radius(field, rays, upper(rays))


def _batch(field: Field) -> tuple[int, ...]:
    return field(np.zeros((1, 2))).shape[:-1]


def boundary(field: Field, upper: Field, parameters: Array, count: int) -> Array:
    """Points on the boundary of one region with packed parameters, (count, 2), m."""
    mean, vectors, _, _ = gaussian.unpack(parameters)
    circle = gaussian.circle(count, vectors)
    widths, multiples = outline(field, upper, circle)
    return np.asarray(mean + (multiples[..., None] * widths * circle) @ vectors.T)


def area(field: Field, upper: Field, count: int = 128) -> Array:
    """w_1 w_2 / 2 times the integral of the squared multiple over t, m^2, (...).

    Midpoints of ``count`` equal steps in one quarter: spectral accuracy, since the square is
    smooth, periodic and even about both axes.
    """
    angle = 0.5 * np.pi * (np.arange(count) + 0.5) / count
    widths, multiples = outline(field, upper, np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    return np.asarray(np.pi * widths.prod(axis=-1) * (multiples**2).mean(axis=-1))
