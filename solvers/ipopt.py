"""IPOPT with MUMPS: the paper's solver."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, final

from ..framework.mpc.ocp.problem import Parameters, Problem
from ..framework.mpc.ocp.transcription import Guess
from ..framework.mpc.solver import Solution, Solver, on_time, refuse_misfits
from ..framework.values.arrays import positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.plan import Status
from .casadi_program import compiled, run

_STATUS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.SOLVED,
    "Maximum_Iterations_Exceeded": Status.LIMIT,
    "Maximum_CpuTime_Exceeded": Status.DEADLINE,
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
    max_cpu_time : s, IPOPT's own limit on each solve: processor time of the whole process, looked
        at once an iteration. None leaves it out; the paper's is 0.45.
    """

    graph: str = "sx"
    iterations: int = 300
    tolerance: float = 1e-8
    max_cpu_time: float | None = None

    def __post_init__(self) -> None:
        if self.graph not in ("sx", "mx"):
            raise WideberthError(f"ipopt.graph is {self.graph!r}; wanted 'sx' or 'mx'")
        whole("ipopt.iterations", self.iterations)
        positive("ipopt.tolerance", self.tolerance)
        if self.max_cpu_time is not None:
            positive("ipopt.max_cpu_time", self.max_cpu_time)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess; IPOPT stops after the iteration in which the deadline passes."""
        begin = perf_counter()
        refuse_misfits(problem, parameters, guesses)
        options: dict[str, Any] = {
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.max_iter": self.iterations,
            "ipopt.tol": self.tolerance,
        }
        if self.max_cpu_time is not None:
            options["ipopt.max_cpu_time"] = self.max_cpu_time
        solutions = []
        with compiled(
            "ipopt",
            problem,
            options,
            staged=False,
            matrix=self.graph == "mx",
            stoppable=deadline is not None,
        ) as program:
            for guess in guesses:
                if program.stop is not None and deadline is not None:
                    program.stop.until = begin + deadline
                found = run(program, parameters, guess, _status)
                solutions.append(on_time(found, perf_counter() - begin, deadline))
                begin = perf_counter()
        return solutions


def _status(stats: dict[str, Any]) -> tuple[Status, str]:
    message = str(stats["return_status"])
    if message == "User_Requested_Stop":
        return Status.DEADLINE, "stopped at the deadline"
    return _STATUS.get(message, Status.FAILED), message
