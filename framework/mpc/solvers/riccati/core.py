"""The primal-dual interior-point iteration.

A. Waechter and L. T. Biegler, On the implementation of an interior-point filter line-search
algorithm for large-scale nonlinear programming, Math. Program. 106 (2006): barrier, step
lengths, filter and regularisation are theirs, the linear algebra is `riccati` and `condense`.
Functions are inlined into one: handing all arrays on took a fifth of an iteration.

Functions are longer here than elsewhere in the project: Numba compiles everything that a
function calls into it once more, so that a deeper tree of calls takes minutes to compile.
"""

import numpy as np
from numba import njit

from .boxes import add_bounds
from .condense import condense
from .line_search import HALVINGS, accept, measure_step, remember, take_back, welcome
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
    S,
    make_block,
    make_columns,
    make_level,
    make_limits,
    make_model,
    make_newton,
    make_path,
    make_slack,
    size_of,
    target,
    union,
)
from .point import (
    SLOT_ELIMINATE,
    SWEEP,
    WALL_ELIMINATE,
    begin,
    derive,
    errors,
    merit,
    rescale,
    start,
    try_point,
)
from .recursion import backward, forward
from .rows import add_rows
from .slack import close
from .slots import make_slots, write_slots

SOLVED, LIMIT, INFEASIBLE, FAILED, STOPPED = range(5)
"""How a solve may end."""

(ITERATIONS, TOLERANCE, BARRIER, PUSH, PENALTY, MOST_PENALTY, GRADIENT, MINIMUM, GUESS) = range(9)
"""Places in the array of settings: limits of iterations and errors; first barrier; distance of the
start from its bounds; price of slack, first and highest; largest gradient after scaling; the
level's minimum and guess."""


@njit(**FAST)
def solve(kernels, sizes, limits, settings, head, given, kinds, found, stop):
    """Solve one problem from one guess.

    Parameters
    ----------
    kernels : addresses of the kernels.
    sizes : n, m, whether a level is shared, rows of input, node and final constraints.
    limits : lower and upper bounds of w.
    settings : see above.
    head : reference, direction, speed, curve, see `problem.Parameters`.
    given : x_0, guessed states (N + 1, n), guessed inputs (N, m).
    kinds : moving and standing slots, see `make_slots`.
    found : results: states, inputs, slack, own variables of either kind, numbers (status,
        iterations, cost, level, error, penalty).
    stop : a number that another thread may set to end the solve.
    """
    size = size_of(sizes[0], sizes[1], sizes[2], len(given[2]), sizes[3], sizes[4], sizes[5])
    block = make_block(size, 2 * head[0].shape[1] + head[3].shape[1] + 2)
    path, step, block = make_path(size, limits, block)
    model, trial, block = make_model(size, block)
    quadratic, gains, block = make_newton(size, union(kinds[0][0], kinds[1][0]), block)
    columns, block = make_columns(size, head, block)
    slack, pull = make_slack(block)
    on_inputs, on_nodes = make_limits(size, path, model, trial)
    filtered, level = np.zeros((200, 2)), make_level()
    state = np.zeros(13)
    state[MU], state[SMIN], state[S] = settings[BARRIER], settings[MINIMUM], settings[GUESS]
    start(size, path, state, given, settings[PUSH])
    scale = rescale(size, path, model, kernels, columns, settings[GRADIENT])
    state[RHO], state[THETA_MOST] = scale * settings[PENALTY], -1.0
    if size.shared > 0:
        level.p[0, 0] = target(kinds[0][5], kinds[0][6])
    level.p[1, 0] = scale
    moving = make_slots(size, kinds[0], scale, settings[PUSH])
    standing = make_slots(size, kinds[1], scale, settings[PUSH])
    slots, tolerance = len(moving.active) + len(standing.active), settings[TOLERANCE]
    status, iterations, error, present, length = -1, -1, 0.0, (0.0, 0.0, 0.0, 0.0), 0.0
    longest, reach, slope, attempt, forget = 0.0, 0.0, 0.0, 0, False
    left, deepest, primal, numbers = np.inf, 0.0, np.inf, found[5]  # left: slack at the last price
    while True:
        # the trial point: at first the guess, then along the direction
        state[LENGTH], s = length, state[S] + length * state[DS]
        try_point(
            size, path, step, model, slack, trial, state, kernels, columns, level, moving,
            standing, s,
        )  # fmt: skip
        if iterations < 0:
            begin(size, path, slack, on_inputs, on_nodes, state, moving, standing, settings[PUSH])
            trial.slack[:] = slack.eps
        tried = merit(
            size, path, model, trial, on_inputs, on_nodes, state, level, moving, standing, s
        )
        if iterations >= 0:
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
            accept(
                size, path, step, slack, on_inputs, on_nodes, state, moving, standing, length,
                reach,
            )  # fmt: skip
        iterations, present = iterations + 1, tried
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
        deepest = slack.eps[: size.steps].max() if slots else 0.0
        if error <= tolerance:
            total = slack.eps[: size.steps].sum() if slots else 0.0
            if deepest <= 10.0 * tolerance:
                status = SOLVED
                break
            if state[RHO] >= scale * settings[MOST_PENALTY] or total > 0.99 * left:
                status = INFEASIBLE
                break
            # slack is left that a higher price may remove; if it does not, this point is kept
            _write(size, path, slack, moving, standing, given[0], found)
            numbers[2], numbers[3], left = present[3] / scale, state[S], total
            price = present[1] + 29.0 * state[RHO] * total
            present = present[0], price, present[2], present[3]
            state[RHO] *= 30.0
            state[MU] = max(state[MU], 1e-4)
            for i in range(size.steps):
                slack.nu[i] = max(state[RHO] - slack.tally[0, i], state[MU] / slack.eps[i])
            state[ENTRIES], state[THETA_MOST] = 0, -1.0
        if iterations >= settings[ITERATIONS] or stop[0] > 0.0:
            status = STOPPED if stop[0] > 0.0 else LIMIT
            break
        _lower_barrier(state, tolerance, primal, dual / many, wrong / many)
        if not _direction(
            size, path, step, model, quadratic, gains, slack, on_inputs, on_nodes, state, level,
            moving, standing, kernels,
        ):  # fmt: skip
            status = FAILED
            break
        share = max(0.99, 1.0 - state[MU])
        longest, reach, slope = measure_step(
            size, path, step, model, quadratic, slack, on_inputs, on_nodes, state, level, moving,
            standing, share, kernels,
        )  # fmt: skip
        length, attempt, forget = longest, 0, False
    if status == LIMIT and primal <= tolerance and slots > 0 and deepest > 1e-4:
        status, left = INFEASIBLE, np.inf  # slowly, but all that moves is how slack is shared out
    if left == np.inf or status == SOLVED or status == INFEASIBLE:
        _write(size, path, slack, moving, standing, given[0], found)
        numbers[2], numbers[3] = present[3] / scale, state[S]
    elif status != STOPPED:
        status = INFEASIBLE  # with the point that was kept
    numbers[0], numbers[1] = status, iterations
    numbers[4], numbers[5] = error, state[RHO] / scale


