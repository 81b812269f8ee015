"""IPOPT with MUMPS: the paper's solver."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

from ...arrays import positive, whole
from ...errors import WideberthError
from ...plan import Status
from ..problem import Parameters, Problem
from ..transcription import Guess
from .base import Solution, Solver, compiled, run

_STATUS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.SOLVED,
    "Maximum_Iterations_Exceeded": Status.LIMIT,
    "Maximum_CpuTime_Exceeded": Status.DEADLINE,
    "Maximum_WallTime_Exceeded": Status.DEADLINE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
}


@final
@dataclass(frozen=True)
class Ipopt(Solver):
    """Interior point by Waechter and Biegler (2006), through CasADi.

    The paper builds its program on MX graphs; SX gives the same iterates in about half the
    time (benchmarks/ measures it), so SX is the default.

    Parameters
    ----------
    graph : ``sx``, or ``mx`` as in the paper.
    iterations : limit; a count, unlike a time, is reproducible. The paper names none; IPOPT's own
        is 3000.
    tolerance : IPOPT's ``tol``.
    """

    graph: str = "sx"
    iterations: int = 300
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        if self.graph not in ("sx", "mx"):
            raise WideberthError(f"ipopt.graph is {self.graph!r}; wanted 'sx' or 'mx'")
        whole("ipopt.iterations", self.iterations)
        positive("ipopt.tolerance", self.tolerance)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; the deadline is IPOPT's ``max_cpu_time``."""
        options: dict[str, Any] = {
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": self.iterations,
            "ipopt.tol": self.tolerance,
        }
        if deadline is not None:
            options["ipopt.max_cpu_time"] = deadline
        program = compiled("ipopt", problem, options, staged=False, matrix=self.graph == "mx")
        return [run(program, parameters, guess, _status) for guess in guesses]


def _status(stats: dict[str, Any]) -> tuple[Status, str]:
    message = str(stats["return_status"])
    return _STATUS.get(message, Status.FAILED), message
