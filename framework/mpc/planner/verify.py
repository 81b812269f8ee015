"""Verify a plan without the solver that made it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...values.arrays import Array, all_finite
from ...values.plan import TOLERANCE, Breach, BreachKind, Status
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..slots.base import Touch
from ..solver import Solution
from .instance import Instance
from .rollout import clip, follow
from .starts import suited_each


@dataclass(frozen=True, eq=False)
class Violation:
    """How far a plan breaks its constraints; 0 where it keeps them.

    Attributes
    ----------
    motion : (N,), dynamics, bounds and robot limits, each in its own unit.
    regions : (N, K), how far the region of each slot, kind by kind, is entered at steps 1..N,
        unit-free.
    touch : what is touched on the way to each step, where that was looked at.
    pressed : (N,), how far the rule of contact is broken, see `in_contact`; None where none is
        in contact.
    presses : the name of one of those who are.
    """

    motion: Array
    regions: Array
    touch: Touch | None = None
    pressed: Array | None = None
    presses: str = ""

    @property
    def touched(self) -> Array:
        """How deep the bodies are in things on the way to each step, (N,), m."""
        return np.zeros(len(self.motion)) if self.touch is None else self.touch.depth

    @property
    def leaves(self) -> bool:
        """Whether it keeps the rule of contact."""
        return self.pressed is None or not self.pressed.any()

    @cached_property
    def worst(self) -> float:
        """The largest of all."""
        found = [self.motion, self.regions]
        found += [] if self.touch is None else [self.touch.depth]
        found += [] if self.pressed is None else [self.pressed]
        return float(max(np.maximum.reduce(one, axis=None, initial=0.0) for one in found))

    @property
    def total(self) -> float:
        """Sum over steps of the deepest entry into any region or thing."""
        return float(totals([self])[0])

    def breach(self, names: tuple[str, ...]) -> Breach | None:
        """Name what is broken most; ``names`` are those of all slots, (K,)."""
        if self.pressed is not None and (pressed := self.pressed.max(initial=0.0)) > 0.0:
            step = int(self.pressed.argmax()) + 1
            return Breach(BreachKind.CONTACT, self.presses, step, float(pressed))
        deepest = self.regions.max(initial=0.0)
        touched = self.touched.max(initial=0.0)
        if self.touch is not None and touched > 0.0 and deepest == 0.0:
            step = int(self.touched.argmax())
            return Breach(BreachKind.POLYGON, self.touch.names[step], step + 1, float(touched))
        broken = self.motion.max(initial=0.0)
        if deepest > 0.0 and deepest >= broken:
            step, slot = divmod(int(self.regions.argmax()), self.regions.shape[1])
            name = names[slot] if slot < len(names) else "?"
            return Breach(BreachKind.REGION, name, step + 1, float(deepest))
        if broken > 0.0:
            return Breach(BreachKind.MOTION, "", int(self.motion.argmax()) + 1, float(broken))
        return None

    def where(self, names: tuple[str, ...]) -> str:
        """Describe the worst breach in words."""
        return str(self.breach(names) or "nothing is broken")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A plan that could be taken, with what the re-check says of it.

    Attributes
    ----------
    point, found : the plan, and the re-check.
    solution : what a solver returned, if one made it.
    way : names the manoeuvre where it is one, see `stopping.stops`.
    cost : objective at the point; nan where nothing was priced.
    as_aimed : (N, K), how far it enters regions of the level aimed at; None where that was not
        looked at.
    """

    point: Guess
    found: Violation
    solution: Solution | None = None
    way: str = ""
    cost: float = float("nan")
    as_aimed: Array | None = None

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


def totals(found: Sequence[Violation]) -> Array:
    """`Violation.total` of each of several, of the same problem."""
    deepest = _stacked([one.regions for one in found]).max(axis=2, initial=0.0)
    return np.asarray((deepest + _stacked([one.touched for one in found])).sum(axis=1))


def _stacked(arrays: Sequence[Array]) -> Array:
    """Return what `numpy.stack` does, in a third of its time; a view of one array alone."""
    if len(arrays) == 1:
        return arrays[0][None]
    return np.concatenate(arrays).reshape(len(arrays), *arrays[0].shape)


