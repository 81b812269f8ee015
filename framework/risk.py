"""Collision risk: the probability that a disc (a ball in 3-D) meets one at a Gaussian place."""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from .arrays import Array, BoolArray
from .errors import WideberthError

REACH = 9.0
"""Standard deviations beyond the likeliest point that the outer integral covers (1e-18)."""

SHARP = 1e-8
"""A deviation below this share of the radius counts as zero."""


def collision_probability(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike, nodes: int = 64
) -> Array:
    """Pr(|X| < radius) for X ~ N(difference, covariance), (...).

    In the eigenframe, with y the coordinate along the smallest deviation s2 and x the other,

        P = int R cos f phi((R sin f + y) / s2) / s2
              [Phi((R cos f - x) / s1) - Phi((-R cos f - x) / s1)] df

    over f in [-pi/2, pi/2], by Gauss-Legendre on the part that matters; in 3-D the bracket is
    the same formula on the disc of radius R cos f. Zero and singular covariances are limits
    of their own. With 64 nodes the relative error is below 1e-9 for P above 1e-12.

    Parameters
    ----------
    difference : (..., D), m, mean position of the obstacle minus that of the robot.
    covariance : (..., D, D), m^2, of that difference; D is 2 or 3.
    radius : (...), m, both radii together.
    nodes : Gauss-Legendre nodes per integral.

    Raises
    ------
    WideberthError : shapes that do not fit, a negative radius, or a number that is not finite.

    Examples
    --------
    >>> float(collision_probability([3.0, 1.0], [[1.0, 0.0], [0.0, 0.25]], 1.5).round(10))
    0.0301269415
    """
    local, deviations, size = eigenframe(difference, covariance, radius)
    return np.asarray(np.clip(_ball(local, deviations, size, nodes), 0.0, 1.0))


