"""The primal-dual interior-point iteration.

A. Waechter and L. T. Biegler, On the implementation of an interior-point filter line-search
algorithm for large-scale nonlinear programming, Math. Program. 106 (2006): barrier, step
lengths, filter and regularisation are theirs, the linear algebra is `riccati` and `condense`.

Functions are longer here than elsewhere in the project: Numba compiles everything that a
function calls into it once more, so that a deeper tree of calls takes minutes to compile.
"""

import numpy as np
from numba import njit

from .boxes import add_bounds
from .condense import condense
from .memory import (
    DELTA,
    DS,
    ENTRIES,
    FAILURES,
    FAST,
    LEAN,
    LENGTH,
    MU,
    RHO,
    SMIN,
    THETA_LEAST,
    THETA_MOST,
    ZS,
    Level,
    S,
    Slack,
    make_limits,
    make_model,
    make_newton,
    make_path,
    size_of,
)
from .point import begin, derive, errors, merit, rescale, start, try_point
from .riccati import backward, forward
from .rows import add_rows
from .search import HALVINGS, accept, measure_step, remember, take_back, welcome
from .slack import close
from .slots import make_slots, write_slots

SOLVED, LIMIT, INFEASIBLE, FAILED, STOPPED = range(5)
"""How a solve may end."""

(TOLERANCE, BARRIER, PUSH, PENALTY, MOST_PENALTY, GRADIENT, MINIMUM, TARGET, GUESS) = range(9)
"""Places in the array of settings: limit of the errors; first barrier; distance of the start from
its bounds; price of slack, first and highest; largest gradient after scaling; the level's
minimum, reference and guess."""


