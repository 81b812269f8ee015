"""Probabilities that a Gaussian point is within a disc, tabled by where the disc is."""

from typing import Any

import numpy as np

from wideberth.framework.values.arrays import Array

NODES, PLACES = 32, 24
"""Nodes of the integrals, and places per axis of a table."""
REACH = 3.5
"""Deviations beyond which a point is not expected."""


def ellipses_of(covariance: Array, least: float) -> tuple[Array, Array]:
    """Return the deviations of covariances along their axes, and where these point.

    Parameters
    ----------
    covariance : (..., 2, 2), m^2.
    least : m, which smaller deviations are raised to.

    Returns
    -------
    deviations : (..., 2), m, the smaller one first.
    turns : (..., 2), unit vector along the axis of the smaller deviation.
    """
    a, b, c = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    middle, apart = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    angle = 0.5 * np.arctan2(2.0 * b, a - c) + 0.5 * np.pi
    squares = np.maximum(np.stack([middle - apart, middle + apart], axis=-1), least**2)
    return np.sqrt(squares), np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def overlap_tables(deviations: Array, radii: Array) -> Array:
    """Return probabilities that a Gaussian point is within a disc, by the disc's place.

    With the deviations s_1 <= s_2 along the axes and the centre at (d_1, d_2) from the mean

        int_{-R}^R phi((u - d_1) / s_1) / s_1
            (Phi((w - d_2) / s_2) - Phi((-w - d_2) / s_2)) du,    w^2 = R^2 - u^2

    by Gauss and Legendre's rule, whose nodes are the same for all places: the integrals of a table
    are one product of two matrices. `collision_probability` is exact for any numbers, and far
    slower.

    Parameters
    ----------
    deviations : (..., 2), m.
    radii : (...), m, R.

    Returns
    -------
    tables : (..., PLACES, PLACES), for d_1 and d_2 from 0 to R + REACH s.
    """
    from scipy.special import ndtr

    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    size = radii[..., None]
    u = size * nodes
    w = np.sqrt(size**2 - u**2)
    share = np.linspace(0.0, 1.0, PLACES)
    narrow, wide = deviations[..., 0, None], deviations[..., 1, None]
    first = ((size + REACH * narrow) * share / narrow)[..., :, None]
    second = ((size + REACH * wide) * share / wide)[..., None, :]
    density = np.exp(-0.5 * ((u / narrow)[..., None, :] - first) ** 2)
    density *= (size * weights / narrow / np.sqrt(2.0 * np.pi))[..., None, :]
    half = (w / wide)[..., :, None]
    return np.asarray(density @ (ndtr(half - second) - ndtr(-half - second)))


def scales_of(deviations: Array, radii: Array) -> Array:
    """Return the places of tables per m along both axes, (..., 2); arguments as above."""
    return np.asarray((PLACES - 1.0) / (radii[..., None] + REACH * deviations))


def bilinear(table: Any, p: Any, q: Any) -> Any:
    """Interpolate a table between its places; for Numba, float32."""
    i, j = int(p), int(q)
    p, q = p - np.float32(i), q - np.float32(j)
    near = table[i, j] + q * (table[i, j + 1] - table[i, j])
    next_ = table[i + 1, j] + q * (table[i + 1, j + 1] - table[i + 1, j])
    return near + p * (next_ - near)
