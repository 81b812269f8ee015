"""The symbolic kernels of a problem: its stage functions with derivatives, and the Newton step.

Each is an SX function of two vectors (variables v, parameters p) to one, evaluated for all
stages, or all slots of all stages, in one call, see `wideberth.framework.jit.transpile`. They
do not depend on the horizon or on the number of slots, so a problem with more obstacles needs
no other code.

`build` differentiates the stage functions. `eliminate` and `expand` are what one obstacle
contributes to the Newton step, everything of its own eliminated. With slack t, multiplier lambda
and the stage's slack eps, the rows of the Newton system that belong to (t, lambda) are solved by
hand: with sigma = lambda / t and r = h + eps - t they add

    sigma (grad h, 1) (grad h, 1)'   and   -(mu / t - sigma r) (grad h, 1)

to the quadratic in (x, s, a, eps). The slot's own variables a, and the multipliers of its
equalities, are then eliminated from a small dense matrix.

`sweep` is one stage of the Riccati recursion, written out for a robot:

    minimise    sum_i  dw_i H_i dw_i / 2 + g_i dw_i + ds h_i dx_i   +   top of ds
    subject to  dx_{i+1} = A_i dx_i + B_i du_i + gap_i,  dx_0 = 0.

The one level s is shared by all stages. It is carried as a second right-hand side: with the
value function x P x / 2 + (p + q ds) x the recursion for q is that for p without its constant
terms, and what is left at stage 0 is a parabola in ds. Treating s as a constant state would need
a P larger by one row. Most entries of A, B and of the dynamics' Hessian are zeros and ones. A
recursion that knows which takes a third of the time of loops over full matrices.

J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control (2017), section 8.8.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...framework.mpc.ocp.problem import Problem, Slots
from ...framework.numerics.symbolic import ca
from .interior_point import EQUALITY_REGULARISATION, SMALLEST_OWN_PIVOT, SMALLEST_PIVOT


@dataclass(frozen=True)
class SlotShape:
    """Sizes of the kernels of one kind of slots.

    Attributes
    ----------
    depends : entries of x that the constraint depends on.
    inequalities, equalities : how many of each.
    """

    depends: tuple[int, ...]
    inequalities: int
    equalities: int


@dataclass(frozen=True, eq=False)
class Kernels:
    """CasADi functions to be compiled, and their sizes.

    Attributes
    ----------
    functions : name -> function ([v, p], [out]); ``drive`` of (x, u) at i < N, ``node`` of x at
        i > 0, ``level`` of s, and `slot_name` of one slot of each kind, each with derivatives and,
        as ``..._values``, without.
    input_rows, node_rows, final_rows : number of constraints on (x_i, u_i), on x_i, and on x_N
        beside those.
    slots : sizes of the slots' kernels, of each kind.
    """

    functions: dict[str, Any]
    input_rows: int
    node_rows: int
    final_rows: int
    slots: tuple[SlotShape, ...]


def slot_name(place: int) -> str:
    """Name of the kernels of the slots of one kind, by its place among the problem's."""
    return f"slot{place}"


def build(problem: Problem) -> Kernels:
    """Differentiate the stage functions of a problem."""
    functions: dict[str, Any] = {}
    input_rows = _drive(problem, functions)
    node_rows, final_rows = _node(problem, functions)
    _level(problem, functions)
    shapes = tuple(
        _slot(slot_name(k), problem, slots, functions) for k, slots in enumerate(problem.slots)
    )
    return Kernels(functions, input_rows, node_rows, final_rows, shapes)


