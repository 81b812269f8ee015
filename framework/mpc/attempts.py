"""Solving from several starts, where that is worth it and as long as there is time."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..plan import Rung, Status
from .case import Candidate, Case, Outcome
from .ladder import Ladder
from .solvers.base import Solution, Solver
from .starts import OTHERS, Starts, along, other_starts
from .transcription import Guess
from .verify import violation

RESERVE = 0.1
"""Share of the deadline that is kept for checking the results and for falling back."""

STUCK = 0.1
"""Share of its way that a plan has to come along not to be stuck. Between two people who stand, a
plan that waits is optimal among those near it, and stays so for ever."""


@dataclass(frozen=True)
class Budget:
    """Time of one call of the planner.

    Attributes
    ----------
    deadline : s, or None for no limit.
    begin : clock reading when the call came.
    """

    deadline: float | None
    begin: float

    @classmethod
    def start(cls, deadline: float | None) -> "Budget":
        """Begin to count."""
        return cls(deadline, perf_counter())

    def spent(self) -> float:
        """Return how long the call has taken, s."""
        return perf_counter() - self.begin

    def left(self) -> float:
        """Return what is left for solving, s; infinite without a deadline."""
        if self.deadline is None:
            return np.inf
        return (1.0 - RESERVE) * self.deadline - self.spent()


@dataclass(frozen=True, eq=False)
class Attempts:
    """Solves one instance from the last plan first, then from other starts.

    With ``auto`` these are all of `OTHERS` when the first solve gave no feasible plan, when there
    is no last plan, when something has just come into the way, and when the plan does not get
    past it (less than `STUCK` of the way); as long as it stays there else, ``along`` alone. In
    the way is what the reference enters at the level aimed at, or what makes
    the level give way. With nothing there the problem is the tracking problem, and one start is
    enough.

    The first solve may take all the time there is. The next one begins while as much is left as
    the longest took so far, since not every solver can be stopped.

    Parameters
    ----------
    solver : the plug-in.
    starts : names, or auto.
    budget : of the call.
    """

    solver: Solver
    starts: Starts
    budget: Budget

    def run(self, ladder: Ladder, case: Case, first: Guess, crowded: bool) -> Outcome:
        """Solve; ``crowded`` is what the last outcome said."""
        try:
            return self._run(ladder, case, first, crowded)
        except Exception as error:  # a plug-in's solver may fail in any way; the ladder goes on
            message = f"{type(error).__name__}: {error}"
            return Outcome((), (first,), crowded, crowded, Status.FAILED, message)

    def _run(self, ladder: Ladder, case: Case, first: Guess, crowded: bool) -> Outcome:
        if self.budget.left() <= 0.0:
            message = "no time was left to solve"
            return Outcome((), (first,), crowded, crowded, Status.DEADLINE, message)
        reference = ladder.guess(*along(ladder.robot, case.parameters, ladder.dt))
        solutions = self._solve(case, [first])
        candidates = [ladder.assess(case, one) for one in solutions]
        there = _in_the_way(ladder, case, reference, candidates[0])
        names = self._names(ladder, case, candidates[0], there, crowded)
        found = other_starts(ladder.robot, case.problem, case.parameters, first, names)
        others = [ladder.suited(case.parameters, guess) for guess in found]
        solutions = self._others(case, others, solutions[0].seconds)
        candidates += [ladder.assess(case, one) for one in solutions]
        guesses = (first, *others[: len(solutions)])
        solved = candidates[0].solution
        assert solved is not None
        return Outcome(tuple(candidates), guesses, there, crowded, solved.status, solved.message)

    def _names(
        self, ladder: Ladder, case: Case, first: Candidate, there: bool, crowded: bool
    ) -> Sequence[str]:
        """Return the starts that this situation asks for."""
        if self.starts != "auto":
            return self.starts
        if first.rung is not Rung.OPTIMAL:
            return OTHERS
        if not there:
            return ()
        anew = ladder.inputs is None or not crowded
        return OTHERS if anew or _stuck(ladder, case, first) else ("along",)

    def _others(self, case: Case, guesses: Sequence[Guess], longest: float) -> list[Solution]:
        """Solve from other starts while there is time."""
        if not guesses:
            return []
        if self.budget.deadline is None:
            return self._solve(case, guesses)
        solutions: list[Solution] = []
        for guess in guesses:
            if self.budget.left() < longest:
                break
            solutions += self._solve(case, [guess])
            longest = max(longest, solutions[-1].seconds)
        return solutions

    def _solve(self, case: Case, guesses: Sequence[Guess]) -> list[Solution]:
        left = None if self.budget.deadline is None else max(self.budget.left(), 1e-3)
        return self.solver.solve(case.problem, case.parameters, guesses, left)


def _stuck(ladder: Ladder, case: Case, solved: Candidate) -> bool:
    """Whether a plan ends where it begins, measured by the way to where its reference ends."""
    begin, end = (
        np.array(ladder.robot.pose(tuple(state)).position, dtype=np.float64)
        for state in (solved.point.states[0], solved.point.states[-1])
    )
    way = np.linalg.norm(case.parameters.reference[-1] - begin)
    return bool(np.linalg.norm(end - begin) < STUCK * way)


def _in_the_way(ladder: Ladder, case: Case, reference: Guess, solved: Candidate) -> bool:
    """Whether something stands on the reference, or makes the level give way."""
    parameters = case.parameters
    if not (parameters.active.any() or parameters.static_active.any()):
        return False
    point = ladder.suited(parameters, reference)
    if violation(case.problem, parameters, point).regions.max(initial=0.0) > 0.0:
        return True
    return case.problem.shared and solved.point.level < parameters.target - 1e-3
