"""Solving from several starting points, where it is worth it and there is time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...values.arrays import FARTHEST, altered
from ...values.failures import caught
from ...values.plan import Status
from ..ocp.transcription import Guess
from ..solver import Solution, enters, pressed
from .instance import Instance
from .starts import OTHERS, ReferenceGuess, Starts, faces_away, other_starts, suited_each
from .verify import Candidate, assess_each, entered
from .watchdog import Budget, SolverRefused, SolverTimeout, WatchedSolver

STUCK = 0.1
"""Share of its way that a plan has to come along not to be stuck. Between two people who stand, a
plan that waits is optimal among those near it, and stays so for ever."""

DEEP = 0.5
"""Share of what a level may give way from which on every start is tried again. In `blind_corner`
two of 20 episodes ended in a contact after ten decisions at the lowest level, from the last plan
and ``along`` alone, where ``back-right`` led to plans cheaper by 6 to 23 %."""


@dataclass(frozen=True, eq=False)
class MultiStartResult:
    """What solving from one start or several came to.

    Attributes
    ----------
    candidates : the verified solutions, that from the last plan first; without those given up.
    guesses : what was solved from.
    obstacle_in_way : whether something is in the way, see `MultiStart`.
    before : whether that was so at the last call.
    status, message : of the first solve, or why there was none.
    note : why the solver was not asked from all other starts, where it did not return.
    solutions : what the solver returned from each guess, those given up too.
    """

    candidates: tuple[Candidate, ...]
    guesses: tuple[Guess, ...]
    obstacle_in_way: bool
    before: bool
    status: Status
    message: str
    note: str = ""
    solutions: tuple[Solution, ...] = ()

    @property
    def converged(self) -> list[Solution]:
        """The solutions that converged, and keep every constraint by the verification."""
        return [one.solution for one in self.candidates if one.solution and one.optimal]


class FurtherStarts(NamedTuple):
    """What solving from other starts than the last plan came to, and why it was cut off."""

    candidates: Sequence[Candidate]
    guesses: Sequence[Guess]
    solutions: Sequence[Solution]
    note: str


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Solves one instance from the last plan first, then from other starts.

    A `CheapestSolver` gives those up that lead to no cheaper plan than is known. A plan
    that enters regions counts as known, where they have no variables of their own; no start is too
    dear because of it. A plan that fails the re-check for another reason does not count: what was
    given up because of it is then solved.

    With ``auto`` these are all of `OTHERS` when the first solve gave no feasible plan, when there
    is no last plan, when something has just come into the way, when the plan does not get
    past it (less than `STUCK` of the way), and when its level gives way far (by `DEEP`); as long
    as it stays there else, ``along`` alone. In the way is what the reference enters at the level
    aimed at, or what makes the level give way. With nothing there, or where no region presses on
    the plan, the problem is the tracking problem, and one start is enough. Before a robot that
    faces away from its reference, see `faces_away`, there is ``turn`` as well.

    The first solve may take all the time there is. The next one begins while as much is left as
    the longest took so far, since not every solver can be stopped. One that does not return in
    time is left behind, and no other start is tried.

    Parameters
    ----------
    watch : calls the solver.
    starts : names, or auto.
    budget : of the call.
    """

    watch: WatchedSolver
    starts: Starts
    budget: Budget

    def run(self, instance: Instance, first: Guess, obstacle_in_way: bool) -> MultiStartResult:
        """Solve; ``obstacle_in_way`` is what the last outcome said."""
        try:
            return self._run(instance, first, obstacle_in_way)
        except (SolverTimeout, SolverRefused) as error:
            status, message = Status.DEADLINE, f"{self.watch.name} {error}"
        except Exception as error:  # a plug-in's solver may fail in any way; the ladder goes on
            status, message = Status.FAILED, caught(error)
        return MultiStartResult((), (first,), obstacle_in_way, obstacle_in_way, status, message)

    def _run(self, instance: Instance, first: Guess, before: bool) -> MultiStartResult:
        parameters = instance.parameters
        if self.budget.left() <= 0.0:
            message = "no time was left to solve"
            return MultiStartResult((), (first,), before, before, Status.DEADLINE, message)
        places = parameters.initial, parameters.reference
        if not all(np.abs(one).max() <= FARTHEST for one in places):
            message = f"state or reference exceed {FARTHEST:g}: nothing was solved"
            return MultiStartResult((), (first,), before, before, Status.FAILED, message)
        (solved,) = self.watch.solve(instance, [first], self.budget)
        (candidate,) = assess_each(instance, [solved])
        laid = None
        if any(one.active.any() for one in parameters.slots):
            laid = ReferenceGuess.along(instance.robot, parameters, instance.problem.dt)
        there, candidate = _in_the_way(instance, candidate, laid)
        names = self._names(instance, candidate, there, before)
        further = FurtherStarts((), (), (), "")
        if names:
            further = self._further(instance, first, candidate, names, laid)
        return MultiStartResult(
            (candidate, *further.candidates), (first, *further.guesses), there, before,
            solved.status, solved.message, further.note, (solved, *further.solutions),
        )  # fmt: skip

    def _further(
        self,
        instance: Instance,
        first: Guess,
        candidate: Candidate,
        names: Sequence[str],
        laid: ReferenceGuess | None,
    ) -> FurtherStarts:
        """Solve from starts of some names."""
        solved = candidate.solution
        assert solved is not None
        aimed = replace(first, level=instance.target)  # a warm start is at the last plan's level
        given = instance.robot, instance.problem, instance.parameters
        others = suited_each(instance, other_starts(*given, aimed, names, laid))
        known: list[Solution] | None = [solved] if candidate.optimal else []
        if _refuted(candidate):  # those of other starts will be as well
            known = [solved] if _enters(instance, candidate) else None
        more, note = self._others(instance, others, known, solved.seconds)
        assessed = _assessed(instance, more)
        if any(_refuted(one) and not _enters(instance, one) for one in assessed):
            # others may be given up because of it
            dropped = [k for k, one in enumerate(more) if one.status is Status.GIVEN_UP]
            again, why = self._others(instance, [others[k] for k in dropped], None, 0.0)
            for k, one in zip(dropped, again, strict=False):
                more[k] = replace(one, iterations=one.iterations + more[k].iterations)
            assessed, note = _assessed(instance, more), note or why
        return FurtherStarts(assessed, others[: len(more)], more, note)

    def _names(
        self, instance: Instance, first: Candidate, there: bool, before: bool
    ) -> Sequence[str]:
        """Return the starts that this situation asks for."""
        if self.starts != "auto":
            return self.starts
        found = self._past(instance, first, there, before)
        return (*found, "turn") if faces_away(instance.robot, instance.parameters) else found

    def _past(
        self, instance: Instance, first: Candidate, there: bool, before: bool
    ) -> Sequence[str]:
        """Return the starts that ``auto`` tries for what is in the way."""
        if not first.optimal:
            return OTHERS
        if not there or (first.solution is not None and not pressed(first.solution)):
            return ()
        anew = instance.last_inputs is None or not before
        every = anew or _stuck(instance, first) or _gives_way_far(instance, first)
        return OTHERS if every else ("along",)

    def _others(
        self,
        instance: Instance,
        guesses: Sequence[Guess],
        known: Sequence[Solution] | None,
        longest: float,
    ) -> tuple[list[Solution], str]:
        """Solve from other starts while there is time; say where that was cut off.

        Those that lead to no cheaper plan than ``known``, or than one another, are given up; with
        None they are not.
        """
        solutions: list[Solution] = []
        try:
            if self.budget.deadline is None:
                return (self._solve(instance, guesses, known) if guesses else []), ""
            for guess in guesses:
                if self.budget.left() < longest:
                    break
                so_far = None if known is None else [*known, *solutions]
                solutions += self._solve(instance, [guess], so_far)
                longest = max(longest, solutions[-1].seconds)
        except (SolverTimeout, SolverRefused) as error:
            return solutions, f"from another start {self.watch.name} {error}"
        return solutions, ""

    def _solve(
        self, instance: Instance, guesses: Sequence[Guess], known: Sequence[Solution] | None
    ) -> list[Solution]:
        if known is None:
            return self.watch.solve(instance, guesses, self.budget)
        return self.watch.solve_cheapest(instance, guesses, known, self.budget)