def _drive(problem: Problem, functions: dict[str, Any]) -> int:
    """(x, u, pi, y), (head, scale) -> f, cost, its gradient, [A B], Hessian, c, its Jacobian."""
    n, m = problem.states, problem.inputs
    x, u, pi = ca.SX.sym("x", n), ca.SX.sym("u", m), ca.SX.sym("pi", n)
    head, scale = ca.SX.sym("head", problem.head_width), ca.SX.sym("scale")
    f, c = problem.dynamics(x, u), problem.input_constraints(x, u)
    y = ca.SX.sym("y", c.numel())
    cost = scale * problem.input_cost(x, u, head)
    w = ca.vertcat(x, u)
    hessian = ca.hessian(cost + ca.dot(pi, f) - ca.dot(y, c), w)[0]
    jacobians = [_rows(ca.jacobian(f, w)), _full(hessian), c, _rows(ca.jacobian(c, w))]
    v, p = ca.vertcat(x, u, pi, y), ca.vertcat(head, scale)
    functions["drive"] = _kernel(v, p, [f, cost, ca.gradient(cost, w), *jacobians])
    functions["drive_values"] = _kernel(v, p, [f, cost, c])
    return int(c.numel())


def _node(problem: Problem, functions: dict[str, Any]) -> tuple[int, int]:
    """(x, y), (head, scale) -> cost, its gradient, Hessian, g, its Jacobian."""
    x, head = ca.SX.sym("x", problem.states), ca.SX.sym("head", problem.head_width)
    scale = ca.SX.sym("scale")
    always, final = problem.state_constraints(x), problem.terminal_constraints(x)
    g = ca.vertcat(always, final)
    y = ca.SX.sym("y", g.numel())
    cost = scale * problem.state_cost(x, head)
    hessian = ca.hessian(cost - ca.dot(y, g), x)[0]
    v, p = ca.vertcat(x, y), ca.vertcat(head, scale)
    derivatives = [ca.gradient(cost, x), _full(hessian), g, _rows(ca.jacobian(g, x))]
    functions["node"] = _kernel(v, p, [cost, *derivatives])
    functions["node_values"] = _kernel(v, p, [cost, g])
    return int(always.numel()), int(final.numel())


def _level(problem: Problem, functions: dict[str, Any]) -> None:
    """(s), (s_ref, scale) -> cost, its derivative, its second derivative."""
    s, target, scale = ca.SX.sym("s"), ca.SX.sym("target"), ca.SX.sym("scale")
    cost = scale * problem.level_cost(s if problem.shared else ca.SX(0, 1), target)
    hessian, gradient = ca.hessian(cost, s)
    functions["level"] = _kernel(s, ca.vertcat(target, scale), [cost, gradient, hessian])


def _slot(name: str, problem: Problem, slots: Slots, functions: dict[str, Any]) -> SlotShape:
    """(x's entries, s, a, lambda, y), numbers -> h, e, their Jacobian, Hessian."""
    x, numbers = ca.SX.sym("x", problem.states), ca.SX.sym("numbers", slots.size)
    s, a = ca.SX.sym("s", int(problem.shared)), ca.SX.sym("a", len(slots.auxiliary))
    entries = ca.vertsplit(numbers)
    entries[slots.active] = ca.SX(1.0)
    given = ca.vertcat(*entries)
    h, e = slots.constraint(x, a, s, given)
    values = ca.vertcat(h, e)
    seen = ca.which_depends(values, x, 1, False) if values.numel() else [False] * problem.states
    depends = tuple(int(i) for i in np.flatnonzero(seen))
    own = x[list(depends)] if depends else ca.SX(0, 1)
    w = ca.vertcat(own, s, a)
    y = ca.SX.sym("y", values.numel())
    hessian = ca.hessian(-ca.dot(y, values), w)[0]
    v = ca.vertcat(w, y)
    functions[name] = _kernel(v, numbers, [values, _rows(ca.jacobian(values, w)), _full(hessian)])
    functions[f"{name}_values"] = _kernel(v, numbers, [values])
    return SlotShape(depends, h.numel(), e.numel())


