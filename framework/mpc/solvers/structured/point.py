"""A point of the iteration: where it starts, its derivatives, its errors, its merit."""

import numpy as np
from numba import njit

from ....jit.columns import caller
from .boxes import inside, log_bounds, pull_bounds, start_bounds
from .memory import LEAN, LENGTH, MU, RHO, SMIN, ZS, S, logarithm
from .rows import merit_rows, pull_rows, start_rows
from .slots import merit_slots, place, pull_slots, start_slots, try_slots

call = caller()
(DRIVE, DRIVE_VALUES, NODE, NODE_VALUES, LEVEL, SLOT, SLOT_VALUES, WALL, WALL_VALUES) = range(9)
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
    call(kernels[DRIVE], 0, size.steps, path.v, heads, model.drive)
    call(kernels[NODE], 0, size.steps, path.vn, heads, model.node)
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
        deepest = min(_deepest(moving, i), _deepest(standing, i))
        # inside a region, as far from zero as the region is deep: short slacks mean short steps
        slack.eps[i] = mu / rho - deepest if deepest > -push else push - 2.0 * deepest
        slack.nu[i] = mu / slack.eps[i]
    start_slots(size, moving, slack.eps, mu, push)
    start_slots(size, standing, slack.eps, mu, push)
    start_rows(inputs, mu, push)
    start_rows(nodes, mu, push)
    start_bounds(size, path, mu)
    state[ZS] = mu / (state[S] - state[SMIN]) if state[SMIN] > -np.inf else 0.0


@njit(**LEAN)
def _deepest(slots, i):
    """Lowest value of a stage's inequalities, at most 0."""
    lowest, count = 0.0, len(slots.active)
    for j in range(slots.t.shape[0]):
        for c in range(i * count, (i + 1) * count):
            lowest = min(lowest, slots.tried[j, c])
    return lowest


@njit(**LEAN)
def derive(size, path, model, state, kernels, heads, level, moving, standing):
    """Values and derivatives of everything at the present point."""
    v = path.v
    for r in range(size.n):
        for i in range(size.steps):
            path.vn[r, i] = v[r, i + 1]
    call(kernels[DRIVE], 0, size.steps, v, heads, model.drive)
    call(kernels[NODE], 0, size.steps, path.vn, heads, model.node)
    _derive_slots(size, moving, kernels[SLOT], v, state[S])
    _derive_slots(size, standing, kernels[WALL], v, state[S])
    level.v[0, 0] = state[S]
    call(kernels[LEVEL], 0, 1, level.v, level.p, level.out)
    for r in range(size.n):
        for i in range(size.steps):
            model.gap[r, i] = model.drive[r, i] - v[r, i + 1]


@njit(**LEAN)
def _derive_slots(size, slots, kernel, v, s):
    if slots.v.shape[1]:
        place(size, slots, slots.v, v, s)
        call(kernel, 0, slots.v.shape[1], slots.v, slots.p, slots.out)


@njit(**LEAN)
def _try_slots(size, slots, kernel, v, s, length):
    if slots.v.shape[1]:
        try_slots(size, slots, length)
        place(size, slots, slots.trial, v, s)
        call(kernel, 0, slots.v.shape[1], slots.trial, slots.p, slots.tried)


@njit(**LEAN)
def try_point(size, path, step, slack, trial, state, kernels, heads, level, moving, standing, s):
    """Values at the point ``state``'s step length along the direction; s is the level there."""
    length = state[LENGTH]
    for r in range(size.w):
        for i in range(size.steps + 1):
            trial.v[r, i] = path.v[r, i] + length * step.v[r, i]
    for i in range(size.steps):
        for r in range(size.n):
            trial.vn[r, i] = trial.v[r, i + 1]
        trial.slack[i] = slack.eps[i] + length * slack.deps[i]
    call(kernels[DRIVE_VALUES], 0, size.steps, trial.v, heads, trial.drive)
    call(kernels[NODE_VALUES], 0, size.steps, trial.vn, heads, trial.node)
    _try_slots(size, moving, kernels[SLOT_VALUES], trial.v, s, length)
    _try_slots(size, standing, kernels[WALL_VALUES], trial.v, s, length)
    level.v[0, 0] = s
    call(kernels[LEVEL], 0, 1, level.v, level.p, level.tried)