def _assessed(instance: Instance, solutions: Sequence[Solution]) -> list[Candidate]:
    """Verify what was not given up."""
    return assess_each(instance, [one for one in solutions if one.status is not Status.GIVEN_UP])


def _refuted(one: Candidate) -> bool:
    """Whether a solver calls a plan solved that does not pass the re-check."""
    assert one.solution is not None
    return one.solution.status is Status.SOLVED and not one.feasible


def _enters(instance: Instance, one: Candidate) -> bool:
    """Whether a plan enters regions, so that no start which leads near it has to be solved.

    With auxiliaries that is not known: other ones at nearly the same states may keep all regions.
    In `blind_corner` (outline, seed 1) a robot was touched where starts were given up near such a
    plan.
    """
    own = one.solution
    return own is not None and enters(own) and bool(instance.problem.no_auxiliaries)


def _stuck(instance: Instance, solved: Candidate) -> bool:
    """Whether a plan ends where it begins, measured by the way to where its reference ends."""
    begin, end = (
        np.array(instance.robot.pose(tuple(state)).position, dtype=np.float64)
        for state in (solved.point.states[0], solved.point.states[-1])
    )
    way = np.linalg.norm(instance.parameters.reference[-1] - begin)
    return bool(np.linalg.norm(end - begin) < STUCK * way)


def _gives_way_far(instance: Instance, solved: Candidate) -> bool:
    """Whether a plan holds less than half of what lies between lowest level and level asked."""
    if not instance.problem.shared:
        return False
    asked, lowest = instance.parameters.target, max(instance.problem.minimum, 0.0)
    return bool(asked - solved.point.level > DEEP * (asked - lowest) > 0.0)


def _in_the_way(
    instance: Instance, solved: Candidate, laid: ReferenceGuess | None
) -> tuple[bool, Candidate]:
    """Whether something stands on the reference, or makes the level give way.

    A plan of a shared level is looked at on the level aimed at too, and returned with what it
    enters there. ``laid`` are states on the reference; None where there is nothing to stand in
    the way.
    """
    parameters, problem = instance.parameters, instance.problem
    if laid is None:
        return False, solved
    bare = Guess.bare(laid.states, np.zeros((problem.horizon, problem.inputs)), instance.target)
    own = solved.point
    aimed = Guess(own.states, own.inputs, own.auxiliaries, parameters.target, own.slack)
    points = [bare, aimed] if problem.shared else [bare]
    into_regions = entered(problem, parameters, suited_each(instance, points))
    if problem.shared:
        solved = altered(solved, as_aimed=into_regions[1])
    if into_regions[0].max(initial=0.0) > 0.0:
        return True, solved
    return problem.shared and solved.point.level < parameters.target - 1e-3, solved
