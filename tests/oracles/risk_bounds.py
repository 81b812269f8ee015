"""What the field uses in place of the collision probability: bounds, and one that is none.

All take the difference of the mean positions, the covariance of that difference and the sum of
the radii, as `framework.risk.collision_probability` does, and broadcast. `half_plane_bound` is the
best bound from a line.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from wideberth.framework.numerics.eigenframe import checked_pairs, principal_axes
from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.ellipses import UNIT_BALL


def centre_point_value(difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike) -> Array:
    """Volume of the disc times the density at its centre, (...); not a bound.

    pi R^2 f(p) in 2-D, 4/3 pi R^3 f(p) in 3-D. Too small or too large: where the radius is
    much above the deviations it tends to 0 although the probability is near 1.

    Raises
    ------
    WideberthError : as `collision_probability`, or a singular covariance: it has no density.

    References
    ----------
    N. E. du Toit and J. W. Burdick, Probabilistic collision checking with chance constraints,
    IEEE Transactions on Robotics 27 (2011).
    """
    local, deviations, size = eigenframe(difference, covariance, radius)
    distance = np.hypot.reduce(local / _solid(deviations), axis=-1)
    return _ball_times_density(deviations, size, distance)


def highest_density_bound(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> Array:
    """Volume of the disc times the largest density in it, (...): a bound, also above 1.

    The likeliest point of the disc has the Mahalanobis distance m of `half_plane_level`: both
    ask for the first ellipse that touches the disc. So the bound is
    V_D(R) exp(-m^2 / 2) / ((2 pi)^(D/2) sqrt(det Sigma)).

    Raises
    ------
    WideberthError : as `centre_point_value`.

    References
    ----------
    J. S. Park, C. Park and D. Manocha, Efficient probabilistic collision detection for
    non-convex shapes, ICRA (2017), and the later work on trajectory optimisation.
    """
    _, deviations, size = eigenframe(difference, covariance, radius)
    _solid(deviations)
    return _ball_times_density(deviations, size, half_plane_level(difference, covariance, radius))


def centre_line_bound(difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike) -> Array:
    """Phi((R - |d|) / sqrt(a^T Sigma a)) with a = d / |d|, (...): a bound.

    The disc lies in the half-plane a . x >= |d| - R seen from the mean. The normal points from
    robot to obstacle; `half_plane_bound` takes the best normal and is never larger outside the
    disc. Without a direction (d = 0) any normal gives a bound; the longest axis gives the least.

    References
    ----------
    H. Zhu and J. Alonso-Mora, Chance-constrained collision avoidance for MAVs in dynamic
    environments, IEEE Robotics and Automation Letters 4 (2019).
    """
    local, deviations, size = eigenframe(difference, covariance, radius)
    length = np.hypot.reduce(local, axis=-1)
    along = np.divide(
        local, length[..., None], out=np.zeros_like(local), where=length[..., None] > 0
    )
    along[length == 0.0] = np.eye(local.shape[-1])[0]
    reach = np.hypot.reduce(along * deviations, axis=-1)
    room = size - length
    known = np.where(room > 0.0, np.inf, -np.inf)  # no spread along the normal
    level = np.divide(room, reach, out=known, where=reach > 0.0)
    return np.asarray(special.ndtr(level))


def box_bound(difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike) -> Array:
    """Probability of the box around the disc along the eigenvectors, (...): a bound.

        P <= prod_i [Phi((R - x_i) / s_i) - Phi((-R - x_i) / s_i)]

    The box is the disc's bounding square in the eigenframe, where coordinates are independent.
    The idea of a combined body bounded after decorrelation is attributed to Hardy and Campbell;
    for discs this is the form it takes.

    References
    ----------
    J. Hardy and M. Campbell, Contingency planning over probabilistic obstacle predictions for
    autonomous road vehicles, IEEE Transactions on Robotics 29 (2013).
    """
    local, deviations, size = eigenframe(difference, covariance, radius)
    room = size[..., None]
    solid = np.where(deviations > 0.0, deviations, 1.0)
    smooth = special.ndtr((room - local) / solid) - special.ndtr((-room - local) / solid)
    sharp = np.where(local < room, 1.0, 0.0)
    return np.asarray(np.where(deviations > 0.0, smooth, sharp).prod(axis=-1))


def _solid(deviations: Array) -> Array:
    """Return the deviations if none is zero."""
    if not (deviations > 0.0).all():
        raise WideberthError(
            "a covariance is singular, so the obstacle's position has no density; use "
            "collision_probability or half_plane_bound, which take it as a limit"
        )
    return deviations


def _ball_times_density(deviations: Array, radius: Array, distance: Array) -> Array:
    """V_D(R) times the density at a Mahalanobis distance."""
    size = deviations.shape[-1]
    volume = UNIT_BALL[size] * radius**size
    peak = (2.0 * np.pi) ** (-0.5 * size) / deviations.prod(axis=-1)
    return np.asarray(volume * peak * np.exp(-0.5 * distance**2))


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
    WideberthError : as `checked_pairs`.
    """
    d, sigma, size = checked_pairs(difference, covariance, radius)
    deviations, vectors = principal_axes(sigma)
    local = np.abs(np.einsum("...ij,...i->...j", vectors, d))
    shape = np.broadcast_shapes(local.shape[:-1], deviations.shape[:-1], size.shape)
    full = (*shape, d.shape[-1])
    return (
        np.broadcast_to(local, full).copy(),
        np.broadcast_to(deviations, full).copy(),
        np.broadcast_to(size, shape).copy(),
    )
