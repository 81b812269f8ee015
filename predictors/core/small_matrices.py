"""Roots and spectral radii of many small matrices at once."""

import numpy as np

from ...framework.values.arrays import Array, BoolArray

LARGEST_SIZE = 6
"""Rows up to which characteristic polynomials are trusted."""
NEGLIGIBLE = 1e-14
"""A pivot below this share of its diagonal entry is rounding: the matrix is singular there."""


def lower_root(matrix: Array) -> Array:
    """Return lower triangular L with L L' = matrix, (S, S, O), obstacle axis last.

    Cholesky's, but where a matrix is only semi-definite the column without a pivot is zero.
    """
    rest, root = matrix.copy(), np.zeros_like(matrix)
    for k in range(len(matrix)):
        pivot = rest[k, k]
        scale = np.where(pivot > NEGLIGIBLE * matrix[k, k], pivot, np.inf) ** -0.5
        root[k:, k] = rest[k:, k] * scale
        rest[k + 1 :, k + 1 :] -= root[k + 1 :, None, k] * root[None, k + 1 :, k]
    return root


def spectral_radius(matrix: Array, floor: float = 0.0) -> Array:
    """Largest modulus of the eigenvalues of each matrix (O, S, S), at least ``floor``.

    Whether all lie within ``floor`` is decided without them, at a tenth of their cost. Where one
    is within 1e-3 of ``floor`` that may be left open, and the radius is computed after all.
    """
    radius = np.full(len(matrix), floor)
    rest = np.ones(len(matrix), dtype=np.bool_)
    if floor and matrix.shape[1] <= LARGEST_SIZE:
        rest = ~_inside(matrix, floor)
    if rest.any():
        largest = np.abs(np.linalg.eigvals(matrix[rest])).max(axis=1)
        radius[rest] = np.maximum(largest, floor)
    return radius


def _inside(matrix: Array, radius: float) -> BoolArray:
    """Tell which matrices (O, S, S) certainly have all eigenvalues within ``radius``.

    Schur-Cohn: scaled to the unit circle, the characteristic polynomial loses one degree a
    turn, and every reflection coefficient must lie below 1. The polynomial comes from the
    traces of powers (Newton's identities). Rounding moves a fourfold root by 2e-4, which is
    why callers keep such a distance.
    """
    count, size = matrix.shape[:2]
    powers = [matrix / radius]
    while 2 * len(powers) < size:
        powers.append(powers[-1] @ powers[0])
    traces = [np.einsum("oii->o", powers[0])]
    for k in range(2, size + 1):
        traces.append(np.einsum("oij,oji->o", powers[k // 2 - 1], powers[(k + 1) // 2 - 1]))
    polynomial = np.zeros((size + 1, count))
    polynomial[0] = 1.0
    for k in range(1, size + 1):
        terms = [polynomial[k - i] * traces[i - 1] for i in range(1, k + 1)]
        polynomial[k] = -sum(terms) / k
    inside = np.ones(count, dtype=np.bool_)
    with np.errstate(all="ignore"):
        while len(polynomial) > 1:
            reflection = polynomial[-1] / polynomial[0]
            inside &= np.abs(reflection) < 1
            polynomial = (polynomial - reflection * polynomial[::-1])[:-1]
    return inside
