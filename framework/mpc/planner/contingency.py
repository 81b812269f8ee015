"""Plans with two tails: if people make way for the robot, and if they do not.

The forecast of people who react is one Gaussian, wide where they may or may not make way. A plan
with two tails is made for each of the two cases, with one beginning: the robot does now what suits
both, and by the time the beginning is over it will know more. The plan that is handed out, checked
and executed is that for people who keep on; the other tail only draws the beginning towards
what would be good if they made way, by their probability. See `ocp.two_tails`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ...values.arrays import positive
from ...values.forecast import Forecast, Futures
from ...values.plan import Status
from ..fallback.instance_check import InstanceCheck
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..ocp.two_tails import Tails
from ..solvers.base import CheapestSolver, Solution, Solver, solve_cheapest

LEAST_SHARE = 0.05
"""Probability that all of them make way, below which no tail is planned for it."""


@final
@dataclass(frozen=True)
class Contingency:
    """How far a plan is common to the two tails, and for whom there are two.

    Parameters
    ----------
    head : s that the tails have in common.
    matters : m, by which somebody's expected places must differ between the two cases.

    Raises
    ------
    WideberthError : a number that is not above 0; for ``matters`` below 0.
    """

    head: float = 0.6
    matters: float = 0.1

    def __post_init__(self) -> None:
        positive("contingency.head", self.head)
        positive("contingency.matters", self.matters, zero=True)

    def stages(self, dt: float, horizon: int) -> int:
        """Return how many stages of a plan are common, at least 1 and less than all."""
        return max(min(round(self.head / dt), horizon - 1), 1)

    def branch(self, futures: Futures) -> "Branch | None":
        """Say for whom there are two tails; None where nobody matters or all keep on anyway.

        Those whose places differ most come first; as many make way in the first tail as do so
        together with probability `LEAST_SHARE`, each by himself. All others keep on in both.
        """
        rows: list[int] = []
        share, apart = 1.0, futures.difference
        for row in np.argsort(-apart, kind="stable").tolist():
            if apart[row] < self.matters or share * futures.share[row] < LEAST_SHARE:
                break
            rows.append(row)
            share *= float(futures.share[row])
        return Branch(futures.if_all_make_way(rows), share) if rows else None


@dataclass(frozen=True, eq=False)
class Branch:
    """The case in which those who matter make way.

    Attributes
    ----------
    forecast : of all obstacles in this case.
    share : its probability.
    """

    forecast: Forecast
    share: float


@final
class TwoTailed(CheapestSolver):
    """Solves an instance together with another one that has the same beginning.

    For planner and re-check it is a solver of the instance alone: what it returns is the
    instance's own tail, at the cost of both. It lives for one planning cycle.

    Parameters
    ----------
    solver : of the problem of both.
    problem : of both, see `two_tails`.
    other : the other instance. guess : where that is solved from first, beside ``first``.
    first : the guess of the instance that ``guess`` belongs to.
    share, head : as of `Tails`.
    """

    def __init__(
        self,
        solver: Solver,
        problem: Problem,
        other: InstanceCheck,
        guesses: tuple[Guess, Guess],
        share: float,
        head: int,
    ) -> None:
        self._solver, self._problem, self._other = solver, problem, other
        self._first, self._guess = guesses
        self._share, self._head = share, head
        self._whole: dict[int, tuple[Solution, Guess, Solution]] = {}

    @property
    def problem(self) -> Problem:
        """The problem of both."""
        return self._problem

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve both from each guess."""
        tails = self._tails(parameters)
        whole = [self._joined(tails, one) for one in guesses]
        found = self._solver.solve(self._problem, tails.parameters, whole, deadline)
        return [self._cut(tails, one) for one in found]

    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve both, but for starts that lead to no cheaper plan."""
        tails = self._tails(parameters)
        whole = [self._joined(tails, one) for one in guesses]
        before = [self._whole[id(one)][0] for one in known if id(one) in self._whole]
        found = solve_cheapest(
            self._solver, self._problem, tails.parameters, whole, before, within, deadline
        )
        return [self._cut(tails, one) for one in found]

    def tail(self, solution: Solution | None) -> Guess | None:
        """Return the other instance's tail of a solution; None where it is none of these."""
        known = self._whole.get(id(solution))
        return None if known is None or known[0].status is not Status.SOLVED else known[1]

    def _tails(self, parameters: Parameters) -> Tails:
        return Tails(self._problem, self._other.parameters, parameters, self._share, self._head)

    def _joined(self, tails: Tails, guess: Guess) -> Guess:
        """Join a guess with one of the other instance: its own, or the same trajectory."""
        known = np.array_equal(guess.inputs, self._first.inputs)
        other = self._guess if known else self._other.guess(guess.states, guess.inputs)
        return tails.guess(other, guess)

    def _cut(self, tails: Tails, found: Solution) -> Solution:
        first, second = tails.cut(found.point)
        own = replace(found, point=second)
        self._whole[id(own)] = found, first, own  # kept, so that no other gets its place
        return own