def _kernel(v: Any, p: Any, pieces: list[Any]) -> Any:
    """One function to a dense column; the transpiler writes every entry of it."""
    out = ca.densify(ca.vertcat(*[ca.densify(piece) for piece in pieces]))
    return ca.Function("kernel", [v, p], [out], {"cse": True})


def _rows(matrix: Any) -> Any:
    """Entries of a matrix row by row."""
    return ca.vec(ca.densify(matrix).T)


def _full(matrix: Any) -> Any:
    return ca.vec(ca.densify(matrix))


@dataclass(frozen=True)
class Slot:
    """Sizes and bounds of one slot.

    Attributes
    ----------
    outer : entries of (x, s) that it depends on.
    lower, upper : bounds of the own variables.
    unequal, equal : inequalities, equalities.
    """

    outer: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    unequal: int
    equal: int

    def symbols(self) -> tuple[dict[str, Any], Any]:
        """Symbols of a slot's variables, and all in a column: the rows of ``v`` in `core`."""
        own = len(self.lower)
        counts = {
            "outer": self.outer, "a": own, "lam": self.unequal, "y": self.equal,
            "t": self.unequal, "zl": own, "zu": own, "guess": own, "eps": 1, "mu": 1, "delta": 1,
            "weight": 1, "d_outer": self.outer, "d_eps": 1,
        }  # fmt: skip
        made = {name: ca.SX.sym(name, count) for name, count in counts.items()}
        return made, ca.vertcat(*made.values())

    def derivatives(self) -> tuple[Any, Any, Any, Any]:
        """Symbols of the kernel's results: values, slopes, Hessian; all in a column."""
        rows, wide = self.unequal + self.equal, self.outer + len(self.lower)
        values, slopes = ca.SX.sym("values", rows), ca.SX.sym("slopes", rows * wide)
        hessian = ca.SX.sym("hessian", wide * wide)
        column = ca.vertcat(values, slopes, hessian)
        return values, _square(slopes, rows, wide), _square(hessian, wide, wide), column


def eliminate(slot: Slot) -> Any:
    """(variables, derivatives) -> quadratic in (x, s, eps), its force, back, whether it may be.

    The matrix stands row by row up to the diagonal; ``back`` gives the step of the own variables
    and new multipliers (of -y) from (x, s, eps, 1), row by row; the last entry is 1 where the
    curvature in the own variables is positive.
    """
    own, equal, outer = len(slot.lower), slot.equal, slot.outer + 1
    known, v = slot.symbols()
    values, slopes, hessian, results = slot.derivatives()
    inner = own + equal
    matrix, force = ca.SX(inner + outer, inner + outer), ca.SX(inner + outer, 1)
    place = [*range(inner, inner + slot.outer), *range(own)]  # of (x, s, a)
    matrix[place, place] = hessian
    for r in range(own):
        pull = 2.0 * known["weight"]
        matrix[r, r] += pull + known["delta"]
        force[r] += pull * (known["a"][r] - known["guess"][r])
        for gap, z, sign in _bounds(slot, known, r):
            matrix[r, r] += z / gap
            force[r] -= sign * known["mu"] / gap
    for j in range(slot.unequal):
        t = known["t"][j]
        sigma = known["lam"][j] / t
        weight = known["mu"] / t - sigma * (values[j] + known["eps"] - t)
        gradient = ca.SX(inner + outer, 1)
        gradient[place] = slopes[j, :].T
        gradient[-1] = 1.0
        force -= weight * gradient
        matrix += (sigma * gradient) @ gradient.T
    for j in range(equal):
        row = ca.SX(1, inner + outer)
        row[place] = slopes[slot.unequal + j, :]
        matrix[own + j, :], matrix[:, own + j] = row, row.T
        matrix[own + j, own + j], force[own + j] = (
            -EQUALITY_REGULARISATION,
            values[slot.unequal + j],
        )
    matrix, force, sound = _reduced(own, inner, matrix, force)
    back = _back(inner, matrix, force)
    kept = [matrix[r, c] for r in range(inner, inner + outer) for c in range(inner, r + 1)]
    out = ca.vertcat(*kept, force[inner:], ca.vec(back.T), sound)
    return ca.Function("eliminate", [v, results], [ca.densify(out)], {"cse": True})


