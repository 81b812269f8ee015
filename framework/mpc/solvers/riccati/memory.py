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
`point.try_point`."""

Quadratic = namedtuple("Quadratic", "rows hessian gradient cross slots force top seen")
"""Condensed, without what ``drive`` gives, one column per stage: ``rows`` holds the Hessian of w
(w w, row by row; its part up to the diagonal), its gradient, the mixed derivatives of x and the
level, the gap of the dynamics and the regularisation; the first three have names of their own.
``slots`` ((n + 2)^2), ``force`` (n + 2): what slots add to (x, s, slack), of which they touch the
entries ``seen`` of x; curvature and slope of the level."""

Gains = namedtuple("Gains", "rows P p q top sound K k ks")
"""Results of `sweep.sweep`, one column per stage, and the first rows of its pieces."""

Slack = namedtuple("Slack", "eps nu deps dnu tally most")
"""Of the regions, one per stage, its multiplier, their steps; what `slots.pull_slots` and
`slots.reach_slots` find."""

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
    wide = 8 * ((steps + 8) // 8)
    return Size(n, m, w, shared, steps, wide, inputs, always, always + final, jacobian, hessian,
                value, value + inputs)  # fmt: skip


@njit(**FAST)
def make_block(size, width):
    """Room for all that is made of it below, zero: one block costs no more than each of them."""
    n, m, w, node = size.n, size.m, size.w, 1 + size.n + size.n**2
    path = w + n + size.inputs + n + size.nodes + 2 * w + 3 * w + n
    model = size.slope + size.inputs * w + node + size.nodes * (1 + n) + n
    trial = w + n + size.inputs + n + size.nodes + 1 + size.nodes + 1
    newton = w * w + w + 2 * n + 1 + (n + 2) ** 2 + n + 2
    gains = n * (n + 1) // 2 + 2 * n + 3 + m * (n + 2)
    return np.zeros((path + model + trial + newton + gains + 12 + w + width, size.wide))


@njit(**FAST)
def cut(block, rows):
    """Return the first rows of a block, and the rest."""
    return block[:rows], block[rows:]


@njit(**FAST)
def make_path(size, limits, block):
    """Variables and steps."""
    v, block = cut(block, size.w + size.n + size.inputs)
    vn, block = cut(block, size.n + size.nodes)
    zl, block = cut(block, size.w)
    zu, block = cut(block, size.w)
    move, block = cut(block, size.w)
    pi, block = cut(block, size.n)
    dzl, block = cut(block, size.w)
    dzu, block = cut(block, size.w)
    return Path(v, vn, limits[0], limits[1], zl, zu), Step(move, pi, dzl, dzu), block


@njit(**FAST)
def make_model(size, block):
    """Room for the results of the kernels, here and at a trial point."""
    n, node = size.n, 1 + size.n + size.n**2
    drive, block = cut(block, size.slope + size.inputs * size.w)
    nodes, block = cut(block, node + size.nodes * (1 + n))
    gap, block = cut(block, n)
    v, block = cut(block, size.w + n + size.inputs)
    vn, block = cut(block, n + size.nodes)
    node_values, block = cut(block, 1 + size.nodes)
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
    reference, direction, speed, curve = head
    dimension = reference.shape[1]
    columns, block = cut(block, 2 * dimension + curve.shape[1] + 2)
    for i in range(size.steps):
        for r in range(dimension):
            columns[r, i] = reference[i, r]
            columns[dimension + r, i] = direction[i, r]
        columns[2 * dimension, i] = speed[i]
        for r in range(curve.shape[1]):
            columns[2 * dimension + 1 + r, i] = curve[i, r]
    return columns, block


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
    rows, block = cut(block, square + w + 2 * n + 1)
    slots, block = cut(block, (n + 2) ** 2)
    force, block = cut(block, n + 2)
    quadratic = Quadratic(
        rows, rows[:square], rows[square : square + w], rows[square + w : square + w + n],
        slots, force, np.zeros(2), seen,
    )  # fmt: skip
    p = n * (n + 1) // 2
    gain = p + 2 * n + 3
    found, block = cut(block, gain + m * (n + 2))
    gains = Gains(found, 0, p, p + n, p + 2 * n, gain - 1, gain, gain + m * n, gain + m * n + m)
    return quadratic, gains, block


@njit(**FAST)
def union(one, two):
    """Entries of x that slots of either kind depend on; NumPy's own compiles for seconds."""
    count, found = 0, np.empty(len(one) + len(two), dtype=np.int64)
    for k in range(len(found)):
        entry = one[k] if k < len(one) else two[k - len(one)]
        new = True
        for j in range(count):
            new = new and found[j] != entry
        if new:
            found[count] = entry
            count += 1
    return found[:count]


@njit(**LEAN)
def target(levels, active):
    """Mean level of the active slots, `Parameters.target`."""
    total, count = 0.0, 0
    for k in range(len(active)):
        if active[k] > 0.0:
            for i in range(len(levels)):
                total, count = total + levels[i, k], count + 1
    return total / count if count > 0 else 0.0


@njit(**LEAN)
def reach(value, step, share, longest):
    """Longest step, at most ``longest``, that keeps 1 - ``share`` of a positive value."""
    if step < 0.0:
        return min(longest, -share * value / step)
    return longest


@njit(**LEAN)
def larger(value, most):
    """Whichever is larger; NaN wins."""
    return most if value <= most else value


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
