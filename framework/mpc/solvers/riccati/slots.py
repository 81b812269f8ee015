"""The obstacles of all stages: their poses, slacks, multipliers and own variables.

One column c = k wide + i per active slot k and stage i + 1. Each states h(x, s, a) + eps_i = t > 0
and e(x, s, a) = 0 with own variables a. Rows of ``v`` are (x's entries, s, a, lambda, y), as the
kernel wants them, and behind them what `elimination` wants to know: t, multipliers of the bounds
of a, what a is drawn to; slack, barrier, regularisation, weight of the draw; steps of (x's
entries, s) and of the slack.
"""

from collections import namedtuple

import numpy as np
from numba import njit

from .boxes import INF, inside
from .memory import FAST, LEAN, larger, logarithm, safe

Slots = namedtuple(
    "Slots",
    "active depends lower upper weight guess given v p out value slope condensed trial tried t zl "
    "zu steps da dt dlam dzl dzu",
)
"""Of one kind. ``active`` K slots, ``depends`` entries of x, ``weight`` of the regularisation;
``guess`` and ``given`` rows of ``v`` where what a is drawn to, and the slack, begin; ``out`` holds
results of the kernel and ``condensed``, ``da`` new multipliers of -e behind the step of a."""


@njit(**FAST)
def make_slots(size, kind, scale, push):
    """Room for the active slots of one kind, with their numbers and own variables.

    ``kind`` is (entries of x that matter, (rows of h, rows of e, whether slots have a level),
    limits of the own variables (2, A), their regularisation (1,), parameters (N, K, P), levels
    (N, K), active (K,), what the regularisation draws to and the start, each (N, K, A)).
    """
    depends, rows, limits, regularisation, numbers, levels, active, drawn, begun = kind
    lower, upper = limits[0], limits[1]
    chosen = np.flatnonzero(active > 0.0)
    unequal, stated, own = rows[0], rows[0] + rows[1], len(lower)
    columns, first = size.wide * len(chosen), len(depends) + size.shared
    w, inner, outer = first + own, own + rows[1], first + 1
    t = w + stated
    guess = t + unequal + 2 * own
    given, width = guess + own, numbers.shape[2]
    last, weight = stated + stated * w + w * w, scale * regularisation[0]
    v, p = np.zeros((given + 4 + outer, columns)), np.ones((width + rows[2] + 1 + own, columns))
    for k in range(len(chosen)):
        for i in range(size.steps):
            c = k * size.wide + i
            for r in range(width):
                p[r, c] = numbers[i, chosen[k], r]
            if rows[2] > 0:
                p[width, c] = levels[i, chosen[k]]
            for r in range(own):
                v[guess + r, c] = drawn[i, chosen[k], r]
                p[width + rows[2] + 1 + r, c] = v[guess + r, c]
                v[first + r, c] = inside(begun[i, chosen[k], r], lower[r], upper[r], push)
            v[given + 3, c] = weight
    out = np.zeros((last + outer * (outer + 1) // 2 + outer + inner * (outer + 1) + 1, columns))
    steps = np.zeros((inner + 2 * unequal + 2 * own, columns))
    dt, dz = inner, inner + 2 * unequal
    return Slots(
        chosen, depends, lower, upper, weight, guess, given, v, p, out, out[:stated],
        out[stated : stated + stated * w].reshape((stated, w, columns)), out[last:],
        np.zeros((w + stated, columns)), np.zeros((stated, columns)), v[t : t + unequal],
        v[t + unequal : t + unequal + own], v[t + unequal + own : guess],
        steps, steps[:inner], steps[dt : dt + unequal], steps[dt + unequal : dz],
        steps[dz : dz + own], steps[dz + own :],
    )  # fmt: skip


@njit(**LEAN)
def place(size, slots, target, v, s):
    """Write poses and level into the variables of the slots."""
    for r in range(len(slots.depends)):
        row = slots.depends[r]
        for k in range(len(slots.active)):
            for i in range(size.steps):
                target[r, k * size.wide + i] = v[row, i + 1]
    if size.shared > 0:
        for c in range(target.shape[1]):
            target[len(slots.depends), c] = s


@njit(**LEAN)
def start_slots(size, slots, eps, mu, push):
    """Slacks at the values, but off zero, and multipliers mu / t; see `point.begin`."""
    own = len(slots.depends) + size.shared
    multipliers = slots.v[own + len(slots.lower) :]
    for c in range(slots.v.shape[1]):
        for j in range(slots.t.shape[0]):
            slots.t[j, c] = max(slots.tried[j, c] + eps[c % size.wide], push)
            multipliers[j, c] = mu / slots.t[j, c]
        for r in range(len(slots.lower)):
            if slots.lower[r] > -INF:
                slots.zl[r, c] = mu / (slots.v[own + r, c] - slots.lower[r])
            if slots.upper[r] < INF:
                slots.zu[r, c] = mu / (slots.upper[r] - slots.v[own + r, c])


@njit(**LEAN)
def reach_slots(size, slots, most):
    """Raise ``most``, of each stage the largest decrease of a slack, multiplier or gap.

    Decreases count as shares of what they decrease: of primal values in row 0, of dual in row 1.
    """
    first, wide = len(slots.depends) + size.shared, size.wide
    multipliers = slots.v[first + len(slots.lower) :]
    for k in range(len(slots.active)):
        at = k * wide
        for j in range(slots.t.shape[0]):
            for i in range(wide):
                t, y = slots.t[j, at + i], multipliers[j, at + i]
                most[0, i] = larger(-slots.dt[j, at + i] / t, most[0, i])
                most[1, i] = larger(-slots.dlam[j, at + i] / y, most[1, i])
        for r in range(len(slots.lower)):
            low, high = slots.lower[r], slots.upper[r]
            for i in range(wide if low > -INF else 0):
                a, z = slots.v[first + r, at + i], slots.zl[r, at + i]
                most[0, i] = larger(-slots.da[r, at + i] / (a - low), most[0, i])
                most[1, i] = larger(-slots.dzl[r, at + i] / z, most[1, i])
            for i in range(wide if high < INF else 0):
                a, z = slots.v[first + r, at + i], slots.zu[r, at + i]
                most[0, i] = larger(slots.da[r, at + i] / (high - a), most[0, i])
                most[1, i] = larger(-slots.dzu[r, at + i] / z, most[1, i])


@njit(**LEAN)
def slope_slots(size, slots, mu):
    """Return the derivative along the step of barrier terms and regularisation."""
    first, wide, total = len(slots.depends) + size.shared, size.wide, 0.0
    for at in range(0, slots.v.shape[1], wide):
        for j in range(slots.t.shape[0]):
            for c in range(at, at + size.steps):
                total -= mu * slots.dt[j, c] / slots.t[j, c]
        for r in range(len(slots.lower)):
            for c in range(at, at + size.steps):
                a, step = slots.v[first + r, c], slots.da[r, c]
                total += 2.0 * slots.weight * (a - slots.v[slots.guess + r, c]) * step
                if slots.lower[r] > -INF:
                    total -= mu * step / (a - slots.lower[r])
                if slots.upper[r] < INF:
                    total += mu * step / (slots.upper[r] - a)
    return total


@njit(**LEAN)
def try_slots(size, slots, step):
    """Own variables at a trial point; `place` writes the rest."""
    first = len(slots.depends) + size.shared
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            slots.trial[first + r, c] = slots.v[first + r, c] + step * slots.da[r, c]


@njit(**LEAN)
def merit_slots(size, slots, eps, step):
    """Residual, regularisation and sum of logarithms at a trial point."""
    value, variables, unequal = slots.tried, slots.trial, slots.t.shape[0]
    first, wide = len(slots.depends) + size.shared, size.wide
    residual, cost, total, product = 0.0, 0.0, 0.0, 1.0
    for at in range(0, slots.v.shape[1], wide):
        for j in range(unequal):
            for i in range(size.steps):
                t = slots.t[j, at + i] + step * slots.dt[j, at + i]
                residual += abs(value[j, at + i] + eps[i] - t)
                total, product = logarithm(total, product, t)
        for j in range(unequal, value.shape[0]):
            for i in range(size.steps):
                residual += abs(value[j, at + i])
        for r in range(len(slots.lower)):
            for c in range(at, at + size.steps):
                a = variables[first + r, c]
                cost += slots.weight * (a - slots.v[slots.guess + r, c]) ** 2
                if slots.lower[r] > -INF:
                    total, product = logarithm(total, product, a - slots.lower[r])
                if slots.upper[r] < INF:
                    total, product = logarithm(total, product, slots.upper[r] - a)
    return residual, cost, total + np.log(product)


@njit(**LEAN)
def accept_slots(size, slots, primal, dual, mu):
    """Take the step in slacks, multipliers and own variables."""
    first, own = len(slots.depends) + size.shared, len(slots.lower)
    multipliers = slots.v[first + own :]
    for j in range(slots.t.shape[0]):
        for c in range(slots.t.shape[1]):
            slots.t[j, c] += primal * slots.dt[j, c]
            z = multipliers[j, c] + dual * slots.dlam[j, c]
            multipliers[j, c] = safe(z, slots.t[j, c], mu)
    for r in range(own):
        for c in range(slots.t.shape[1]):
            slots.v[first + r, c] += primal * slots.da[r, c]
            a = slots.v[first + r, c]
            if slots.lower[r] > -INF:
                z = slots.zl[r, c] + dual * slots.dzl[r, c]
                slots.zl[r, c] = safe(z, a - slots.lower[r], mu)
            if slots.upper[r] < INF:
                z = slots.zu[r, c] + dual * slots.dzu[r, c]
                slots.zu[r, c] = safe(z, slots.upper[r] - a, mu)
    for j in range(slots.t.shape[0], slots.tried.shape[0]):  # the step solves for -y
        for c in range(slots.t.shape[1]):
            new = -slots.da[own + j - slots.t.shape[0], c]
            multipliers[j, c] += primal * (new - multipliers[j, c])


@njit(**LEAN)
def pull_slots(size, slots, pull, eps, tally, mu):
    """Add the slots' forces to the gradient of the Lagrangian, and to the ``tally`` of each stage.

    Its rows are the sum of the multipliers that press on the stage's slack, the largest residual,
    error of complementarity and of stationarity, the force on the level, the sum of the bounds'
    multipliers.
    """
    first, wide, known = len(slots.depends) + size.shared, size.wide, len(slots.depends)
    multipliers = slots.v[first + len(slots.lower) :]
    for at in range(0, slots.v.shape[1], wide):
        for j in range(slots.tried.shape[0]):
            for r in range(known):
                row = slots.depends[r]
                for i in range(size.steps):
                    pull[row, i + 1] -= multipliers[j, at + i] * slots.slope[j, r, at + i]
            for i in range(wide if size.shared > 0 else 0):
                tally[4, i] -= multipliers[j, at + i] * slots.slope[j, known, at + i]
        for j in range(slots.t.shape[0]):
            for i in range(wide):
                t, y = slots.t[j, at + i], multipliers[j, at + i]
                tally[0, i] += y
                tally[1, i] = larger(abs(slots.value[j, at + i] + eps[i] - t), tally[1, i])
                tally[2, i] = larger(abs(t * y - mu), tally[2, i])
        for j in range(slots.t.shape[0], slots.tried.shape[0]):
            for i in range(wide):
                tally[1, i] = larger(abs(slots.value[j, at + i]), tally[1, i])
        _pull_own(size, slots, at, multipliers, tally, mu)


@njit(**LEAN)
def _pull_own(size, slots, at, multipliers, tally, mu):
    """Do the same for the own variables: stationarity, complementarity, sum of multipliers."""
    first = len(slots.depends) + size.shared
    for r in range(len(slots.lower)):
        low, high = slots.lower[r], slots.upper[r]
        for i in range(size.steps):
            c = at + i
            a = slots.v[first + r, c]
            force = 2.0 * slots.weight * (a - slots.v[slots.guess + r, c])
            for j in range(slots.tried.shape[0]):
                force -= multipliers[j, c] * slots.slope[j, first + r, c]
            if low > -INF:
                force -= slots.zl[r, c]
                tally[2, i] = larger(abs((a - low) * slots.zl[r, c] - mu), tally[2, i])
                tally[5, i] += slots.zl[r, c]
            if high < INF:
                force += slots.zu[r, c]
                tally[2, i] = larger(abs((high - a) * slots.zu[r, c] - mu), tally[2, i])
                tally[5, i] += slots.zu[r, c]
            tally[3, i] = larger(abs(force), tally[3, i])


@njit(**LEAN)
def withdraw(size, slots, length):
    """Take the step in the own variables back."""
    first = len(slots.depends) + size.shared
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            slots.v[first + r, c] -= length * slots.da[r, c]


@njit(**LEAN)
def write_slots(size, slots, into):
    """Copy the own variables into an array (N, K, A)."""
    first = len(slots.depends) + size.shared
    for k in range(len(slots.active)):
        for i in range(size.steps):
            for r in range(len(slots.lower)):
                into[i, slots.active[k], r] = slots.v[first + r, k * size.wide + i]
