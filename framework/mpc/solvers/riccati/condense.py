"""What the obstacles of all stages contribute to the Newton step, by the kernels of `elimination`.

The sum over the obstacles of a stage stands in ``slots`` and ``force`` of the quadratic; `slack`
eliminates the stage's slack from it.
"""

from numba import njit

from ....jit.columns import caller
from .memory import LEAN

call = caller()


@njit(**LEAN)
def condense(size, slots, quadratic, eps, mu, delta, kernel):
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
    call(kernel, 0, count * wide, slots.v, slots.out, slots.condensed)
    if slots.da.shape[0]:
        row = slots.condensed.shape[0] - 1
        for k in range(count):
            for i in range(size.steps):
                if not slots.condensed[row, k * wide + i] > 0.0:
                    return False
    _sum(size, slots, quadratic)
    return True


@njit(**LEAN)
def _sum(size, slots, quadratic):
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
def expand(size, slots, slack, dv, ds, kernel):
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
    call(kernel, 0, count * wide, slots.v, slots.out, slots.steps)
