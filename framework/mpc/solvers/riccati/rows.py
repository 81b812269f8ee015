"""Constraints that hold without slack to give: those of the robot. Each is c(w) - t = 0, t > 0."""

import numpy as np
from numba import njit

from .memory import LEAN, logarithm, reach, safe


@njit(**LEAN)
def start_rows(rows, mu, push):
    """Slacks at the values, but off zero, and multipliers mu / t."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                rows.t[j, i] = max(rows.tried[rows.at + j, i], push)
                rows.y[rows.first + j, i] = mu / rows.t[j, i]


@njit(**LEAN)
def add_rows(size, rows, quadratic, mu):
    """Add to the condensed quadratic what the constraints contribute, t and y eliminated."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                t = rows.t[j, i]
                sigma = rows.y[rows.first + j, i] / t
                force = mu / t - sigma * (rows.out[rows.value + j, i] - t)
                k, row = i + rows.after, rows.slope + j * rows.width
                for r in range(rows.width):
                    quadratic.gradient[r, k] -= force * rows.out[row + r, i]
                    for c in range(r + 1):
                        quadratic.hessian[r * size.w + c, k] += (
                            sigma * rows.out[row + r, i] * rows.out[row + c, i]
                        )


@njit(**LEAN)
def step_rows(rows, dv, mu, share, primal, dual):
    """Give the steps of slacks and multipliers; shorten step lengths; slope of the barrier."""
    total = 0.0
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                t, y = rows.t[j, i], rows.y[rows.first + j, i]
                step = rows.out[rows.value + j, i] - t
                for r in range(rows.width):
                    step += rows.out[rows.slope + j * rows.width + r, i] * dv[r, i + rows.after]
                rows.dt[j, i] = step
                rows.dy[j, i] = (mu - y * step) / t - y
                primal = reach(t, step, share, primal)
                dual = reach(y, rows.dy[j, i], share, dual)
                total -= mu * step / t
    return primal, dual, total


@njit(**LEAN)
def merit_rows(rows, step):
    """Residual of the constraints at a trial point, and sum of the logarithms of the slacks."""
    residual, total, product = 0.0, 0.0, 1.0
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                t = rows.t[j, i] + step * rows.dt[j, i]
                residual += abs(rows.tried[rows.at + j, i] - t)
                total, product = logarithm(total, product, t)
    return residual, total + np.log(product)


@njit(**LEAN)
def accept_rows(rows, primal, dual, mu):
    """Take the step in slacks and multipliers."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                rows.t[j, i] += primal * rows.dt[j, i]
                rows.y[rows.first + j, i] = safe(
                    rows.y[rows.first + j, i] + dual * rows.dy[j, i], rows.t[j, i], mu
                )


@njit(**LEAN)
def pull_rows(rows, pull, mu):
    """Add the constraints' forces to the gradient of the Lagrangian.

    Returns the largest residual, error of complementarity, sum of multipliers, their number.
    """
    primal, error, total, count = 0.0, 0.0, 0.0, 0
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                for r in range(rows.width):
                    pull[r, i + rows.after] -= (
                        rows.y[rows.first + j, i] * rows.out[rows.slope + j * rows.width + r, i]
                    )
                primal = max(primal, abs(rows.out[rows.value + j, i] - rows.t[j, i]))
                error = max(error, abs(rows.t[j, i] * rows.y[rows.first + j, i] - mu))
                total, count = total + rows.y[rows.first + j, i], count + 1
    return primal, error, total, count
