"""Re-check a plan without the solver that made it."""

from collections.abc import Sequence
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
    values = _interpreted if problem.constraint_values is None else _compiled
    motion, entered = values(problem, parameters, points)
    for own, point in zip(motion, points, strict=True):
        begin = np.abs(point.states[0] - parameters.initial).max(initial=0.0)
        own[0] = max(own[0], begin)
        if problem.ends_at_rest:
            (final,) = problem.stop_values([point.states[-1]])
            own[-1] = max(own[-1], (-final).max(initial=0.0))
    found = []
    for moved, into in zip(motion, entered, strict=True):
        if np.isfinite(moved).all() and np.isfinite(into).all():
            found.append(Violation(moved, into))
        else:
            found.append(Violation(np.full(problem.horizon, np.inf), np.zeros(into.shape)))
    return found


def _compiled(
    problem: Problem, parameters: Parameters, points: Sequence[Guess]
) -> tuple[Array, Array]:
    """How far S points break the motion (S, N), and enter regions (S, N, K)."""
    values = problem.constraint_values
    assert values is not None
    n, m, steps, count = problem.states, problem.inputs, problem.horizon, len(points)
    steps_of = np.empty((2 * n + m, count, steps))
    for k, point in enumerate(points):
        states = point.states.T
        steps_of[:n, k], steps_of[n : n + m, k] = states[:, :-1], point.inputs.T
        steps_of[n + m :, k] = states[:, 1:]
    rows = values("motion", steps_of, _NONE)
    broken = np.abs(rows[:n]).max(axis=0, initial=0.0)
    motion = np.maximum(broken, (-rows[n:]).max(axis=0, initial=0.0))
    entered = np.zeros((count, steps, sum(one.count for one in problem.slots)))
    begun = 0
    for place, (slots, numbers) in enumerate(zip(problem.slots, parameters.slots, strict=True)):
        if not slots.count:
            continue
        own = len(slots.auxiliary)
        given = np.empty((n + own + int(problem.shared), count, steps, slots.count))
        given[:n] = steps_of[n + m :, ..., None]
        for k, point in enumerate(points):
            if own:
                given[n : n + own, k] = point.auxiliaries[place].transpose(2, 0, 1)
            given[n + own :, k] = point.level
        flat = given.reshape(len(given), count, -1)
        rows = values(f"slot{place}", flat, numbers.columns).reshape(-1, *given.shape[1:])
        tied = slots.constraint.size1_out(0)
        deep = np.maximum.reduce(-rows[:tied], axis=0, initial=0.0)
        if tied < len(rows):
            deep = np.maximum(deep, np.abs(rows[tied:]).max(axis=0))
        # What an empty slot holds its auxiliaries to says nothing of the plan.
        entered[..., begun : begun + slots.count] = deep * numbers.active
        begun += slots.count
    return motion, entered


_NONE = np.zeros((0, 0))


def _interpreted(
    problem: Problem, parameters: Parameters, points: Sequence[Guess]
) -> tuple[Array, Array]:
    """Evaluate the same as `_compiled` by CasADi's virtual machine."""
    motion = np.empty((len(points), problem.horizon))
    entered = np.empty((*motion.shape, sum(one.count for one in problem.slots)))
    for k, point in enumerate(points):
        gap, limits, room, _, *rows = _evaluated(problem, parameters, point)
        parts = [np.abs(gap), -limits, -room]
        motion[k] = np.concatenate(parts, axis=1).max(axis=1, initial=0.0)
        begun = 0
        pairs = zip(problem.slots, parameters.slots, rows[::2], rows[1::2], strict=True)
        for slots, numbers, outside, tied in pairs:
            if slots.count:
                own = entered[k, :, begun : begun + slots.count]
                own[...] = _entered(outside, tied, slots.count) * numbers.active
                begun += slots.count
    return motion, entered


def price(problem: Problem, parameters: Parameters, point: Guess) -> float:
    """Objective at a point that keeps every region, and so needs no slack."""
    total = float(_evaluated(problem, parameters, point)[3].sum())
    if problem.shared:
        total += float(problem.level_cost(point.level, parameters.target))
    return total


def _evaluated(problem: Problem, parameters: Parameters, point: Guess) -> list[Array]:
    """`Problem.residuals` at a point, each (N, rows)."""
    return problem.residual_values([
        point.states[:-1],
        point.inputs,
        point.states[1:],
        point.level,
        parameters.stages(),
        *_lifted(problem, point),
    ])  # fmt: skip


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
