"""The arrays that one solve works on, by role, and their sizes.

Everything that belongs to a stage is a row whose entries run over the stages, so that one call of
a kernel serves all of them. Functions take the roles they need and no more: what Numba compiles
grows with every array that is handed on.

All of it works on w = (x, u). Rows of ``v`` are (x, u, pi, y), of ``vn`` (x of the next stage,
y of its constraints), as the kernels of `kernels.build` want them.
"""

from collections import namedtuple
from typing import Any

import numpy as np
from numba import njit

FAST: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "nogil": True,
}
"""No check for division by zero, sums in any order; NaN and infinity keep their meaning."""

LEAN: dict[str, Any] = {**FAST, "_nrt": False}
"""The same for functions that make no arrays, nor call one that does: Numba then counts no
references, which costs as much as the work on short arrays."""

Size = namedtuple("Size", "n m w shared steps inputs always nodes jacobian hessian value slope")
"""n, m, n + m, whether a level is shared, N; rows of constraints on (x_i, u_i), on every x_i, and
on x_N; first rows of [A B], Hessian, constraints and their slopes in the result of ``drive``,
where f, the cost and its gradient come first."""

Path = namedtuple("Path", "v vn lower upper zl zu")
"""Variables; bounds of w and their multipliers (w, N + 1)."""

Step = namedtuple("Step", "v pi zl zu")
"""Steps of them."""

Model = namedtuple("Model", "drive node gap")
"""Results of the kernels ``drive`` (.., N) at i < N and ``node`` (.., N) at i > 0, and
f(x_i, u_i) - x_{i+1}."""

Limits = namedtuple("Limits", "out value slope width y first t dt dy tried at always after")
"""Constraints of the robot with a slack t: where values and slopes stand in ``out`` and the
multipliers in ``y``; slacks and steps; ``tried`` holds values at a trial point from row ``at``.
The first ``always`` hold at every step, the rest at the last alone; ``after`` is 1 where they are
about x of the next stage."""

Trial = namedtuple("Trial", "v vn drive node slack")
"""Variables and values at a point that is tried."""

Quadratic = namedtuple("Quadratic", "hessian gradient cross slots force top")
"""Condensed, without what ``drive`` gives: (N + 1, w, w), (N + 1, w), with the level (N + 1, n);
what slots add to (x, s, slack): (N, n + 2, n + 2), (N, n + 2); curvature and slope of the
level."""

Gains = namedtuple("Gains", "P p q K k ks slopes product curve force shared")
"""Value functions x P x / 2 + (p + q ds) x, the feedback K, k + ks ds, and room for
one stage."""

Slack = namedtuple("Slack", "eps nu deps dnu pressure")
"""Of the regions, one per stage (N,), its multiplier, their steps; sum of the regions'
multipliers."""

Level = namedtuple("Level", "v p out tried")
"""Variables and parameters of the kernel ``level``, its result here and at a trial point."""

MU, RHO, S, DS, ZS, DZS, SMIN, DELTA, THETA_MOST, THETA_LEAST, ENTRIES, FAILURES, LENGTH = range(
    13
)
"""Places in the array of single numbers: barrier, penalty, level with step, multiplier and its
step, its bound; last regularisation, limits and length of the filter, failed searches, step length
that is tried."""


@njit(**LEAN)
def size_of(n, m, shared, steps, inputs, always, final):
    """Sizes, and where the pieces of the kernel's result begin."""
    w = n + m
    jacobian = n + 1 + w
    hessian = jacobian + n * w
    value = hessian + w * w
    return Size(n, m, w, shared, steps, inputs, always, always + final, jacobian, hessian, value,
                value + inputs)  # fmt: skip


@njit(**FAST)
def make_path(size, limits):
    """Variables and steps, all zero."""
    wide = size.w, size.steps + 1
    path = Path(
        np.zeros((size.w + size.n + size.inputs, size.steps + 1)),
        np.zeros((size.n + size.nodes, size.steps)),
        limits[0], limits[1], np.zeros(wide), np.zeros(wide),
    )  # fmt: skip
    step = Step(np.zeros(wide), np.zeros((size.n, size.steps)), np.zeros(wide), np.zeros(wide))
    return path, step


@njit(**FAST)
def make_model(size):
    """Room for the results of the kernels, here and at a trial point."""
    n, steps, node = size.n, size.steps, 1 + size.n + size.n**2
    model = Model(
        np.zeros((size.slope + size.inputs * size.w, steps)),
        np.zeros((node + size.nodes * (1 + n), steps)),
        np.zeros((n, steps)),
    )
    trial = Trial(
        np.zeros((size.w + n + size.inputs, steps + 1)), np.zeros((n + size.nodes, steps)),
        np.zeros((n + 1 + size.inputs, steps)), np.zeros((1 + size.nodes, steps)),
        np.zeros(steps),
    )  # fmt: skip
    return model, trial


@njit(**FAST)
def make_limits(size, path, model, trial):
    """Constraints on (x_i, u_i), and on x_{i+1}."""
    n, node = size.n, 1 + size.n + size.n**2
    one, two = (size.inputs, size.steps), (size.nodes, size.steps)
    inputs = Limits(
        model.drive, size.value, size.slope, size.w, path.v, size.w + n, np.zeros(one),
        np.zeros(one), np.zeros(one), trial.drive, n + 1, size.inputs, 0,
    )  # fmt: skip
    nodes = Limits(
        model.node, node, node + size.nodes, n, path.vn, n, np.zeros(two), np.zeros(two),
        np.zeros(two), trial.node, 1, size.always, 1,
    )  # fmt: skip
    return inputs, nodes


@njit(**FAST)
def make_newton(size):
    """Room for the condensed quadratic and its solution."""
    n, m, w, steps = size.n, size.m, size.w, size.steps
    quadratic = Quadratic(
        np.zeros((steps + 1, w, w)), np.zeros((steps + 1, w)), np.zeros((steps + 1, n)),
        np.zeros((steps, n + 2, n + 2)), np.zeros((steps, n + 2)), np.zeros(2),
    )  # fmt: skip
    gains = Gains(
        np.zeros((steps + 1, n, n)), np.zeros((steps + 1, n)), np.zeros((steps + 1, n)),
        np.zeros((steps, m, n)), np.zeros((steps, m)), np.zeros((steps, m)),
        np.zeros((n, w)), np.zeros((n, w)), np.zeros((w, w)), np.zeros(w), np.zeros(w),
    )  # fmt: skip
    return quadratic, gains


@njit(**LEAN)
def reach(value, step, share, longest):
    """Longest step, at most ``longest``, that keeps 1 - ``share`` of a positive value."""
    if step < 0.0:
        return min(longest, -share * value / step)
    return longest


@njit(**LEAN)
def safe(z, gap, mu):
    """Keep a multiplier within a huge factor of mu / gap (Waechter and Biegler 2006, eq. 16)."""
    return max(min(z, 1e10 * mu / gap), 1e-10 * mu / gap)


@njit(**LEAN)
def logarithm(total, product, value):
    """Add a factor to a product whose logarithm is wanted, without one call per factor."""
    product *= value
    if not 1e-200 < product < 1e200:
        return total + np.log(product), 1.0
    return total, product
