"""The Newton step by a Riccati recursion over the horizon.

minimise    sum_i  dw_i H_i dw_i / 2 + g_i dw_i + ds h_i dx_i   +   top of ds
subject to  dx_{i+1} = A_i dx_i + B_i du_i + gap_i,  dx_0 = 0.

The one level s is shared by all stages. It is carried as a second right-hand side: with the
value function x P x / 2 + (p + q ds) x the recursion for q is that for p without its constant
terms, and what is left at stage 0 is a parabola in ds. Treating s as a constant state would need
a P larger by one row.

J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control (2017), section 8.8.
"""

from numba import njit

from .memory import DELTA, DS, LEAN

_SMALLEST = 1e-10
"""Pivot below which the reduced Hessian does not count as positive definite."""


@njit(**LEAN)
def backward(size, model, quadratic, gains, state):
    """Recursion from the last stage to the first; False where the curvature is wrong.

    One function, since handing the arrays of a stage to others costs as much as the work on them.
    """
    n, m, w, last = size.n, size.m, size.w, size.steps
    hessian, gradient, cross, top = (
        quadratic.hessian, quadratic.gradient, quadratic.cross, quadratic.top,
    )  # fmt: skip
    P, p, q, K, k, ks = gains.P, gains.p, gains.q, gains.K, gains.k, gains.ks
    drive, gap, delta = model.drive, model.gap, state[DELTA]
    slopes, product, curve = gains.slopes, gains.product, gains.curve
    force, shared = gains.force, gains.shared
    for r in range(n):
        for c in range(n):
            P[last, r, c] = hessian[last, r, c]
        P[last, r, r] += delta
        p[last, r], q[last, r] = gradient[last, r], cross[last, r]
    for i in range(last - 1, -1, -1):
        # curve = H + [A B]' P [A B], force = g + [A B]' (p + P gap), shared = h + [A B]' q
        for r in range(n):
            for c in range(w):
                slopes[r, c] = drive[size.jacobian + r * w + c, i]
                product[r, c] = 0.0
        for r in range(n):
            for j in range(n):
                factor = P[i + 1, r, j]
                for c in range(w):
                    product[r, c] += factor * slopes[j, c]
        for r in range(w):
            for c in range(w):
                curve[r, c] = hessian[i, r, c] + drive[size.hessian + r * w + c, i]
            curve[r, r] += delta
            force[r] = gradient[i, r] + drive[n + 1 + r, i]
            shared[r] = cross[i, r] if r < n else 0.0
        for j in range(n):
            for r in range(w):
                factor = slopes[j, r]
                for c in range(w):
                    curve[r, c] += factor * product[j, c]
            weight, level = p[i + 1, j], q[i + 1, j]
            for c in range(n):
                weight += P[i + 1, j, c] * gap[c, i]
            for r in range(w):
                force[r] += slopes[j, r] * weight
                shared[r] += slopes[j, r] * level
            top[1] += level * gap[j, i]
        # the inputs eliminated, in place
        for a in range(n, w):
            if not curve[a, a] > _SMALLEST:
                return False
            inverse = 1.0 / curve[a, a]
            for r in range(w):
                if r < n or r > a:
                    factor = curve[a, r] * inverse
                    for c in range(w):
                        curve[r, c] -= factor * curve[a, c]
                    force[r] -= factor * force[a]
                    shared[r] -= factor * shared[a]
            top[0] -= shared[a] * inverse * shared[a]
            top[1] -= shared[a] * inverse * force[a]
        # their feedback du = K dx + k + ks ds, and the value function that is left
        for a in range(m - 1, -1, -1):
            inverse = 1.0 / curve[n + a, n + a]
            for c in range(n):
                value = curve[n + a, c]
                for b in range(a + 1, m):
                    value += curve[n + a, n + b] * K[i, b, c]
                K[i, a, c] = -value * inverse
            value, level = force[n + a], shared[n + a]
            for b in range(a + 1, m):
                value += curve[n + a, n + b] * k[i, b]
                level += curve[n + a, n + b] * ks[i, b]
            k[i, a], ks[i, a] = -value * inverse, -level * inverse
        for r in range(n):
            for c in range(n):
                P[i, r, c] = curve[r, c]
            p[i, r], q[i, r] = force[r], shared[r]
    if size.shared > 0:
        curvature = top[0] + delta
        if not curvature > _SMALLEST:
            return False
        state[DS] = -top[1] / curvature
    return True


@njit(**LEAN)
def forward(size, path, step, model, gains, ds):
    """Write the steps of states and inputs, and of the multipliers of the dynamics."""
    n, w = size.n, size.w
    for i in range(size.steps):
        for a in range(size.m):
            value = gains.k[i, a] + gains.ks[i, a] * ds
            for c in range(n):
                value += gains.K[i, a, c] * step.v[c, i]
            step.v[n + a, i] = value
        for r in range(n):
            value = model.gap[r, i]
            for c in range(w):
                value += model.drive[size.jacobian + r * w + c, i] * step.v[c, i]
            step.v[r, i + 1] = value
        for r in range(n):
            value = gains.p[i + 1, r] + gains.q[i + 1, r] * ds
            for c in range(n):
                value += gains.P[i + 1, r, c] * step.v[c, i + 1]
            step.pi[r, i] = value - path.v[w + r, i]
