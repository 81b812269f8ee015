"""A point of the iteration: where it starts, its derivatives, its errors, its merit."""

import numpy as np
from numba import njit

from ....jit.columns import caller
from .boxes import inside, log_bounds, pull_bounds, start_bounds
from .memory import LEAN, LENGTH, MU, RHO, SMIN, ZS, S, larger, logarithm
from .rows import merit_rows, pull_rows, start_rows
from .slots import merit_slots, place, pull_slots, start_slots, try_slots

call = caller()
(
    DRIVE, NODE, NODE_VALUES, LEVEL, SLOT, SLOT_VALUES, SLOT_ELIMINATE, SLOT_EXPAND, WALL,
    WALL_VALUES, WALL_ELIMINATE, WALL_EXPAND, SWEEP,
) = range(13)  # fmt: skip
"""Places of the kernels' addresses."""


@njit(**LEAN)
def start(size, path, state, given, push):
    """States and inputs of the guess, off their bounds. ``given``: initial, states, inputs."""
    n, lower, upper = size.n, path.lower, path.upper
    initial, states, inputs = given
    for r in range(n):
        path.v[r, 0] = initial[r]
        for i in range(size.steps):
            value = inside(states[i + 1, r], lower[r], upper[r], push)
            path.v[r, i + 1] = path.vn[r, i] = value
    for r in range(size.m):
        for i in range(size.steps):
            path.v[n + r, i] = inside(inputs[i, r], lower[n + r], upper[n + r], push)
    state[S] = inside(state[S], state[SMIN], np.inf, push)


@njit(**LEAN)
def rescale(size, path, model, kernels, heads, most):
    """Scale of the cost at which no entry of its gradient exceeds ``most``."""
    heads[-1, :] = 1.0
    call(kernels[DRIVE], 0, size.wide, path.v, heads, model.drive)
    call(kernels[NODE], 0, size.wide, path.vn, heads, model.node)
    largest = 1e-12
    for i in range(size.steps):
        for r in range(size.w):
            largest = max(largest, abs(model.drive[size.n + 1 + r, i]))
        for r in range(size.n):
            largest = max(largest, abs(model.node[1 + r, i]))
    heads[-1, :] = max(min(1.0, most / largest), 1e-8)
    return heads[-1, 0]


@njit(**LEAN)
def begin(size, path, slack, inputs, nodes, state, moving, standing, push):
    """Slacks and multipliers for the barrier mu; values are those of the trial point."""
    mu, rho = state[MU], state[RHO]
    for i in range(size.steps):
        deepest = 0.0
        for slots in (moving, standing):
            deepest = min(deepest, _deepest(size, slots, i))
        # inside a region, as far from zero as the region is deep: short slacks mean short steps
        slack.eps[i] = mu / rho - deepest if deepest > -push else push - 2.0 * deepest
        slack.nu[i] = mu / slack.eps[i]
    for slots in (moving, standing):
        start_slots(size, slots, slack.eps, mu, push)
    for rows in (inputs, nodes):
        start_rows(rows, mu, push)
    start_bounds(size, path, mu)
    state[ZS] = mu / (state[S] - state[SMIN]) if state[SMIN] > -np.inf else 0.0


@njit(**LEAN)
def _deepest(size, slots, i):
    """Lowest value of a stage's inequalities, at most 0."""
    lowest, count = 0.0, len(slots.active)
    for j in range(slots.t.shape[0]):
        for c in range(i, i + count * size.wide, size.wide):
            lowest = min(lowest, slots.tried[j, c])
    return lowest


@njit(**LEAN)
def derive(size, path, model, state, kernels, heads, level, moving, standing):
    """Values and derivatives of everything at the present point, that was tried last."""
    v = path.v
    for r in range(size.n):
        for i in range(size.steps):
            path.vn[r, i] = v[r, i + 1]
    if size.inputs > 0:  # else `try_point` did
        call(kernels[DRIVE], 0, size.wide, v, heads, model.drive)
    call(kernels[NODE], 0, size.wide, path.vn, heads, model.node)
    at = SLOT
    for slots in (moving, standing):
        if slots.v.shape[1]:
            place(size, slots, slots.v, v, state[S])
            call(kernels[at], 0, slots.v.shape[1], slots.v, slots.p, slots.out)
        at = WALL
    level.v[0, 0] = state[S]
    call(kernels[LEVEL], 0, 1, level.v, level.p, level.out)
    for r in range(size.n):
        for i in range(size.steps):
            model.gap[r, i] = model.drive[r, i] - v[r, i + 1]


