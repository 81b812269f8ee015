"""A peer: do-mpc on the paper's problem, IPOPT with its defaults behind it.

do-mpc has neither a variable that belongs to no step nor constraints on x_N; s is therefore a
constant state whose first value is set free, and the regions are added to the program that
do-mpc has prepared, as its manual shows. The dynamics are the paper's RK4 as a discrete model.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from typing import Any, final

import casadi as ca
import numpy as np
from paper_program import (
    ACCELERATION,
    POSITION,
    SLOT,
    SPEED,
    TOP_ACCELERATION,
    TOP_SPEED,
    TOP_YAW_ACCELERATION,
    TOP_YAW_RATE,
    YAW_ACCELERATION,
    follow,
    gauge,
)

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.values.plan import Status

HEAD = 4
"""Numbers of a step before its ellipses: reference place 2, reference speed, s_ref."""


@final
@dataclass(frozen=True)
class DoMpcProgram(Solver):
    """do-mpc on the paper's program.

    Parameters
    ----------
    tolerance : IPOPT's ``tol``.

    References
    ----------
    F. Fiedler et al., do-mpc: Towards FAIR nonlinear and robust model predictive control,
    Control Eng. Pract. 140 (2023).
    """

    tolerance: float

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; only the problem's sizes are used, the rest is the paper's."""
        sizes = problem.horizon, problem.slots[0].count, problem.dt
        program = _compile(self.tolerance, deadline, *sizes)
        return [_solve(program, parameters, guess) for guess in guesses]


def _solve(program: Any, parameters: Parameters, guess: Guess) -> Solution:
    begin = perf_counter()
    steps = len(guess.inputs)
    # The cost of x_0 is a constant: its reference is x_0 itself.
    head = np.column_stack([parameters.reference, parameters.speed])
    head = np.vstack([parameters.initial[[0, 1, 3]], head])
    numbers = parameters.slots[0].parameters.reshape(steps, -1)
    numbers = np.vstack([np.ones_like(numbers[:1]), numbers])
    target = np.full((steps + 1, 1), parameters.target)
    varying = np.hstack([head, target, numbers])
    known, start = program.opt_p_num, program.opt_x_num
    known["_x0"] = np.append(parameters.initial, guess.level)
    for i in range(steps + 1):
        known["_tvp", i] = varying[i]
        start["_x", i, 0, -1] = np.append(guess.states[i], guess.level)
        if i < steps:
            start["_u", i, 0] = guess.inputs[i]
    program.solve()
    found, stats = program.opt_x_num, program.solver_stats
    states = np.hstack([np.asarray(found["_x", i, 0, -1]) for i in range(steps + 1)]).T
    inputs = np.hstack([np.asarray(found["_u", i, 0]) for i in range(steps)]).T
    point = Guess.bare(states[:, :5], inputs, float(states[-1, 5]))
    status = Status.SOLVED if stats["success"] else Status.FAILED
    message, count = str(stats["return_status"]), int(stats["iter_count"])
    cost = float(stats["iterations"]["obj"][-1])
    return Solution(point, status, message, cost, count, perf_counter() - begin)


@cache
def _compile(
    tolerance: float, deadline: float | None, steps: int, obstacles: int, dt: float
) -> Any:
    """Write the program down for N steps among K ellipses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # do-mpc warns of missing extras
        import do_mpc

    model = _model(do_mpc, obstacles, dt)
    mpc = do_mpc.controller.MPC(model)
    options: dict[str, Any] = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}
    options |= {"ipopt.tol": tolerance, "calc_lam_p": False}
    if deadline is not None:
        options["ipopt.max_wall_time"] = deadline
    mpc.set_param(n_horizon=steps, t_step=dt, nlpsol_opts=options)
    mpc.set_objective(mterm=model.aux["last"], lterm=model.aux["each"])
    mpc.set_rterm(a=0.0, alpha=0.0)
    bounds = {"v": TOP_SPEED, "omega": TOP_YAW_RATE}
    for name, bound in bounds.items():
        mpc.bounds["lower", "_x", name], mpc.bounds["upper", "_x", name] = -bound, bound
        mpc.terminal_bounds["lower", name], mpc.terminal_bounds["upper", name] = -bound, bound
    mpc.bounds["lower", "_x", "s"] = 0.0
    for name, bound in {"a": TOP_ACCELERATION, "alpha": TOP_YAW_ACCELERATION}.items():
        mpc.bounds["lower", "_u", name], mpc.bounds["upper", "_u", name] = -bound, bound
    template = mpc.get_tvp_template()
    mpc.set_tvp_fun(lambda _: template)
    mpc.prepare_nlp()
    mpc.nlp_cons_lb[0][5], mpc.nlp_cons_ub[0][5] = -np.inf, np.inf  # s_0 is free
    for i in range(1, steps + 1):
        state, varying = mpc.opt_x["_x", i, 0, -1], mpc.opt_p["_tvp", i]
        slots = ca.reshape(varying[HEAD:], SLOT, obstacles)
        outside = [gauge(state, slots[:, k], state[5]) for k in range(obstacles)]
        mpc.nlp_cons.append(ca.vertcat(*outside))
        mpc.nlp_cons_lb.append(np.ones((obstacles, 1)))
        mpc.nlp_cons_ub.append(np.full((obstacles, 1), np.inf))
    mpc.create_nlp()
    return mpc


def _model(do_mpc: Any, obstacles: int, dt: float) -> Any:
    """State the paper's robot, s as a constant state, and the cost."""
    model = do_mpc.model.Model("discrete", "SX")
    x = [model.set_variable("_x", name) for name in ("x", "y", "theta", "v", "omega", "s")]
    u = [model.set_variable("_u", name) for name in ("a", "alpha")]
    varying = model.set_variable("_tvp", "step", (HEAD + SLOT * obstacles, 1))
    following = follow(ca.vertcat(*x[:5]), ca.vertcat(*u), dt)
    for i, name in enumerate(("x", "y", "theta", "v", "omega")):
        model.set_rhs(name, following[i])
    model.set_rhs("s", x[5])
    cost = POSITION * ((x[0] - varying[0]) ** 2 + (x[1] - varying[1]) ** 2)
    cost += SPEED * (x[3] - varying[2]) ** 2
    effort = ACCELERATION * u[0] ** 2 + YAW_ACCELERATION * u[1] ** 2
    model.set_expression("each", cost + effort)
    model.set_expression("last", cost + (x[5] - varying[3]) ** 2)
    model.setup()
    return model
