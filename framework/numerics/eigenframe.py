"""Principal axes of covariances and the rim of a disc, to the last digits of the input."""

import numpy as np
from numpy.typing import ArrayLike

from ..values.arrays import Array, checked_covariance
from ..values.errors import WideberthError

_SPLIT = 2.0**27 + 1.0
"""Cuts a double into halves of 26 bits (Dekker)."""


def checked_pairs(
    difference: ArrayLike, covariance: ArrayLike, radius: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return the three as arrays.

    Covariances are checked by `arrays.checked_covariance`, which forgives rounding: an asymmetry
    and a negative eigenvalue of at most 1e-9 of the largest entry.

    Raises
    ------
    WideberthError : shapes that do not fit, a negative radius, a number that is not finite, or a
        matrix that is no covariance.
    """
    try:
        d, sigma, size = (
            np.asarray(value, dtype=np.float64) for value in (difference, covariance, radius)
        )
    except (TypeError, ValueError) as error:
        raise WideberthError(
            f"difference, covariance and radius must be arrays of numbers: {error}"
        ) from None
    if d.ndim < 1 or d.shape[-1] not in (2, 3) or sigma.shape[-2:] != (d.shape[-1],) * 2:
        raise WideberthError(
            f"difference has shape {d.shape} and covariance {sigma.shape}; wanted (..., D) and "
            "(..., D, D) with D = 2 or 3"
        )
    try:
        np.broadcast_shapes(d.shape[:-1], sigma.shape[:-2], size.shape)
    except ValueError:
        raise WideberthError(
            f"difference has shape {d.shape}, covariance {sigma.shape} and radius {size.shape}; "
            "their leading axes must be those of one batch"
        ) from None
    if not (np.isfinite(d).all() and np.isfinite(sigma).all() and np.isfinite(size).all()):
        raise WideberthError("difference, covariance and radius must be finite numbers")
    if (size < 0).any():
        raise WideberthError(f"radius is {size.min():g}; wanted at least 0 m")
    return d, checked_covariance("covariance", sigma, d.shape[-1]), size


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Deviations, large to small, (..., D), m, and unit eigenvectors as columns, (..., D, D).

    A small eigenvalue from `numpy.linalg.eigh` is known to 1e-16 of the large one: at a condition
    of 1e8 that is 1e-8 of itself, and up to 25 times that in a probability of 1e-12. In 2-D
    l2 = det / l1 with the determinant to twice the digits; in 3-D the small two come from the
    2-D block that eigh's vectors cut out, computed to twice the digits. Negative ones become 0.
    """
    if covariance.shape[-1] == 2:
        entries = covariance[..., 0, 0], covariance[..., 1, 0], covariance[..., 1, 1]
        values, vectors = _two(*entries)
    else:
        _, vectors = np.linalg.eigh(covariance)
        vectors = vectors[..., ::-1].copy()
        first, *small = (vectors[..., i] for i in range(3))
        b, m, c = (_form(covariance, small[i], small[j]) for i, j in ((0, 0), (1, 0), (1, 1)))
        below, turn = _two(b, m, c)
        vectors[..., 1:] = vectors[..., 1:] @ turn
        values = np.concatenate([_form(covariance, first, first)[..., None], below], axis=-1)
    return np.sqrt(np.clip(values, 0.0, None)), vectors


def eigen_axes(covariance: Array) -> tuple[Array, Array]:
    """Deviations and eigenvectors as `principal_axes`, by `numpy.linalg.eigh` alone.

    Fast, and exact enough for constraints: the small eigenvalue has an error of 1e-16 of the large
    one. Regions keep to it, since their numbers hang on the signs of the eigenvectors too.
    """
    values, vectors = np.linalg.eigh(covariance)
    deviations = np.sqrt(np.maximum(values, 0.0))
    return deviations[..., ::-1], vectors[..., ::-1]


def rim_gap(difference: Array, radius: Array) -> Array:
    """R^2 - |d|^2, (...), m^2, to its own last digits however close to the rim."""
    sides = np.broadcast_arrays(radius, *np.moveaxis(difference, -1, 0))
    high, low = _dot([sides[0], *(-side for side in sides[1:])], list(sides))
    return np.asarray(high + low)


def _two(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Eigenvalues and vectors of [[a, b], [b, c]]; exact axes for a diagonal matrix."""
    largest = 0.5 * (a + c + np.hypot(a - c, 2.0 * b))
    high, low = _dot([a, -b], [c, b])
    least = np.divide(high + low, largest, out=np.zeros_like(largest), where=largest > 0.0)
    angle = 0.5 * np.arctan2(2.0 * b, np.abs(a - c))
    cosine, sine, first = np.cos(angle), np.sin(angle), a >= c
    one = np.where(first, cosine, sine), np.where(first, sine, cosine)
    other = np.where(first, -sine, cosine), np.where(first, cosine, -sine)
    vectors = np.stack([np.stack(one, axis=-1), np.stack(other, axis=-1)], axis=-1)
    return np.stack([largest, least], axis=-1), vectors


def _form(matrix: Array, left: Array, right: Array) -> Array:
    """left^T M right by products of twice the digits, (...)."""
    row = [_dot(list(np.moveaxis(matrix[..., i, :], -1, 0)), _columns(right)) for i in range(3)]
    parts = [part for pair in row for part in pair]
    high, low = _dot([side for side in _columns(left) for _ in range(2)], parts)
    return np.asarray(high + low)


def _columns(vector: Array) -> list[Array]:
    return list(np.moveaxis(vector, -1, 0))


def _dot(left: list[Array], right: list[Array]) -> tuple[Array, Array]:
    """Sum of products and its rounding error, as if computed with twice the digits.

    References
    ----------
    T. Ogita, S. M. Rump and S. Oishi, Accurate sum and dot product, SIAM Journal on Scientific
    Computing 26 (2005), algorithm Dot2.
    """
    total, error = _product(left[0], right[0])
    for a, b in zip(left[1:], right[1:], strict=True):
        term, small = _product(a, b)
        fresh = total + term
        shift = fresh - total
        error = error + ((total - (fresh - shift)) + (term - shift) + small)
        total = fresh
    return total, error


def _product(a: Array, b: Array) -> tuple[Array, Array]:
    """Product and its rounding error (Dekker)."""
    (a1, a2), (b1, b2) = _halves(a), _halves(b)
    product = a * b
    return product, a2 * b2 - (((product - a1 * b1) - a2 * b1) - a1 * b2)


def _halves(a: Array) -> tuple[Array, Array]:
    big = _SPLIT * a
    high = big - (big - a)
    return high, a - high