@njit(**LEAN)
def try_point(
    size, path, step, model, slack, trial, state, kernels, heads, level, moving, standing, s
):
    """Values at the point ``state``'s step length along the direction; s is the level there.

    Of ``drive`` the derivatives as well: nine of ten points are taken, and the sines and cosines
    that both need take half of its time.
    """
    length = state[LENGTH]
    for r in range(size.w):
        for i in range(size.steps + 1):
            trial.v[r, i] = path.v[r, i] + length * step.v[r, i]
    for i in range(size.steps):
        for r in range(size.n):
            trial.vn[r, i] = trial.v[r, i + 1]
        trial.slack[i] = slack.eps[i] + length * slack.deps[i]
    for r in range(size.n):
        for i in range(size.wide):
            trial.v[size.w + r, i] = path.v[size.w + r, i] + length * step.pi[r, i]
    call(kernels[DRIVE], 0, size.wide, trial.v, heads, model.drive)
    call(kernels[NODE_VALUES], 0, size.wide, trial.vn, heads, trial.node)
    at = SLOT_VALUES
    for slots in (moving, standing):
        if slots.v.shape[1]:
            try_slots(size, slots, length)
            place(size, slots, slots.trial, trial.v, s)
            call(kernels[at], 0, slots.v.shape[1], slots.trial, slots.p, slots.tried)
        at = WALL_VALUES
    level.v[0, 0] = s
    call(kernels[LEVEL], 0, 1, level.v, level.p, level.tried)


@njit(**LEAN)
def merit(size, path, model, trial, inputs, nodes, state, level, moving, standing, s):
    """Residual theta, cost and logarithms at the trial point: phi = cost - mu logarithms.

    At last the cost without slack and regularisation.
    """
    n, length = size.n, state[LENGTH]
    cost, theta = level.tried[0, 0], 0.0
    for i in range(size.steps):
        cost += model.drive[n, i] + trial.node[0, i]
        for r in range(n):
            theta += abs(model.drive[r, i] - trial.v[r, i + 1])
    plain = cost
    logarithms = log_bounds(size, path, trial.v)
    for rows in (inputs, nodes):
        more, gain = merit_rows(rows, length)
        theta, logarithms = theta + more, logarithms + gain
    for slots in (moving, standing):
        more, price, gain = merit_slots(size, slots, trial.slack, length)
        theta, cost, logarithms = theta + more, cost + price, logarithms + gain
    if len(moving.active) + len(standing.active):
        total, product = 0.0, 1.0
        for i in range(size.steps):
            cost += state[RHO] * trial.slack[i]
            total, product = logarithm(total, product, trial.slack[i])
        logarithms += total + np.log(product)
    if state[SMIN] > -np.inf:
        logarithms += np.log(s - state[SMIN])
    return theta, cost, logarithms, plain


@njit(**LEAN)
def errors(size, path, model, pull, slack, inputs, nodes, state, level, moving, standing):
    """Largest residual, error of stationarity and of complementarity, and the scale of both.

    The scale is that of IPOPT: the mean multiplier, where it exceeds 100.
    """
    mu, force, tally = state[MU], level.out[1, 0], slack.tally
    total, count = _pull(size, path, model, pull), size.n * size.steps
    primal = _largest(model.gap, size.steps)
    error, more, many = pull_bounds(size, path, pull, mu)
    total, count = total + more, count + many
    for rows in (inputs, nodes):
        off, wrong, more, many = pull_rows(rows, pull, mu)
        primal, error = max(primal, off), max(error, wrong)
        total, count = total + more, count + many
    if len(moving.active) + len(standing.active):
        for r in range(tally.shape[0]):
            for i in range(size.wide):
                tally[r, i] = 0.0
        for slots in (moving, standing):
            pull_slots(size, slots, pull, slack.eps, tally, mu)
            count += len(slots.active) * size.steps * (slots.t.shape[0] + 2 * len(slots.lower))
    dual = _largest(pull, size.steps + 1)
    if len(moving.active) + len(standing.active):
        for i in range(size.steps):
            off = larger(tally[3, i], abs(state[RHO] - tally[0, i] - slack.nu[i]))
            dual, primal = larger(off, dual), larger(tally[1, i], primal)
            wrong = larger(tally[2, i], abs(slack.eps[i] * slack.nu[i] - mu))
            error, force = larger(wrong, error), force + tally[4, i]
            total += slack.nu[i] + tally[0, i] + tally[5, i]
        count += size.steps
    if state[SMIN] > -np.inf:
        force -= state[ZS]
        error = max(error, abs((state[S] - state[SMIN]) * state[ZS] - mu))
    dual = max(dual, abs(force) if size.shared > 0 else 0.0)
    return primal, dual, error, max(100.0, total / count) / 100.0


@njit(**LEAN)
def _pull(size, path, model, pull):
    """Gradient of cost and dynamics in states and inputs; returns the sum of |pi|."""
    n, w, total = size.n, size.w, 0.0
    for r in range(w):
        for i in range(size.steps):
            value = model.drive[n + 1 + r, i]
            for c in range(n):
                value += model.drive[size.jacobian + c * w + r, i] * path.v[w + c, i]
            pull[r, i] = value
        pull[r, size.steps] = 0.0
    for r in range(n):
        pull[r, 0] = 0.0  # x_0 is given
        for i in range(size.steps):
            pull[r, i + 1] += model.node[1 + r, i] - path.v[w + r, i]
            total += abs(path.v[w + r, i])
    return total


@njit(**LEAN)
def _largest(values, columns):
    """Largest absolute value; NaN where there is one in the last."""
    largest = 0.0
    for r in range(values.shape[0]):
        for i in range(columns):
            largest = larger(abs(values[r, i]), largest)
    return largest
