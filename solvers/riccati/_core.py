"""The primal-dual interior-point iteration, from the first point to the results.

A. Waechter and L. T. Biegler, On the implementation of an interior-point filter line-search
algorithm for large-scale nonlinear programming, Math. Program. 106 (2006): barrier, step
lengths, filter and regularisation are theirs. The Newton step is a Riccati recursion over the
horizon, `kernels.sweep`, after everything that belongs to one obstacle has been eliminated,
`kernels.eliminate`.

Every quantity of a stage is a row whose entries run over the stages, so that one call of a kernel
serves all of them. Everything works on w = (x, u). Rows of ``v`` are (x, u, pi, y), of ``vn`` (x
of the next stage, y of its constraints), as `kernels.build` wants them.

Obstacles have one column c = k wide + i per active slot k and stage i + 1. Each states
h(x, s, a) + eps_i = t > 0 and e(x, s, a) = 0 with own variables a. Rows of ``v`` are (x's entries,
s, a, lambda, y), as the kernel wants them, and behind them what `kernels.eliminate` wants: t,
multipliers of the bounds of a, what a is drawn to; slack, barrier, regularisation, weight of the
draw; steps of (x's entries, s) and of the slack.

Constraints of the robot hold without slack: each is c(w) - t = 0, t > 0.

Functions are longer here than elsewhere in the project, and are inlined into one: Numba compiles
whatever a function calls into it once more, so that a deeper tree of calls takes minutes to
compile, and handing all arrays on took a fifth of an iteration. They take the groups of arrays
that they need and no more: what Numba compiles grows with every array that is handed on.
"""

from collections import namedtuple
from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from ...framework.jit.columns import caller
from ._protocol import KERNEL, NUMBER, OUTCOME, SETTING, SIZE, SlotKernels
from .interior_point import (
    ARMIJO,
    BARRIER_FACTOR,
    BARRIER_POWER,
    BOUNDARY_SHARE,
    DEARER,
    DEARER_BARRIER,
    FAILURES,
    FILTER_SIZE,
    FIRST_GROWTH,
    FIRST_SHIFT,
    HARDLY_ENTERED,
    LARGEST_RESIDUAL,
    LARGEST_SHIFT,
    LAST_BARRIER,
    MARGIN,
    MUCH_DEARER,
    MUCH_SLACK,
    MULTIPLIER_RANGE,
    NEAR,
    RESIDUAL_POWER,
    ROUNDING,
    SAME_TARGET,
    SETTLED_SLOPE,
    SETTLED_STEPS,
    SHIFT_DECREASE,
    SHIFT_GROWTH,
    SLACK_LEFT,
    SLOPE_POWER,
    SMALL_RESIDUAL,
    SMALLEST_PIVOT,
    SMALLEST_SHIFT,
    STILL_CHANGE,
    STILL_RESIDUAL,
    TRIALS,
    WARM_RANGE,
)

call = caller()
INF = np.inf

SMALLEST_FACTOR = 1.0 / MULTIPLIER_RANGE

FAST: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "nogil": True,
}
"""No check for division by zero, sums in any order; NaN and infinity keep their meaning."""

LEAN: dict[str, Any] = {**FAST, "_nrt": False, "forceinline": True}
"""The same for functions that make no arrays, nor call one that does: Numba then counts no
references, which costs as much as the work on short arrays."""

Size = namedtuple(
    "Size", "n m w shared steps wide inputs always nodes jacobian hessian value slope"
)
"""n, m, n + m, whether a level is shared, N, columns of every array; rows of constraints on
(x_i, u_i), on every x_i, and on x_N; first rows of [A B], Hessian, constraints and their slopes in
the result of ``drive``, where f, the cost and its gradient come first.

There are at least N + 1 columns, and a multiple of 8, which processors work on at once: what is
computed for each column is computed for all of them. What stands in those that no stage has is
never read."""

Path = namedtuple("Path", "v vn lower upper zl zu")
"""Variables; bounds of w and their multipliers (w, N + 1)."""

Step = namedtuple("Step", "v pi zl zu")
"""Steps of them."""

Model = namedtuple("Model", "drive node gap")
"""Results of the kernels ``drive`` at i < N and ``node`` at i > 0, and f(x_i, u_i) - x_{i+1}."""

Limits = namedtuple("Limits", "out value slope width y first t dt dy tried at always after")
"""Constraints of the robot with a slack t: where values and slopes stand in ``out`` and the
multipliers in ``y``; slacks and steps; ``tried`` holds values at a trial point from row ``at``.
The first ``always`` hold at every step, the rest at the last alone; ``after`` is 1 where they are
about x of the next stage."""

Trial = namedtuple("Trial", "v vn node slack")
"""Variables and values at a point that is tried; those of ``drive`` stand in the model, see
`try_point`."""

Quadratic = namedtuple("Quadratic", "rows hessian gradient cross slots force top seen")
"""Condensed, without what ``drive`` gives, one column per stage: ``rows`` holds the Hessian of w
(w w, row by row; its part up to the diagonal), its gradient, the mixed derivatives of x and the
level, the gap of the dynamics and the regularisation; the first three have names of their own.
``slots`` ((n + 2)^2), ``force`` (n + 2): what slots add to (x, s, slack), of which they touch the
entries ``seen`` of x; curvature and slope of the level."""

Gains = namedtuple("Gains", "rows P p q top sound K k ks")
"""Results of `kernels.sweep`, one column per stage, and the first rows of its pieces."""

Slack = namedtuple("Slack", "eps nu deps dnu tally most")
"""Of the regions, one per stage, its multiplier, their steps; what `stationarity_of_slots`
and `boundary_of_slots` find."""

Level = namedtuple("Level", "v p out tried")
"""Variables and parameters of the kernel ``level``, its result here and at a trial point."""

(
    MU, RHO, S, DS, ZS, DZS, SMIN, DELTA, THETA_MOST, THETA_LEAST, ENTRIES, FAILED_SEARCHES,
    LENGTH, SHARE,
) = range(14)  # fmt: skip
"""Places in the array of single numbers: barrier, penalty, level with step, multiplier and its
step, its bound; last regularisation, limits and length of the filter, failed searches, step length
that is tried, share of the way to a bound that it may go."""
SCALARS = SHARE + 1

REFUSE, ACCEPT, ACCEPT_AND_ADD = range(3)
"""Answers of the filter: the last accepts the trial point and adds the present one."""

SlotArrays = namedtuple(
    "SlotArrays",
    "kernels active depends lower upper weight guess given v p out value slope condensed trial "
    "tried t zl zu steps da dt dlam dzl dzu",
)
"""Of one kind. ``kernels`` addresses, ``active`` K slots, ``depends`` entries of x, ``weight`` of
the regularisation; ``guess`` and ``given`` rows of ``v`` where what a is drawn to, and the slack,
begin; ``out`` holds results of the kernel and ``condensed``, ``da`` new multipliers of -e behind
the step of a."""


# ---- The iteration