def verify_each(
    instance: Instance, points: Sequence[Guess], touches: Sequence[Touch | None] = ()
) -> list[Violation]:
    """Evaluate every constraint at several points, what is touched, and the rule of contact.

    ``touches`` are what is touched on the way of each, where that is known already.
    """
    every = violations(instance.problem, instance.parameters, points)
    known = touches or [None] * len(points)
    return [
        _completed(instance, point, found, touch)
        for point, found, touch in zip(points, every, known, strict=True)
    ]


def verify(instance: Instance, point: Guess) -> Violation:
    """Evaluate every constraint at one point."""
    return verify_each(instance, [point])[0]


def _completed(
    instance: Instance, point: Guess, found: Violation, touch: Touch | None
) -> Violation:
    """Add what is touched on the way, and how far the rule of contact is broken."""
    touch = instance.around.touched(point.states) if touch is None else touch
    rule = instance.in_contact
    if rule is None or not all_finite(point.states):
        return Violation(found.motion, found.regions, touch)
    pressed = rule.pressed(instance.robot, point.states, point.inputs)
    return Violation(found.motion, found.regions, touch, pressed, rule.name)


def assess_each(instance: Instance, solutions: Sequence[Solution]) -> list[Candidate]:
    """Verify solutions; those that did not converge are first made drivable."""
    points = [_drivable(instance, one) for one in solutions]
    every = verify_each(instance, points)
    return [
        Candidate(point, found, one, cost=_cost(instance, one, point, found))
        for one, point, found in zip(solutions, points, every, strict=True)
    ]


def _drivable(instance: Instance, solution: Solution) -> Guess:
    point, problem = solution.point, instance.problem
    if problem.shared and point.level < problem.minimum:
        # the last iterate of a solver may lie below the bound
        point = replace(point, level=problem.minimum)
    if solution.status is Status.SOLVED:
        return point
    inputs = clip(instance.robot, point.inputs)
    states = follow(instance.robot, instance.parameters.initial, inputs, problem.dt)
    return suited_each(instance, [replace(point, states=states, inputs=inputs)])[0]


def _cost(instance: Instance, solution: Solution, point: Guess, found: Violation) -> float:
    """Cost of a solution; the solver's is that of its last iterate, not yet drivable."""
    if solution.status is Status.SOLVED or found.worst > TOLERANCE:
        return solution.cost
    return price(instance.problem, instance.parameters, point)


def contact(instance: Instance, one: Candidate, window: int) -> float:
    """Return how deep a plan enters things or their expected places before a stop ends.

    The region of a slot without a level is the thing itself, so that entering it counts as well.
    The window is the steps that braking takes and one more: what lies beyond can still be
    braked for when the next plan is made.
    """
    depth = np.maximum(instance.around.overlap(one.point.states), one.found.touched)
    begun = 0
    for slots in instance.problem.slots:
        if slots.count and not slots.levelled:
            entered = one.found.regions[:, begun : begun + slots.count]
            depth = np.maximum(depth, entered.max(axis=1, initial=0.0))
        begun += slots.count
    return float(depth[:window].max(initial=0.0))


def violation(problem: Problem, parameters: Parameters, point: Guess) -> Violation:
    """Evaluate every constraint of the problem at a point, x_0 included.

    A soft region counts as entered however much slack was paid for it.
    """
    return violations(problem, parameters, [point])[0]


def violations(
    problem: Problem, parameters: Parameters, points: Sequence[Guess]
) -> list[Violation]:
    """Evaluate every constraint of the problem at several points, see `violation`."""
    if not points:
        return []
    motion = _motion(problem, points)
    into_regions = _entered_at(problem, parameters, points)
    for own, point in zip(motion, points, strict=True):
        own[0] = max(own[0], np.maximum.reduce(np.abs(point.states[0] - parameters.initial)))
    if problem.ends_at_rest:
        for own, point in zip(motion, points, strict=True):
            (final,) = problem.stop_values([point.states[-1]])
            own[-1] = max(own[-1], (-final).max(initial=0.0))
    if not (all_finite(motion) and all_finite(into_regions)):
        unknown = ~(np.isfinite(motion).all(axis=1) & np.isfinite(into_regions).all(axis=(1, 2)))
        motion[unknown], into_regions[unknown] = np.inf, 0.0
    return [Violation(*pair) for pair in zip(motion, into_regions, strict=True)]