@njit(**FAST)
def solve(sizes, kernels, settings, limits, given, kinds, found, stop):
    """Solve one problem from one guess.

    Parameters
    ----------
    sizes : n, m, whether a level is shared, rows of input, node and final constraints, limit of
        iterations.
    kernels : addresses of the kernels.
    settings : see above.
    limits : lower and upper bounds of w.
    given : x_0, heads (N, H), guessed states (N + 1, n), guessed inputs (N, m).
    kinds : moving and standing slots, see `make_slots`.
    found : results: states, inputs, slack, own variables of either kind, numbers (status,
        iterations, cost, level, error, penalty).
    stop : a number that another thread may set to end the solve.
    """
    initial, heads, states, inputs = given
    size = size_of(sizes[0], sizes[1], sizes[2], len(inputs), sizes[3], sizes[4], sizes[5])
    path, step = make_path(size, limits)
    model, trial = make_model(size)
    on_inputs, on_nodes = make_limits(size, path, model, trial)
    quadratic, gains = make_newton(size)
    zero, filtered, pull = np.zeros(size.steps), np.zeros((200, 2)), np.zeros_like(step.v)
    slack = Slack(zero, zero.copy(), zero.copy(), zero.copy(), zero.copy())
    columns = np.empty((heads.shape[1] + 1, size.steps))
    columns[:-1] = heads.T
    state = np.zeros(13)
    state[MU], state[SMIN], state[S] = settings[BARRIER], settings[MINIMUM], settings[GUESS]
    start(size, path, state, (initial, states, inputs), settings[PUSH])
    scale = rescale(size, path, model, kernels, columns, settings[GRADIENT])
    state[RHO], state[THETA_MOST] = scale * settings[PENALTY], -1.0
    level = Level(np.zeros((1, 1)), np.zeros((2, 1)), np.zeros((3, 1)), np.zeros((3, 1)))
    level.p[0, 0], level.p[1, 0] = settings[TARGET], scale
    moving = make_slots(size, kinds[0], scale, settings[PUSH])
    standing = make_slots(size, kinds[1], scale, settings[PUSH])
    slots, tolerance = len(moving.active) + len(standing.active), settings[TOLERANCE]
    status, iterations, error, present, length = -1, -1, 0.0, (0.0, 0.0, 0.0), 0.0
    longest, reach, slope, attempt, forget = 0.0, 0.0, 0.0, 0, False
    left, numbers, primal = np.inf, found[5], np.inf  # left: slack at the last price
    while True:
        # the trial point: at first the guess, then along the direction
        state[LENGTH], s = length, state[S] + length * state[DS]
        try_point(
            size, path, step, slack, trial, state, kernels, columns, level, moving, standing, s
        )
        if iterations < 0:
            begin(size, path, slack, on_inputs, on_nodes, state, moving, standing, settings[PUSH])
            trial.slack[:] = slack.eps
            present = merit(
                size, path, trial, on_inputs, on_nodes, state, level, moving, standing, s
            )
        else:
            tried = merit(
                size, path, trial, on_inputs, on_nodes, state, level, moving, standing, s
            )
            phi = present[1] - state[MU] * present[2]
            if state[THETA_MOST] < 0.0:
                state[THETA_MOST] = 1e4 * max(1.0, present[0])
                state[THETA_LEAST] = 1e-4 * max(1.0, present[0])
            new = tried[0], tried[1] - state[MU] * tried[2]
            answer = welcome(filtered, state, length, slope, (present[0], phi), new)
            attempt += 1
            if answer == 0 and not forget:
                length *= 0.5
                if attempt == HALVINGS:
                    state[FAILURES] += 1
                    state[ENTRIES], state[THETA_MOST], forget = 0, -1.0, True
                    length = longest if state[FAILURES] < 3 else 0.5 * longest
                continue
            if forget and not np.isfinite(new[1]):
                status = FAILED
                break
            if answer == 2 and not forget:
                remember(filtered, state, present[0], phi)
            present = tried
            accept(
                size, path, step, slack, on_inputs, on_nodes, state, moving, standing, length,
                reach,
            )  # fmt: skip
        iterations += 1
        derive(size, path, model, state, kernels, columns, level, moving, standing)
        primal, dual, wrong, many = errors(
            size, path, model, pull, slack, on_inputs, on_nodes, state, level, moving, standing
        )
        error = max(primal, max(dual, wrong + state[MU]) / many)
        if not np.isfinite(error):
            take_back(size, path, step, state, moving, standing, length)
        if not np.isfinite(error) or state[FAILURES] > 8:
            status = FAILED
            break
        deepest = slack.eps.max() if slots else 0.0
        if error <= tolerance:
            total = slack.eps.sum() if slots else 0.0
            if deepest <= 10.0 * tolerance:
                status = SOLVED
                break
            if state[RHO] >= scale * settings[MOST_PENALTY] or total > 0.99 * left:
                status = INFEASIBLE
                break
            # slack is left that a higher price may remove; if it does not, this point is kept
            _write(size, path, model, slack, level, moving, standing, initial, found, scale)
            numbers[3], left = state[S], total
            present = present[0], present[1] + 29.0 * state[RHO] * slack.eps.sum(), present[2]
            state[RHO] *= 30.0
            state[MU] = max(state[MU], 1e-4)
            for i in range(size.steps):
                slack.nu[i] = max(state[RHO] - slack.pressure[i], state[MU] / slack.eps[i])
            state[ENTRIES], state[THETA_MOST] = 0, -1.0
        if iterations >= sizes[6] or stop[0] > 0.0:
            status = STOPPED if stop[0] > 0.0 else LIMIT
            break
        _lower_barrier(state, tolerance, primal, dual / many, wrong / many)
        if not _direction(
            size, path, step, model, quadratic, gains, slack, on_inputs, on_nodes, state, level,
            moving, standing,
        ):  # fmt: skip
            status = FAILED
            break
        share = max(0.99, 1.0 - state[MU])
        longest, reach, slope = measure_step(
            size, path, step, model, quadratic, slack, on_inputs, on_nodes, state, level, moving,
            standing, share,
        )  # fmt: skip
        length, attempt, forget = longest, 0, False
    if status == LIMIT and primal <= tolerance and slots > 0 and slack.eps.max() > 1e-4:
        status, left = INFEASIBLE, np.inf  # slowly, but all that moves is how slack is shared out
    if left == np.inf or status == SOLVED or status == INFEASIBLE:
        _write(size, path, model, slack, level, moving, standing, initial, found, scale)
        numbers[3] = state[S]
    elif status != STOPPED:
        status = INFEASIBLE  # with the point that was kept
    numbers[0], numbers[1] = status, iterations
    numbers[4], numbers[5] = error, state[RHO] / scale


