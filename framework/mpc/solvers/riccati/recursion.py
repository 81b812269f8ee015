"""The Newton step by a Riccati recursion over the horizon; `sweep` has the equations."""

from numba import njit

from ....jit.columns import caller
from .memory import DELTA, DS, LEAN

call = caller()
_SMALLEST = 1e-10
"""Curvature of the level below which it does not count as positive."""


@njit(**LEAN)
def backward(size, model, quadratic, gains, state, kernel):
    """Recursion from the last stage to the first; False where the curvature is wrong."""
    n, w, last, delta = size.n, size.w, size.steps, state[DELTA]
    rows, given, at = gains.rows, quadratic.rows, size.w * size.w + size.w + size.n
    for i in range(size.wide):
        given[at + n, i] = delta
    for r in range(n):
        for i in range(size.wide):
            given[at + r, i] = model.gap[r, i]
        for c in range(r + 1):
            rows[gains.P + r * (r + 1) // 2 + c, last] = quadratic.hessian[r * w + c, last]
        rows[gains.P + r * (r + 1) // 2 + r, last] += delta
        rows[gains.p + r, last] = quadratic.gradient[r, last]
        rows[gains.q + r, last] = quadratic.cross[r, last]
    rows[gains.top, last], rows[gains.top + 1, last] = quadratic.top[0], quadratic.top[1]
    rows[gains.sound, last] = 1.0
    call(kernel, 0, last, model.drive, given, rows)
    if not rows[gains.sound, 0] > 0.0:
        return False
    if size.shared > 0:
        curvature = rows[gains.top, 0] + delta
        if not curvature > _SMALLEST:
            return False
        state[DS] = -rows[gains.top + 1, 0] / curvature
    return True


@njit(**LEAN)
def forward(size, path, step, model, gains, ds):
    """Write the steps of states and inputs, and of the multipliers of the dynamics."""
    n, w, rows = size.n, size.w, gains.rows
    for i in range(size.steps):
        for a in range(size.m):
            value = rows[gains.k + a, i] + rows[gains.ks + a, i] * ds
            for c in range(n):
                value += rows[gains.K + a * n + c, i] * step.v[c, i]
            step.v[n + a, i] = value
        for r in range(n):
            value = model.gap[r, i]
            for c in range(w):
                value += model.drive[size.jacobian + r * w + c, i] * step.v[c, i]
            step.v[r, i + 1] = value
    for r in range(n):
        for i in range(size.steps):
            value = rows[gains.p + r, i + 1] + rows[gains.q + r, i + 1] * ds
            step.pi[r, i] = value - path.v[w + r, i]
        for c in range(n):
            packed = gains.P + max(r, c) * (max(r, c) + 1) // 2 + min(r, c)
            for i in range(size.steps):
                step.pi[r, i] += rows[packed, i + 1] * step.v[c, i + 1]
