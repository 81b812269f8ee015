"""Bounds of states and inputs: barrier terms, steps of their multipliers, step lengths."""

import numpy as np
from numba import njit

from .memory import LEAN, logarithm, reach, safe

INF = np.inf


@njit(**LEAN)
def inside(value, lower, upper, push):
    """Move a value off its bounds by a share of the room there is."""
    room = upper - lower
    if lower > -INF:
        value = max(value, lower + push * min(max(1.0, abs(lower)), room))
    if upper < INF:
        value = min(value, upper - push * min(max(1.0, abs(upper)), room))
    return value


@njit(**LEAN)
def start_bounds(size, path, mu):
    """Multipliers mu / gap."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    path.zl[r, i] = mu / (path.v[r, i] - path.lower[r])
                if path.upper[r] < INF:
                    path.zu[r, i] = mu / (path.upper[r] - path.v[r, i])


@njit(**LEAN)
def add_bounds(size, path, quadratic, mu):
    """Add to the condensed quadratic what the bounds contribute."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    gap = path.v[r, i] - path.lower[r]
                    quadratic.hessian[r * size.w + r, i] += path.zl[r, i] / gap
                    quadratic.gradient[r, i] -= mu / gap
                if path.upper[r] < INF:
                    gap = path.upper[r] - path.v[r, i]
                    quadratic.hessian[r * size.w + r, i] += path.zu[r, i] / gap
                    quadratic.gradient[r, i] += mu / gap


@njit(**LEAN)
def step_bounds(size, path, step, mu, share, primal, dual):
    """Give the steps of the multipliers; shortened step lengths; slope of the barrier terms."""
    slope = 0.0
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                move = step.v[r, i]
                if path.lower[r] > -INF:
                    gap, z = path.v[r, i] - path.lower[r], path.zl[r, i]
                    step.zl[r, i] = (mu - z * move) / gap - z
                    primal = reach(gap, move, share, primal)
                    dual = reach(z, step.zl[r, i], share, dual)
                    slope -= mu * move / gap
                if path.upper[r] < INF:
                    gap, z = path.upper[r] - path.v[r, i], path.zu[r, i]
                    step.zu[r, i] = (mu + z * move) / gap - z
                    primal = reach(gap, -move, share, primal)
                    dual = reach(z, step.zu[r, i], share, dual)
                    slope += mu * move / gap
    return primal, dual, slope


@njit(**LEAN)
def log_bounds(size, path, v):
    """Sum of the logarithms of all gaps."""
    total, product = 0.0, 1.0
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    total, product = logarithm(total, product, v[r, i] - path.lower[r])
                if path.upper[r] < INF:
                    total, product = logarithm(total, product, path.upper[r] - v[r, i])
    return total + np.log(product)


@njit(**LEAN)
def accept_bounds(size, path, step, primal, dual, mu):
    """Take the step in states, inputs and the multipliers of their bounds."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                path.v[r, i] += primal * step.v[r, i]
                if path.lower[r] > -INF:
                    gap = path.v[r, i] - path.lower[r]
                    path.zl[r, i] = safe(path.zl[r, i] + dual * step.zl[r, i], gap, mu)
                if path.upper[r] < INF:
                    gap = path.upper[r] - path.v[r, i]
                    path.zu[r, i] = safe(path.zu[r, i] + dual * step.zu[r, i], gap, mu)


@njit(**LEAN)
def pull_bounds(size, path, pull, mu):
    """Add the bounds' forces to the gradient of the Lagrangian.

    Returns the largest error of complementarity, the sum of the multipliers, their number.
    """
    error, total, count = 0.0, 0.0, 0
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    z = path.zl[r, i]
                    pull[r, i] -= z
                    error = max(error, abs((path.v[r, i] - path.lower[r]) * z - mu))
                    total, count = total + z, count + 1
                if path.upper[r] < INF:
                    z = path.zu[r, i]
                    pull[r, i] += z
                    error = max(error, abs((path.upper[r] - path.v[r, i]) * z - mu))
                    total, count = total + z, count + 1
    return error, total, count