@njit(**FAST)
def solve(kernels, sizes, limits, settings, head, given, given_slots, found, stop):
    """Solve one problem from one guess.

    Parameters
    ----------
    kernels, sizes, settings : by the names of `Kernels`, `Sizes`, `Settings`.
    limits : (2, w), bounds of w.
    head, given, found : `Head`, `Start`, `Found`.
    given_slots : `SlotArguments` of each kind.
    stop : a number that another thread may set to end the solve.
    """
    size = size_of(sizes, len(given.inputs))
    block = make_block(size, 2 * head.reference.shape[1] + head.curve.shape[1] + 2)
    path, step, block = make_path(size, limits, block)
    model, trial, block = make_model(size, block)
    quadratic, gains, block = make_newton(size, union(given_slots), block)
    columns, block = make_columns(size, head, block)
    slack, pull = make_slack(block)
    on_inputs, on_nodes = make_limits(size, path, model, trial)
    filtered, level = np.zeros((FILTER_SIZE, 2)), make_level()
    state = make_state(settings)
    start_point(size, path, state, given, settings[SETTING.push])
    scale = rescale(size, path, model, kernels, columns, settings[SETTING.gradient])
    state[RHO], state[THETA_MOST] = scale * settings[SETTING.penalty], -1.0
    if size.shared > 0:
        level.p[0, 0] = mean_level(given_slots)
    level.p[1, 0] = scale
    kinds = make_kinds(size, given_slots, scale, settings[SETTING.push])
    slots, tolerance = count_slots(kinds), settings[SETTING.tolerance]
    if settings[SETTING.warm] > 0.0:
        state[MU] = LAST_BARRIER * tolerance
        _take_costates(size, path.v, given.multipliers, scale)
    status, iterations, error, present, length = -1, -1, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0
    longest, reach, slope, attempt, forget = 0.0, 0.0, 0.0, 0, False
    left, deepest, primal, settled = np.inf, 0.0, np.inf, 0  # left: slack at the last price
    inequalities = _count_inequalities(size, kinds)
    numbers = found.numbers
    while True:
        # the trial point: at first the guess, then along the direction
        state[LENGTH], s = length, state[S] + length * state[DS]
        try_point(size, path, step, model, slack, trial, state, kernels, columns, level, kinds, s)
        if iterations < 0:
            start_multipliers(size, path, slack, on_inputs, on_nodes, state, kinds,
                              settings[SETTING.push])  # fmt: skip
            if settings[SETTING.warm] > 0.0:
                take_multipliers(size, path, slack, on_inputs, on_nodes, state, kinds,
                                 given.multipliers, given_slots, scale,
                                 settings[SETTING.barrier], settings[SETTING.push])  # fmt: skip
            trial.slack[:] = slack.eps
        tried = merit(size, path, model, trial, on_inputs, on_nodes, state, level, kinds, s)
        if iterations >= 0:
            phi = present[1] - state[MU] * present[2]
            new = tried[0], tried[1] - state[MU] * tried[2]
            answer = filter_accepts(filtered, state, length, slope, (present[0], phi), new)
            attempt += 1
            if answer == REFUSE and not forget:
                length *= 0.5
                if attempt == TRIALS:
                    state[FAILED_SEARCHES] += 1
                    state[ENTRIES], state[THETA_MOST], forget = 0, -1.0, True
                    length = longest if state[FAILED_SEARCHES] < 3 else 0.5 * longest
                continue
            if forget and not np.isfinite(new[1]):
                status = OUTCOME.failed
                break
            if answer == ACCEPT_AND_ADD and not forget:
                add_to_filter(filtered, state, present[0], phi)
            accept(size, path, step, slack, on_inputs, on_nodes, state, kinds, length, reach)
        iterations, present = iterations + 1, tried
        differentiate(size, path, model, state, kernels, columns, level, kinds)
        primal, dual, wrong, many = errors(
            size, path, model, pull, slack, on_inputs, on_nodes, state, level, kinds
        )
        error = max(primal, max(dual, wrong + state[MU]) / many)
        if not np.isfinite(error):
            undo_step(size, path, step, state, kinds, length)
        if not np.isfinite(error) or state[FAILED_SEARCHES] > FAILURES:
            status = OUTCOME.failed
            break
        deepest = slack.eps[: size.steps].max() if slots else 0.0
        if error <= tolerance or (settled >= SETTLED_STEPS and deepest > MUCH_SLACK):
            total = slack.eps[: size.steps].sum() if slots else 0.0
            if deepest <= SLACK_LEFT * tolerance:
                status = OUTCOME.solved
                break
            if state[RHO] >= scale * settings[SETTING.most_penalty] or total > 0.99 * left:
                status = OUTCOME.infeasible
                break
            if settings[SETTING.plans] > 0.0 and present[1] > scale * settings[SETTING.best]:
                status = OUTCOME.dearer  # and dearer still at a higher price
                break
            # slack is left that a higher price may remove; if it does not, this point is kept
            _write_results(size, path, slack, on_inputs, on_nodes, state, kinds, given.initial,
                           given_slots, found, scale)  # fmt: skip
            numbers[NUMBER.cost], numbers[NUMBER.level], left = present[3] / scale, state[S], total
            price = present[1] + (DEARER - 1.0) * state[RHO] * total
            present = present[0], price, present[2], present[3]
            _raise_price(size, slack, state)
        if iterations >= settings[SETTING.iterations] or stop[0] > 0.0:
            status = OUTCOME.stopped if stop[0] > 0.0 else OUTCOME.limit
            break
        _lower_barrier(state, settings[SETTING.test], tolerance, primal, dual / many, wrong / many)
        if not _direction(size, path, step, model, quadratic, gains, slack, on_inputs, on_nodes,
                          state, level, kinds, kernels):  # fmt: skip
            status = OUTCOME.failed
            break
        state[SHARE] = max(BOUNDARY_SHARE, 1.0 - state[MU])
        longest, reach, slope, fall = measure_step(size, path, step, model, quadratic, slack,
                                                   on_inputs, on_nodes, state, level, kinds,
                                                   state[SHARE])  # fmt: skip
        length, attempt, forget = longest, 0, False
        settled = settled + 1 if is_settled(state, tolerance, primal, slope, present) else 0
        if settings[SETTING.plans] > 0.0:
            total = slack.eps[: size.steps].sum() if slots else 0.0
            ahead = (present[1] + fall - state[MU] * inequalities) / scale
            status = hopeless(
                size, path, step, quadratic.seen, given.plans, settings, ahead, total
            )
            if status >= 0:
                break
    if status == OUTCOME.limit and primal <= tolerance and slots > 0 and deepest > MUCH_SLACK:
        # it converges slowly, but all that moves is how slack is shared out
        status, left = OUTCOME.infeasible, np.inf
    if left == np.inf or status == OUTCOME.solved or status == OUTCOME.infeasible:
        _write_results(size, path, slack, on_inputs, on_nodes, state, kinds, given.initial,
                       given_slots, found, scale)  # fmt: skip
        numbers[NUMBER.cost], numbers[NUMBER.level] = present[3] / scale, state[S]
    elif status == OUTCOME.limit or status == OUTCOME.failed:
        status = OUTCOME.infeasible  # with the point that was kept
    numbers[NUMBER.status], numbers[NUMBER.iterations] = status, iterations
    numbers[NUMBER.error], numbers[NUMBER.penalty] = error, state[RHO] / scale


@njit(**LEAN)
def is_settled(state, tolerance, primal, slope, present):
    """Whether the whole Newton step keeps phi, all residuals being small and mu the last one."""
    last = state[MU] <= LAST_BARRIER * tolerance and primal <= tolerance
    return last and abs(slope) <= SETTLED_SLOPE * abs(present[1] - state[MU] * present[2])


@njit(**LEAN)
def _raise_price(size, slack, state):
    """Raise the price of slack, and begin a new filter."""
    state[RHO] *= DEARER
    state[MU] = max(state[MU], DEARER_BARRIER)
    for i in range(size.steps):
        slack.nu[i] = max(state[RHO] - slack.tally[0, i], state[MU] / slack.eps[i])
    state[ENTRIES], state[THETA_MOST] = 0, -1.0


@njit(**LEAN)
def _lower_barrier(state, test, tolerance, primal, dual, wrong):
    """Fiacco and McCormick: a smaller mu once the problem for this one is nearly solved.

    It is solved well enough where the errors are below ``test`` times mu.
    """
    mu = state[MU]
    least = LAST_BARRIER * tolerance
    while mu > least and max(primal, max(dual, wrong)) <= test * mu:
        state[MU] = max(least, min(BARRIER_FACTOR * mu, mu**BARRIER_POWER))
        state[ENTRIES], state[THETA_MOST] = 0, -1.0
        wrong += mu - state[MU]
        mu = state[MU]


@njit(**LEAN)
def _direction(
    size, path, step, model, quadratic, gains, slack, inputs, nodes, state, level, kinds, kernels,
):  # fmt: skip
    """Newton direction of the regularised problem whose reduced Hessian is positive definite."""
    last, state[DELTA] = state[DELTA], 0.0
    while state[DELTA] < LARGEST_SHIFT:
        good = _quadratic(size, path, model, quadratic, slack, inputs, nodes, state, level, kinds)
        if good and backward(size, model, quadratic, gains, state, kernels[KERNEL.sweep]):
            if state[DELTA] == 0.0:
                state[DELTA] = last
            forward(size, path, step, model, gains, state[DS])
            return True
        if state[DELTA] == 0.0:
            state[DELTA] = (
                FIRST_SHIFT if last == 0.0 else max(SMALLEST_SHIFT, last / SHIFT_DECREASE)
            )
        else:
            state[DELTA] *= FIRST_GROWTH if last == 0.0 else SHIFT_GROWTH
    return False


@njit(**LEAN)
def _quadratic(size, path, model, quadratic, slack, inputs, nodes, state, level, kinds):
    """Condense everything into stages of (x, u), and the level's curvature and slope."""
    n, w, mu, delta, top = size.n, size.w, state[MU], state[DELTA], quadratic.top
    _clear(quadratic)  # the recursion adds what comes from `drive`
    top[0], top[1] = level.out[2, 0], level.out[1, 0]
    for slots in kinds:
        if not condense_slots(size, slots, quadratic, slack.eps, mu, delta):
            return False
    if count_slots(kinds):
        eliminate_slack(size, quadratic, slack, mu, state[RHO])
    for r in range(n):
        for i in range(size.steps):
            quadratic.gradient[r, i + 1] += model.node[1 + r, i]
        for c in range(r + 1):
            for i in range(size.steps):
                quadratic.hessian[r * w + c, i + 1] += model.node[1 + n + r * n + c, i]
    add_bounds(size, path, quadratic, mu)
    for rows in (inputs, nodes):
        add_rows(size, rows, quadratic, mu)
    if state[SMIN] > -np.inf:
        gap = state[S] - state[SMIN]
        top[0] += state[ZS] / gap
        top[1] -= mu / gap
    return True


