"""Quantile of the chi-square distribution, which bounds squared Mahalanobis distances."""

import math

from ..values.arrays import probability


def content_bound(size: int, tail: float) -> float:
    """Return the q that chi^2 with ``size`` degrees of freedom exceeds with probability ``tail``.

    Two degrees of freedom have the closed form q = -2 ln(tail), so that planning in the plane
    needs no import of SciPy.

    Raises
    ------
    WideberthError : tail outside (0, 1).
    """
    tail = probability("tail", tail)
    if size == 2:
        return -2.0 * math.log(tail)
    from scipy.special import chdtri

    return float(chdtri(size, tail))
