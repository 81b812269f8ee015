"""An instance of the problem with all that a plan is checked against."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.plan import Status
from ..levels.base import LevelPolicy, SharedLevel
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..slots.base import ActiveObstacles, SlotKind, level_at_first, with_auxiliaries_each
from ..slots.contact import Touch
from ..solver import Solution
from .in_contact import InContact
from .rollout import clip, follow
from .verify import Violation, price, violations

TOLERANCE = 1e-4
"""Largest violation of a plan that counts as feasible (m, m/s or unit-free)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A plan that could be taken, with what the re-check says of it.

    Attributes
    ----------
    point, found : the plan, and the re-check.
    solution : what a solver returned, if one made it.
    way : names the manoeuvre where it is one, see `stopping.stops`.
    cost : objective at the point; nan where nothing was priced.
    """

    point: Guess
    found: Violation
    solution: Solution | None = None
    way: str = ""
    cost: float = float("nan")

    @property
    def feasible(self) -> bool:
        """Whether it keeps every constraint."""
        return self.found.worst <= TOLERANCE

    @property
    def optimal(self) -> bool:
        """Whether it is feasible and its solver converged."""
        solved = self.solution is not None and self.solution.status is Status.SOLVED
        return solved and self.feasible

    def named(self, rung: str) -> str:
        """Name the rung it is taken on, and the manoeuvre."""
        return f"{rung} ({self.way})" if self.way else str(rung)


@dataclass(frozen=True, eq=False)
class InstanceCheck:
    """An instance of the problem, as plans are held against it.

    Attributes
    ----------
    problem, parameters : the instance.
    around : all that the bodies could touch.
    level : the policy that the levels come from.
    last_inputs : (N, m), inputs of the last plan from now on; None without one.
    in_contact : who is in contact as plans begin; None for none.
    """

    problem: Problem
    parameters: Parameters
    around: ActiveObstacles
    level: LevelPolicy
    last_inputs: Array | None = None
    in_contact: InContact | None = None

    @property
    def robot(self) -> Robot:
        """The robot of the problem."""
        return self.around.robot

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all slots of the problem, "?" where empty."""
        return self.around.names(self.problem)

    @property
    def note(self) -> str:
        """Who is in contact, in words; "" for none."""
        return "" if self.in_contact is None else str(self.in_contact)

    def guess(self, states: Array, inputs: Array) -> Guess:
        """Wrap a trajectory at the level aimed at, with the auxiliaries that suit it best."""
        target = shared_target(self.around.kinds, self.level, self.robot.dimension)
        return self.suited(Guess.bare(states, inputs, target))

    def suited(self, guess: Guess) -> Guess:
        """Fill in the auxiliaries that suit the guess's poses best."""
        return self.suited_each([guess])[0]

    def suited_each(self, guesses: Sequence[Guess]) -> list[Guess]:
        """Fill in those of several guesses, see `suited`."""
        none = self.problem.no_auxiliaries
        if none:
            return [
                Guess(one.states, one.inputs, none, one.level, one.slack, one.multipliers)
                for one in guesses
            ]
        return with_auxiliaries_each(self.robot, self.around.kinds, self.parameters, guesses)

    def check(self, point: Guess) -> Violation:
        """Evaluate every constraint, and what is touched on the way."""
        return self.check_each([point])[0]

    def check_each(
        self, points: Sequence[Guess], touches: Sequence[Touch | None] = ()
    ) -> list[Violation]:
        """Evaluate every constraint at several points, see `check`.

        ``touches`` are what is touched on the way of each, where that is known already.
        """
        every = violations(self.problem, self.parameters, points)
        looked = [
            self.around.touched(point.states) if touch is None else touch
            for point, touch in zip(points, touches or [None] * len(points), strict=True)
        ]
        found = [
            Violation(one.motion, one.regions, touch)
            for one, touch in zip(every, looked, strict=True)
        ]
        if self.in_contact is None:
            return found
        return [self._pressing(*pair) for pair in zip(points, found, strict=True)]

    def _pressing(self, point: Guess, found: Violation) -> Violation:
        """Hold a plan against the rule of contact as well."""
        rule = self.in_contact
        if rule is None or not np.isfinite(point.states).all():
            return found
        pressed = rule.pressed(self.robot, point.states, point.inputs)
        return replace(found, pressed=pressed, presses=rule.name)

    def assess_each(self, solutions: Sequence[Solution]) -> list[Candidate]:
        """Re-check solutions; those that did not converge are first made drivable."""
        points = [self._drivable(one) for one in solutions]
        every = self.check_each(points)
        return [
            Candidate(point, found, one, cost=self._cost(one, point, found))
            for one, point, found in zip(solutions, points, every, strict=True)
        ]

    def _drivable(self, solution: Solution) -> Guess:
        point = solution.point
        if self.problem.shared:  # the last iterate of a solver may lie below the bound
            point = replace(point, level=max(point.level, self.problem.minimum))
        if solution.status is Status.SOLVED:
            return point
        inputs = clip(self.robot, point.inputs)
        states = follow(self.robot, self.parameters.initial, inputs, self.problem.dt)
        return self.suited(replace(point, states=states, inputs=inputs))

    def _cost(self, solution: Solution, point: Guess, found: Violation) -> float:
        """Cost of a solution; the solver's is that of its last iterate, not yet drivable."""
        if solution.status is Status.SOLVED or found.worst > TOLERANCE:
            return solution.cost
        return price(self.problem, self.parameters, point)


@dataclass(frozen=True, eq=False)
class MultiStartResult:
    """What solving from one start or several came to.

    Attributes
    ----------
    candidates : the re-checked solutions, that from the last plan first; without those given up.
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
        """The solutions that converged, and keep every constraint by the re-check."""
        return [one.solution for one in self.candidates if one.solution and one.optimal]


def contact(check: InstanceCheck, one: Candidate, window: int) -> float:
    """Return how deep a plan enters things or their expected places before a stop ends.

    The region of a slot without a level is the thing itself, so that entering it counts as well.
    The window is the steps that braking takes and one more: what lies beyond can still be
    braked for when the next plan is made.
    """
    depth = np.maximum(check.around.overlap(one.point.states), one.found.touched)
    begun = 0
    for slots in check.problem.slots:
        if slots.count and not slots.levelled:
            entered = one.found.regions[:, begun : begun + slots.count]
            depth = np.maximum(depth, entered.max(axis=1, initial=0.0))
        begun += slots.count
    return float(depth[:window].max(initial=0.0))


def shared_target(kinds: Iterable[SlotKind], level: LevelPolicy, dimension: int) -> float:
    """Return s_ref, the level that a shared level is drawn to; nan where none is shared."""
    if not isinstance(level, SharedLevel):
        return float("nan")
    return level_at_first(kinds, level, dimension)