@njit(**LEAN)
def _clear(quadratic):
    """Set the quadratic to zero; slices set to a number are far slower."""
    for values in (quadratic.hessian, quadratic.gradient, quadratic.cross, quadratic.slots,
                   quadratic.force):  # fmt: skip
        for r in range(values.shape[0]):
            for i in range(values.shape[1]):
                values[r, i] = 0.0


@njit(**LEAN)
def _write_results(
    size, path, slack, inputs, nodes, state, kinds, initial, given_slots, found, scale
):
    """Copy the last point into the results, and its multipliers for the cost before scaling.

    An array of no steps for the multipliers means that they are not wanted.
    """
    n, w, v, some = size.n, size.w, path.v, count_slots(kinds)
    into = found.multipliers
    for r in range(n):
        found.states[0, r] = initial[r]
    for i in range(size.steps):
        for r in range(n):
            found.states[i + 1, r] = v[r, i + 1]
        for r in range(size.m):
            found.inputs[i, r] = v[n + r, i]
        found.slack[i] = slack.eps[i] if some else 0.0
    for i in range(len(into)):
        for r in range(w):
            k = i + 1 if r < n else i
            into[i, r], into[i, w + r] = path.zl[r, k] / scale, path.zu[r, k] / scale
        for r in range(n):
            into[i, 2 * w + r] = v[w + r, i] / scale
        for j in range(size.inputs):
            into[i, 2 * w + n + j] = inputs.y[inputs.first + j, i] / scale
        for j in range(size.nodes):
            into[i, 2 * w + n + size.inputs + j] = nodes.y[nodes.first + j, i] / scale
        into[i, -2] = slack.nu[i] / scale if some else 0.0
        into[i, -1] = state[ZS] / scale
    for k in range(len(kinds)):
        write_slots(size, kinds[k], given_slots[k].found, given_slots[k].after, scale)


# ---- A point: where it starts, its derivatives, its merit, its errors


@njit(**LEAN)
def start_point(size, path, state, given, push):
    """States and inputs of the guess, a `Start`, off their bounds."""
    n, lower, upper = size.n, path.lower, path.upper
    initial, states, inputs = given.initial, given.states, given.inputs
    for r in range(n):
        path.v[r, 0] = initial[r]
        for i in range(size.steps):
            value = push_inside(states[i + 1, r], lower[r], upper[r], push)
            path.v[r, i + 1] = path.vn[r, i] = value
    for r in range(size.m):
        for i in range(size.steps):
            path.v[n + r, i] = push_inside(inputs[i, r], lower[n + r], upper[n + r], push)
    state[S] = push_inside(state[S], state[SMIN], np.inf, push)


@njit(**LEAN)
def rescale(size, path, model, kernels, heads, most):
    """Scale of the cost at which no entry of its gradient exceeds ``most``."""
    heads[-1, :] = 1.0
    call(kernels[KERNEL.drive], 0, size.wide, path.v, heads, model.drive)
    call(kernels[KERNEL.node], 0, size.wide, path.vn, heads, model.node)
    largest = 1e-12
    for i in range(size.steps):
        for r in range(size.w):
            largest = max(largest, abs(model.drive[size.n + 1 + r, i]))
        for r in range(size.n):
            largest = max(largest, abs(model.node[1 + r, i]))
    heads[-1, :] = max(min(1.0, most / largest), 1e-8)
    return heads[-1, 0]


@njit(**LEAN)
def start_multipliers(size, path, slack, inputs, nodes, state, kinds, push):
    """Slacks and multipliers for the barrier mu; values are those of the trial point."""
    mu, rho = state[MU], state[RHO]
    for i in range(size.steps):
        deepest = 0.0
        for slots in kinds:
            deepest = min(deepest, _deepest(size, slots, i))
        # inside a region, as far from zero as the region is deep: short slacks mean short steps
        slack.eps[i] = mu / rho - deepest if deepest > -push else push - 2.0 * deepest
        slack.nu[i] = mu / slack.eps[i]
    for slots in kinds:
        start_slots(size, slots, slack.eps, mu, push)
    for rows in (inputs, nodes):
        start_rows(rows, mu, push)
    start_bounds(size, path, mu)
    state[ZS] = mu / (state[S] - state[SMIN]) if state[SMIN] > -np.inf else 0.0


@njit(**LEAN)
def take_multipliers(
    size, path, slack, inputs, nodes, state, kinds, given, given_slots, scale, most, push
):
    """Take given multipliers instead; mu is the mean of multiplier times gap, at most ``most``.

    Where none is given, NaN, the multiplier becomes mu / gap.
    """
    n, w, some = size.n, size.w, count_slots(kinds)
    for i in range(size.steps):
        for r in range(w):
            k = i + 1 if r < n else i
            path.zl[r, k], path.zu[r, k] = scale * given[i, r], scale * given[i, w + r]
        for j in range(size.inputs):
            inputs.y[inputs.first + j, i] = scale * given[i, 2 * w + n + j]
        for j in range(size.nodes):
            nodes.y[nodes.first + j, i] = scale * given[i, 2 * w + n + size.inputs + j]
    total, count = _sum_of_bounds(size, path)
    for rows in (inputs, nodes):
        more, many = _sum_of_rows(rows)
        total, count = total + more, count + many
    for k in range(len(kinds)):
        more, many = take_of_slots(size, kinds[k], given_slots[k].before, scale, push)
        total, count = total + more, count + many
    state[MU] = mu = max(state[MU], min(most, total / max(count, 1)))
    clip_bounds(size, path, mu)
    for rows in (inputs, nodes):
        clip_rows(rows, mu)
    if state[SMIN] > -np.inf:
        state[ZS] = known_multiplier(scale * given[0, -1], state[S] - state[SMIN], mu)
    for i in range(size.steps if some else 0):
        price = min(max(scale * given[i, -2], state[RHO] / WARM_RANGE), state[RHO])
        slack.eps[i], slack.nu[i] = mu / price, price
    for slots in kinds:
        clip_slots(size, slots, slack.eps, mu)


@njit(**LEAN)
def _take_costates(size, v, given, scale):
    """Take given multipliers of the dynamics."""
    for r in range(size.n):
        for i in range(size.steps):
            v[size.w + r, i] = scale * given[i, 2 * size.w + r]


@njit(**LEAN)
def known_multiplier(z, gap, mu):
    """Return a multiplier within a factor of mu / gap; NaN becomes mu / gap."""
    if z != z:
        return mu / gap
    return max(min(z, WARM_RANGE * mu / gap), mu / (WARM_RANGE * gap))


@njit(**LEAN)
def _deepest(size, slots, i):
    """Lowest value of a stage's inequalities, at most 0."""
    lowest, count = 0.0, len(slots.active)
    for j in range(slots.t.shape[0]):
        for c in range(i, i + count * size.wide, size.wide):
            lowest = min(lowest, slots.tried[j, c])
    return lowest


@njit(**LEAN)
def differentiate(size, path, model, state, kernels, heads, level, kinds):
    """Values and derivatives of everything at the present point, that was tried last."""
    v = path.v
    for r in range(size.n):
        for i in range(size.steps):
            path.vn[r, i] = v[r, i + 1]
    if size.inputs > 0:  # else `try_point` did
        call(kernels[KERNEL.drive], 0, size.wide, v, heads, model.drive)
    call(kernels[KERNEL.node], 0, size.wide, path.vn, heads, model.node)
    for slots in kinds:
        if slots.v.shape[1]:
            write_poses(size, slots, slots.v, v, state[S])
            call(slots.kernels.derivatives, 0, slots.v.shape[1], slots.v, slots.p, slots.out)
    level.v[0, 0] = state[S]
    call(kernels[KERNEL.level], 0, 1, level.v, level.p, level.out)
    for r in range(size.n):
        for i in range(size.steps):
            model.gap[r, i] = model.drive[r, i] - v[r, i + 1]


