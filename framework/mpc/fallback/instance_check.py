"""What plans are held against, and a plan with what the re-check says of it."""

from dataclasses import dataclass, replace

import numpy as np

from ...values.plan import Rung, Status
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..slots.base import Surroundings
from ..solvers.base import Solution
from .verify import Violation, violation

TOLERANCE = 1e-4
"""Largest violation of a plan that counts as feasible (m, m/s or unit-free)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A plan that could be taken, with what the re-check says of it.

    Attributes
    ----------
    point, rung, found : the plan, where it stands, and the re-check.
    solution : what a solver returned, if one made it.
    way : names the manoeuvre where it is one, see `manoeuvres.stops`.
    cost : objective at the point; nan where nothing was priced.
    """

    point: Guess
    rung: Rung
    found: Violation
    solution: Solution | None = None
    way: str = ""
    cost: float = float("nan")

    def __str__(self) -> str:
        """Name the rung, and the manoeuvre."""
        return f"{self.rung} ({self.way})" if self.way else str(self.rung)


@dataclass(frozen=True, eq=False)
class InstanceCheck:
    """What plans are held against: the instance, and all that the bodies could touch."""

    problem: Problem
    parameters: Parameters
    around: Surroundings

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all slots of the problem, "?" where empty."""
        return self.around.names(self.problem)

    def check(self, point: Guess) -> Violation:
        """Evaluate every constraint, and what is touched on the way."""
        found = violation(self.problem, self.parameters, point)
        return replace(found, touch=self.around.touched(point.states))


@dataclass(frozen=True, eq=False)
class Outcome:
    """What solving from one start or several came to.

    Attributes
    ----------
    candidates : the re-checked solutions, that from the last plan first.
    guesses : what was solved from.
    obstacle_in_way : whether something is in the way, see `multistart.MultiStart`.
    before : whether that was so at the last call.
    status, message : of the first solve, or why there was none.
    note : why the solver was not asked from all other starts, where it did not return.
    """

    candidates: tuple[Candidate, ...]
    guesses: tuple[Guess, ...]
    obstacle_in_way: bool
    before: bool
    status: Status
    message: str
    note: str = ""


def contact(check: InstanceCheck, one: Candidate, window: int) -> float:
    """Return how deep a plan enters things or their expected places before a stop ends.

    The region of a slot without a level is the thing itself, so that entering it counts as well.
    The window is the steps that braking takes and one more: what lies beyond can still be
    braked for when the next plan is made.
    """
    certain = np.repeat(
        [not slots.levelled for slots in check.problem.slots],
        [slots.count for slots in check.problem.slots],
    )
    entered = one.found.regions[:, certain].max(axis=1, initial=0.0)
    depth = np.maximum(check.around.overlap(one.point.states), one.found.touched)
    return float(np.maximum(depth, entered)[:window].max(initial=0.0))
