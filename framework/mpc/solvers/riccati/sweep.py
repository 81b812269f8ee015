"""One stage of the Riccati recursion, written out for a robot.

minimise    sum_i  dw_i H_i dw_i / 2 + g_i dw_i + ds h_i dx_i   +   top of ds
subject to  dx_{i+1} = A_i dx_i + B_i du_i + gap_i,  dx_0 = 0.

The one level s is shared by all stages. It is carried as a second right-hand side: with the
value function x P x / 2 + (p + q ds) x the recursion for q is that for p without its constant
terms, and what is left at stage 0 is a parabola in ds. Treating s as a constant state would need
a P larger by one row.

Most entries of A, B and of the dynamics' Hessian are zeros and ones. A recursion that knows which
takes a third of the time of loops over full matrices.

J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control (2017), section 8.8.
"""

from typing import Any

from ....numerics.symbolic import ca

_SMALLEST = 1e-10
"""Pivot below which the reduced Hessian does not count as positive definite."""


def carried(n: int) -> int:
    """How many numbers a stage hands to the one before it."""
    return n * (n + 1) // 2 + 2 * n + 3


def sweep(n: int, m: int, drive: Any) -> Any:
    """Stage i of the recursion as a function of two columns.

    The first holds what stage i + 1 hands on (P row by row up to the diagonal, p, q, curvature
    and slope of the level, 1 if all pivots were positive), then the results of ``drive`` at i;
    the second H row by row, g, h, gap and delta, all without what ``drive`` gives. Of H the
    part up to the diagonal is read. The result is what the stage hands on, and its feedback
    K, k, ks of du = K dx + k + ks ds.

    Parameters
    ----------
    n, m : states and inputs.
    drive : the kernel of that name, see `kernels.build`.
    """
    w, first = n + m, n + 1 + n + m
    results, leaves = _results(drive)
    handed, value, p, q, top, sound = _handed(n)
    hessian, g, h = ca.SX.sym("H", w * w), ca.SX.sym("g", w), ca.SX.sym("h", n)
    gap, delta = ca.SX.sym("gap", n), ca.SX.sym("delta")
    slopes = ca.sparsify(ca.reshape(results[first : first + n * w], w, n).T)  # [A B]
    own = results[first + n * w : first + n * w + w * w]
    curve = ca.reshape(hessian + own, w, w).T + delta * ca.SX.eye(w)
    curve += slopes.T @ (value @ slopes)
    force = g + results[n + 1 : first] + slopes.T @ (p + value @ gap)
    shared = ca.vertcat(h, ca.SX(m, 1)) + slopes.T @ q
    top += ca.vertcat(0.0, ca.dot(q, gap))
    sides = ca.horzcat(force, shared)
    curve, sides, top, sound = _eliminated(n, curve, sides, top, sound)
    feedback = _solved(n, curve, sides)
    kept = [curve[r, c] for r in range(n) for c in range(r + 1)]
    out = ca.vertcat(*kept, sides[:n, 0], sides[:n, 1], top, sound)
    out = ca.vertcat(out, ca.vec(feedback[:, :n].T), feedback[:, n], feedback[:, n + 1])
    v, given = ca.vertcat(handed, leaves), ca.vertcat(hessian, g, h, gap, delta)
    return ca.Function("sweep", [v, given], [ca.densify(out)], {"cse": True})


def _results(drive: Any) -> tuple[Any, Any]:
    """Results of a kernel: numbers where they never change, symbols elsewhere; all symbols."""
    v, p = (ca.SX.sym("given", drive.numel_in(i)) for i in range(2))
    exact = ca.vertsplit(drive(v, p))
    leaves = ca.SX.sym("drive", len(exact))
    mixed = [one if one.is_constant() else leaves[i] for i, one in enumerate(exact)]
    return ca.vertcat(*mixed), leaves


def _handed(n: int) -> tuple[Any, ...]:
    """Name what the stage behind hands on: all of it in a column; P, p, q, top, sound."""
    names = {"P": n * (n + 1) // 2, "p": n, "q": n, "top": 2, "sound": 1}
    packed, *rest = (ca.SX.sym(name, count) for name, count in names.items())
    value = ca.SX(n, n)
    for r in range(n):
        for c in range(n):
            value[r, c] = packed[max(r, c) * (max(r, c) + 1) // 2 + min(r, c)]
    return (ca.vertcat(packed, *rest), value, *rest)


def _eliminated(n: int, curve: Any, sides: Any, top: Any, sound: Any) -> tuple[Any, Any, Any, Any]:
    """Eliminate the inputs one after the other; symmetric matrices up to their diagonal."""
    w = curve.shape[0]
    for a in range(n, w):
        sound *= curve[a, a] > _SMALLEST
        inverse = 1.0 / curve[a, a]
        left = [*range(n), *range(a + 1, w)]
        row = {r: curve[max(r, a), min(r, a)] for r in left}
        force, shared = sides[a, 0], sides[a, 1]
        for r in left:
            factor = row[r] * inverse
            for c in left:
                if c <= r:
                    curve[r, c] -= factor * row[c]
            sides[r, 0] -= factor * force
            sides[r, 1] -= factor * shared
        top -= shared * inverse * ca.vertcat(shared, force)
    return curve, sides, top, sound


def _solved(n: int, curve: Any, sides: Any) -> Any:
    """Feedback of the inputs, (K, k, ks), from what the elimination left of their rows."""
    m = curve.shape[0] - n
    feedback = ca.SX(m, n + 2)
    for a in range(m - 1, -1, -1):
        right = ca.horzcat(curve[n + a, :n], sides[n + a, :])
        for b in range(a + 1, m):
            right += curve[n + b, n + a] * feedback[b, :]
        feedback[a, :] = -right / curve[n + a, n + a]
    return feedback
