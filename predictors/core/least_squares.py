"""Least squares for the vector autoregressions of many obstacles at once.

Orthogonal and as exact as a QR decomposition of each history, at a hundredth of the cost:
modified Gram-Schmidt, a column at a time over all obstacles, whose axis is the last one.
statsmodels, which the paper fits with, stands beside it.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from .history import IntArray
from .velocity_process import VelocityProcess

ROUNDING = 1e-14
"""Singular values below this share of the largest one are rounding errors."""


@dataclass(frozen=True, eq=False)
class Regression:
    """Solution of Y = Z B + U for each obstacle, obstacle axis last.

    Attributes
    ----------
    solution : (K, D, O), B.
    root : (K, K, O), upper triangular W with W W' = (Z'Z)^-1.
    triangle : (K, K, O), upper triangular R with R'R = Z'Z.
    squares : (D, D, O), U'U.
    """

    solution: Array
    root: Array
    triangle: Array
    squares: Array


@dataclass(frozen=True, eq=False)
class Fits:
    """Fitted processes and measures of their quality.

    Attributes
    ----------
    process : coefficients and innovation covariance.
    root : (O, K, K), W with W W' = (Z'Z)^-1, unit (m/s)^-1.
    condition : (O,), largest over smallest singular value of Z; where that is surely below
        the limit asked for it may be a larger number, below the limit too.
    freedom : (O,), residual degrees of freedom of each equation.
    failed : per obstacle why there is no fit, or None.
    """

    process: VelocityProcess
    root: Array
    condition: Array
    freedom: IntArray
    failed: tuple[str | None, ...]


def regress(regressors: Array, targets: Array) -> Regression:
    """Solve many small least squares problems.

    Gram-Schmidt on [Z Y], Y never normalised: what is left of Y are the residuals. Applied to
    Y as well, the modified form is backward stable for least squares (Bjoerck 1967).

    Parameters
    ----------
    regressors : (K, R, O), Z; rows of zeros do not count.
    targets : (D, R, O), Y.

    Returns
    -------
    Regression; not finite for an obstacle whose regressors are exactly dependent.
    """
    size, count = len(regressors), regressors.shape[-1]
    rest = np.concatenate([regressors, targets])
    triangle = np.zeros((size, len(rest), count))
    for k in range(size):
        length = np.sqrt(np.einsum("ro,ro->o", rest[k], rest[k]))
        triangle[k, k] = length
        rest[k] /= np.where(length > 0, length, 1.0)
        for j in range(k + 1, len(rest)):
            triangle[k, j] = np.einsum("ro,ro->o", rest[k], rest[j])
            rest[j] -= rest[k] * triangle[k, j]
    right = np.concatenate([np.zeros((size, size, count)), triangle[:, size:]], axis=1)
    right[range(size), range(size)] = 1.0
    # An exactly dependent regressor divides by zero: the caller reads that off the result.
    with np.errstate(all="ignore"):
        for k in reversed(range(size)):
            right[k] -= np.einsum("jo,jco->co", triangle[k, k + 1 : size], right[k + 1 :])
            right[k] /= triangle[k, k]
    left = rest[size:]
    squares = np.einsum("iro,jro->ijo", left, left)
    return Regression(right[:, size:], right[:, :size], triangle[:, :size], squares)


def lagged(
    velocities: Array,
    began: IntArray,
    order: int,
    seen: BoolArray | None = None,
) -> tuple[Array, Array]:
    """Lay out the regression of velocities on earlier ones: Z (K, R, O) and Y (D, R, O).

    v_h' = z_h' B,   z_h = (v_{h-1}, ..., v_{h-p}),   one row for each h; R = T - p

    Parameters
    ----------
    velocities : (O, T, D), m/s, oldest first.
    began : (O,), first column that belongs to the history; rows that look farther back are
        zero.
    order : p.
    seen : (O, T), whether a velocity was measured; rows that hold one filled in are zero too.
    """
    length = velocities.shape[1]
    rows = max(length - order, 0)
    path = np.ascontiguousarray(velocities.transpose(2, 1, 0))
    lags = [path[:, order - lag :][:, :rows] for lag in range(1, order + 1)]
    regressors, targets = np.concatenate(lags), path[:, length - rows :]
    if seen is None and not began.any():
        return regressors, targets
    inside = np.arange(rows)[:, None] >= began
    if seen is not None:
        inside = inside & complete_rows(seen, order).T
    return regressors * inside, targets * inside


def complete_rows(seen: BoolArray, order: int) -> BoolArray:
    """Tell which rows of `lagged` contain only measured velocities, (O, T) -> (O, R)."""
    rows = max(seen.shape[1] - order, 0)
    complete = np.ones((len(seen), rows), dtype=np.bool_)
    for lag in range(order + 1):
        complete &= seen[:, order - lag :][:, :rows]
    return complete


def fit_velocities(velocities: Array, began: IntArray, order: int, limit: float) -> Fits:
    """Fit a VAR to the velocities of each obstacle by ordinary least squares.

    B = (Z'Z)^-1 Z'Y,   Sigma_u = U'U / (rows - K)

    Parameters
    ----------
    velocities, began, order : as in `lagged`.
    limit : condition number up to which it need not be exact; see `Fits`.
    """
    regression = regress(*lagged(velocities, began, order))
    freedom = _freedom(velocities, began, order)
    solution = np.moveaxis(regression.solution, 2, 0)
    squares = np.moveaxis(regression.squares, 2, 0)
    return Fits(
        _process(solution, squares / np.maximum(freedom, 1)[:, None, None], order),
        np.ascontiguousarray(np.moveaxis(regression.root, 2, 0)),
        _conditions(regression, limit),
        freedom,
        tuple(f"{free} residual degrees of freedom" if free < 1 else None for free in freedom),
    )


def fit_with_statsmodels(velocities: Array, began: IntArray, order: int) -> Fits:
    """Fit as `fit_velocities`, one obstacle after the other, by statsmodels."""
    freedom = _freedom(velocities, began, order)
    count, _, size = velocities.shape
    regressors = order * size
    solution, root = np.zeros((count, regressors, size)), np.zeros((count, regressors, regressors))
    innovation, condition = np.zeros((count, size, size)), np.full(count, np.inf)
    failed: list[str | None] = [None] * count
    for o in range(count):
        if freedom[o] < 1:
            failed[o] = f"{freedom[o]} residual degrees of freedom"
            continue
        try:
            parts = _one_with_statsmodels(velocities[o, began[o] :], order)
            solution[o], innovation[o], root[o], condition[o] = parts
        except (ValueError, np.linalg.LinAlgError) as error:
            failed[o] = f"statsmodels: {error}"
    return Fits(_process(solution, innovation, order), root, condition, freedom, tuple(failed))


def _one_with_statsmodels(velocities: Array, order: int) -> tuple[Array, Array, Array, float]:
    """B (K, D), Sigma_u, W, and the condition of Z."""
    from statsmodels.tsa.vector_ar.var_model import VAR

    # statsmodels and NumPy warn of what the health gate judges; a warning is no answer.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        result = VAR(velocities).fit(maxlags=order, trend="n")
        regressors = np.asarray(result.endog_lagged)
        _, singular, right = np.linalg.svd(regressors, full_matrices=False)
        condition = float(_condition(singular))
        root = right.T / np.maximum(singular, np.finfo(float).tiny)
    innovation = np.asarray(result.sigma_u)
    return np.asarray(result.params), 0.5 * (innovation + innovation.T), root, condition


def _freedom(velocities: Array, began: IntArray, order: int) -> IntArray:
    """Rows minus regressors, (O,)."""
    _, length, size = velocities.shape
    return np.asarray(length - began - order - order * size, dtype=np.int64)


def _process(solution: Array, innovation: Array, order: int) -> VelocityProcess:
    """Sort the rows of B (O, K, D) into the A_j."""
    count, _, size = solution.shape
    lags = solution.reshape(count, order, size, size).swapaxes(2, 3)
    return VelocityProcess(lags, innovation)


def _conditions(regression: Regression, limit: float) -> Array:
    """Condition numbers of Z, (O,); bounded from above where the bound is within the limit."""
    # The Frobenius norm is never below the largest singular value, and costs next to nothing.
    condition = np.ones(regression.triangle.shape[2])
    for matrix in (regression.triangle, regression.root):
        condition = condition * np.sqrt(np.einsum("ijo,ijo->o", matrix, matrix))
    rest = ~(condition <= limit)
    if rest.any():
        triangles = np.moveaxis(regression.triangle[:, :, rest], 2, 0)
        singular = np.asarray(np.linalg.svd(triangles, compute_uv=False), dtype=np.float64)
        condition[rest] = _condition(singular)
    return condition


def _condition(singular: Array) -> Array:
    """Largest over smallest singular value (..., K); infinity where the smallest is rounding."""
    largest, smallest = singular[..., 0], singular[..., -1]
    dependent = smallest <= ROUNDING * largest
    return np.asarray(np.where(dependent, np.inf, largest / np.where(dependent, 1.0, smallest)))