@njit(**LEAN)
def _lower_barrier(state, tolerance, primal, dual, wrong):
    """Fiacco and McCormick: a smaller mu once the problem for this one is solved."""
    mu = state[MU]
    while mu > 0.1 * tolerance and max(primal, max(dual, wrong)) <= 10.0 * mu:
        state[MU] = max(0.1 * tolerance, min(0.2 * mu, mu**1.5))
        state[ENTRIES], state[THETA_MOST] = 0, -1.0
        wrong += mu - state[MU]
        mu = state[MU]


@njit(**LEAN)
def _direction(
    size, path, step, model, quadratic, gains, slack, inputs, nodes, state, level, moving, standing
):
    """Newton direction of the regularised problem whose reduced Hessian is positive definite."""
    last, state[DELTA] = state[DELTA], 0.0
    while state[DELTA] < 1e20:
        good = _quadratic(
            size, path, model, quadratic, slack, inputs, nodes, state, level, moving, standing
        )
        if good and backward(size, model, quadratic, gains, state):
            if state[DELTA] == 0.0:
                state[DELTA] = last
            forward(size, path, step, model, gains, state[DS])
            return True
        if state[DELTA] == 0.0:
            state[DELTA] = 1e-4 if last == 0.0 else max(1e-20, last / 3.0)
        else:
            state[DELTA] *= 100.0 if last == 0.0 else 8.0
    return False


@njit(**LEAN)
def _quadratic(size, path, model, quadratic, slack, inputs, nodes, state, level, moving, standing):
    """Condense everything into stages of (x, u), and the level's curvature and slope."""
    n, mu, top = size.n, state[MU], quadratic.top
    _clear(size, quadratic)  # `backward` adds what comes from `drive`
    if not condense(size, moving, quadratic, slack.eps, mu, state[DELTA]):
        return False
    if not condense(size, standing, quadratic, slack.eps, mu, state[DELTA]):
        return False
    if len(moving.active) + len(standing.active):
        close(size, quadratic, slack, mu, state[RHO])
    top[0], top[1] = level.out[2, 0], level.out[1, 0]
    hessian, gradient, node = quadratic.hessian, quadratic.gradient, model.node
    slots, force, cross = quadratic.slots, quadratic.force, quadratic.cross
    for i in range(size.steps):
        for r in range(n):
            gradient[i + 1, r] += node[1 + r, i] + force[i, r]
            cross[i + 1, r] = slots[i, n, r]
            for c in range(n):
                curve = slots[i, r, c] if r >= c else slots[i, c, r]
                hessian[i + 1, r, c] += node[1 + n + r * n + c, i] + curve
        top[0] += slots[i, n, n]
        top[1] += force[i, n]
    add_bounds(size, path, quadratic, mu)
    add_rows(inputs, quadratic, mu)
    add_rows(nodes, quadratic, mu)
    if state[SMIN] > -np.inf:
        gap = state[S] - state[SMIN]
        top[0] += state[ZS] / gap
        top[1] -= mu / gap
    return True


@njit(**LEAN)
def _clear(size, quadratic):
    """Set the quadratic to zero; slices set to a number are far slower."""
    for i in range(size.steps + 1):
        for r in range(size.w):
            quadratic.gradient[i, r] = 0.0
            for c in range(size.w):
                quadratic.hessian[i, r, c] = 0.0
    for i in range(size.steps):
        for r in range(size.n + 2):
            quadratic.force[i, r] = 0.0
            for c in range(size.n + 2):
                quadratic.slots[i, r, c] = 0.0


@njit(**LEAN)
def _write(size, path, model, slack, level, moving, standing, initial, found, scale):
    """Copy the last point into the results."""
    n, v = size.n, path.v
    states, inputs, slacks, own, still, numbers = found
    numbers[2] = level.out[0, 0] / scale
    for r in range(n):
        states[0, r] = initial[r]
    for i in range(size.steps):
        for r in range(n):
            states[i + 1, r] = v[r, i + 1]
        for r in range(size.m):
            inputs[i, r] = v[n + r, i]
        slacks[i] = slack.eps[i] if len(moving.active) + len(standing.active) else 0.0
        numbers[2] += (model.drive[n, i] + model.node[0, i]) / scale
    write_slots(size, moving, own)
    write_slots(size, standing, still)
