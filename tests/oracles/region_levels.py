"""Levels and distances in closed form that only tests need."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from wideberth.framework.values.arrays import Array, probability


def bhattacharyya_distance(difference: ArrayLike, first: ArrayLike, second: ArrayLike) -> Array:
    """D_B between two Gaussians whose means differ by (..., D), with covariances (..., D, D)."""
    d, a, b = (np.asarray(value, dtype=np.float64) for value in (difference, first, second))
    blend = 0.5 * (a + b)
    apart = (d * np.linalg.solve(blend, d[..., None])[..., 0]).sum(axis=-1)
    log_det = [np.linalg.slogdet(value)[1] for value in (blend, a, b)]
    return np.asarray(apart / 8.0 + 0.5 * log_det[0] - 0.25 * (log_det[1] + log_det[2]))


def ellipse_level_of_content(content: float, dimension: int = 2) -> float:
    """The level of a content near 0, where the tail would have lost the digits."""
    content = probability("content", content)
    if dimension == 2:
        return float(np.sqrt(-2.0 * np.log1p(-content)))
    return float(np.sqrt(2.0 * special.gammaincinv(0.5 * dimension, content)))
