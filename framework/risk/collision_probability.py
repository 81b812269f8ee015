"""Collision risk: the probability that a disc (a ball in 3-D) meets one at a Gaussian place."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ..numerics.eigenframe import checked_pairs, eigenframe, principal_axes, rim_gap
from ..values.arrays import Array, BoolArray
from ..values.errors import WideberthError
from .inversion import probability, slopes

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
        result[part] = probability(*split(columns[:, part]), nodes, np)
    return result.reshape(shape)


def collision_probability_gradient(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike, nodes: int = 64
) -> Array:
    """Gradient of the probability by the robot's position, 1/m, (..., D).

    In the eigenframe, with x the obstacle's mean seen from the robot, 2 x_i / R^2 times the
    density at 1 of |X|^2 / R^2 with two more degrees of freedom along axis i
    (`inversion.slopes`): the sum of noncentral chi-square variables falls in a noncentrality by
    what it has there with two degrees more. It points towards the obstacle. Each coordinate in
    the eigenframe is known to 1e-9 of itself, also deep inside, where the probability is 1.
    Where all spread is along a line or a plane the gradient is that of the limit.

    Parameters
    ----------
    difference, covariance, radius, nodes : as in `collision_probability`.

    Raises
    ------
    WideberthError : as `collision_probability`; a singular covariance whose line or plane just
        touches the disc: there the probability has no gradient.
    """
    shape, columns, vectors, slope = scaled(difference, covariance, radius)
    result = np.zeros(slope.shape)
    for part in _parts(slope.shape[1]):
        result[:, part] = slope[:, part] * slopes(*split(columns[:, part]), nodes, np)
    return turned_back(result, vectors, shape)


def turned_back(local: Array, vectors: Array, shape: tuple[int, ...]) -> Array:
    """Gradients in the eigenframe (D, n) in the frame of the input, (..., D).

    Raises
    ------
    WideberthError : one that is NaN.
    """
    if np.isnan(local).any():
        raise WideberthError(
            "a covariance is singular or too thin, and the line or plane on which the obstacle "
            "lies just touches the disc: the probability has no gradient there; move the "
            "obstacle or add a little to the covariance"
        )
    gradient = local.T.reshape(*shape, len(local))
    return np.asarray(np.einsum("...ij,...j->...i", vectors, gradient))


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
    """Ratios, squares and gap of `scaled`, one array per coordinate."""
    size = len(columns) // 2
    return list(columns[:size]), list(columns[size:-1]), columns[-1]


def _parts(count: int) -> Iterator[slice]:
    return (slice(start, start + _CHUNK) for start in range(0, count, _CHUNK))


def half_plane_level(difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike) -> Array:
    """Margin in standard deviations of the best separating line, (...).

    m = max_n (n . d - R) / sqrt(n^T Sigma n), the level at which the ellipse of the covariance
    touches the disc. At the optimum d_i = n_i (kappa l_i + R) in the eigenframe, so kappa is the
    root of sum d_i^2 / (kappa l_i + R)^2 = 1 and m = kappa sqrt(n^T Sigma n). 0 where the disc
    covers the mean, infinite where the covariance cannot reach it.

    Parameters
    ----------
    difference, covariance, radius : as in `collision_probability`.
    """
    local, deviations, size = eigenframe(difference, covariance, radius)
    variances = deviations**2
    outside = np.hypot.reduce(local, axis=-1) > size
    kappa, beyond = _multiplier(np.abs(local), variances, size, outside)
    below = kappa[..., None] * variances + size[..., None]
    normal = np.divide(local, below, out=np.zeros_like(local), where=below > 0)
    reach = kappa * np.sqrt((variances * normal**2).sum(axis=-1))
    return np.asarray(np.where(outside, np.where(beyond, np.inf, reach), 0.0))


def half_plane_bound(difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike) -> Array:
    """Bound Phi(-m) on the collision probability from the best separating line, (...).

    Where the disc covers the mean there is no such line and the bound is 1.
    """
    level = half_plane_level(difference, covariance, radius)
    return np.asarray(np.where(level > 0.0, special.ndtr(-level), 1.0))


def _multiplier(
    size: Array, variances: Array, radius: Array, outside: Array
) -> tuple[Array, BoolArray]:
    """Kappa, and whether the covariance cannot reach the disc at all.

    Newton on 1 / |d / (kappa l + R)| - 1, which is concave, so monotone from the left.
    """
    room = radius[..., None]
    safe = np.where(variances > 0, variances, 1.0)
    first = np.where(variances > 0, (size - room) / safe, 0.0).max(axis=-1)
    kappa = np.where(outside, np.maximum(first, 0.0), 0.0)
    fixed = np.where(variances > 0, 0.0, size)
    reachable = np.hypot.reduce(fixed, axis=-1) < radius
    spread = (variances > 0).all(axis=-1) | reachable
    for _ in range(60):
        below = kappa[..., None] * variances + room
        part = np.divide(size, below, out=np.zeros_like(size), where=below > 0)
        norm = np.hypot.reduce(part, axis=-1)
        slope = np.divide(part**2 * variances, below, out=np.zeros_like(size), where=below > 0)
        total = slope.sum(axis=-1)
        step = np.divide(norm**2 * (norm - 1.0), total, out=np.zeros_like(norm), where=total > 0)
        step = np.where(outside & spread, np.maximum(step, 0.0), 0.0)
        if not (step > 1e-16 * kappa).any():
            break
        kappa = kappa + step
    return kappa, outside & ~spread
