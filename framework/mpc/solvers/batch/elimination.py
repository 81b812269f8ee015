"""Elimination of variables from quadratics, of many at once.

A quadratic in z is kept as a symmetric matrix over (z, 1): the Hessian, bordered by the
gradient. Arrays are (L, L, ...): the trailing axes are stages, slots and instances, over which
everything is vectorised; the small matrices are worked on row by row.
"""

from collections.abc import Sequence
from typing import Any


def eliminate(matrix: Any, signs: Sequence[int], least: float) -> tuple[tuple[Any, ...], Any, Any]:
    """Eliminate the first variables at the stationary point of the quadratic.

    Parameters
    ----------
    matrix : (L, L, ...).
    signs : of the pivots wanted, one per variable to eliminate: 1 for a minimum, -1 for a
        multiplier.
    least : size that a pivot must exceed.

    Returns
    -------
    rows : of each variable, its dependence on what stands behind it, for `substitute`.
    rest : the quadratic of the rest.
    fine : (...), whether all pivots have their signs.
    """
    rows, fine = [], True
    for sign in signs:
        pivot = matrix[0, 0]
        fine &= sign * pivot > least
        row = matrix[0, 1:] / pivot
        rows.append(row)
        matrix = matrix[1:, 1:] - matrix[0, 1:][:, None] * row[None]
    return tuple(rows), matrix, fine


def substitute(rows: Sequence[Any], known: Any) -> Any:
    """Values of the eliminated variables, (len(rows), ...); ``known`` are the rest and 1."""
    import jax.numpy as jnp

    for row in reversed(rows):
        value = -(row * known).sum(axis=0)
        known = jnp.concatenate([jnp.broadcast_to(value, known.shape[1:])[None], known])
    return known[: len(rows)]


def product(left: Any, right: Any) -> Any:
    """Matrix products (L, M, ...) x (M, P, ...)."""
    return sum(left[:, j][:, None] * right[j][None] for j in range(left.shape[1]))


def behind(matrix: Any, motion: Any) -> Any:
    """Take a quadratic of (y, r), where y = F (z, r), as one of (z, r).

    Parameters
    ----------
    matrix : (n + L, n + L, ...), with r the last L entries.
    motion : F, (n, Z + L, ...).
    """
    import jax.numpy as jnp

    n, rest = len(motion), ((0, 0),) * (matrix.ndim - 2)
    more = motion.shape[1] - (len(matrix) - n)
    half = product(matrix[:, :n], motion) + jnp.pad(matrix[:, n:], ((0, 0), (more, 0), *rest))
    below = jnp.pad(half[n:], ((more, 0), (0, 0), *rest))
    return product(jnp.swapaxes(motion, 0, 1), half[:n]) + below


def quadratic(hessian: Any, gradient: Any, jacobian: Any, curvature: Any, pull: Any) -> Any:
    """H + J' diag(curvature) J bordered by g - J' pull, (L + 1, L + 1, ...).

    Parameters
    ----------
    hessian, gradient : (L, L, ...) and (L, ...).
    jacobian : (rows, L, ...).
    curvature, pull : (rows, ...).
    """
    for j in range(jacobian.shape[0]):
        row = jacobian[j]
        hessian = hessian + (curvature[j] * row)[:, None] * row[None]
        gradient = gradient - pull[j] * row
    return bordered(hessian, gradient)


def bordered(hessian: Any, gradient: Any) -> Any:
    """Symmetric matrix of a quadratic, its constant 0."""
    import jax.numpy as jnp

    below = jnp.concatenate([gradient, jnp.zeros_like(gradient[:1])])[None]
    return jnp.concatenate([jnp.concatenate([hessian, gradient[:, None]], axis=1), below])


def spread(matrix: Any, places: Sequence[int], size: int) -> Any:
    """Take a quadratic as one of ``size`` - 1 variables, of which it sees those at ``places``."""
    import jax.numpy as jnp

    where = [len(matrix)] * size  # the row of zeros that is appended
    for own, place in enumerate(places):
        where[place] = own
    found = jnp.pad(matrix, [(0, 1), (0, 1), *[(0, 0)] * (matrix.ndim - 2)])
    order = jnp.array(where)
    return found[order][:, order]


def shifted(matrix: Any, diagonal: Sequence[float], weight: Any) -> Any:
    """Add a weight (B,) times a diagonal to matrices (L, L, ..., B)."""
    import jax.numpy as jnp

    where = jnp.diag(jnp.asarray(diagonal, dtype=float))
    return matrix + where.reshape(*where.shape, *(1,) * (matrix.ndim - 2)) * weight