@njit(**LEAN)
def try_point(size, path, step, model, slack, trial, state, kernels, heads, level, kinds, s):
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
    call(kernels[KERNEL.drive], 0, size.wide, trial.v, heads, model.drive)
    call(kernels[KERNEL.node_values], 0, size.wide, trial.vn, heads, trial.node)
    for slots in kinds:
        if slots.v.shape[1]:
            try_slots(size, slots, length)
            write_poses(size, slots, slots.trial, trial.v, s)
            call(slots.kernels.values, 0, slots.v.shape[1], slots.trial, slots.p, slots.tried)
    level.v[0, 0] = s
    call(kernels[KERNEL.level], 0, 1, level.v, level.p, level.tried)


@njit(**LEAN)
def merit(size, path, model, trial, inputs, nodes, state, level, kinds, s):
    """Residual theta, cost and logarithms at the trial point: phi = cost - mu logarithms.

    At last the cost without slack and regularisation.
    """
    n, length = size.n, state[LENGTH]
    cost, theta, least = level.tried[0, 0], 0.0, 1.0 - state[SHARE]
    for i in range(size.steps):
        cost += model.drive[n, i] + trial.node[0, i]
        for r in range(n):
            theta += abs(model.drive[r, i] - trial.v[r, i + 1])
    plain = cost
    logarithms = log_bounds(size, path, trial.v)
    for rows in (inputs, nodes):
        more, gain = merit_rows(rows, length, least)
        theta, logarithms = theta + more, logarithms + gain
    for slots in kinds:
        more, price, gain = merit_slots(size, slots, trial.slack, length, least)
        theta, cost, logarithms = theta + more, cost + price, logarithms + gain
    if count_slots(kinds):
        total, product = 0.0, 1.0
        for i in range(size.steps):
            cost += state[RHO] * trial.slack[i]
            total, product = add_logarithm(total, product, trial.slack[i])
        logarithms += total + np.log(product)
    if state[SMIN] > -np.inf:
        logarithms += np.log(s - state[SMIN])
    return theta, cost, logarithms, plain


@njit(**LEAN)
def errors(size, path, model, pull, slack, inputs, nodes, state, level, kinds):
    """Largest residual, error of stationarity and of complementarity, and the scale of both.

    The scale is that of IPOPT: the mean multiplier, where it exceeds 100.
    """
    mu, force, tally = state[MU], level.out[1, 0], slack.tally
    total, count = _stationarity_of_path(size, path, model, pull), size.n * size.steps
    primal = _largest(model.gap, size.steps)
    error, more, many = stationarity_of_bounds(size, path, pull, mu)
    total, count = total + more, count + many
    for rows in (inputs, nodes):
        off, wrong, more, many = stationarity_of_rows(rows, pull, mu)
        primal, error = max(primal, off), max(error, wrong)
        total, count = total + more, count + many
    if count_slots(kinds):
        for r in range(tally.shape[0]):
            for i in range(size.wide):
                tally[r, i] = 0.0
        for slots in kinds:
            stationarity_of_slots(size, slots, pull, slack.eps, tally, mu)
            count += len(slots.active) * size.steps * (slots.t.shape[0] + 2 * len(slots.lower))
    dual = _largest(pull, size.steps + 1)
    if count_slots(kinds):
        for i in range(size.steps):
            off = max_or_nan(tally[3, i], abs(state[RHO] - tally[0, i] - slack.nu[i]))
            dual, primal = max_or_nan(off, dual), max_or_nan(tally[1, i], primal)
            wrong = max_or_nan(tally[2, i], abs(slack.eps[i] * slack.nu[i] - mu))
            error, force = max_or_nan(wrong, error), force + tally[4, i]
            total += slack.nu[i] + tally[0, i] + tally[5, i]
        count += size.steps
    if state[SMIN] > -np.inf:
        force -= state[ZS]
        error = max(error, abs((state[S] - state[SMIN]) * state[ZS] - mu))
    dual = max(dual, abs(force) if size.shared > 0 else 0.0)
    return primal, dual, error, max(100.0, total / count) / 100.0


@njit(**LEAN)
def _stationarity_of_path(size, path, model, pull):
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
            largest = max_or_nan(abs(values[r, i]), largest)
    return largest


# ---- Filter line search


@njit(**LEAN)
def measure_step(
    size, path, step, model, quadratic, slack, inputs, nodes, state, level, kinds, share
):
    """Give the steps of all slacks and multipliers, longest step lengths, and the slope of phi.

    At last the slope of the cost, with slack and without the barrier.
    """
    mu, ds = state[MU], state[DS]
    slope = level.out[1, 0] * ds
    for i in range(size.steps):
        for r in range(size.w):
            slope += model.drive[size.n + 1 + r, i] * step.v[r, i]
        for r in range(size.n):
            slope += model.node[1 + r, i] * step.v[r, i + 1]
    fall = slope
    primal, dual, gain = step_bounds(size, path, step, mu, share, 1.0, 1.0)
    slope += gain
    for rows in (inputs, nodes):
        primal, dual, gain = step_rows(rows, step.v, mu, share, primal, dual)
        slope += gain
    if count_slots(kinds):
        most = slack.most
        recover_slack(size, quadratic, slack, step.v, ds, mu)
        for i in range(size.wide):
            most[0, i] = -slack.deps[i] / slack.eps[i]
            most[1, i] = -slack.dnu[i] / slack.nu[i]
        for slots in kinds:
            expand_slots(size, slots, slack, step.v, ds)
        refine_multipliers(size, kinds, slack, mu, state[RHO])
        for slots in kinds:
            boundary_of_slots(size, slots, most)
            slope += slope_slots(size, slots, mu)
        for i in range(size.steps):
            slope += (state[RHO] - mu / slack.eps[i]) * slack.deps[i]
            fall += state[RHO] * slack.deps[i]
            primal = fraction_to_boundary(1.0, -most[0, i], share, primal)
            dual = fraction_to_boundary(1.0, -most[1, i], share, dual)
    if state[SMIN] > -np.inf:
        gap = state[S] - state[SMIN]
        state[DZS] = (mu - state[ZS] * ds) / gap - state[ZS]
        primal, dual = (
            fraction_to_boundary(gap, ds, share, primal),
            fraction_to_boundary(state[ZS], state[DZS], share, dual),
        )
        slope -= mu * ds / gap
    return primal, dual, slope, fall


@njit(**LEAN)
def hopeless(size, path, step, seen, plans, settings, ahead, entered):
    """Return an outcome where this start will not lead to a better plan than those known, or -1.

    It leads to the same plan where both the present point and that of the whole Newton step are
    near it. It leads to a dearer one where regions are hardly entered and the cost ``ahead``, that
    of the whole step by the cost's slope less what the barrier may still be worth, is far above
    the best.
    """
    for k in range(int(settings[SETTING.plans])):
        here, there = 0.0, 0.0
        for r in seen:
            for i in range(1, size.steps + 1):
                off = path.v[r, i] - plans[k, i, r]
                here, there = max(here, abs(off)), max(there, abs(off + step.v[r, i]))
        if here < settings[SETTING.within] and there < SAME_TARGET * settings[SETTING.within]:
            return OUTCOME.same
    best = settings[SETTING.best]
    if entered < HARDLY_ENTERED and ahead > best + MUCH_DEARER * (1.0 + abs(best)):
        return OUTCOME.dearer
    return -1


@njit(**LEAN)
def filter_accepts(filtered, state, length, slope, present, found):
    """Whether the filter accepts a trial point: `REFUSE`, `ACCEPT` or `ACCEPT_AND_ADD`.

    ``present`` and ``found`` are (theta, phi). A new filter takes its limits from the former.
    """
    theta, phi = present
    new_theta, new_phi = found
    if state[THETA_MOST] < 0.0:
        state[THETA_MOST] = LARGEST_RESIDUAL * max(1.0, theta)
        state[THETA_LEAST] = SMALL_RESIDUAL * max(1.0, theta)
    if max(theta, new_theta) <= STILL_RESIDUAL and abs(new_phi - phi) <= STILL_CHANGE * abs(phi):
        return ACCEPT
    if not (new_theta <= state[THETA_MOST] and np.isfinite(new_phi)):
        return REFUSE
    for k in range(int(state[ENTRIES])):
        if new_theta >= filtered[k, 0] and new_phi >= filtered[k, 1]:
            return REFUSE
    rounding = ROUNDING * abs(phi)
    steep = slope < 0.0 and length * (-slope) ** SLOPE_POWER > theta**RESIDUAL_POWER
    if theta <= state[THETA_LEAST] and steep:
        return ACCEPT if new_phi <= phi + ARMIJO * length * slope + rounding else REFUSE
    if new_theta <= (1.0 - MARGIN) * theta or new_phi <= phi - MARGIN * theta + rounding:
        return ACCEPT_AND_ADD
    return REFUSE


