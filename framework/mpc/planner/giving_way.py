"""Levels that a plan keeps: how much less than asked, from which step on, for which thing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import accumulate
from typing import final

import numpy as np

from ...values.arrays import Array
from ...values.plan import TOLERANCE, GivenWay
from ..ocp.transcription import Guess
from ..slots.base import LevelledKind
from .instance import Instance
from .starts import suited_each
from .verify import Candidate, at_share, entered

_HALVINGS = 12
"""Of the interval in which the level held lies: to 1/4096 of the level asked for."""
_AT_ONCE = 3
"""Halvings that are looked at together, whichever way they go: seven shares in one compiled call
take less time than three calls. It divides `_HALVINGS`."""


@final
@dataclass(frozen=True, eq=False)
class PlanLevels:
    """What a plan says of levels: of all used slots with one, and of what needs no slot.

    Attributes
    ----------
    ids : names of O things.
    level, target, content : (N, O), held, aimed at, and the content that is held.
    auxiliaries : (N, O, A), nan where a thing has fewer than A.
    given_way : None where everything is kept as aimed at.
    """

    ids: tuple[str, ...]
    level: Array
    target: Array
    content: Array
    auxiliaries: Array
    given_way: GivenWay | None

    @classmethod
    def of(cls, instance: Instance, best: Candidate, *, optimal: bool) -> "PlanLevels":
        """Compute levels, contents and auxiliaries of a plan."""
        target, around = target_levels(instance), instance.around
        level, given_way = achieved_levels(instance, best, target, optimal=optimal)
        size, begun = instance.robot.dimension, 0
        ids: tuple[str, ...] = ()
        contents: list[Array] = []
        for kind, _, names in around.levelled:
            if names:
                own = level[:, begun : begun + len(names)]
                contents.append(_contents(kind, own, size))
                begun, ids = begun + len(names), ids + names
        content = _side_by_side(contents, len(level))
        auxiliaries = _auxiliaries(instance, best.point)
        if not around.out_of_reach:
            return cls(ids, level, target, content, auxiliaries, given_way)
        parts = [(level, target, content, auxiliaries)]
        for kind, beyond in around.out_of_reach:
            # The level aimed at is kept, whatever the plan; a shared level is that of the slots.
            kept = beyond.level
            if instance.problem.shared and level.size:
                kept = np.broadcast_to(level[:, :1], kept.shape)
            none = np.full((*kept.shape, auxiliaries.shape[2]), np.nan)
            parts.append((kept, beyond.level, _contents(kind, kept, size), none))
            ids += beyond.names
        all_levels, targets, content, auxiliaries = (
            np.concatenate(some, axis=1) for some in zip(*parts, strict=True)
        )
        return cls(ids, all_levels, targets, content, auxiliaries, given_way)


def achieved_levels(
    instance: Instance, best: Candidate, target: Array, *, optimal: bool
) -> tuple[Array, GivenWay | None]:
    """Return the level at which a plan keeps each constraint, and how it gave way, if it did.

    A plan gave way if it enters a region of the level aimed at, by more than `TOLERANCE`: less
    than that is what every plan is allowed. The solver knows the level of an optimal plan whose
    level is shared. For all others, those that were held against the lowest level and those that
    enter a region, it is the largest share of the levels aimed at, the same for all, at which no
    region is entered, found by bisection.

    Parameters
    ----------
    instance : what plans are verified against.
    best : the plan taken.
    target : (N, O), `target_levels`.
    optimal : whether it is that of a solver that converged.

    Returns
    -------
    level : (N, O). given_way : None where everything is kept as aimed at.
    """
    if not target.size:
        return target, None
    broken = _as_aimed(instance, best)
    if broken.max() <= TOLERANCE:
        return target, None
    shared = instance.problem.shared
    if shared and optimal:
        lower, worst, kept = np.full_like(target, best.point.level), broken, True
    else:
        share, worst, kept = _largest(instance, best, broken)
        lower = share * target
    level = np.where(shared | (broken > TOLERANCE), lower, target)
    step, slot = divmod(int(worst.argmax()), worst.shape[1])
    policy, size = instance.level, instance.robot.dimension
    kind, name = [(kind, name) for kind, _, names in instance.around.levelled for name in names][
        slot
    ]
    tails = [
        kind.tail(float(value), policy.promise, size)
        for value in (target[step, slot], level[step, slot])
    ]
    first = int((broken[:, slot] > TOLERANCE).argmax()) + 1
    return level, GivenWay(tails[0], tails[1] if kept else 1.0, policy.promise, first, name)


def target_levels(instance: Instance) -> Array:
    """Levels aimed at, of all used slots that have one, (N, O)."""
    found = [
        level[:, : len(names)]
        for _, k, names in instance.around.levelled
        if (level := instance.parameters.slots[k].level) is not None
    ]
    return _side_by_side(found, instance.problem.horizon)


def _side_by_side(columns: Sequence[Array], steps: int) -> Array:
    """Put columns (N, ...) beside each other."""
    some = [one for one in columns if one.shape[1]]
    return some[0] if len(some) == 1 else np.concatenate([np.zeros((steps, 0)), *some], axis=1)


def _largest(instance: Instance, best: Candidate, broken: Array) -> tuple[float, Array, bool]:
    """Return the largest share that is kept, what is entered just above it, and whether any is."""
    (at_least,) = _entered(instance, best, (0.0,))
    if at_least.max() > TOLERANCE:
        return 0.0, at_least, False
    # Auxiliaries have to be made for each share where they depend on the level.
    together = _AT_ONCE if instance.problem.levels_alone else 1
    low, wide, above = 0.0, 1.0, broken
    for _ in range(_HALVINGS // together):
        parts = 2**together
        wide /= parts
        found = _entered(instance, best, [low + wide * k for k in range(1, parts)])
        first, last = 0, parts
        while last - first > 1:
            middle = (first + last) // 2
            if found[middle - 1].max() > TOLERANCE:
                last, above = middle, found[middle - 1]
            else:
                first = middle
        low += wide * first
    return low, above, True


def _as_aimed(instance: Instance, best: Candidate) -> Array:
    """How far each region is entered at the levels aimed at, (N, O)."""
    if not instance.problem.shared and instance.problem.levels_alone:
        return _levelled(instance, best.found.regions)  # the re-check asked the same
    if best.as_aimed is not None:
        return _levelled(instance, best.as_aimed)
    return np.asarray(_entered(instance, best, (1.0,))[0])


def _entered(instance: Instance, best: Candidate, shares: Sequence[float]) -> Array:
    """How far each region is entered at S shares of the levels aimed at, (S, N, O)."""
    problem, parameters, point = instance.problem, instance.parameters, best.point
    if problem.shared:
        levels = [share * parameters.target for share in shares]
        points = suited_each(instance, [replace(point, level=level) for level in levels])
    elif problem.levels_alone:
        points = [point]
    else:
        lower = [replace(instance, parameters=at_share(parameters, share)) for share in shares]
        points = [suited_each(one, [point])[0] for one in lower]
    return _levelled(instance, entered(problem, parameters, points, shares))


def _levelled(instance: Instance, values: Array) -> Array:
    """Of values of all slots (..., K) take those of used slots with a level, (..., O)."""
    first = [0, *accumulate(slots.count for slots in instance.problem.slots)]
    found = [
        values[..., first[k] : first[k] + len(names)]
        for _, k, names in instance.around.levelled
        if names
    ]
    return found[0] if len(found) == 1 else np.concatenate([values[..., :0], *found], axis=-1)


def _contents(kind: LevelledKind, level: Array, dimension: int) -> Array:
    """Content that each level stands for; 0 for the paper's unbounded level below 0."""
    first = float(level[0, 0]) if level.size else 0.0
    if (level == first).all():
        return np.full(level.shape, _content(kind, first, dimension))
    different, which = np.unique(level, return_inverse=True)
    found = np.array([_content(kind, value, dimension) for value in different.tolist()])
    return found[which].reshape(level.shape)


def _content(kind: LevelledKind, level: float, dimension: int) -> float:
    if not level > 0.0:
        return 0.0
    try:
        return _known_content(kind, level, dimension)
    except TypeError:  # a third party's region may not be hashable
        return _content_of(kind, level, dimension)


def _content_of(kind: LevelledKind, level: float, dimension: int) -> float:
    return 1.0 - kind.tail(level, "content", dimension)


_known_content = lru_cache(maxsize=256)(_content_of)
"""Plans that keep the levels aimed at ask for the same at every decision."""


def _auxiliaries(instance: Instance, point: Guess) -> Array:
    """Auxiliaries of all used slots with a level, (N, O, A); nan where one has fewer than A."""
    own = [
        point.auxiliaries[k][:, : len(names)] for _, k, names in instance.around.levelled if names
    ]
    if len(own) == 1:
        return own[0]
    wide = max((one.shape[2] for one in own), default=0)
    count = sum(one.shape[1] for one in own)
    found, begun = np.full((instance.problem.horizon, count, wide), np.nan), 0
    for one in own:
        found[:, begun : begun + one.shape[1], : one.shape[2]] = one
        begun += one.shape[1]
    return found