def entered(
    problem: Problem,
    parameters: Parameters,
    points: Sequence[Guess],
    shares: Sequence[float] | None = None,
) -> Array:
    """How far several points enter each region, (S, N, K), see `Violation.regions`.

    Parameters
    ----------
    problem, parameters : the instance.
    points : S of them, or one for all shares.
    shares : S shares of the slots' levels at which the points are looked at; None for 1. Where
        the level is shared, it is the point's, and they change nothing.
    """
    into_regions = _entered_at(problem, parameters, points, shares)
    if not all_finite(into_regions):  # as in `violations`
        into_regions[~np.isfinite(into_regions).all(axis=(1, 2))] = 0.0
    return into_regions


def at_share(parameters: Parameters, share: float) -> Parameters:
    """Return an instance at a share of the levels of its slots."""
    slots = tuple(
        own if own.level is None else replace(own, level=share * own.level)
        for own in parameters.slots
    )
    return replace(parameters, slots=slots)


def _motion(problem: Problem, points: Sequence[Guess]) -> Array:
    """How far S points break the motion, (S, N)."""
    n, m, steps = problem.states, problem.inputs, problem.horizon
    states = _stacked([point.states for point in points]).transpose(2, 0, 1)
    steps_of = np.empty((2 * n + m, len(points), steps))
    steps_of[:n], steps_of[n + m :] = states[..., :-1], states[..., 1:]
    steps_of[n : n + m] = _stacked([point.inputs for point in points]).transpose(2, 0, 1)
    rows = problem.constraint_values("motion", steps_of, _NONE)
    broken = np.maximum.reduce(np.abs(rows[:n]), axis=0, initial=0.0)
    motion: Array = np.maximum(broken, np.maximum.reduce(-rows[n:], axis=0, initial=0.0))
    return motion


def _entered_at(
    problem: Problem,
    parameters: Parameters,
    points: Sequence[Guess],
    shares: Sequence[float] | None = None,
) -> Array:
    """How far points enter regions, as in `entered`; what is not finite stays."""
    n, steps, shared = problem.states, problem.horizon, problem.shared
    count = len(points) if shares is None else len(shares)
    states = _stacked([point.states[1:] for point in points]).transpose(2, 0, 1)[..., None]
    found: list[Array] = []
    for place, (slots, numbers) in enumerate(zip(problem.slots, parameters.slots, strict=True)):
        if not slots.count:
            continue
        own = slots.own
        given = np.empty((n + own + shared, count, steps, slots.count))
        given[:n] = states
        if own:
            lifted = _stacked([point.auxiliaries[place] for point in points])
            given[n : n + own] = lifted.transpose(3, 0, 1, 2)
        if shared:
            given[n + own] = np.array([point.level for point in points])[:, None, None]
        together, columns = (count, steps * slots.count), numbers.columns
        if shares is not None and numbers.level is not None:
            together, columns = (1, -1), numbers.columns_at(np.asarray(shares))
        rows = problem.constraint_values(
            f"slot{place}", given.reshape(len(given), *together), columns
        )
        rows, tied = rows.reshape(-1, *given.shape[1:]), slots.inequalities
        deep = np.maximum.reduce(-rows[:tied], axis=0, initial=0.0)
        if tied < len(rows):
            deep = np.maximum(deep, np.abs(rows[tied:]).max(axis=0))
        # What an empty slot holds its auxiliaries to says nothing of the plan.
        found.append(deep * numbers.active)
    if len(found) == 1:
        return found[0]
    return np.concatenate(found, axis=2) if found else np.zeros((count, steps, 0))


_NONE = np.zeros((0, 0))


def price(problem: Problem, parameters: Parameters, point: Guess) -> float:
    """Objective at a point that keeps every region, and so needs no slack."""
    none = [np.zeros((problem.horizon, 0))] * len(problem.slots)  # a bare point has no auxiliaries
    lifted = [own.reshape(problem.horizon, -1) for own in point.auxiliaries] or none
    stages = [point.states[:-1], point.inputs, point.states[1:], parameters.stages()]
    total = float(problem.stage_costs([*stages, *lifted])[0].sum())
    if problem.shared:
        total += float(problem.level_cost(point.level, parameters.target))
    return total
