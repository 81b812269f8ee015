"""The stage functions of a problem with their derivatives.

Each is an SX function of two vectors (variables v, parameters p) to one, evaluated for all
stages, or all slots of all stages, in one call, see `wideberth.framework.programs`. They do not
depend on the horizon or on the number of slots.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...framework.mpc.ocp.problem import Problem, Slots
from ...framework.numerics.symbolic import ca


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
    """CasADi functions of a problem, and their sizes.

    Attributes
    ----------
    functions : name -> function ([v, p], [out]); ``drive`` of (x, u) at i < N, ``node`` of x at
        i > 0, ``level`` of s, and `slot_name` of one slot of each kind, all with derivatives;
        ``node_values`` and ``..._values`` of a slot without.
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
    """One function to a dense column."""
    out = ca.densify(ca.vertcat(*[ca.densify(piece) for piece in pieces]))
    return ca.Function("kernel", [v, p], [out], {"cse": True})


def _rows(matrix: Any) -> Any:
    """Entries of a matrix row by row."""
    return ca.vec(ca.densify(matrix).T)


def _full(matrix: Any) -> Any:
    return ca.vec(ca.densify(matrix))