def expand(slot: Slot) -> Any:
    """(variables, derivatives and results of `eliminate`) -> steps of all of its own.

    Steps of a, new multipliers (of -y), steps of t, lambda, zl, zu; 0 where there is no bound.
    """
    own, inner, outer = len(slot.lower), len(slot.lower) + slot.equal, slot.outer + 1
    known, v = slot.symbols()
    values, slopes, _, results = slot.derivatives()
    before = outer * (outer + 1) // 2 + outer
    condensed = ca.SX.sym("condensed", before + inner * (outer + 1) + 1)
    back = _square(condensed[before : before + inner * (outer + 1)], inner, outer + 1)
    given = ca.vertcat(known["d_outer"], known["d_eps"], 1.0)
    new = back @ given
    move, mu = ca.vertcat(known["d_outer"], new[:own]), known["mu"]
    rise = values[: slot.unequal] + slopes[: slot.unequal, :] @ move
    dt = rise + known["eps"] + known["d_eps"] - known["t"]
    lam = known["lam"]
    steps = [new, dt, (mu - lam * dt) / known["t"] - lam]
    bounds = {1.0: [ca.SX(0.0)] * own, -1.0: [ca.SX(0.0)] * own}
    for r in range(own):
        for gap, z, sign in _bounds(slot, known, r):
            bounds[sign][r] = (mu - sign * z * new[r]) / gap - z
    out = ca.vertcat(*steps, *bounds[1.0], *bounds[-1.0])
    p = ca.vertcat(results, condensed)
    return ca.Function("expand", [v, p], [ca.densify(out)], {"cse": True})


def _square(column: Any, rows: int, wide: int) -> Any:
    """Return the matrix whose entries stand row by row."""
    return ca.reshape(column, wide, rows).T


def _bounds(slot: Slot, known: dict[str, Any], r: int) -> list[tuple[Any, Any, float]]:
    """Gap, multiplier and sign of the bounds that an own variable has."""
    a, found = known["a"][r], []
    if np.isfinite(slot.lower[r]):
        found.append((a - slot.lower[r], known["zl"][r], 1.0))
    if np.isfinite(slot.upper[r]):
        found.append((slot.upper[r] - a, known["zu"][r], -1.0))
    return found


def _reduced(own: int, inner: int, matrix: Any, force: Any) -> tuple[Any, Any, Any]:
    """Eliminate the first ``inner`` unknowns, in the part up to the diagonal.

    Own variables need positive pivots and multipliers of equalities negative ones.
    """
    sound, size = ca.SX(1.0), matrix.shape[0]
    for j in range(inner):
        sound *= (matrix[j, j] if j < own else -matrix[j, j]) > SMALLEST_OWN_PIVOT
        inverse = 1.0 / matrix[j, j]
        for r in range(j + 1, size):
            factor = matrix[r, j] * inverse
            force[r] -= factor * force[j]
            for k in range(j + 1, r + 1):
                matrix[r, k] -= factor * matrix[k, j]
    return matrix, force, sound


def _back(inner: int, matrix: Any, force: Any) -> Any:
    """Solve for the inner unknowns as a function of the outer ones and 1."""
    outer = matrix.shape[0] - inner
    back = ca.SX(inner, outer + 1)
    for j in range(inner - 1, -1, -1):
        value = ca.horzcat(matrix[inner:, j].T, force[j])
        for k in range(j + 1, inner):
            value += matrix[k, j] * back[k, :]
        back[j, :] = -value / matrix[j, j]
    return back


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
    drive : the kernel of that name, see `build`.
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
        sound *= curve[a, a] > SMALLEST_PIVOT
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
