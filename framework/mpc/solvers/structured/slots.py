"""The obstacles of all stages: their poses, slacks, multipliers and own variables.

One column c = i K + k per stage i + 1 and active slot k. Each states h(x, s, a) + eps_i = t > 0
and e(x, s, a) = 0 with own variables a. Rows of ``v`` are (x's entries, s, a, lambda, y), as
the kernel wants them.
"""

from collections import namedtuple

import numpy as np
from numba import njit

from .boxes import INF, inside
from .memory import FAST, LEAN, logarithm, reach, safe

Slots = namedtuple(
    "Slots",
    "active depends lower upper pull v p out value slope hessian trial tried t dt dlam zl zu dzl "
    "dzu da back matrix force gradient",
)
"""Of one kind. ``active`` K slots, ``depends`` entries of x, ``pull`` weight of the
regularisation; ``matrix``, ``force``, ``gradient`` room for one slot; ``back`` gives the step of a
slot's own variables from that of (x, s, eps, 1)."""


@njit(**FAST)
def make_slots(size, kind, scale, push):
    """Room for the active slots of one kind, with their numbers and own variables.

    ``kind`` is (entries of x that matter, (rows of h, rows of e, whether slots have a level),
    limits of the own variables (2, A), their regularisation (1,), parameters (N, K, P), levels
    (N, K), active (K,), what the regularisation pulls to and the start (2, N, K, A)).
    """
    depends, rows, limits, regularisation, numbers, levels, active, guess = kind
    lower, upper = limits[0], limits[1]
    chosen = np.flatnonzero(active > 0.0)
    steps = size.steps
    columns, own, first = steps * len(chosen), len(lower), len(depends) + size.shared
    w, stated = first + own, rows[0] + rows[1]
    inner = first + own + rows[1] + 1
    width = numbers.shape[2]
    at = width + rows[2] + 1  # the guess stands behind parameters, level and mask
    v, p = np.zeros((w + stated, columns)), np.ones((at + own, columns))
    for i in range(steps):
        for k in range(len(chosen)):
            c = i * len(chosen) + k
            for r in range(width):
                p[r, c] = numbers[i, chosen[k], r]
            if rows[2] > 0:
                p[width, c] = levels[i, chosen[k]]
            for r in range(own):
                p[at + r, c] = guess[0, i, chosen[k], r]
                v[first + r, c] = inside(guess[1, i, chosen[k], r], lower[r], upper[r], push)
    out = np.zeros((stated + stated * w + w * w, columns))
    last = stated + stated * w
    tall, wide = (rows[0], columns), (own, columns)
    return Slots(
        chosen, depends, lower, upper, np.array([scale * regularisation[0], float(at)]), v, p,
        out, out[:stated], out[stated:last].reshape((stated, w, columns)),
        out[last:].reshape((w, w, columns)), np.zeros_like(v), np.zeros((stated, columns)),
        np.zeros(tall), np.zeros(tall), np.zeros(tall), np.zeros(wide), np.zeros(wide),
        np.zeros(wide), np.zeros(wide), np.zeros((own + rows[1], columns)),
        np.zeros((columns, own + rows[1], first + 2)),
        np.zeros((inner, inner)), np.zeros(inner), np.zeros(inner),
    )  # fmt: skip


