"""The paper's program, written down as the paper has it: the reference of all speed-ups.

One flat NLP for IPOPT with its default options; the region is q >= 1, squares and all. It shares
no expression with the assembler, whose stage functions are SX in either graph and whose
constraint is 0.5 log q >= 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from typing import Any, final

import casadi as ca
import numpy as np

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.values.plan import Status

SLOT = 9
"""Numbers of one ellipse: mean 2, eigenvectors 4, deviations 2, margin 1."""
POSITION, SPEED, ACCELERATION, YAW_ACCELERATION = 100.0, 10.0, 1e4, 500.0
"""The paper's weights."""
TOP_SPEED, TOP_YAW_RATE, TOP_ACCELERATION, TOP_YAW_ACCELERATION = 0.7, 0.3, 0.7, 0.1
"""The paper's limits, m/s, rad/s, m/s^2, rad/s^2."""


@final
@dataclass(frozen=True)
class PaperProgram(Solver):
    """IPOPT on the paper's program.

    Parameters
    ----------
    graph : ``mx``, CasADi's graph of matrix operations, as in the paper; or ``sx``.
    tolerance : IPOPT's ``tol``; its default is 1e-8.
    """

    graph: str
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
        program = _compile(self.graph, self.tolerance, deadline, *sizes)
        return [_solve(program, parameters, guess) for guess in guesses]


def _solve(program: dict[str, Any], parameters: Parameters, guess: Guess) -> Solution:
    begin = perf_counter()
    given = numbers(parameters)
    start = np.concatenate([guess.states[1:].ravel(), guess.inputs.ravel(), [guess.level]])
    solver = program["solver"]
    found = solver(x0=start, p=given, **program["bounds"])
    flat, stats = np.asarray(found["x"]).ravel(), solver.stats()
    steps = len(guess.inputs)
    states = np.vstack([parameters.initial, flat[: 5 * steps].reshape(steps, 5)])
    inputs = flat[5 * steps : -1].reshape(steps, 2)
    point = Guess.bare(states, inputs, float(flat[-1]))
    status = Status.SOLVED if stats["success"] else Status.FAILED
    message, count = str(stats["return_status"]), int(stats["iter_count"])
    cost = float(found["f"])
    return Solution(point, status, message, cost, count, perf_counter() - begin)


def numbers(parameters: Parameters) -> np.ndarray:
    """Return the numbers of an instance in a row: x_0, s_ref, places, speeds, ellipses."""
    head = [*parameters.initial, parameters.target, *parameters.reference.ravel()]
    return np.concatenate([head, parameters.speed, parameters.slots[0].parameters.ravel()])


@cache
def _compile(
    graph: str, tolerance: float, deadline: float | None, steps: int, obstacles: int, dt: float
) -> dict[str, Any]:
    """Write the program down for N steps among K ellipses and make the solver."""
    kind = ca.MX if graph == "mx" else ca.SX
    states, inputs, s = kind.sym("x", 5, steps), kind.sym("u", 2, steps), kind.sym("s")
    initial, target = kind.sym("x0", 5), kind.sym("target")
    reference, speed = kind.sym("reference", 2, steps), kind.sym("speed", steps)
    regions = kind.sym("regions", SLOT, obstacles * steps)
    cost, gaps, outside = (s - target) ** 2, [], []
    before = initial
    for i in range(steps):
        x, u = states[:, i], inputs[:, i]
        gaps.append(x - follow(before, u, dt))
        cost += POSITION * ca.sumsqr(x[:2] - reference[:, i]) + SPEED * (x[3] - speed[i]) ** 2
        cost += ACCELERATION * u[0] ** 2 + YAW_ACCELERATION * u[1] ** 2
        slots = [regions[:, i * obstacles + k] for k in range(obstacles)]
        outside += [gauge(x, slot, s) for slot in slots]
        before = x
    program = {
        "x": ca.vertcat(ca.vec(states), ca.vec(inputs), s),
        "p": ca.vertcat(initial, target, ca.vec(reference), speed, ca.vec(regions)),
        "f": cost,
        "g": ca.vertcat(*gaps, *outside),
    }
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    options: dict[str, Any] = {**quiet, "calc_lam_p": False, "ipopt.tol": tolerance}
    if deadline is not None:
        options["ipopt.max_wall_time"] = deadline
    upper = [np.inf] * 3 + [TOP_SPEED, TOP_YAW_RATE]
    limits = np.array(upper * steps + [TOP_ACCELERATION, TOP_YAW_ACCELERATION] * steps)
    bounds = {
        "lbx": np.append(-limits, 0.0),
        "ubx": np.append(limits, np.inf),
        "lbg": np.append(np.zeros(5 * steps), np.ones(obstacles * steps)),
        "ubg": np.append(np.zeros(5 * steps), np.full(obstacles * steps, np.inf)),
    }
    return {"solver": ca.nlpsol("paper", "ipopt", program, options), "bounds": bounds}


def follow(state: Any, control: Any, dt: float) -> Any:
    """RK4 of the unicycle (x, y, theta, v, omega) with inputs (a, alpha)."""

    def rate(x: Any) -> Any:
        return ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), x[4], control)

    k1 = rate(state)
    k2 = rate(state + dt / 2 * k1)
    k3 = rate(state + dt / 2 * k2)
    k4 = rate(state + dt * k3)
    return state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def gauge(state: Any, slot: Any, s: Any) -> Any:
    """Return q = dp^T R Lambda(s)^-1 R^T dp, product by product as the paper prints it.

    On MX every product is an operation of its own: written out entry by entry, q takes half the
    time. On SX both are the same.
    """
    frame = ca.reshape(slot[2:6], 2, 2).T  # CasADi fills columns
    inverse = ca.diag(1 / (s * slot[6:8] + slot[8]) ** 2)
    offset = state[:2] - slot[:2]
    return ca.mtimes([offset.T, frame, inverse, frame.T, offset])
