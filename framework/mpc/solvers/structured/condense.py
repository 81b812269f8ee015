"""What the obstacles contribute to the Newton step, everything of their own eliminated.

For one slot with slack t, multiplier lambda and the stage's slack eps, the rows of the Newton
system that belong to (t, lambda) are solved by hand: with sigma = lambda / t and
r = h + eps - t they add

    sigma (grad h, 1) (grad h, 1)'   and   -(mu / t - sigma r) (grad h, 1)

to the quadratic in (x, s, a, eps). The slot's own variables a, and the multipliers of its
equalities, are then eliminated from a small dense matrix, and at last, once per stage, eps.
"""

from numba import njit

from .boxes import INF
from .memory import LEAN

_DUAL = 1e-10
"""Regularisation of equalities, so that dependent ones do no harm."""


@njit(**LEAN)
def condense(size, slots, quadratic, eps, mu, delta):
    """Add one kind of slots to ``slots`` and ``force`` of the quadratic.

    Returns whether the curvature in their own variables is right.
    """
    if slots.back.shape[1] == 0:
        _sum(size, slots, quadratic, eps, mu)
        return True
    return _eliminated(size, slots, quadratic, eps, mu, delta)


@njit(**LEAN)
def _sum(size, slots, quadratic, eps, mu):
    """Slots without variables of their own: sums over those of a stage."""
    n, first, count = size.n, len(slots.depends) + size.shared, len(slots.active)
    multipliers = slots.v[first:]
    for i in range(len(eps) if count else 0):
        into, force = quadratic.slots[i], quadratic.force[i]
        for r in range(first):
            row = n if r == len(slots.depends) else slots.depends[r]
            for k in range(r + 1):
                column = n if k == len(slots.depends) else slots.depends[k]
                total = 0.0
                for c in range(i * count, (i + 1) * count):
                    total += slots.hessian[r, k, c]
                into[max(row, column), min(row, column)] += total
        for j in range(slots.t.shape[0]):
            weight = pressure = 0.0
            for c in range(i * count, (i + 1) * count):
                sigma = multipliers[j, c] / slots.t[j, c]
                given = mu / slots.t[j, c] - sigma * (slots.value[j, c] + eps[i] - slots.t[j, c])
                slots.dt[j, c], slots.dlam[j, c] = sigma, given  # kept for the sums below
                weight += sigma
                pressure += given
            into[n + 1, n + 1] += weight
            force[n + 1] -= pressure
            for r in range(first):
                row = n if r == len(slots.depends) else slots.depends[r]
                pressure = weight = 0.0
                for c in range(i * count, (i + 1) * count):
                    pressure += slots.dlam[j, c] * slots.slope[j, r, c]
                    weight += slots.dt[j, c] * slots.slope[j, r, c]
                force[row] -= pressure
                into[n + 1, row] += weight
                for k in range(r + 1):
                    column = n if k == len(slots.depends) else slots.depends[k]
                    total = 0.0
                    for c in range(i * count, (i + 1) * count):
                        total += slots.dt[j, c] * slots.slope[j, r, c] * slots.slope[j, k, c]
                    into[max(row, column), min(row, column)] += total