@njit(**LEAN)
def add_to_filter(filtered, state, theta, phi):
    """Add an entry to the filter."""
    k = int(state[ENTRIES])
    if k < len(filtered):
        filtered[k, 0], filtered[k, 1] = (1.0 - MARGIN) * theta, phi - MARGIN * theta
        state[ENTRIES] = k + 1


@njit(**LEAN)
def accept(size, path, step, slack, inputs, nodes, state, kinds, primal, dual):
    """Take the step."""
    mu, least = state[MU], 1.0 - state[SHARE]
    accept_bounds(size, path, step, primal, dual, mu)
    for r in range(size.n):
        for i in range(size.steps):
            path.v[size.w + r, i] += primal * step.pi[r, i]
    for rows in (inputs, nodes):
        accept_rows(rows, primal, dual, mu, least)
    if count_slots(kinds):
        for i in range(size.wide):
            slack.eps[i] += primal * slack.deps[i]
            slack.nu[i] = clip_multiplier(slack.nu[i] + dual * slack.dnu[i], slack.eps[i], mu)
    state[S] += primal * state[DS]
    if state[SMIN] > -np.inf:
        state[ZS] = clip_multiplier(state[ZS] + dual * state[DZS], state[S] - state[SMIN], mu)
    for slots in kinds:
        accept_slots(size, slots, slack.eps, primal, dual, mu, least)


