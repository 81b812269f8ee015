"""Collision risk: probability that a disc (a ball in 3-D) overlaps one at a Gaussian position."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..numerics.eigenframe import checked_pairs, principal_axes, rim_gap
from ..values.arrays import Array
from .inversion import probability

SHARP = 1e-30
"""A deviation below this share of the radius counts as zero, and one above its inverse as that.

The probability is then below 1e-30 either way.
"""

_CHUNK = 512
"""Pairs at a time: 64 nodes of them are 256 KiB, which stay in the cache."""


def collision_probability(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike, nodes: int = 64
) -> Array:
    """Pr(|X| < radius) for X ~ N(difference, covariance), (...).

    One integral in the complex plane, `inversion.logarithm`, for 2-D and 3-D alike. With 64 nodes
    the relative error is below 1e-9, in 2-D and 3-D, for P above 1e-12 (and far below) with
    deviations of 1e-5 to 1e3 radii and conditions to 1e8. Zero and singular covariances are
    limits of their own.

    Parameters
    ----------
    difference : (..., D), m, mean position of the obstacle minus that of the robot.
    covariance : (..., D, D), m^2, of that difference; D is 2 or 3.
    radius : (...), m, both radii together.
    nodes : of the integral, see `inversion.rule`; 32 give 1e-8, 48 give 1e-10.

    Raises
    ------
    WideberthError : shapes that do not fit, a negative radius, a number that is not finite, or a
        matrix that is no covariance; see `eigenframe.checked_pairs`.

    Examples
    --------
    >>> float(collision_probability([3.0, 1.0], [[1.0, 0.0], [0.0, 0.25]], 1.5).round(10))
    0.0301269415
    """
    shape, columns, _, _ = scaled(difference, covariance, radius)
    result = np.zeros(columns.shape[1])
    for part in _parts(len(result)):
        result[part] = probability(*split(columns[:, part]), nodes)
    return result.reshape(shape)


def scaled(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> tuple[tuple[int, ...], Array, Array, Array]:
    """Return the arguments of the integral, one row per pair, and the frame of its gradient.

    Lengths are divided by the radius, first by a power of two, so that the gap keeps its digits.

    Returns
    -------
    shape : of the result.
    columns : (2 D + 1, n), ratios, squares and gap of `inversion.logarithm`, large spread first.
    vectors : (..., D, D), the eigenvectors as columns.
    slope : (D, n), 2 x_i / R^2, 1/m; 0 where the radius is.

    Raises
    ------
    WideberthError : as `collision_probability`.
    """
    d, sigma, size = checked_pairs(difference, covariance, radius)
    deviations, vectors = principal_axes(sigma)
    shape = np.broadcast_shapes(d.shape[:-1], deviations.shape[:-1], size.shape)
    flat = (-1, d.shape[-1])
    local = np.einsum("...ij,...i->...j", vectors, d)
    local, deviations, d = (
        np.broadcast_to(value, (*shape, flat[1])).reshape(flat) for value in (local, deviations, d)
    )
    size = np.broadcast_to(size, shape).reshape(-1)
    room, exponent = np.frexp(np.where(size > 0.0, size, 1.0))
    far = 1.0 / SHARP
    places = np.clip(np.ldexp(local, -exponent[:, None]), -far, far).T / room
    ratios = np.clip(np.ldexp(deviations, -exponent[:, None]).T / room, 0.0, far)
    ratios = np.where((ratios > SHARP) & (size > 0.0), ratios, 0.0) ** 2
    corner = np.clip(np.ldexp(d, -exponent[:, None]), -far, far)
    gap = np.where(size > 0.0, rim_gap(corner, room) / room**2, -1.0)
    columns = np.concatenate([ratios, places**2, gap[None]])
    slope = np.where(size > 0.0, 2.0 * places / np.ldexp(room, exponent), 0.0)
    return shape, columns, vectors, slope


def split(columns: Any) -> tuple[list[Any], list[Any], Any]:
    """Split the columns of `scaled` into ratios and squares, one array per coordinate, and gap."""
    size = len(columns) // 2
    return list(columns[:size]), list(columns[size:-1]), columns[-1]


def _parts(count: int) -> Iterator[slice]:
    return (slice(start, start + _CHUNK) for start in range(0, count, _CHUNK))