@njit(**LEAN)
def merit(size, path, trial, inputs, nodes, state, level, moving, standing, s):
    """Residual theta, cost and logarithms at the trial point: phi = cost - mu logarithms."""
    n, length = size.n, state[LENGTH]
    cost, theta = level.tried[0, 0], 0.0
    for i in range(size.steps):
        cost += trial.drive[n, i] + trial.node[0, i]
        for r in range(n):
            theta += abs(trial.drive[r, i] - trial.v[r, i + 1])
    logarithms = log_bounds(size, path, trial.v)
    more, gain = merit_rows(inputs, length)
    theta, logarithms = theta + more, logarithms + gain
    more, gain = merit_rows(nodes, length)
    theta, logarithms = theta + more, logarithms + gain
    more, price, gain = merit_slots(size, moving, trial.slack, length)
    theta, cost, logarithms = theta + more, cost + price, logarithms + gain
    more, price, gain = merit_slots(size, standing, trial.slack, length)
    theta, cost, logarithms = theta + more, cost + price, logarithms + gain
    if len(moving.active) + len(standing.active):
        total, product = 0.0, 1.0
        for i in range(size.steps):
            cost += state[RHO] * trial.slack[i]
            total, product = logarithm(total, product, trial.slack[i])
        logarithms += total + np.log(product)
    if state[SMIN] > -np.inf:
        logarithms += np.log(s - state[SMIN])
    return theta, cost, logarithms


@njit(**LEAN)
def errors(size, path, model, pull, slack, inputs, nodes, state, level, moving, standing):
    """Largest residual, error of stationarity and of complementarity, and the scale of both.

    The scale is that of IPOPT: the mean multiplier, where it exceeds 100.
    """
    mu, force, eps, pressure = state[MU], level.out[1, 0], slack.eps, slack.pressure
    total, count, primal = _pull(size, path, model, pull), model.gap.size, _largest(model.gap)
    error, more, many = pull_bounds(size, path, pull, mu)
    total, count = total + more, count + many
    off, wrong, more, many = pull_rows(inputs, pull, mu)
    primal, error, total, count = max(primal, off), max(error, wrong), total + more, count + many
    off, wrong, more, many = pull_rows(nodes, pull, mu)
    primal, error, total, count = max(primal, off), max(error, wrong), total + more, count + many
    for i in range(size.steps):
        pressure[i] = 0.0
    push, off, dual, wrong, more = pull_slots(size, moving, pull, eps, pressure, mu)
    force, primal, error, total = force + push, max(primal, off), max(error, wrong), total + more
    push, off, still, wrong, more = pull_slots(size, standing, pull, eps, pressure, mu)
    force, primal, error, total = force + push, max(primal, off), max(error, wrong), total + more
    dual = max(dual, still)
    count += moving.t.size + standing.t.size + 2 * (moving.zl.size + standing.zl.size)
    if len(moving.active) + len(standing.active):
        for i in range(size.steps):
            dual = max(dual, abs(state[RHO] - slack.pressure[i] - slack.nu[i]))
            error = max(error, abs(slack.eps[i] * slack.nu[i] - mu))
            total, count = total + slack.nu[i], count + 1
    if state[SMIN] > -np.inf:
        force -= state[ZS]
        error = max(error, abs((state[S] - state[SMIN]) * state[ZS] - mu))
    dual = max(_largest(pull), max(dual, abs(force) if size.shared > 0 else 0.0))
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
def _largest(values):
    """Largest absolute value; NaN where there is one."""
    largest = 0.0
    for r in range(values.shape[0]):
        for i in range(values.shape[1]):
            if not abs(values[r, i]) <= largest:
                largest = abs(values[r, i])
    return largest
