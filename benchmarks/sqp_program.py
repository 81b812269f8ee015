"""A peer: CasADi's sequential quadratic programming with the QP solvers that its wheel ships.

It solves the assembled problem, as `Ipopt` does, with exact second derivatives and a line search.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, final

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.solver import Solution, Solver, on_time, refuse_misfits
from wideberth.framework.values.plan import Status
from wideberth.solvers.casadi_program import compiled, run

_OSQP = {"verbose": False, "eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 4000, "polish": True}
SETTINGS: dict[str, dict[str, Any]] = {
    "piqp": {},
    "qpoases": {"qpsol_options": {"printLevel": "none", "sparse": True}},
    # OSQP wants a convex QP: negative curvature changes its sign.
    "osqp": {"convexify_strategy": "eigen-reflect", "qpsol_options": {"osqp": _OSQP}},
}
"""What each QP solver needs beyond CasADi's defaults."""
_STATUS = {"Solve_Succeeded": Status.SOLVED, "Maximum_Iterations_Exceeded": Status.LIMIT}


@final
@dataclass(frozen=True)
class Sqp(Solver):
    """CasADi's ``sqpmethod`` on the assembled problem.

    Parameters
    ----------
    qp : the QP solver, a key of `SETTINGS`.
    tolerance : of feasibility and stationarity, unscaled.
    iterations : limit; each solves one QP. A single one is a real-time iteration: a full step.
    """

    qp: str
    tolerance: float
    iterations: int = 100

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; a deadline stops nothing, the result is marked as late."""
        begin = perf_counter()
        refuse_misfits(problem, parameters, guesses)
        own = SETTINGS[self.qp]
        quiet = {"print_time": False, "error_on_fail": False}
        options: dict[str, Any] = {
            **{"print_header": False, "print_iteration": False, "print_status": False},
            **{"tol_pr": self.tolerance, "tol_du": self.tolerance, "max_iter": self.iterations},
            **({"max_iter_ls": 0} if self.iterations == 1 else {}),
            **own,
            "qpsol": self.qp,
            "qpsol_options": {**quiet, **own.get("qpsol_options", {})},
        }
        solutions = []
        for guess in guesses:
            try:
                with compiled("sqpmethod", problem, options, staged=False) as program:
                    found = run(program, parameters, guess, _status)
            except RuntimeError as error:  # a QP that the QP solver refuses
                words = str(error).splitlines()[-1]
                nothing = float("nan")
                found = Solution(guess, Status.FAILED, words, nothing, 0, perf_counter() - begin)
            solutions.append(on_time(found, perf_counter() - begin, deadline))
            begin = perf_counter()
        return solutions


def _status(stats: dict[str, Any]) -> tuple[Status, str]:
    message = str(stats["return_status"])
    return _STATUS.get(message, Status.FAILED), message
