"""fatrop: an interior-point method that exploits the stages of the problem."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, final

from ..framework.mpc.ocp.problem import Parameters, Problem
from ..framework.mpc.ocp.transcription import Guess
from ..framework.mpc.solver import Solution, Solver, on_time, refuse_misfits
from ..framework.values.arrays import positive, whole
from ..framework.values.plan import Status
from .casadi_program import compiled, run

START_BARRIER = 1e-2
"""fatrop's ``mu_init``; small, because guesses are warm."""


@final
@dataclass(frozen=True)
class Fatrop(Solver):
    """Structured interior point by Vanroye et al. (2023), through CasADi.

    The paper's one level becomes a constant state, so that every constraint touches only
    neighbouring stages.

    Parameters
    ----------
    iterations : limit.
    tolerance : fatrop's ``tol``.
    """

    iterations: int = 300
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        whole("fatrop.iterations", self.iterations)
        positive("fatrop.tolerance", self.tolerance)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess.

        fatrop offers no time limit and no callback; a solve that took longer than the deadline
        is reported as late, with its result.
        """
        begin = perf_counter()
        refuse_misfits(problem, parameters, guesses)
        options: dict[str, Any] = {
            "fatrop.print_level": 0,
            "fatrop.max_iter": self.iterations,
            "fatrop.tol": self.tolerance,
            "fatrop.mu_init": START_BARRIER,
        }
        solutions = []
        with compiled("fatrop", problem, options, staged=True) as program:
            for guess in guesses:
                found = run(program, parameters, guess, _status)
                solutions.append(on_time(found, perf_counter() - begin, deadline))
                begin = perf_counter()
        return solutions


def _status(stats: dict[str, Any]) -> tuple[Status, str]:
    # return_status is the integer 0 whatever happened: success decides.
    if stats["success"]:
        return Status.SOLVED, "solved"
    return Status.FAILED, f"no convergence ({stats['return_status']})"
