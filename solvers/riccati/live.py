"""The solver ``riccati_live``: `Riccati` for a loop that must not wait until it is compiled."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import final

from ...framework.mpc.ocp.problem import Parameters, Problem
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.solver import CheapestSolver, SizelessSolver, Solution
from ...framework.values.errors import WideberthError
from .solver import Riccati, by_fatrop


@final
@dataclass(frozen=True)
class RiccatiLive(SizelessSolver, CheapestSolver):
    """As `Riccati`, but `Fatrop` answers while Numba compiles the core in the background.

    Both are the same where the package ships object code for the processor. Elsewhere `Riccati`
    waits for the compiler, a minute or two once per machine, and each solution is then by the same
    solver. Here the solver changes at some decision, so that two runs may differ; until then
    `Solution.stand_in` and the plan's reason say that fatrop solved.
    """

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        if _core_is_coming(problem):
            return by_fatrop(problem, parameters, guesses, deadline, _WHY)
        return Riccati().solve(problem, parameters, guesses, deadline)

    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess, but for those that lead to no cheaper plan; fatrop from each."""
        if _core_is_coming(problem):
            return by_fatrop(problem, parameters, guesses, deadline, _WHY)
        return Riccati().solve_cheapest(problem, parameters, guesses, known, within, deadline)


_WHY = "riccati is still compiled in the background"


def _core_is_coming(problem: Problem) -> bool:
    """Whether Numba still compiles the core; until then this compiles the kernels."""
    from .compiled import LEAST_KINDS, compiled_problem, core_is_coming

    if not core_is_coming(max(len(problem.slots), LEAST_KINDS)):
        return False
    with suppress(WideberthError):  # `Riccati` will say it
        compiled_problem(problem)  # now, as `Riccati` does, and not when the core is here
    return True