@njit(**LEAN)
def undo_step(size, path, step, state, kinds, length):
    """Return to states, inputs and own variables before the step, the last that were finite."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                path.v[r, i] -= length * step.v[r, i]
    state[S] -= length * state[DS]
    for slots in kinds:
        undo_slots(size, slots, length)


# ---- Newton step: Riccati recursion over the horizon


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
        if not curvature > SMALLEST_PIVOT:
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


# ---- Newton step: the obstacles of all stages


@njit(**LEAN)
def condense_slots(size, slots, quadratic, eps, mu, delta):
    """Add one kind of slots to ``slots`` and ``force`` of the quadratic.

    Returns whether the curvature in their own variables is right.
    """
    count, wide = len(slots.active), size.wide
    if count == 0:
        return True
    row = slots.given
    for k in range(count):
        for i in range(wide):
            slots.v[row, k * wide + i] = eps[i]
            slots.v[row + 1, k * wide + i] = mu
            slots.v[row + 2, k * wide + i] = delta
    call(slots.kernels.eliminate, 0, count * wide, slots.v, slots.out, slots.condensed)
    if slots.da.shape[0]:
        row = slots.condensed.shape[0] - 1
        for k in range(count):
            for i in range(size.steps):
                if not slots.condensed[row, k * wide + i] > 0.0:
                    return False
    _sum_slots(size, slots, quadratic)
    return True


@njit(**LEAN)
def _sum_slots(size, slots, quadratic):
    """Sum over the slots of each stage."""
    n, known, wide = size.n, len(slots.depends), size.wide
    outer, found = known + size.shared + 1, slots.condensed
    at = 0
    for r in range(outer):
        row = slots.depends[r] if r < known else (n + 1 if r == outer - 1 else n)
        for c in range(r + 1):
            column = slots.depends[c] if c < known else (n + 1 if c == outer - 1 else n)
            place = max(row, column) * (n + 2) + min(row, column)
            for k in range(len(slots.active)):
                for i in range(wide):
                    quadratic.slots[place, i] += found[at, k * wide + i]
            at += 1
    for r in range(outer):
        row = slots.depends[r] if r < known else (n + 1 if r == outer - 1 else n)
        for k in range(len(slots.active)):
            for i in range(wide):
                quadratic.force[row, i] += found[at + r, k * wide + i]


@njit(**LEAN)
def expand_slots(size, slots, slack, dv, ds):
    """Write the steps of own variables, slacks and multipliers of all slots of one kind."""
    known, count, wide = len(slots.depends), len(slots.active), size.wide
    if count == 0:
        return
    row = slots.given + 4
    for k in range(count):
        for r in range(known):
            for i in range(size.steps):
                slots.v[row + r, k * wide + i] = dv[slots.depends[r], i + 1]
        for i in range(wide):
            if size.shared > 0:
                slots.v[row + known, k * wide + i] = ds
            slots.v[row + known + size.shared, k * wide + i] = slack.deps[i]
    call(slots.kernels.expand, 0, count * wide, slots.v, slots.out, slots.steps)


# ---- Newton step: the slack of the regions


@njit(**LEAN)
def eliminate_slack(size, quadratic, slack, mu, rho):
    """Eliminate the slack of each stage, whose price is rho, and add the rest to the stages."""
    n, tall, wide = size.n, size.n + 2, size.wide
    into, force, seen = quadratic.slots, quadratic.force, quadratic.seen
    last = (n + 1) * tall
    for i in range(wide):
        into[last + n + 1, i] += slack.nu[i] / slack.eps[i]
        force[n + 1, i] += rho - mu / slack.eps[i]
    for a in range(len(seen) + size.shared):
        r = seen[a] if a < len(seen) else n
        for i in range(wide):
            force[r, i] -= into[last + r, i] * force[n + 1, i] / into[last + n + 1, i]
        for b in range(a + 1):
            c = seen[b] if b < len(seen) else n
            for i in range(wide):
                both = into[last + r, i] * into[last + c, i] / into[last + n + 1, i]
                into[max(r, c) * tall + min(r, c), i] -= both
    _add_slots_to_stages(size, quadratic)


@njit(**LEAN)
def _add_slots_to_stages(size, quadratic):
    """Add what slots contribute to the stages: x_{i+1} is that of stage i + 1."""
    n, tall, w = size.n, size.n + 2, size.w
    into, force, seen = quadratic.slots, quadratic.force, quadratic.seen
    for r in seen:
        for i in range(size.steps):
            quadratic.gradient[r, i + 1] += force[r, i]
        for c in seen:
            if c <= r:
                for i in range(size.steps):
                    quadratic.hessian[r * w + c, i + 1] += into[r * tall + c, i]
        if size.shared > 0:
            for i in range(size.steps):
                quadratic.cross[r, i + 1] = into[n * tall + r, i]
    if size.shared > 0:
        for i in range(size.steps):
            quadratic.top[0] += into[n * tall + n, i]
            quadratic.top[1] += force[n, i]


@njit(**LEAN)
def recover_slack(size, quadratic, slack, dv, ds, mu):
    """Write the steps of the slacks and their multipliers from those of states and level."""
    n, tall = size.n, size.n + 2
    into, force, last = quadratic.slots, quadratic.force, (size.n + 1) * (size.n + 2)
    for i in range(size.wide):
        slack.deps[i] = force[n + 1, i] + into[last + n, i] * ds
    for r in quadratic.seen:
        for i in range(size.steps):
            slack.deps[i] += into[last + r, i] * dv[r, i + 1]
    for i in range(size.wide):
        slack.deps[i] = -slack.deps[i] / into[last + tall - 1, i]
        eps, nu = slack.eps[i], slack.nu[i]
        slack.dnu[i] = (mu - nu * slack.deps[i]) / eps - nu


@njit(**LEAN)
def refine_multipliers(size, kinds, slack, mu, rho):
    """Correct the step of the constraint with the largest multiplier at each stage.

    Inside a region t is tiny, and its step, a difference of numbers that nearly cancel, loses all
    digits once it is multiplied by lambda / t. The slack's own equation,
    rho - nu - sum lambda = 0 after the step, gives the new lambda without that loss.
    """
    for i in range(size.steps):
        if slack.nu[i] > 0.9 * rho:
            continue
        largest = largest_multipliers(size, kinds, i)
        which = 0
        for k in range(1, len(kinds)):
            if largest[k][0] > largest[which][0]:
                which = k
        old, row, column = largest[which]
        if old < 0.1 * rho:
            continue
        new = rho - slack.nu[i] - slack.dnu[i]
        for total in sums_of_multipliers(size, kinds, i, which, row, column):
            new -= total
        _set_multiplier(kinds[which], row, column, new, old, mu)


@njit(**LEAN)
def _largest_multiplier(size, slots, i):
    """Return the largest multiplier of a stage and where it stands."""
    first, count = len(slots.depends) + size.shared + len(slots.lower), len(slots.active)
    largest, row, column = 0.0, 0, 0
    for j in range(slots.t.shape[0]):
        for c in range(i, i + count * size.wide, size.wide):
            if slots.v[first + j, c] > largest:
                largest, row, column = slots.v[first + j, c], j, c
    return largest, row, column


@njit(**LEAN)
def _sum_multipliers(size, slots, i, row, column):
    """Sum of the new multipliers of a stage, but for one."""
    first, count = len(slots.depends) + size.shared + len(slots.lower), len(slots.active)
    total = 0.0
    for j in range(slots.t.shape[0]):
        for c in range(i, i + count * size.wide, size.wide):
            if j != row or c != column:
                total += slots.v[first + j, c] + slots.dlam[j, c]
    return total


@njit(**LEAN)
def _set_multiplier(slots, j, c, new, old, mu):
    """Write the steps of lambda and t that lead to a new lambda."""
    slots.dlam[j, c] = new - old
    slots.dt[j, c] = (mu - slots.t[j, c] * new) / old


# ---- Obstacles


def make_kinds(size, given, scale, push):
    """Call `make_slots` for each kind; ``given`` is a tuple of `SlotArguments`."""
    return tuple(make_slots(size, kind, scale, push) for kind in given)


def largest_multipliers(size, kinds, i):
    """Call `_largest_multiplier` for each kind."""
    return tuple(_largest_multiplier(size, slots, i) for slots in kinds)


def sums_of_multipliers(size, kinds, i, which, row, column):
    """Call `_sum_multipliers` for each kind; the constraint left out is one of kind ``which``."""
    return tuple(
        _sum_multipliers(size, kinds[k], i, row if k == which else -1, column)
        for k in range(len(kinds))
    )


def _tuple(names, entry, kinds):
    """Write a function that makes a tuple, with one entry for each kind.

    Compiled code has no tuple whose length is found while it runs.
    """
    entries = "".join(entry.format(k=k) + ", " for k in range(len(kinds)))
    return eval(f"lambda {names}: ({entries})", globals())


@overload(make_kinds)
def _make_kinds(size, given, scale, push):
    entry = "make_slots(size, given[{k}], scale, push)"
    return _tuple("size, given, scale, push", entry, given)


@overload(largest_multipliers, inline="always")
def _largest_multipliers(size, kinds, i):
    return _tuple("size, kinds, i", "_largest_multiplier(size, kinds[{k}], i)", kinds)


@overload(sums_of_multipliers, inline="always")
def _sums_of_multipliers(size, kinds, i, which, row, column):
    entry = "_sum_multipliers(size, kinds[{k}], i, row if which == {k} else -1, column)"
    return _tuple("size, kinds, i, which, row, column", entry, kinds)


@njit(**FAST)
def make_slots(size, kind, scale, push):
    """Arrays of the active slots of one kind, with their numbers and own variables.

    ``kind`` is `SlotArguments`.
    """
    lower, upper = kind.limits[0], kind.limits[1]
    chosen = np.flatnonzero(kind.active > 0.0)
    unequal, stated, own = kind.rows[0], kind.rows[0] + kind.rows[1], len(lower)
    columns, first = size.wide * len(chosen), len(kind.depends) + size.shared
    w, inner, outer = first + own, own + kind.rows[1], first + 1
    t = w + stated
    guess = t + unequal + 2 * own
    given, width = guess + own, kind.numbers.shape[2]
    last, weight = stated + stated * w + w * w, scale * kind.regularisation[0]
    v, p = (
        np.zeros((given + 4 + outer, columns)),
        np.ones((width + kind.rows[2] + 1 + own, columns)),
    )
    for k in range(len(chosen)):
        for i in range(size.steps):
            c = k * size.wide + i
            for r in range(width):
                p[r, c] = kind.numbers[i, chosen[k], r]
            if kind.rows[2] > 0:
                p[width, c] = kind.levels[i, chosen[k]]
            for r in range(own):
                v[guess + r, c] = kind.drawn[i, chosen[k], r]
                p[width + kind.rows[2] + 1 + r, c] = v[guess + r, c]
                v[first + r, c] = push_inside(
                    kind.begun[i, chosen[k], r], lower[r], upper[r], push
                )
            v[given + 3, c] = weight
    out = np.zeros((last + outer * (outer + 1) // 2 + outer + inner * (outer + 1) + 1, columns))
    steps = np.zeros((inner + 2 * unequal + 2 * own, columns))
    dt, dz = inner, inner + 2 * unequal
    kernels = SlotKernels(kind.kernels[0], kind.kernels[1], kind.kernels[2], kind.kernels[3])
    return SlotArrays(
        kernels, chosen, kind.depends, lower, upper, weight, guess, given, v, p, out, out[:stated],
        out[stated : stated + stated * w].reshape((stated, w, columns)), out[last:],
        np.zeros((w + stated, columns)), np.zeros((stated, columns)), v[t : t + unequal],
        v[t + unequal : t + unequal + own], v[t + unequal + own : guess],
        steps, steps[:inner], steps[dt : dt + unequal], steps[dt + unequal : dz],
        steps[dz : dz + own], steps[dz + own :],
    )  # fmt: skip


@njit(**LEAN)
def write_poses(size, slots, target, v, s):
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
    """Slacks at the values, but off zero, and multipliers mu / t; see `start_multipliers`."""
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
def take_of_slots(size, slots, given, scale, push):
    """Take given multipliers; return the sum of multiplier times gap, and of how many."""
    first, own, stated = len(slots.depends) + size.shared, len(slots.lower), len(slots.tried)
    total, count = 0.0, 0
    for k in range(len(slots.active)):
        where = slots.active[k]
        for i in range(size.steps):
            c = k * size.wide + i
            for j in range(stated):
                z = scale * given[i, where, j]
                slots.v[first + own + j, c] = z
                if j < slots.t.shape[0]:
                    slots.t[j, c] = max(slots.tried[j, c], push)
                if j < slots.t.shape[0] and z == z:
                    total, count = total + z * slots.t[j, c], count + 1
            for r in range(own):
                low = scale * given[i, where, stated + r]
                high = scale * given[i, where, stated + own + r]
                slots.zl[r, c], slots.zu[r, c] = low, high
                if slots.lower[r] > -INF and low == low:
                    total += low * (slots.v[first + r, c] - slots.lower[r])
                    count += 1
                if slots.upper[r] < INF and high == high:
                    total += high * (slots.upper[r] - slots.v[first + r, c])
                    count += 1
    return total, count


@njit(**LEAN)
def clip_slots(size, slots, eps, mu):
    """Bring multipliers within a factor of mu / gap; those of equalities that are NaN become 0."""
    first, own = len(slots.depends) + size.shared, len(slots.lower)
    multipliers = slots.v[first + own :]
    for c in range(slots.t.shape[1]):
        if c % size.wide >= size.steps:
            continue
        for j in range(slots.t.shape[0]):
            slots.t[j, c] = max(slots.t[j, c], slots.tried[j, c] + eps[c % size.wide])
            multipliers[j, c] = known_multiplier(multipliers[j, c], slots.t[j, c], mu)
        for j in range(slots.t.shape[0], len(slots.tried)):
            if multipliers[j, c] != multipliers[j, c]:
                multipliers[j, c] = 0.0
        for r in range(own):
            a = slots.v[first + r, c]
            if slots.lower[r] > -INF:
                slots.zl[r, c] = known_multiplier(slots.zl[r, c], a - slots.lower[r], mu)
            if slots.upper[r] < INF:
                slots.zu[r, c] = known_multiplier(slots.zu[r, c], slots.upper[r] - a, mu)


@njit(**LEAN)
def boundary_of_slots(size, slots, most):
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
                most[0, i] = max_or_nan(-slots.dt[j, at + i] / t, most[0, i])
                most[1, i] = max_or_nan(-slots.dlam[j, at + i] / y, most[1, i])
        for r in range(len(slots.lower)):
            low, high = slots.lower[r], slots.upper[r]
            for i in range(wide if low > -INF else 0):
                a, z = slots.v[first + r, at + i], slots.zl[r, at + i]
                most[0, i] = max_or_nan(-slots.da[r, at + i] / (a - low), most[0, i])
                most[1, i] = max_or_nan(-slots.dzl[r, at + i] / z, most[1, i])
            for i in range(wide if high < INF else 0):
                a, z = slots.v[first + r, at + i], slots.zu[r, at + i]
                most[0, i] = max_or_nan(slots.da[r, at + i] / (high - a), most[0, i])
                most[1, i] = max_or_nan(-slots.dzu[r, at + i] / z, most[1, i])


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
    """Own variables at a trial point; `write_poses` writes the rest."""
    first = len(slots.depends) + size.shared
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            slots.trial[first + r, c] = slots.v[first + r, c] + step * slots.da[r, c]


@njit(**LEAN)
def merit_slots(size, slots, eps, step, least):
    """Residual, regularisation and sum of logarithms at a trial point."""
    value, variables, unequal = slots.tried, slots.trial, slots.t.shape[0]
    first, wide = len(slots.depends) + size.shared, size.wide
    residual, cost, total, product = 0.0, 0.0, 0.0, 1.0
    for at in range(0, slots.v.shape[1], wide):
        for j in range(unequal):
            for i in range(size.steps):
                here = value[j, at + i] + eps[i]
                t = next_slack(slots.t[j, at + i], step * slots.dt[j, at + i], here, least)
                residual += t - here
                total, product = add_logarithm(total, product, t)
        for j in range(unequal, value.shape[0]):
            for i in range(size.steps):
                residual += abs(value[j, at + i])
        for r in range(len(slots.lower)):
            for c in range(at, at + size.steps):
                a = variables[first + r, c]
                cost += slots.weight * (a - slots.v[slots.guess + r, c]) ** 2
                if slots.lower[r] > -INF:
                    total, product = add_logarithm(total, product, a - slots.lower[r])
                if slots.upper[r] < INF:
                    total, product = add_logarithm(total, product, slots.upper[r] - a)
    return residual, cost, total + np.log(product)


@njit(**LEAN)
def accept_slots(size, slots, eps, primal, dual, mu, least):
    """Take the step in slacks, multipliers and own variables."""
    first, own = len(slots.depends) + size.shared, len(slots.lower)
    multipliers = slots.v[first + own :]
    for j in range(slots.t.shape[0]):
        for c in range(slots.t.shape[1]):
            here = slots.tried[j, c] + eps[c % size.wide]
            slots.t[j, c] = next_slack(slots.t[j, c], primal * slots.dt[j, c], here, least)
            z = multipliers[j, c] + dual * slots.dlam[j, c]
            multipliers[j, c] = clip_multiplier(z, slots.t[j, c], mu)
    for r in range(own):
        for c in range(slots.t.shape[1]):
            slots.v[first + r, c] += primal * slots.da[r, c]
            a = slots.v[first + r, c]
            if slots.lower[r] > -INF:
                z = slots.zl[r, c] + dual * slots.dzl[r, c]
                slots.zl[r, c] = clip_multiplier(z, a - slots.lower[r], mu)
            if slots.upper[r] < INF:
                z = slots.zu[r, c] + dual * slots.dzu[r, c]
                slots.zu[r, c] = clip_multiplier(z, slots.upper[r] - a, mu)
    for j in range(slots.t.shape[0], slots.tried.shape[0]):  # the step solves for -y
        for c in range(slots.t.shape[1]):
            new = -slots.da[own + j - slots.t.shape[0], c]
            multipliers[j, c] += primal * (new - multipliers[j, c])


@njit(**LEAN)
def stationarity_of_slots(size, slots, pull, eps, tally, mu):
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
                tally[1, i] = max_or_nan(abs(slots.value[j, at + i] + eps[i] - t), tally[1, i])
                tally[2, i] = max_or_nan(abs(t * y - mu), tally[2, i])
        for j in range(slots.t.shape[0], slots.tried.shape[0]):
            for i in range(wide):
                tally[1, i] = max_or_nan(abs(slots.value[j, at + i]), tally[1, i])
        _stationarity_of_own(size, slots, at, multipliers, tally, mu)


@njit(**LEAN)
def _stationarity_of_own(size, slots, at, multipliers, tally, mu):
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
                tally[2, i] = max_or_nan(abs((a - low) * slots.zl[r, c] - mu), tally[2, i])
                tally[5, i] += slots.zl[r, c]
            if high < INF:
                force += slots.zu[r, c]
                tally[2, i] = max_or_nan(abs((high - a) * slots.zu[r, c] - mu), tally[2, i])
                tally[5, i] += slots.zu[r, c]
            tally[3, i] = max_or_nan(abs(force), tally[3, i])


@njit(**LEAN)
def undo_slots(size, slots, length):
    """Take the step in the own variables back."""
    first = len(slots.depends) + size.shared
    for r in range(len(slots.lower)):
        for c in range(slots.v.shape[1]):
            slots.v[first + r, c] -= length * slots.da[r, c]


@njit(**LEAN)
def write_slots(size, slots, own, multipliers, scale):
    """Copy own variables and multipliers into arrays, of the active slots.

    An array of no steps for the multipliers means that they are not wanted.
    """
    first, count, stated = len(slots.depends) + size.shared, len(slots.lower), len(slots.tried)
    for i in range(len(multipliers)):
        for k in range(multipliers.shape[1]):
            for j in range(multipliers.shape[2]):  # of an empty slot that is all
                multipliers[i, k, j] = np.nan
    for k in range(len(slots.active)):
        where = slots.active[k]
        for i in range(size.steps):
            for r in range(count):
                own[i, where, r] = slots.v[first + r, k * size.wide + i]
        for i in range(len(multipliers)):
            c = k * size.wide + i
            for r in range(count):
                multipliers[i, where, stated + r] = slots.zl[r, c] / scale
                multipliers[i, where, stated + count + r] = slots.zu[r, c] / scale
            for j in range(stated):
                multipliers[i, where, j] = slots.v[first + count + j, c] / scale


# ---- Constraints of the robot


@njit(**LEAN)
def start_rows(rows, mu, push):
    """Slacks at the values, but off zero, and multipliers mu / t."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                rows.t[j, i] = max(rows.tried[rows.at + j, i], push)
                rows.y[rows.first + j, i] = mu / rows.t[j, i]


