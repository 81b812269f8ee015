"""A peer: acados, sequential quadratic programming in generated C, on the paper's program.

acados has no variable that belongs to no stage: s is a state that the first stage's third input
sets and that stays as it is. The same input of later stages does nothing and has a small cost,
since acados wants a cost on every input. The regions are 0.5 log q >= 0, as in the assembled
problem.
"""

import contextlib
import ctypes
import io
import os
import shutil
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
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

BESIDE = Path(__file__).resolve().parents[1] / ".venv" / "acados"
"""Where `make acados` puts it."""
SCALE = 1e-3
"""Of the cost: its weights go up to 1e4, and acados scales nothing."""
IDLE = 1e-2
"""Cost of the input that does nothing, before scaling."""
FAR = np.array([1e4, 1e4, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
"""An ellipse far away, for x_0, which no plan changes."""
HIGHEST, FARTHEST = 10.0, 20.0
"""Bounds of s and of 0.5 log q that are never active; HPIPM takes infinity for a number."""
_STATUS = {0: Status.SOLVED, 2: Status.LIMIT}
_WORDS = ("solved", "not a number", "iteration limit", "least step", "the QP solver failed")


def missing() -> str:
    """Say what acados lacks here; empty where it can take part."""
    if not (_root() / "lib" / "libacados.so").exists():
        return "not installed (`make acados`, or ACADOS_SOURCE_DIR)"
    lacking = [name for name in ("cc", "make") if shutil.which(name) is None]
    return f"it compiles its problem, and there is no {lacking[0]}" if lacking else ""


def _root() -> Path:
    return Path(os.environ.get("ACADOS_SOURCE_DIR", BESIDE))


@final
@dataclass(frozen=True)
class AcadosProgram(Solver):
    """acados: SQP with exact second derivatives, made convex by projection, and full steps.

    Parameters
    ----------
    tolerance : of all residuals; the cost is scaled by `SCALE`.

    References
    ----------
    R. Verschueren et al., acados: a modular open-source framework for fast embedded optimal
    control, Math. Program. Comput. 14 (2022).
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
        solver = _compile(self.tolerance, *sizes)
        return [_solve(solver, parameters, guess) for guess in guesses]


def _solve(solver: Any, parameters: Parameters, guess: Guess) -> Solution:
    begin = perf_counter()
    steps = len(guess.inputs)
    initial = np.append(parameters.initial, 0.0)
    # The cost of x_0 is a constant: its reference is x_0 itself.
    places = np.vstack([parameters.initial[:2], parameters.reference])
    speeds = np.append(parameters.initial[3], parameters.speed)
    regions = parameters.slots[0].parameters.reshape(steps, -1)
    regions = np.vstack([np.resize(FAR, regions.shape[1]), regions])
    solver.reset()
    solver.constraints_set(0, "lbx", initial)
    solver.constraints_set(0, "ubx", initial)
    for i in range(steps + 1):
        first = float(i == 0)
        solver.set(i, "p", np.append(regions[i], first))
        solver.set(i, "x", np.append(guess.states[i], (1.0 - first) * guess.level))
        seen = [*places[i], speeds[i]]
        if i < steps:
            solver.set(i, "u", np.append(guess.inputs[i], first * guess.level))
            solver.set(i, "yref", np.array([*seen, 0.0, 0.0, 0.0]))
        else:
            solver.set(i, "yref", np.array([*seen, parameters.target]))
    code = solver.solve()
    states = np.array([solver.get(i, "x") for i in range(steps + 1)])
    inputs = np.array([solver.get(i, "u") for i in range(steps)])
    cost = solver.get_cost() / SCALE
    count = int(np.ravel(solver.get_stats("sqp_iter"))[0])
    seconds = perf_counter() - begin
    point = Guess.bare(states[:, :5], inputs[:, :2], float(states[-1, 5]))
    status = _STATUS.get(code, Status.FAILED)
    words = _WORDS[code] if code < len(_WORDS) else f"status {code}"
    return Solution(point, status, words, cost, count, seconds)


@cache
def _scratch() -> "TemporaryDirectory[str]":
    """Make a folder for generated code; it is removed when the process ends."""
    return TemporaryDirectory(prefix="acados-")


@cache
def _compile(tolerance: float, steps: int, obstacles: int, dt: float) -> Any:
    """Write the program for N steps among K ellipses, generate its C and compile that."""
    template = _imported()
    ocp = template.AcadosOcp()
    ocp.model, ocp.dims.N = _model(template, obstacles, dt), steps
    ocp.parameter_values = np.zeros(SLOT * obstacles + 1)
    _cost(ocp.cost, dt)
    _limits(ocp.constraints, obstacles)
    options = ocp.solver_options
    options.tf, options.integrator_type, options.nlp_solver_type = steps * dt, "DISCRETE", "SQP"
    options.hessian_approx, options.regularize_method = "EXACT", "PROJECT"
    options.qp_solver = "PARTIAL_CONDENSING_HPIPM"  # the fastest of three that were tried
    options.qp_solver_cond_N, options.qp_solver_iter_max = steps, 200
    options.nlp_solver_max_iter, options.tol, options.qp_tol = 100, tolerance, 0.01 * tolerance
    options.ext_fun_compile_flags = "-O2"
    folder = f"{_scratch().name}/{obstacles}"
    ocp.code_export_directory = f"{folder}"
    with contextlib.redirect_stdout(io.StringIO()):
        return template.AcadosOcpSolver(ocp, json_file=f"{folder}.json", verbose=False)


def _imported() -> Any:
    """Import acados's Python interface, and load its libraries, which it expects to be found."""
    root = _root()
    os.environ["ACADOS_SOURCE_DIR"] = str(root)
    for name in ("blasfeo", "hpipm", "qpOASES_e"):
        ctypes.CDLL(str(root / "lib" / f"lib{name}.so"), ctypes.RTLD_GLOBAL)
    sys.path.append(str(root / "interfaces" / "acados_template"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its docstrings
        import acados_template

    return acados_template


def _model(template: Any, obstacles: int, dt: float) -> Any:
    """State the paper's robot with s, and the regions."""
    model = template.AcadosModel()
    model.name = f"paper_{obstacles}"
    x, u, p = ca.SX.sym("x", 6), ca.SX.sym("u", 3), ca.SX.sym("p", SLOT * obstacles + 1)
    slots = ca.reshape(p[:-1], SLOT, obstacles)
    outside = [0.5 * ca.log(gauge(x, slots[:, k], x[5])) for k in range(obstacles)]
    model.x, model.u, model.p = x, u, p
    model.disc_dyn_expr = ca.vertcat(follow(x[:5], u[:2], dt), x[5] + p[-1] * u[2])
    model.con_h_expr = model.con_h_expr_e = ca.vertcat(*outside)
    return model


def _cost(cost: Any, dt: float) -> None:
    """State the cost, half of weighted squares; acados multiplies all but the last by dt."""
    robot = np.eye(6)[[0, 1, 3]]
    each = np.diag([POSITION, POSITION, SPEED, ACCELERATION, YAW_ACCELERATION, IDLE])
    first = np.diag([*np.diag(each)[:5], 0.0])
    cost.cost_type_0 = cost.cost_type = cost.cost_type_e = "LINEAR_LS"
    cost.Vx_0 = cost.Vx = np.vstack([robot, np.zeros((3, 6))])
    cost.Vu_0 = cost.Vu = np.vstack([np.zeros((3, 3)), np.eye(3)])
    cost.Vx_e = np.vstack([robot, np.eye(6)[5]])
    cost.W_0, cost.W = 2.0 * SCALE / dt * first, 2.0 * SCALE / dt * each
    cost.W_e = 2.0 * SCALE * np.diag([POSITION, POSITION, SPEED, 1.0])
    cost.yref_0, cost.yref, cost.yref_e = np.zeros(6), np.zeros(6), np.zeros(4)


def _limits(limits: Any, obstacles: int) -> None:
    bound = np.array([TOP_SPEED, TOP_YAW_RATE])
    limits.x0 = np.zeros(6)
    limits.idxbx = limits.idxbx_e = np.array([3, 4])
    limits.lbx = limits.lbx_e = -bound
    limits.ubx = limits.ubx_e = bound
    limits.idxbu = np.arange(3)
    limits.lbu = np.array([-TOP_ACCELERATION, -TOP_YAW_ACCELERATION, 0.0])
    limits.ubu = np.array([TOP_ACCELERATION, TOP_YAW_ACCELERATION, HIGHEST])
    limits.lh = limits.lh_e = np.zeros(obstacles)
    limits.uh = limits.uh_e = np.full(obstacles, FARTHEST)
