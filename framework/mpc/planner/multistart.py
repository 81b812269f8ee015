"""Solving from several starts, where that is worth it and as long as there is time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np

from ...values.arrays import FARTHEST
from ...values.plan import Rung, Status
from ..fallback.instance_check import Candidate, InstanceCheck, Outcome
from ..fallback.ladder import Ladder
from ..fallback.verify import violation
from ..ocp.transcription import Guess
from ..solvers.base import Solution, Solver, on_time
from ..solvers.watchdog import LeftBehind, Refused, watched
from .starting_points import OTHERS, Starts, along, other_starts

RESERVE = 0.1
"""Share of the deadline that is kept for checking the results and for falling back. A solver that
runs on is waited for during the first half of it."""

PATIENCE = 60.0
"""s that a solve may take where there is no deadline: far more than solvers need."""

COMPILING = 10.0
"""The first use of a problem, which compiles it, may take so many times the planner's patience."""

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

    def wait(self) -> float:
        """Return how much longer a solver is waited for, s; infinite without a deadline."""
        return self.left() + (0.0 if self.deadline is None else 0.5 * RESERVE * self.deadline)


class Watch:
    """Calls a planner's solver in a thread that is left behind where it does not return.

    Parameters
    ----------
    solver : the plug-in.
    patience : s that one solve may take where there is no deadline.
    """

    def __init__(self, solver: Solver, patience: float = PATIENCE) -> None:
        self._solver, self._patience = solver, patience
        self._used: set[str] = set()

    @property
    def name(self) -> str:
        """What reasons call the solver."""
        return type(self._solver).__name__

    def solve(
        self, check: InstanceCheck, guesses: Sequence[Guess], budget: Budget
    ) -> list[Solution]:
        """Solve from each guess.

        With a deadline all of it, compilation included, may take what the budget has left.
        Without one the planner's patience counts, and more of it at the first use of a problem.

        Raises
        ------
        LeftBehind, Refused : there is no solution, see `watch.watched`.
        """
        given = check.problem, check.parameters
        if budget.deadline is None:
            limit = self._patience * len(guesses)
            if check.problem.key not in self._used:
                limit *= COMPILING
                self._used.add(check.problem.key)
            return watched(partial(self._solver.solve, *given, guesses, None), limit)
        begin, left = budget.spent(), max(budget.left(), 1e-3)
        call = partial(self._solver.solve, *given, guesses, left)
        found = watched(call, max(budget.wait(), left))
        return [on_time(one, budget.spent() - begin, left) for one in found]


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Solves one instance from the last plan first, then from other starts.

    With ``auto`` these are all of `OTHERS` when the first solve gave no feasible plan, when there
    is no last plan, when something has just come into the way, and when the plan does not get
    past it (less than `STUCK` of the way); as long as it stays there else, ``along`` alone. In
    the way is what the reference enters at the level aimed at, or what makes
    the level give way. With nothing there the problem is the tracking problem, and one start is
    enough.

    The first solve may take all the time there is. The next one begins while as much is left as
    the longest took so far, since not every solver can be stopped. One that does not return in
    time is left behind, and no other start is tried.

    Parameters
    ----------
    watch : calls the solver.
    starts : names, or auto.
    budget : of the call.
    """

    watch: Watch
    starts: Starts
    budget: Budget

    def run(
        self, ladder: Ladder, check: InstanceCheck, first: Guess, obstacle_in_way: bool
    ) -> Outcome:
        """Solve; ``obstacle_in_way`` is what the last outcome said."""
        try:
            return self._run(ladder, check, first, obstacle_in_way)
        except (LeftBehind, Refused) as error:
            message = f"{self.watch.name} {error}"
            return Outcome(
                (), (first,), obstacle_in_way, obstacle_in_way, Status.DEADLINE, message
            )
        except Exception as error:  # a plug-in's solver may fail in any way; the ladder goes on
            message = f"{type(error).__name__}: {error}"
            return Outcome((), (first,), obstacle_in_way, obstacle_in_way, Status.FAILED, message)

    def _run(
        self, ladder: Ladder, check: InstanceCheck, first: Guess, obstacle_in_way: bool
    ) -> Outcome:
        if self.budget.left() <= 0.0:
            message = "no time was left to solve"
            return Outcome(
                (), (first,), obstacle_in_way, obstacle_in_way, Status.DEADLINE, message
            )
        where = np.concatenate([ladder.start, check.parameters.reference.ravel()])
        if not np.abs(where).max() <= FARTHEST:
            message = f"state or reference exceed {FARTHEST:g}: nothing was solved"
            return Outcome((), (first,), obstacle_in_way, obstacle_in_way, Status.FAILED, message)
        reference = ladder.guess(*along(ladder.robot, check.parameters, ladder.dt))
        solutions = self._solve(check, [first])
        candidates = [ladder.assess(check, one) for one in solutions]
        there = _in_the_way(ladder, check, reference, candidates[0])
        names = self._names(ladder, check, candidates[0], there, obstacle_in_way)
        found = other_starts(ladder.robot, check.problem, check.parameters, first, names)
        others = [ladder.suited(check.parameters, guess) for guess in found]
        solutions, note = self._others(check, others, solutions[0].seconds)
        candidates += [ladder.assess(check, one) for one in solutions]
        guesses = (first, *others[: len(solutions)])
        solved = candidates[0].solution
        assert solved is not None
        status, message = solved.status, solved.message
        return Outcome(tuple(candidates), guesses, there, obstacle_in_way, status, message, note)

    def _names(
        self,
        ladder: Ladder,
        check: InstanceCheck,
        first: Candidate,
        there: bool,
        obstacle_in_way: bool,
    ) -> Sequence[str]:
        """Return the starts that this situation asks for."""
        if self.starts != "auto":
            return self.starts
        if first.rung is not Rung.OPTIMAL:
            return OTHERS
        if not there:
            return ()
        anew = ladder.inputs is None or not obstacle_in_way
        return OTHERS if anew or _stuck(ladder, check, first) else ("along",)

    def _others(
        self, check: InstanceCheck, guesses: Sequence[Guess], longest: float
    ) -> tuple[list[Solution], str]:
        """Solve from other starts while there is time; say where that was cut off."""
        solutions: list[Solution] = []
        try:
            if self.budget.deadline is None:
                return (self._solve(check, guesses) if guesses else []), ""
            for guess in guesses:
                if self.budget.left() < longest:
                    break
                solutions += self._solve(check, [guess])
                longest = max(longest, solutions[-1].seconds)
        except (LeftBehind, Refused) as error:
            return solutions, f"from another start {self.watch.name} {error}"
        return solutions, ""

    def _solve(self, check: InstanceCheck, guesses: Sequence[Guess]) -> list[Solution]:
        return self.watch.solve(check, guesses, self.budget)


def _stuck(ladder: Ladder, check: InstanceCheck, solved: Candidate) -> bool:
    """Whether a plan ends where it begins, measured by the way to where its reference ends."""
    begin, end = (
        np.array(ladder.robot.pose(tuple(state)).position, dtype=np.float64)
        for state in (solved.point.states[0], solved.point.states[-1])
    )
    way = np.linalg.norm(check.parameters.reference[-1] - begin)
    return bool(np.linalg.norm(end - begin) < STUCK * way)


def _in_the_way(ladder: Ladder, check: InstanceCheck, reference: Guess, solved: Candidate) -> bool:
    """Whether something stands on the reference, or makes the level give way."""
    parameters = check.parameters
    if not any(one.active.any() for one in parameters.slots):
        return False
    point = ladder.suited(parameters, reference)
    if violation(check.problem, parameters, point).regions.max(initial=0.0) > 0.0:
        return True
    return check.problem.shared and solved.point.level < parameters.target - 1e-3
