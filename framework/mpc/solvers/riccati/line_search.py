"""Filter line search, of Waechter and Biegler (2006), section 2.3, without its restoration.

A trial point has to improve the residual theta or the barrier function phi over the present
point and over every entry of the filter; close to feasibility phi has to fall as its slope
promises. Where no step does, the full step is taken and the filter forgotten: the regions are
soft, so that what is left to be restored is the dynamics, which full steps restore.
"""

import numpy as np
from numba import njit

from .boxes import accept_bounds, step_bounds
from .condense import expand
from .memory import (
    DS,
    DZS,
    ENTRIES,
    LEAN,
    MU,
    RHO,
    SMIN,
    THETA_LEAST,
    THETA_MOST,
    ZS,
    S,
    reach,
    safe,
)
from .point import SLOT_EXPAND, WALL_EXPAND
from .rows import accept_rows, step_rows
from .slack import open_slack, settle
from .slots import accept_slots, reach_slots, slope_slots, withdraw

HALVINGS = 12


@njit(**LEAN)
def measure_step(
    size, path, step, model, quadratic, slack, inputs, nodes, state, level, moving, standing,
    share, kernels,
):  # fmt: skip
    """Give the steps of all slacks and multipliers, longest step lengths, and the slope of phi."""
    mu, ds = state[MU], state[DS]
    slope = level.out[1, 0] * ds
    for i in range(size.steps):
        for r in range(size.w):
            slope += model.drive[size.n + 1 + r, i] * step.v[r, i]
        for r in range(size.n):
            slope += model.node[1 + r, i] * step.v[r, i + 1]
    primal, dual, gain = step_bounds(size, path, step, mu, share, 1.0, 1.0)
    slope += gain
    for rows in (inputs, nodes):
        primal, dual, gain = step_rows(rows, step.v, mu, share, primal, dual)
        slope += gain
    if len(moving.active) + len(standing.active):
        most = slack.most
        open_slack(size, quadratic, slack, step.v, ds, mu)
        for i in range(size.wide):
            most[0, i] = -slack.deps[i] / slack.eps[i]
            most[1, i] = -slack.dnu[i] / slack.nu[i]
        at = SLOT_EXPAND
        for slots in (moving, standing):
            expand(size, slots, slack, step.v, ds, kernels[at])
            at = WALL_EXPAND
        settle(size, moving, standing, slack, mu, state[RHO])
        for slots in (moving, standing):
            reach_slots(size, slots, most)
            slope += slope_slots(size, slots, mu)
        for i in range(size.steps):
            slope += (state[RHO] - mu / slack.eps[i]) * slack.deps[i]
            primal = reach(1.0, -most[0, i], share, primal)
            dual = reach(1.0, -most[1, i], share, dual)
    if state[SMIN] > -np.inf:
        gap = state[S] - state[SMIN]
        state[DZS] = (mu - state[ZS] * ds) / gap - state[ZS]
        primal, dual = reach(gap, ds, share, primal), reach(state[ZS], state[DZS], share, dual)
        slope -= mu * ds / gap
    return primal, dual, slope


@njit(**LEAN)
def welcome(filtered, state, length, slope, present, found):
    """Whether a trial point may be taken: 0 no, 1 yes, 2 yes, and remember the present one.

    ``present`` and ``found`` are (theta, phi).
    """
    theta, phi = present
    new_theta, new_phi = found
    if max(theta, new_theta) <= 1e-9 and abs(new_phi - phi) <= 1e-12 * abs(phi):
        return 1
    if not (new_theta <= state[THETA_MOST] and np.isfinite(new_phi)):
        return 0
    for k in range(int(state[ENTRIES])):
        if new_theta >= filtered[k, 0] and new_phi >= filtered[k, 1]:
            return 0
    rounding = 1e-13 * abs(phi)
    if theta <= state[THETA_LEAST] and slope < 0.0 and length * (-slope) ** 2.3 > theta**1.1:
        return 1 if new_phi <= phi + 1e-8 * length * slope + rounding else 0
    if new_theta <= (1.0 - 1e-5) * theta or new_phi <= phi - 1e-5 * theta + rounding:
        return 2
    return 0


@njit(**LEAN)
def remember(filtered, state, theta, phi):
    """Add an entry to the filter."""
    k = int(state[ENTRIES])
    if k < len(filtered):
        filtered[k, 0], filtered[k, 1] = (1.0 - 1e-5) * theta, phi - 1e-5 * theta
        state[ENTRIES] = k + 1


@njit(**LEAN)
def accept(size, path, step, slack, inputs, nodes, state, moving, standing, primal, dual):
    """Take the step."""
    mu = state[MU]
    accept_bounds(size, path, step, primal, dual, mu)
    for r in range(size.n):
        for i in range(size.steps):
            path.v[size.w + r, i] += primal * step.pi[r, i]
    for rows in (inputs, nodes):
        accept_rows(rows, primal, dual, mu)
    if len(moving.active) + len(standing.active):
        for i in range(size.wide):
            slack.eps[i] += primal * slack.deps[i]
            slack.nu[i] = safe(slack.nu[i] + dual * slack.dnu[i], slack.eps[i], mu)
    state[S] += primal * state[DS]
    if state[SMIN] > -np.inf:
        state[ZS] = safe(state[ZS] + dual * state[DZS], state[S] - state[SMIN], mu)
    for slots in (moving, standing):
        accept_slots(size, slots, primal, dual, mu)


@njit(**LEAN)
def take_back(size, path, step, state, moving, standing, length):
    """Return to states, inputs and own variables before the step, the last that were finite."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                path.v[r, i] -= length * step.v[r, i]
    state[S] -= length * state[DS]
    for slots in (moving, standing):
        withdraw(size, slots, length)
