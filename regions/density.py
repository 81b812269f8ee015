"""The Gaussian density in place of the collision probability.

Both compare volume * density with the risk eps. With x = R^T (p - mu), V the area of the disc
(the volume of the ball) of the margin and the level l = sqrt(-2 ln eps), V f(p) > eps is

    sum_i x_i^2 / l_i < q,    q = l^2 - k,    k = 2 ln((2 pi)^(D/2) sqrt(det Sigma) / V):

an ellipse of level sqrt(q), nothing where q <= 0. In 2-D k = 2 ln(2 sigma_1 sigma_2 / margin^2).
"""

import numpy as np

from ..framework.values.arrays import Array
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import GaussianObstacle
from ..metrics.ellipses import UNIT_BALL
from . import gaussian

_THIN = 1e-12
"""Share of the largest variance below which the smallest counts as zero (rounding)."""
_SMALL = 1e-60
"""m. A margin of zero counts as this: the regions are empty for every risk above 1e-100."""


def checked_spread(obstacle: GaussianObstacle, name: str) -> Array:
    """Variances (..., D), m^2, from large to small.

    Raises
    ------
    WideberthError : a covariance is singular, so that there is no density.
    """
    variances = np.linalg.eigvalsh(obstacle.covariance)[..., ::-1]
    if (variances[..., -1] <= _THIN * variances[..., 0]).any():
        raise WideberthError(
            f"{name} is undefined for a singular covariance, which has no density; add the "
            "measurement variance, or choose minkowski_sum or risk_contour"
        )
    return np.asarray(variances, dtype=np.float64)


def pack(obstacle: GaussianObstacle, margin: Array, name: str) -> Array:
    """Packed parameters and k, (..., P); raises as `checked_margin` and `checked_spread`."""
    packed = gaussian.pack(obstacle, margin, tuple(UNIT_BALL))
    k = _offset(checked_spread(obstacle, name), packed[..., -1])
    return np.concatenate([packed, k[..., None]], axis=-1)


def longest(deviations: Array, margin: Array, level: Array) -> Array:
    """Longest semi-axis sqrt(q) sigma_1 of the ellipse, (...), m, 0 where it is empty."""
    with np.errstate(divide="ignore"):  # without a density k is -inf: the ellipse has no end
        q = np.maximum(np.asarray(level) ** 2 - _offset(deviations**2, margin), 0.0)
    return np.asarray(np.sqrt(q) * deviations[..., 0])


def _offset(variances: Array, margin: Array) -> Array:
    """Return k of variances (..., D), m^2, and margins (...), m."""
    room, size = np.maximum(margin, _SMALL), variances.shape[-1]
    spread = 0.5 * np.log(2.0 * np.pi * variances).sum(axis=-1)
    return np.asarray(2.0 * (spread - np.log(UNIT_BALL[size]) - size * np.log(room)))
