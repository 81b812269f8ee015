"""A peer: alpaqa, an augmented Lagrangian with PANOC inside, on the paper's program.

Its authors advise single shooting: the inputs, scaled by their limits, and s are the variables;
states follow by the dynamics, so that a plan keeps them exactly. Limits of speed and yaw rate and
the regions are general constraints. The problem is written on MX, as calls of one stage, and
compiled to C: straight-line code takes a minute to compile at 20 obstacles.
"""

import contextlib
import io
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
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
    numbers,
)

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.values.plan import Status

LIMITS = np.array([TOP_ACCELERATION, TOP_YAW_ACCELERATION])
PENALTY = 100.0
"""First price of a constraint, after scaling; 1 to 1e4 take about as long."""
MEMORY = 30
"""Pairs that L-BFGS keeps: about the number of variables."""


def missing() -> str:
    """Say what alpaqa lacks here; empty where it can take part."""
    if find_spec("alpaqa") is None:
        return "not installed (dependency group `bench`)"
    lacking = [name for name in ("cc", "cmake") if shutil.which(name) is None]
    return f"it compiles its problem, and there is no {lacking[0]}" if lacking else ""


@final
@dataclass(frozen=True)
class AlpaqaProgram(Solver):
    """PANOC with structured L-BFGS directions inside alpaqa's augmented Lagrangian.

    Parameters
    ----------
    tolerance : of stationarity and of the constraints.

    References
    ----------
    P. Pas, M. Schuurmans, P. Patrinos, Alpaqa: A matrix-free solver for nonlinear MPC and
    large-scale nonconvex optimization, ECC 2022.
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
        program = _compile(problem.horizon, problem.slots[0].count, problem.dt)
        return [self._one(program, parameters, guess) for guess in guesses]

    def _one(self, program: dict[str, Any], parameters: Parameters, guess: Guess) -> Solution:
        import alpaqa

        begin = perf_counter()
        outer = {"tolerance": self.tolerance, "dual_tolerance": self.tolerance}
        inner = alpaqa.PANOCSolver(
            {"max_iter": 2000}, alpaqa.StructuredLBFGSDirection({"memory": MEMORY})
        )
        solver = alpaqa.ALMSolver({**outer, "initial_penalty": PENALTY, "max_iter": 200}, inner)
        compiled = program["problem"]
        compiled.param = numbers(parameters)
        start = np.append((guess.inputs / LIMITS).ravel(), guess.level)
        rows = np.zeros(compiled.num_constraints)
        flat, _, stats = solver(compiled, x=start, y=rows)
        inputs = flat[:-1].reshape(-1, 2) * LIMITS
        driven = np.asarray(program["states"](parameters.initial, inputs.T)).T
        states = np.vstack([parameters.initial, driven])
        cost = float(compiled.eval_objective(flat))
        seconds = perf_counter() - begin
        point = Guess.bare(states, inputs, float(flat[-1]))
        solved = stats["status"] == alpaqa.SolverStatus.Converged
        status = Status.SOLVED if solved else Status.FAILED
        count = int(stats["inner"]["iterations"])
        return Solution(point, status, stats["status"].name, cost, count, seconds)


@cache
def _scratch() -> "TemporaryDirectory[str]":
    """Make a folder for generated code; it is removed when the process ends."""
    return TemporaryDirectory(prefix="alpaqa-")


@cache
def _compile(steps: int, obstacles: int, dt: float) -> dict[str, Any]:
    """Write the program for N steps among K ellipses and compile it."""
    import alpaqa

    stage, step = _stage(obstacles, dt)
    flat = ca.MX.sym("w", 2 * steps + 1)
    head = 6 + 3 * steps
    given = ca.MX.sym("p", head + SLOT * obstacles * steps)
    regions = ca.reshape(given[head:], SLOT * obstacles, steps)
    state, s, cost, rows = given[:5], flat[-1], (flat[-1] - given[5]) ** 2, []
    for i in range(steps):
        reference = ca.vertcat(given[6 + 2 * i : 8 + 2 * i], given[6 + 2 * steps + i])
        control = flat[2 * i : 2 * i + 2]
        state, price, row = stage(state, control, s, regions[:, i], reference)
        cost, rows = cost + price, [*rows, row]
    top = np.append(np.ones(2 * steps), 1e3)  # alpaqa refuses no infinite bound, but this is wide
    box = -np.append(np.ones(2 * steps), 0.0), top
    edge = np.array([TOP_SPEED, TOP_YAW_RATE])
    lower = np.tile(np.append(-edge, np.ones(obstacles)), steps)
    upper = np.tile(np.append(edge, np.full(obstacles, np.inf)), steps)
    described = alpaqa.minimize(cost, flat).subject_to_box(box)
    described = described.subject_to(ca.vertcat(*rows), (lower, upper))
    described = described.with_param(given, np.zeros(given.numel()))
    # alpaqa's cache is one folder, in which two processes that compile disturb each other.
    os.environ["ALPAQA_CACHE_DIR"] = _scratch().name
    with contextlib.redirect_stdout(io.StringIO()):
        problem = described.with_name(f"paper_{steps}_{obstacles}").compile(sym=ca.MX.sym)
    return {"problem": problem, "states": step.mapaccum(steps)}


def _stage(obstacles: int, dt: float) -> tuple[Any, Any]:
    """Return what one step costs and breaks, and the dynamics alone."""
    state, control, s = ca.SX.sym("x", 5), ca.SX.sym("u", 2), ca.SX.sym("s")
    regions, reference = ca.SX.sym("regions", SLOT * obstacles), ca.SX.sym("reference", 3)
    driven = control * ca.DM(LIMITS)
    after = follow(state, driven, dt)
    slots = ca.reshape(regions, SLOT, obstacles)
    rows = ca.vertcat(after[3:], *[gauge(after, slots[:, k], s) for k in range(obstacles)])
    cost = POSITION * ca.sumsqr(after[:2] - reference[:2]) + SPEED * (after[3] - reference[2]) ** 2
    cost += ACCELERATION * driven[0] ** 2 + YAW_ACCELERATION * driven[1] ** 2
    given = [state, control, s, regions, reference]
    stage = ca.Function("stage", given, [after, cost, rows])
    return stage, ca.Function("step", [state, control], [follow(state, control, dt)])
