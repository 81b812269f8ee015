"""What the field uses in place of the collision probability: bounds, and one that is none.

All take the difference of the mean positions, the covariance of that difference and the sum of
the radii, as `framework.risk.collision_probability` does, and broadcast. `half_plane_bound`
there is the best bound from a line.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from wideberth.framework.numerics.eigenframe import eigenframe
from wideberth.framework.numerics.geometry import UNIT_BALL
from wideberth.framework.risk.collision_probability import half_plane_level
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError


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
