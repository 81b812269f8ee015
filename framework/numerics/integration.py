"""The classical Runge-Kutta method of order four: the one integrator of the package."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from ..values.arrays import Array, Scalar

NUDGE = 1e-6
"""Step of the central differences, in the argument's own units."""

Derivative: TypeAlias = Callable[[Sequence[Scalar], Sequence[Scalar]], tuple[Scalar, ...]]


def runge_kutta(
    derivative: Derivative,
    state: Sequence[Scalar],
    control: Sequence[Scalar],
    dt: Scalar,
    substeps: int = 1,
) -> tuple[Scalar, ...]:
    """State after ``dt`` seconds under a constant input.

    With h = dt / substeps, each substep is::

        k1 = f(x, u)              k2 = f(x + h/2 k1, u)
        k3 = f(x + h/2 k2, u)     k4 = f(x + h k3, u)
        x <- x + h/6 (k1 + 2 k2 + 2 k3 + k4)

    The error of the whole step is of order dt * h^4.

    Parameters
    ----------
    derivative : f(state, control), one entry per state.
    state, control : scalars: floats, NumPy arrays (a batch) or CasADi expressions.
    dt : s; may be a CasADi expression.
    substeps : equal parts the step is cut into.

    References
    ----------
    The paper, section IV ("symbolic Runge-Kutta of order 4"); Hairer, Norsett and Wanner,
    Solving Ordinary Differential Equations I, section II.1.

    Examples
    --------
    >>> decay = lambda state, control: (-state[0],)
    >>> round(runge_kutta(decay, (1.0,), (), 1.0, substeps=10)[0], 6)
    0.36788
    """
    h = dt / substeps
    point = tuple(state)
    for _ in range(substeps):
        k1 = derivative(point, control)
        k2 = derivative(_moved(point, k1, 0.5 * h), control)
        k3 = derivative(_moved(point, k2, 0.5 * h), control)
        k4 = derivative(_moved(point, k3, h), control)
        point = tuple(
            x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            for x, a, b, c, d in zip(point, k1, k2, k3, k4, strict=True)
        )
    return point


def slopes(function: Callable[[Array], Array], point: Sequence[float] | Array) -> Array:
    """Jacobian of a function of arrays by central differences, (n,) -> (m, n)."""
    here = np.asarray(point, dtype=np.float64)
    columns = [
        (function(here + nudge) - function(here - nudge)) / (2.0 * NUDGE)
        for nudge in NUDGE * np.eye(len(here))
    ]
    return np.stack(columns, axis=1)


def carried_covariance(
    function: Callable[[Array], Array], point: Sequence[float] | Array, covariance: Array
) -> Array:
    """Return the covariance of f(x), to first order: (n, n) -> (m, m).

    With J = df/dx by central differences it is J C J^T.

    Parameters
    ----------
    function : f, (n,) -> (m,).
    point : mean of x, (n,).
    covariance : C of x.
    """
    slope = slopes(function, point)
    found = slope @ covariance @ slope.T
    return np.asarray(0.5 * (found + found.T))


def _moved(
    point: tuple[Scalar, ...], slope: tuple[Scalar, ...], step_size: Scalar
) -> tuple[Scalar, ...]:
    return tuple(x + step_size * k for x, k in zip(point, slope, strict=True))
