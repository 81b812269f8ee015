"""Every registered solver keeps the public contract; solvers that break one law do not."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins import registry
from wideberth.framework.testing.laws import Law
from wideberth.framework.testing.solver import check_solver
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.plan import Status
from wideberth.solvers.fatrop import Fatrop

BUILT_IN = [
    pytest.param(law, id=f"{name}: {law.name}")
    for name in registry.names("solvers")
    for law in check_solver.laws(registry.load("solvers", name)())
]


@pytest.mark.parametrize("law", BUILT_IN)
def test_registered_solvers_keep_every_law(law: Law) -> None:
    law.check()


@dataclass(frozen=True)
class Liar(Solver):
    """Fatrop, with one thing broken."""

    broken: str
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        if self.broken == "raises" and not all(np.isfinite(one.states).all() for one in guesses):
            raise ValueError("the guess is not finite")
        if self.broken == "waits":
            deadline = None
        if self.broken == "sees unused slots":
            parameters = used(parameters, np.ones(4))
        if self.broken == "takes the first slots":
            parameters = used(parameters, np.array([1.0, 1.0, 1.0, 0.0]))
        try:
            found = Fatrop().solve(problem, parameters, guesses, deadline)
        except WideberthError:
            if self.broken != "takes anything":
                raise
            return [Solution(one, Status.FAILED, "", 0.0, 0, 0.0) for one in guesses]
        return CHANGES.get(self.broken, lambda _, own: own)(
            problem, self._one_by_one(guesses, found)
        )

    def _one_by_one(self, guesses: Sequence[Guess], found: list[Solution]) -> list[Solution]:
        if self.broken == "keeps the turn":
            turns = [abs(one.states[0, 2]) > np.pi for one in guesses]
            return [moved(one, 2.0 * np.pi * turn) for one, turn in zip(found, turns, strict=True)]
        if self.broken == "scatters":
            return [moved(one, 1e-9 * self.rng.normal()) for one in found]
        return found


def used(parameters: Parameters, slots: np.ndarray) -> Parameters:
    """Take the slots that are 1 for used, or those among them that are."""
    (discs,) = parameters.slots
    active = slots if slots.all() else discs.active * slots
    return replace(parameters, slots=(replace(discs, active=active),))


def moved(solution: Solution, by: float) -> Solution:
    states = solution.point.states.copy()
    states[1:, 2] += by
    return replace(solution, point=replace(solution.point, states=states))


def every(
    change: Callable[[Solution], Solution],
) -> Callable[[Problem, list[Solution]], list[Solution]]:
    return lambda _, found: [change(one) for one in found]


CHANGES: dict[str, Callable[[Problem, list[Solution]], list[Solution]]] = {
    "reverses": lambda _, found: found[::-1],
    "drops the last": lambda _, found: found[:-1] if len(found) > 1 else found,
    "leaves the motion": every(lambda one: moved(one, 1e-3)),
    "is dear": every(lambda one: replace(one, cost=one.cost + 1e4)),
    "counts wrongly": every(lambda one: replace(one, cost=one.cost + 1.0)),
    "is always sure": every(lambda one: replace(one, status=Status.SOLVED)),
    "wants slots": lambda problem, found: (
        found if problem.slots[0].count else [replace(one, status=Status.FAILED) for one in found]
    ),
    "gives slack away": lambda problem, found: [
        replace(one, cost=one.cost - (problem.penalty or 0.0) * slack(one)) for one in found
    ],
    "is afraid of slack": lambda problem, found: (
        found
        if problem.penalty is None
        else [replace(one, status=Status.INFEASIBLE) for one in found]
    ),
    "lowers the level": every(lambda one: replace(one, point=replace(one.point, level=-1.0))),
}  # fmt: skip


def slack(solution: Solution) -> float:
    return float(solution.point.slack.sum())


@pytest.mark.parametrize(
    ("broken", "name"),
    [
        ("reverses", "one solution per guess, in order"),
        ("drops the last", "one solution per guess, in order"),
        ("leaves the motion", "solved keeps every constraint"),
        ("is dear", "no dearer than a feasible guess"),
        ("counts wrongly", "the cost is that of the point"),
        ("scatters", "same input, same bytes"),
        ("waits", "a deadline that has passed is the status"),
        ("raises", "no number makes it raise"),
        ("is always sure", "no number makes it raise"),
        ("is always sure", "regions that nothing keeps are not solved"),
        ("wants slots", "no slots"),
        ("sees unused slots", "unused slots change nothing"),
        ("takes the first slots", "the order of the obstacles changes nothing"),
        ("keeps the turn", "a full turn of the heading changes nothing"),
        ("gives slack away", "soft regions"),
        ("is afraid of slack", "soft regions"),
        ("lowers the level", "the level keeps its bound"),
        ("takes anything", "refuses what does not fit"),
    ],
)
def test_every_law_can_be_broken(broken: str, name: str) -> None:
    (law,) = (one for one in check_solver.laws(Liar(broken)) if one.name == name)
    with pytest.raises(AssertionError) as caught:
        law.check()
    assert "breaks a law" not in str(caught.value)  # `require` and the command line say it


def test_every_law_has_a_solver_that_breaks_it() -> None:
    marks = test_every_law_can_be_broken.pytestmark  # type: ignore[attr-defined]
    broken = {name for _, name in marks[0].args[1]}
    common = {"frozen"}  # of all kinds of values, and tested there
    assert broken | common == {law.name for law in check_solver.laws(Fatrop())}


def test_the_check_names_what_is_broken() -> None:
    check_solver(Liar("nothing"))
    with pytest.raises(AssertionError, match="the cost is that of the point"):
        check_solver(Liar("counts wrongly"))