@njit(**LEAN)
def _eliminated(size, slots, quadratic, eps, mu, delta):
    """Slots with variables of their own: one small matrix each."""
    n, first = size.n, len(slots.depends) + size.shared
    inner, count = slots.back.shape[1], len(slots.active)
    matrix, force = slots.matrix, slots.force
    for c in range(slots.v.shape[1]):
        for r in range(len(force)):
            force[r] = 0.0
            for k in range(r + 1):
                matrix[r, k] = 0.0
        _own(size, slots, c, matrix, force, mu, delta)
        _inequalities(size, slots, c, matrix, force, eps[c // count], mu)
        _equalities(size, slots, c, matrix, force)
        if not _reduce(len(slots.lower), inner, matrix, force):
            return False
        _keep(slots.back[c], inner, matrix, force)
        into, push = quadratic.slots[c // count], quadratic.force[c // count]
        for r in range(first + 1):
            row = slots.depends[r] if r < len(slots.depends) else (n if r < first else n + 1)
            push[row] += force[inner + r]
            for k in range(r + 1):
                column = (
                    slots.depends[k] if k < len(slots.depends) else (n if k < first else n + 1)
                )
                into[max(row, column), min(row, column)] += matrix[inner + r, inner + k]
    return True


@njit(**LEAN)
def _own(size, slots, c, matrix, force, mu, delta):
    """Curvature of the constraints; regularisation and bounds of the own variables."""
    first, inner = len(slots.depends) + size.shared, slots.back.shape[1]
    for r in range(slots.hessian.shape[0]):
        row = inner + r if r < first else r - first
        for k in range(r + 1):
            column = inner + k if k < first else k - first
            matrix[max(row, column), min(row, column)] += slots.hessian[r, k, c]
    weight, guess = 2.0 * slots.pull[0], int(slots.pull[1])
    for r in range(len(slots.lower)):
        a = slots.v[first + r, c]
        matrix[r, r] += weight + delta
        force[r] += weight * (a - slots.p[guess + r, c])
        if slots.lower[r] > -INF:
            matrix[r, r] += slots.zl[r, c] / (a - slots.lower[r])
            force[r] -= mu / (a - slots.lower[r])
        if slots.upper[r] < INF:
            matrix[r, r] += slots.zu[r, c] / (slots.upper[r] - a)
            force[r] += mu / (slots.upper[r] - a)


@njit(**LEAN)
def _inequalities(size, slots, c, matrix, force, eps, mu):
    """Add sigma J J' and the force of each inequality; J in the matrix's order, eps at last."""
    first, own, inner = len(slots.depends) + size.shared, len(slots.lower), slots.back.shape[1]
    gradient = slots.gradient
    for j in range(slots.t.shape[0]):
        t = slots.t[j, c]
        sigma = slots.v[first + own + j, c] / t
        weight = mu / t - sigma * (slots.value[j, c] + eps - t)
        for r in range(own):
            gradient[r] = slots.slope[j, first + r, c]
        for r in range(first):
            gradient[inner + r] = slots.slope[j, r, c]
        gradient[inner + first] = 1.0
        for r in range(matrix.shape[0]):
            force[r] -= weight * gradient[r]
            factor = sigma * gradient[r]
            for k in range(r + 1):
                matrix[r, k] += factor * gradient[k]


@njit(**LEAN)
def _equalities(size, slots, c, matrix, force):
    """Rows of the equalities, whose unknowns are the new multipliers."""
    first, own, inner = len(slots.depends) + size.shared, len(slots.lower), slots.back.shape[1]
    for j in range(inner - own):
        at, row = own + j, slots.t.shape[0] + j
        matrix[at, at] = -_DUAL
        force[at] = slots.value[row, c]
        for r in range(own):
            matrix[at, r] = slots.slope[row, first + r, c]
        for r in range(first):
            matrix[inner + r, at] = slots.slope[row, r, c]


@njit(**LEAN)
def _reduce(own, inner, matrix, force):
    """Eliminate the first ``inner`` unknowns, in place, in the lower triangle.

    Own variables need positive pivots and multipliers of equalities negative ones.
    """
    for j in range(inner):
        pivot = matrix[j, j] if j < own else -matrix[j, j]
        if not pivot > 1e-13:
            return False
        inverse = 1.0 / matrix[j, j]
        for r in range(j + 1, matrix.shape[0]):
            factor = matrix[r, j] * inverse
            force[r] -= factor * force[j]
            for k in range(j + 1, r + 1):
                matrix[r, k] -= factor * matrix[k, j]
    return True


@njit(**LEAN)
def _keep(back, inner, matrix, force):
    """Solve for the inner unknowns as a function of the outer ones and 1."""
    outer = matrix.shape[0] - inner
    for j in range(inner - 1, -1, -1):
        inverse = 1.0 / matrix[j, j]
        for r in range(outer + 1):
            value = force[j] if r == outer else matrix[inner + r, j]
            for k in range(j + 1, inner):
                value += matrix[k, j] * back[k, r]
            back[j, r] = -value * inverse


@njit(**LEAN)
def expand(size, slots, slack, dv, ds, mu):
    """Write the steps of own variables, slacks and multipliers of all slots of one kind."""
    known, first, own = len(slots.depends), len(slots.depends) + size.shared, len(slots.lower)
    count = len(slots.active)
    for i in range(size.steps if slots.da.shape[0] else 0):
        for c in range(i * count, (i + 1) * count):
            for r in range(slots.da.shape[0]):
                value = slots.back[c, r, first + 1] + slots.back[c, r, first] * slack.deps[i]
                for k in range(known):
                    value += slots.back[c, r, k] * dv[slots.depends[k], i + 1]
                if size.shared > 0:
                    value += slots.back[c, r, known] * ds
                slots.da[r, c] = value
    for j in range(slots.t.shape[0]):
        for i in range(size.steps):
            for c in range(i * count, (i + 1) * count):
                step = slots.value[j, c] - slots.t[j, c] + slack.eps[i] + slack.deps[i]
                for k in range(known):
                    step += slots.slope[j, k, c] * dv[slots.depends[k], i + 1]
                if size.shared > 0:
                    step += slots.slope[j, known, c] * ds
                for r in range(own):
                    step += slots.slope[j, first + r, c] * slots.da[r, c]
                t, y = slots.t[j, c], slots.v[first + own + j, c]
                slots.dt[j, c], slots.dlam[j, c] = step, (mu - y * step) / t - y
    _expand_own(slots, first, mu)


@njit(**LEAN)
def _expand_own(slots, first, mu):
    """Write the steps of the multipliers of the own variables' bounds."""
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            a, step = slots.v[first + r, c], slots.da[r, c]
            if slots.lower[r] > -INF:
                gap, z = a - slots.lower[r], slots.zl[r, c]
                slots.dzl[r, c] = (mu - z * step) / gap - z
            if slots.upper[r] < INF:
                gap, z = slots.upper[r] - a, slots.zu[r, c]
                slots.dzu[r, c] = (mu + z * step) / gap - z
