"""Re-check a plan without the solver that made it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...values.arrays import Array
from ...values.plan import Breach, BreachKind
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess
from ..slots.contact import Touch


@dataclass(frozen=True, eq=False)
class Violation:
    """How far a plan breaks its constraints; 0 where it keeps them.

    Attributes
    ----------
    motion : (N,), dynamics, bounds and robot limits, each in its own unit.
    regions : (N, K), how far the region of each slot, kind by kind, is entered at steps 1..N,
        unit-free.
    touch : what is touched on the way to each step, where that was looked at.
    """

    motion: Array
    regions: Array
    touch: Touch | None = None

    @property
    def touched(self) -> Array:
        """How deep the bodies are in things on the way to each step, (N,), m."""
        return np.zeros(len(self.motion)) if self.touch is None else self.touch.depth

    @cached_property
    def worst(self) -> float:
        """The largest of all."""
        found = [self.motion, self.regions] + [self.touched] * (self.touch is not None)
        return float(max(values.max(initial=0.0) for values in found))

    @property
    def total(self) -> float:
        """Sum over steps of the deepest entry into any region or thing."""
        return float((self.regions.max(axis=1, initial=0.0) + self.touched).sum())

    def breach(self, names: tuple[str, ...]) -> Breach | None:
        """Name what is broken most; ``names`` are those of all slots, (K,)."""
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
        """Name it in words."""
        return str(self.breach(names) or "nothing is broken")


MOST_AT_ONCE = 8
"""Plans that are evaluated in one call: its arrays stay, for each number of plans."""


def violation(problem: Problem, parameters: Parameters, point: Guess) -> Violation:
    """Evaluate every constraint of the problem at a point, x_0 included.

    A soft region counts as entered however much slack was paid for it.
    """
    return violations(problem, parameters, [point])[0]


def violations(
    problem: Problem, parameters: Parameters, points: Sequence[Guess]
) -> list[Violation]:
    """Evaluate every constraint of the problem at several points, see `violation`."""
    return [
        found
        for first in range(0, len(points), MOST_AT_ONCE)
        for found in _violations(problem, parameters, points[first : first + MOST_AT_ONCE])
    ]


def _violations(
    problem: Problem, parameters: Parameters, points: Sequence[Guess]
) -> Iterator[Violation]:
    gap, limits, room, _, *rows = _evaluated(problem, parameters, points)
    motion = np.concatenate([np.abs(gap), -limits, -room], axis=1).max(axis=1, initial=0.0)
    motion = motion.reshape(len(points), problem.horizon)
    for own, point in zip(motion, points, strict=True):
        begin = np.abs(point.states[0] - parameters.initial).max(initial=0.0)
        own[0] = max(own[0], begin)
        if problem.ends_at_rest:
            (final,) = problem.stop_values([point.states[-1]])
            own[-1] = max(own[-1], (-final).max(initial=0.0))
    entered = np.zeros((len(gap), sum(one.count for one in problem.slots)))
    begun = 0
    pairs = zip(problem.slots, parameters.slots, rows[::2], rows[1::2], strict=True)
    for slots, numbers, outside, tied in pairs:
        if slots.count:
            # What an empty slot holds its auxiliaries to says nothing of the plan.
            own = entered[:, begun : begun + slots.count]
            own[...] = _entered(outside, tied, slots.count) * numbers.active
            begun += slots.count
    for moved, into in zip(motion, np.split(entered, len(points)), strict=True):
        if np.isfinite(moved).all() and np.isfinite(into).all():
            yield Violation(moved, into)
        else:
            yield Violation(np.full(problem.horizon, np.inf), np.zeros(into.shape))


def price(problem: Problem, parameters: Parameters, point: Guess) -> float:
    """Objective at a point that keeps every region, and so needs no slack."""
    total = float(_evaluated(problem, parameters, [point])[3].sum())
    if problem.shared:
        total += float(problem.level_cost(point.level, parameters.target))
    return total


def _evaluated(problem: Problem, parameters: Parameters, points: Sequence[Guess]) -> list[Array]:
    """`Problem.residuals` at S points, each (S N, rows)."""
    stages = parameters.stages()
    columns = [
        [
            point.states[:-1],
            point.inputs,
            point.states[1:],
            np.full((problem.horizon, 1), point.level),
            stages,
            *_lifted(problem, point),
        ]
        for point in points
    ]
    together = columns[0] if len(points) == 1 else map(np.concatenate, zip(*columns, strict=True))
    return problem.residual_values(len(points))(list(together))


def _lifted(problem: Problem, point: Guess) -> list[Array]:
    """Auxiliaries of each kind, (N, K A); a bare point has none."""
    if not point.auxiliaries:
        return [np.zeros((problem.horizon, 0))] * len(problem.slots)
    return [own.reshape(problem.horizon, -1) for own in point.auxiliaries]


def _entered(outside: Array, tied: Array, slots: int) -> Array:
    """How far each slot's constraints are broken, (N, slots)."""
    entered = _per_slot(-outside, slots)
    return np.maximum(entered, _per_slot(np.abs(tied), slots)) if tied.size else entered


def _per_slot(values: Array, slots: int) -> Array:
    """Largest of each slot's rows, at least 0: (N, slots * rows) -> (N, slots)."""
    found = values.reshape(len(values), slots, values.shape[1] // slots)
    return np.asarray(found.max(axis=2, initial=0.0))