def collision_probability_gradient(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> Array:
    """Gradient of the probability by the robot's position, 1/m, (..., 2).

        dP/dp = R int_0^{2 pi} f(p + R n) n dphi,   n = (cos phi, sin phi),

    with f the density of the obstacle's position: what the disc wins on one side less what it
    loses on the other. With ``difference`` = mean - p it is minus the gradient by the
    difference. The trapezoidal rule converges spectrally on a full turn; the number of nodes
    follows from the bandwidth R (R + |d|) / s2^2 of the exponent.

    Parameters
    ----------
    difference, covariance, radius : as in `collision_probability`, in two dimensions.

    Raises
    ------
    WideberthError : as `collision_probability`; three dimensions; a covariance that is singular
        or so thin that the rule would need more than a million nodes.
    """
    d, sigma, radii = _checked(difference, covariance, radius)
    if d.shape[-1] != 2:
        raise WideberthError("the gradient is built for two dimensions; difference has 3")
    values, vectors = np.linalg.eigh(sigma)
    shape = np.broadcast_shapes(d.shape[:-1], sigma.shape[:-2], radii.shape)
    turn = np.broadcast_to(vectors, (*shape, 2, 2))
    room = np.broadcast_to(radii, shape)
    local = np.einsum("...ij,...i->...j", turn, d)
    spread = np.sqrt(np.clip(np.broadcast_to(values, (*shape, 2)), 0.0, None))
    band = np.sqrt(room * (room + np.hypot.reduce(local, axis=-1)))
    if (spread[..., 0] <= 2e-5 * band).any() or not (spread > 0.0).all():
        raise WideberthError(
            "a covariance is singular or too thin: the probability has no gradient there that "
            "the rule could find; its smallest deviation must exceed 2e-5 of the radius"
        )
    count = 2 ** np.ceil(np.log2(np.maximum(8.0 * band / spread[..., 0], 64.0))).astype(int)
    result = np.zeros((*shape, 2))
    for nodes in np.unique(count):
        for index in map(tuple, np.argwhere(count == nodes)):
            result[index] = turn[index] @ _circle(local[index], spread[index], room[index], nodes)
    return result


def _circle(d: Array, s: Array, radius: Array, nodes: int) -> Array:
    """Trapezoidal rule for one gradient in the eigenframe."""
    angle = np.arange(nodes) * (2.0 * np.pi / nodes)
    normal = np.stack([np.cos(angle), np.sin(angle)])
    offset = (radius * normal - d[:, None]) / s[:, None]
    density = np.exp(-0.5 * (offset**2).sum(axis=0)) / (2.0 * np.pi * s[0] * s[1])
    return np.asarray(radius * (2.0 * np.pi / nodes) * (normal @ density))


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


def eigenframe(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> tuple[Array, Array, Array]:
    """Difference in the eigenframe and deviations, large to small, and radius, broadcast.

    The signs of the coordinates are dropped: the probability is symmetric in each.

    Raises
    ------
    WideberthError : as `collision_probability`.
    """
    d, sigma, size = _checked(difference, covariance, radius)
    values, vectors = np.linalg.eigh(sigma)
    local = np.einsum("...ij,...i->...j", vectors, d)[..., ::-1]
    deviations = np.sqrt(np.clip(values, 0.0, None))[..., ::-1]
    shape = np.broadcast_shapes(local.shape[:-1], deviations.shape[:-1], size.shape)
    full = (*shape, d.shape[-1])
    return (
        np.abs(np.broadcast_to(local, full)),
        np.broadcast_to(deviations, full).copy(),
        np.broadcast_to(size, shape).copy(),
    )


def _checked(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> tuple[Array, Array, Array]:
    d = np.asarray(difference, dtype=np.float64)
    sigma = np.asarray(covariance, dtype=np.float64)
    size = np.asarray(radius, dtype=np.float64)
    if d.ndim < 1 or d.shape[-1] not in (2, 3) or sigma.shape[-2:] != (d.shape[-1],) * 2:
        raise WideberthError(
            f"difference has shape {d.shape} and covariance {sigma.shape}; wanted (..., D) and "
            "(..., D, D) with D = 2 or 3"
        )
    if not (np.isfinite(d).all() and np.isfinite(sigma).all() and np.isfinite(size).all()):
        raise WideberthError("difference, covariance and radius must be finite numbers")
    if (size < 0).any():
        raise WideberthError(f"radius is {size.min():g}; wanted at least 0 m")
    return d, sigma, size


@cache
def gauss_legendre(nodes: int) -> tuple[Array, Array]:
    """Points and weights of the rule on [-1, 1]."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    return np.asarray(points), np.asarray(weights)


def _ball(d: Array, s: Array, radius: Array, nodes: int) -> Array:
    """Integrate the last coordinate, the one with the smallest deviation; the rest recursively."""
    y, last = d[..., -1], s[..., -1]
    sharp = last <= SHARP * radius
    solid = np.where(last > 0, last, 1.0)
    if d.shape[-1] == 1:
        smooth = special.ndtr((radius - y) / solid) - special.ndtr((-radius - y) / solid)
        return np.asarray(np.where(last > 0, smooth, np.where(y < radius, 1.0, 0.0)))
    if sharp.all():
        return _slice(d, s, radius, nodes)
    size = np.where(radius > 0, radius, 1.0)
    half = solid * np.hypot(REACH, _nearest(d, s, radius))
    low = np.arcsin(np.clip((-y - half) / size, -1.0, 1.0))
    high = np.arcsin(np.clip((half - y) / size, -1.0, 1.0))
    points, weights = gauss_legendre(nodes)
    width = 0.5 * (high - low)
    angle = 0.5 * (high + low)[..., None] + width[..., None] * points
    chord = radius[..., None] * np.cos(angle)
    offset = (radius[..., None] * np.sin(angle) + y[..., None]) / solid[..., None]
    density = np.exp(-0.5 * offset**2) / (np.sqrt(2.0 * np.pi) * solid[..., None])
    rest = (*chord.shape, d.shape[-1] - 1)
    lower = [np.broadcast_to(value[..., None, :-1], rest) for value in (d, s)]
    inner = _ball(lower[0], lower[1], chord, nodes)
    total = (density * chord * inner * weights).sum(axis=-1) * width
    if sharp.any():
        total = np.where(sharp, _slice(d, s, radius, nodes), total)
    return np.asarray(total)


def _slice(d: Array, s: Array, radius: Array, nodes: int) -> Array:
    """Limit of a last deviation of zero: the chord at that offset."""
    chord = np.sqrt(np.clip((radius - d[..., -1]) * (radius + d[..., -1]), 0.0, None))
    meets = d[..., -1] < radius
    return np.asarray(np.where(meets, _ball(d[..., :-1], s[..., :-1], chord, nodes), 0.0))


def _nearest(d: Array, s: Array, radius: Array) -> Array:
    """Bound on the Mahalanobis distance of the ball: how far out its likeliest point lies."""
    length = np.hypot.reduce(d, axis=-1)
    beyond = np.clip(length - radius, 0.0, None)
    share = np.divide(beyond, length, out=np.zeros_like(length), where=length > 0)
    solid = np.where(s > 0, s, 1.0)
    radial = np.hypot.reduce(share[..., None] * d / solid, axis=-1)
    if d.shape[-1] == 1:
        return np.asarray(radial)
    edge = np.minimum(d[..., -1], radius)
    chord = np.sqrt(np.clip((radius - edge) * (radius + edge), 0.0, None))
    rest = _nearest(d[..., :-1], s[..., :-1], chord)
    return np.asarray(np.minimum(radial, np.hypot((d[..., -1] - edge) / solid[..., -1], rest)))
