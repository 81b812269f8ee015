"""Roots of covariances by their eigenvalues, those that rounding made negative as 0."""

import numpy as np

from .arrays import Array


def factor(covariance: Array) -> Array:
    """Return A with A A^T = covariance, (..., D, D), also of a singular one: V sqrt(L)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def symmetric_root(covariance: Array) -> Array:
    """Return M^1/2 of positive semi-definite matrices, (..., D, D) m^2 -> (..., D, D) m.

    sqrt(n^T M n) is |M^1/2 n|, which rounding cannot make the root of a negative number.
    """
    values, vectors = np.linalg.eigh(covariance)
    axes = np.sqrt(np.maximum(values, 0.0))
    return np.asarray((vectors * axes[..., None, :]) @ vectors.mT)


def reduced(matrix: Array, least: float = 0.0) -> Array:
    """Return matrices (..., D, D) with eigenvalues lower by ``least``, those below 0 as 0."""
    values, vectors = np.linalg.eigh(matrix)
    kept = np.maximum(values - least, 0.0)
    return np.asarray((vectors * kept[..., None, :]) @ vectors.mT)