@njit(**LEAN)
def _sum_of_rows(rows):
    """Return the sum of multiplier times slack, and of how many."""
    total, count = 0.0, 0
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                total, count = total + rows.y[rows.first + j, i] * rows.t[j, i], count + 1
    return total, count


@njit(**LEAN)
def clip_rows(rows, mu):
    """Bring multipliers within a factor of mu / t."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                y = rows.y[rows.first + j, i]
                rows.y[rows.first + j, i] = known_multiplier(y, rows.t[j, i], mu)


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
                primal = fraction_to_boundary(t, step, share, primal)
                dual = fraction_to_boundary(y, rows.dy[j, i], share, dual)
                total -= mu * step / t
    return primal, dual, total


@njit(**LEAN)
def merit_rows(rows, step, least):
    """Residual of the constraints at a trial point, and sum of the logarithms of the slacks."""
    residual, total, product = 0.0, 0.0, 1.0
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                here = rows.tried[rows.at + j, i]
                t = next_slack(rows.t[j, i], step * rows.dt[j, i], here, least)
                residual += t - here
                total, product = add_logarithm(total, product, t)
    return residual, total + np.log(product)


@njit(**LEAN)
def accept_rows(rows, primal, dual, mu, least):
    """Take the step in slacks and multipliers."""
    for j in range(rows.t.shape[0]):
        for i in range(rows.t.shape[1]):
            if j < rows.always or i == rows.t.shape[1] - 1:
                here = rows.tried[rows.at + j, i]
                rows.t[j, i] = next_slack(rows.t[j, i], primal * rows.dt[j, i], here, least)
                rows.y[rows.first + j, i] = clip_multiplier(
                    rows.y[rows.first + j, i] + dual * rows.dy[j, i], rows.t[j, i], mu
                )


@njit(**LEAN)
def stationarity_of_rows(rows, pull, mu):
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


# ---- Bounds of states and inputs


@njit(**LEAN)
def push_inside(value, lower, upper, push):
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
def _sum_of_bounds(size, path):
    """Return the sum of multiplier times gap, and of how many."""
    total, count = 0.0, 0
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    total += path.zl[r, i] * (path.v[r, i] - path.lower[r])
                    count += 1
                if path.upper[r] < INF:
                    total += path.zu[r, i] * (path.upper[r] - path.v[r, i])
                    count += 1
    return total, count


@njit(**LEAN)
def clip_bounds(size, path, mu):
    """Bring multipliers within a factor of mu / gap."""
    for r in range(size.w):
        for i in range(size.steps + 1):
            if i > 0 if r < size.n else i < size.steps:
                if path.lower[r] > -INF:
                    gap = path.v[r, i] - path.lower[r]
                    path.zl[r, i] = known_multiplier(path.zl[r, i], gap, mu)
                if path.upper[r] < INF:
                    gap = path.upper[r] - path.v[r, i]
                    path.zu[r, i] = known_multiplier(path.zu[r, i], gap, mu)


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
                    primal = fraction_to_boundary(gap, move, share, primal)
                    dual = fraction_to_boundary(z, step.zl[r, i], share, dual)
                    slope -= mu * move / gap
                if path.upper[r] < INF:
                    gap, z = path.upper[r] - path.v[r, i], path.zu[r, i]
                    step.zu[r, i] = (mu + z * move) / gap - z
                    primal = fraction_to_boundary(gap, -move, share, primal)
                    dual = fraction_to_boundary(z, step.zu[r, i], share, dual)
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
                    total, product = add_logarithm(total, product, v[r, i] - path.lower[r])
                if path.upper[r] < INF:
                    total, product = add_logarithm(total, product, path.upper[r] - v[r, i])
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
                    path.zl[r, i] = clip_multiplier(path.zl[r, i] + dual * step.zl[r, i], gap, mu)
                if path.upper[r] < INF:
                    gap = path.upper[r] - path.v[r, i]
                    path.zu[r, i] = clip_multiplier(path.zu[r, i] + dual * step.zu[r, i], gap, mu)


@njit(**LEAN)
def stationarity_of_bounds(size, path, pull, mu):
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


# ---- Workspace


@njit(**LEAN)
def size_of(sizes, steps):
    """Sizes, and where the pieces of the kernel's result begin."""
    n, m, inputs, always = (
        sizes[SIZE.n],
        sizes[SIZE.m],
        sizes[SIZE.input_rows],
        sizes[SIZE.node_rows],
    )
    w = n + m
    jacobian = n + 1 + w
    hessian = jacobian + n * w
    value = hessian + w * w
    wide = 8 * ((steps + 8) // 8)
    nodes = always + sizes[SIZE.final_rows]
    return Size(n, m, w, sizes[SIZE.shared], steps, wide, inputs, always, nodes, jacobian, hessian,
                value, value + inputs)  # fmt: skip


@njit(**FAST)
def make_block(size, width):
    """Allocate one zeroed workspace, sliced by the functions below."""
    n, m, w, node = size.n, size.m, size.w, 1 + size.n + size.n**2
    path = w + n + size.inputs + n + size.nodes + 2 * w + 3 * w + n
    model = size.slope + size.inputs * w + node + size.nodes * (1 + n) + n
    trial = w + n + size.inputs + n + size.nodes + 1 + size.nodes + 1
    newton = w * w + w + 2 * n + 1 + (n + 2) ** 2 + n + 2
    gains = n * (n + 1) // 2 + 2 * n + 3 + m * (n + 2)
    return np.zeros((path + model + trial + newton + gains + 12 + w + width, size.wide))


@njit(**FAST)
def take(block, rows):
    """Return the first rows of a block, and the rest."""
    return block[:rows], block[rows:]


@njit(**FAST)
def make_path(size, limits, block):
    """Variables and steps."""
    v, block = take(block, size.w + size.n + size.inputs)
    vn, block = take(block, size.n + size.nodes)
    zl, block = take(block, size.w)
    zu, block = take(block, size.w)
    move, block = take(block, size.w)
    pi, block = take(block, size.n)
    dzl, block = take(block, size.w)
    dzu, block = take(block, size.w)
    return Path(v, vn, limits[0], limits[1], zl, zu), Step(move, pi, dzl, dzu), block


@njit(**FAST)
def make_model(size, block):
    """Room for the results of the kernels, here and at a trial point."""
    n, node = size.n, 1 + size.n + size.n**2
    drive, block = take(block, size.slope + size.inputs * size.w)
    nodes, block = take(block, node + size.nodes * (1 + n))
    gap, block = take(block, n)
    v, block = take(block, size.w + n + size.inputs)
    vn, block = take(block, n + size.nodes)
    node_values, block = take(block, 1 + size.nodes)
    trial = Trial(v, vn, node_values, block[0])
    return Model(drive, nodes, gap), trial, block[1:]


@njit(**FAST)
def make_limits(size, path, model, trial):
    """Constraints on (x_i, u_i), and on x_{i+1}."""
    n, node = size.n, 1 + size.n + size.n**2
    one, two = np.zeros((3, size.inputs, size.steps)), np.zeros((3, size.nodes, size.steps))
    inputs = Limits(
        model.drive, size.value, size.slope, size.w, path.v, size.w + n, one[0], one[1], one[2],
        model.drive, size.value, size.inputs, 0,
    )  # fmt: skip
    nodes = Limits(
        model.node, node, node + size.nodes, n, path.vn, n, two[0], two[1], two[2], trial.node, 1,
        size.always, 1,
    )  # fmt: skip
    return inputs, nodes


@njit(**FAST)
def make_columns(size, head, block):
    """Parameters of the kernels ``drive`` and ``node``: as `Parameters.heads`, then the scale."""
    reference, curve = head.reference, head.curve
    dimension = reference.shape[1]
    columns, block = take(block, 2 * dimension + curve.shape[1] + 2)
    for i in range(size.steps):
        for r in range(dimension):
            columns[r, i] = reference[i, r]
            columns[dimension + r, i] = head.direction[i, r]
        columns[2 * dimension, i] = head.speed[i]
        for r in range(curve.shape[1]):
            columns[2 * dimension + 1 + r, i] = curve[i, r]
    return columns, block


@njit(**FAST)
def make_state(settings):
    """Single numbers at the start of a solve."""
    state = np.zeros(SCALARS)
    state[MU], state[SHARE] = settings[SETTING.barrier], BOUNDARY_SHARE
    state[S], state[SMIN] = settings[SETTING.guess], settings[SETTING.minimum]
    return state


@njit(**FAST)
def make_level():
    """Variable, parameters and results of the kernel ``level``."""
    return Level(np.zeros((1, 1)), np.zeros((2, 1)), np.zeros((3, 1)), np.zeros((3, 1)))


@njit(**FAST)
def make_slack(block):
    """Slacks and multipliers."""
    return Slack(block[0], block[1], block[2], block[3], block[4:10], block[10:12]), block[12:]


@njit(**FAST)
def make_newton(size, seen, block):
    """Room for the condensed quadratic and its solution."""
    n, m, w, square = size.n, size.m, size.w, size.w**2
    rows, block = take(block, square + w + 2 * n + 1)
    slots, block = take(block, (n + 2) ** 2)
    force, block = take(block, n + 2)
    quadratic = Quadratic(
        rows, rows[:square], rows[square : square + w], rows[square + w : square + w + n],
        slots, force, np.zeros(2), seen,
    )  # fmt: skip
    p = n * (n + 1) // 2
    gain = p + 2 * n + 3
    found, block = take(block, gain + m * (n + 2))
    gains = Gains(found, 0, p, p + n, p + 2 * n, gain - 1, gain, gain + m * n, gain + m * n + m)
    return quadratic, gains, block


@njit(**FAST)
def union(given_slots):
    """Entries of x that slots of any kind depend on; NumPy's own compiles for seconds."""
    most = 0
    for kind in given_slots:
        most += len(kind.depends)
    count, found = 0, np.empty(most, dtype=np.int64)
    for kind in given_slots:
        for entry in kind.depends:
            new = True
            for j in range(count):
                new = new and found[j] != entry
            if new:
                found[count] = entry
                count += 1
    return found[:count]


@njit(**LEAN)
def _count_inequalities(size, kinds):
    """Count bounds and inequalities, an upper limit: of every bound both sides."""
    count = (2 * size.w + size.inputs + size.nodes) * size.steps
    for slots in kinds:
        count += len(slots.active) * size.steps * (len(slots.t) + 2 * len(slots.lower))
    return count


@njit(**LEAN)
def count_slots(kinds):
    """Count the active slots of all kinds."""
    count = 0
    for slots in kinds:
        count += len(slots.active)
    return count


@njit(**LEAN)
def mean_level(given_slots):
    """Mean level of the active slots, `Parameters.target`."""
    total, count = 0.0, 0
    for kind in given_slots:
        for k in range(len(kind.active)):
            if kind.active[k] > 0.0:
                for i in range(len(kind.levels)):
                    total, count = total + kind.levels[i, k], count + 1
    return total / count if count > 0 else 0.0


# ---- Single numbers


@njit(**LEAN)
def fraction_to_boundary(value, step, share, longest):
    """Longest step, at most ``longest``, that keeps 1 - ``share`` of a positive value."""
    if step < 0.0:
        return min(longest, -share * value / step)
    return longest


@njit(**LEAN)
def next_slack(t, step, here, least):
    """Slack after a step: the value itself, unless that is far below what the step leads to.

    The step leaves at least a share ``least`` of it. The value of a constraint bends along the
    step; with a slack that follows it, this is no residual that a later step would have to remove.
    """
    led = max(t + step, least * t)
    return here if here >= NEAR * led else led


@njit(**LEAN)
def max_or_nan(value, most):
    """Whichever is larger; NaN wins."""
    return most if value <= most else value


@njit(**LEAN)
def clip_multiplier(z, gap, mu):
    """Keep a multiplier within a huge factor of mu / gap (Waechter and Biegler 2006, eq. 16)."""
    return max(min(z, MULTIPLIER_RANGE * mu / gap), SMALLEST_FACTOR * mu / gap)


@njit(**LEAN)
def add_logarithm(total, product, value):
    """Add a factor to a product whose logarithm is wanted, without one call per factor."""
    product *= value
    if not 1e-200 < product < 1e200:
        return total + np.log(product), 1.0
    return total, product