@njit(**LEAN)
def _lower_barrier(state, tolerance, primal, dual, wrong):
    """Fiacco and McCormick: a smaller mu once the problem for this one is nearly solved.

    IPOPT waits for errors of 10 mu. With 1000, and from further inside the bounds, the recorded
    instances take 8.4 iterations in the mean instead of 11.1, and one more is solved.
    """
    mu = state[MU]
    while mu > 0.1 * tolerance and max(primal, max(dual, wrong)) <= 1000.0 * mu:
        state[MU] = max(0.1 * tolerance, min(0.2 * mu, mu**1.5))
        state[ENTRIES], state[THETA_MOST] = 0, -1.0
        wrong += mu - state[MU]
        mu = state[MU]


@njit(**LEAN)
def _direction(
    size, path, step, model, quadratic, gains, slack, inputs, nodes, state, level, moving,
    standing, kernels,
):  # fmt: skip
    """Newton direction of the regularised problem whose reduced Hessian is positive definite."""
    last, state[DELTA] = state[DELTA], 0.0
    while state[DELTA] < 1e20:
        good = _quadratic(
            size, path, model, quadratic, slack, inputs, nodes, state, level, moving, standing,
            kernels,
        )  # fmt: skip
        if good and backward(size, model, quadratic, gains, state, kernels[SWEEP]):
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
def _quadratic(
    size, path, model, quadratic, slack, inputs, nodes, state, level, moving, standing, kernels
):
    """Condense everything into stages of (x, u), and the level's curvature and slope."""
    n, w, mu, delta, top = size.n, size.w, state[MU], state[DELTA], quadratic.top
    _clear(quadratic)  # the recursion adds what comes from `drive`
    top[0], top[1] = level.out[2, 0], level.out[1, 0]
    at = SLOT_ELIMINATE
    for slots in (moving, standing):
        if not condense(size, slots, quadratic, slack.eps, mu, delta, kernels[at]):
            return False
        at = WALL_ELIMINATE
    if len(moving.active) + len(standing.active):
        close(size, quadratic, slack, mu, state[RHO])
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
def _write(size, path, slack, moving, standing, initial, found):
    """Copy the last point into the results."""
    n, v = size.n, path.v
    states, inputs, slacks, own, still, _ = found
    for r in range(n):
        states[0, r] = initial[r]
    for i in range(size.steps):
        for r in range(n):
            states[i + 1, r] = v[r, i + 1]
        for r in range(size.m):
            inputs[i, r] = v[n + r, i]
        slacks[i] = slack.eps[i] if len(moving.active) + len(standing.active) else 0.0
    write_slots(size, moving, own)
    write_slots(size, standing, still)
