"""All constraints and the cost of a problem as one CasADi function: a second implementation."""

from typing import Any

import casadi as ca
import numpy as np

from wideberth.framework.mpc.ocp.problem import Problem


def residuals(problem: Problem) -> Any:
    """State all steps at once, without the evaluator that plans are checked with.

    (x_i, u_i, x_{i+1}, s, stage parameters, auxiliaries of each kind of slots), one column per
    step -> gaps of the dynamics, robot limits (>= 0), room to each finite bound of x_{i+1} and u_i
    (>= 0), the cost without level and slack, and of each kind of slots the inequalities and the
    equalities.
    """
    x, u = ca.SX.sym("x", problem.states), ca.SX.sym("u", problem.inputs)
    following, stage = ca.SX.sym("next", problem.states), ca.SX.sym("stage", problem.stage_width)
    s = ca.SX.sym("s", int(problem.shared))
    lifted = [ca.SX.sym("auxiliary", one.count * len(one.auxiliary)) for one in problem.slots]
    limits = ca.vertcat(problem.input_constraints(x, u), problem.state_constraints(following))
    head, numbers = problem.cut(stage)
    cost = problem.input_cost(x, u, head) + problem.state_cost(following, head)
    rows: list[Any] = []
    for one, own, given in zip(problem.slots, lifted, numbers, strict=True):
        rows += one.all_of(following, own, s, given)
        cost += one.regularisation(own, given)
    gap, space = following - problem.dynamics(x, u), room(problem, following, u)
    single = ca.Function(
        "residuals", [x, u, following, s, stage, *lifted], [gap, limits, space, cost, *rows]
    )
    return single.map(problem.horizon)


def room(problem: Problem, x: Any, u: Any) -> Any:
    """How far a state and an input are from each of their finite bounds."""
    rows = [ca.SX(0, 1)]
    for values, bounds in ((x, problem.state_bounds), (u, problem.input_bounds)):
        for i, (lower, upper) in enumerate(zip(bounds.lower, bounds.upper, strict=True)):
            rows += [values[i] - lower] * bool(np.isfinite(lower))
            rows += [upper - values[i]] * bool(np.isfinite(upper))
    return ca.vertcat(*rows)