@njit(**LEAN)
def place(size, slots, target, v, s):
    """Write poses and level into the variables of the slots."""
    count = len(slots.active)
    for r in range(len(slots.depends)):
        row = slots.depends[r]
        for i in range(v.shape[1] - 1):
            for k in range(count):
                target[r, i * count + k] = v[row, i + 1]
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
            slots.t[j, c] = max(slots.tried[j, c] + eps[c // len(slots.active)], push)
            multipliers[j, c] = mu / slots.t[j, c]
        for r in range(len(slots.lower)):
            if slots.lower[r] > -INF:
                slots.zl[r, c] = mu / (slots.v[own + r, c] - slots.lower[r])
            if slots.upper[r] < INF:
                slots.zu[r, c] = mu / (slots.upper[r] - slots.v[own + r, c])


@njit(**LEAN)
def reach_slots(size, slots, share, primal, dual):
    """Shorten the step lengths so that slacks, multipliers and gaps stay positive."""
    first = len(slots.depends) + size.shared
    multipliers = slots.v[first + len(slots.lower) :]
    for j in range(slots.t.shape[0]):
        for c in range(slots.t.shape[1]):
            primal = reach(slots.t[j, c], slots.dt[j, c], share, primal)
            dual = reach(multipliers[j, c], slots.dlam[j, c], share, dual)
    for r in range(len(slots.lower)):
        for c in range(slots.t.shape[1]):
            a, step = slots.v[first + r, c], slots.da[r, c]
            if slots.lower[r] > -INF:
                primal = reach(a - slots.lower[r], step, share, primal)
                dual = reach(slots.zl[r, c], slots.dzl[r, c], share, dual)
            if slots.upper[r] < INF:
                primal = reach(slots.upper[r] - a, -step, share, primal)
                dual = reach(slots.zu[r, c], slots.dzu[r, c], share, dual)
    return primal, dual


@njit(**LEAN)
def slope_slots(size, slots, mu):
    """Return the derivative along the step of barrier terms and regularisation."""
    first, total = len(slots.depends) + size.shared, 0.0
    for j in range(slots.t.shape[0]):
        for c in range(slots.t.shape[1]):
            total -= mu * slots.dt[j, c] / slots.t[j, c]
    weight, row = slots.pull[0], int(slots.pull[1])
    for r in range(len(slots.lower)):
        for c in range(slots.t.shape[1]):
            a, step = slots.v[first + r, c], slots.da[r, c]
            total += 2.0 * weight * (a - slots.p[row + r, c]) * step
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
    value, variables = slots.tried, slots.trial
    first, count = len(slots.depends) + size.shared, len(slots.active)
    residual, cost, total, product = 0.0, 0.0, 0.0, 1.0
    for j in range(value.shape[0]):
        for i in range(size.steps):
            for c in range(i * count, (i + 1) * count):
                if j < slots.t.shape[0]:
                    t = slots.t[j, c] + step * slots.dt[j, c]
                    residual += abs(value[j, c] + eps[i] - t)
                    total, product = logarithm(total, product, t)
                else:
                    residual += abs(value[j, c])
    weight, row = slots.pull[0], int(slots.pull[1])
    for r in range(len(slots.lower)):
        for c in range(value.shape[1]):
            a = variables[first + r, c]
            cost += weight * (a - slots.p[row + r, c]) ** 2
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
    for j in range(slots.t.shape[0], multipliers.shape[0]):  # the step solves for -y
        for c in range(slots.t.shape[1]):
            new = -slots.da[own + j - slots.t.shape[0], c]
            multipliers[j, c] += primal * (new - multipliers[j, c])


@njit(**LEAN)
def pull_slots(size, slots, pull, eps, pressure, mu):
    """Add the slots' forces to the gradient of the Lagrangian.

    ``pressure`` gets the sum of the multipliers of each stage. Returns the force on the level,
    the largest residual, error of stationarity and of complementarity, sum of multipliers.
    """
    count, first = len(slots.active), len(slots.depends) + size.shared
    multipliers = slots.v[first + len(slots.lower) :]
    level, primal, error, total = 0.0, 0.0, 0.0, 0.0
    known = len(slots.depends)
    for j in range(multipliers.shape[0]):
        for i in range(size.steps):
            weight = 0.0
            for c in range(i * count, (i + 1) * count):
                y = multipliers[j, c]
                weight += y
                if size.shared > 0:
                    level -= y * slots.slope[j, known, c]
                if j < slots.t.shape[0]:
                    primal = max(primal, abs(slots.value[j, c] + eps[i] - slots.t[j, c]))
                    error = max(error, abs(slots.t[j, c] * y - mu))
                else:
                    primal = max(primal, abs(slots.value[j, c]))
            for r in range(known):
                force = 0.0
                for c in range(i * count, (i + 1) * count):
                    force += multipliers[j, c] * slots.slope[j, r, c]
                pull[slots.depends[r], i + 1] -= force
            if j < slots.t.shape[0]:
                pressure[i] += weight
                total += weight
    dual, own, more = _pull_own(size, slots, multipliers, mu)
    return level, primal, dual, max(error, own), total + more


@njit(**LEAN)
def _pull_own(size, slots, multipliers, mu):
    """Do the same for the own variables: stationarity, complementarity, sum of multipliers."""
    first = len(slots.depends) + size.shared
    weight, row = slots.pull[0], int(slots.pull[1])
    dual, error, total = 0.0, 0.0, 0.0
    for r in range(len(slots.lower)):
        for c in range(multipliers.shape[1]):
            a = slots.v[first + r, c]
            force = 2.0 * weight * (a - slots.p[row + r, c])
            for j in range(multipliers.shape[0]):
                force -= multipliers[j, c] * slots.slope[j, first + r, c]
            if slots.lower[r] > -INF:
                force -= slots.zl[r, c]
                error = max(error, abs((a - slots.lower[r]) * slots.zl[r, c] - mu))
                total += slots.zl[r, c]
            if slots.upper[r] < INF:
                force += slots.zu[r, c]
                error = max(error, abs((slots.upper[r] - a) * slots.zu[r, c] - mu))
                total += slots.zu[r, c]
            dual = max(dual, abs(force))
    return dual, error, total


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
    first, count = len(slots.depends) + size.shared, len(slots.active)
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            into[c // count, slots.active[c % count], r] = slots.v[first + r, c]
