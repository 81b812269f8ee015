"""Levels that a plan keeps: how much less than asked, from which step on, for which thing."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import accumulate

import numpy as np

from ...values.arrays import Array
from ...values.plan import GivenWay
from ..ocp.transcription import Guess
from ..slots.base import LevelledKind
from .instance_check import TOLERANCE, Candidate, InstanceCheck
from .verify import at_share, entered

_HALVINGS = 12
"""Of the interval in which the level held lies: to 1/4096 of the level asked for."""
_AT_ONCE = 3
"""Halvings that are looked at together, whichever way they go: seven shares in one compiled call
take less time than three calls. It divides `_HALVINGS`."""


def held(check: InstanceCheck, best: Candidate, *, optimal: bool) -> tuple[Array, GivenWay | None]:
    """Return the level at which a plan keeps each constraint, and how it gave way, if it did.

    A plan gave way if it enters a region of the level aimed at, by more than `TOLERANCE`: less
    than that is what every plan is allowed. The solver knows the level of an optimal plan whose
    level is shared. For all others, those that were held against the lowest level and those that
    enter a region, it is the largest share of the levels aimed at, the same for all, at which no
    region is entered, found by bisection.

    Parameters
    ----------
    check : what plans are held against.
    best : the plan taken.
    optimal : whether it is that of a solver that converged.

    Returns
    -------
    level : (N, O). given_way : None where everything is kept as aimed at.
    """
    places = check.around.levelled
    asked = aimed(check)
    if not asked.size:
        return asked, None
    broken = _as_aimed(check, best)
    if broken.max() <= TOLERANCE:
        return asked, None
    shared = check.problem.shared
    if shared and optimal:
        lower, worst, kept = np.full_like(asked, best.point.level), broken, True
    else:
        share, worst, kept = _largest(check, best, broken)
        lower = share * asked
    level = np.where(shared | (broken > TOLERANCE), lower, asked)
    step, slot = divmod(int(worst.argmax()), worst.shape[1])
    policy, size = check.level, check.robot.dimension
    kind, _, _, name = places[slot]
    tails = [
        kind.tail(float(value), policy.promise, size)
        for value in (asked[step, slot], level[step, slot])
    ]
    first = int((broken[:, slot] > TOLERANCE).argmax()) + 1
    return level, GivenWay(tails[0], tails[1] if kept else 1.0, policy.promise, first, name)


def aimed(check: InstanceCheck) -> Array:
    """Levels aimed at, of all used slots that have one, (N, O)."""
    levels = [one.level for one in check.parameters.slots]
    columns = [
        own[:, place] for _, k, place, _ in check.around.levelled if (own := levels[k]) is not None
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((check.problem.horizon, 0))


def _largest(check: InstanceCheck, best: Candidate, broken: Array) -> tuple[float, Array, bool]:
    """Return the largest share that is kept, what is entered just above it, and whether any is."""
    (at_least,) = _entered(check, best, (0.0,))
    if at_least.max() > TOLERANCE:
        return 0.0, at_least, False
    # Auxiliaries have to be made for each share where they depend on the level.
    together = _AT_ONCE if check.problem.levels_alone else 1
    low, wide, above = 0.0, 1.0, broken
    for _ in range(_HALVINGS // together):
        parts = 2**together
        wide /= parts
        found = _entered(check, best, [low + wide * k for k in range(1, parts)])
        first, last = 0, parts
        while last - first > 1:
            middle = (first + last) // 2
            if found[middle - 1].max() > TOLERANCE:
                last, above = middle, found[middle - 1]
            else:
                first = middle
        low += wide * first
    return low, above, True


def _as_aimed(check: InstanceCheck, best: Candidate) -> Array:
    """How far each region is entered at the levels aimed at, (N, O)."""
    if not check.problem.shared and check.problem.levels_alone:
        return best.found.regions[:, _used(check)]  # the re-check asked the same
    return np.asarray(_entered(check, best, (1.0,))[0])


def _entered(check: InstanceCheck, best: Candidate, shares: Sequence[float]) -> Array:
    """How far each region is entered at S shares of the levels aimed at, (S, N, O)."""
    problem, parameters, point = check.problem, check.parameters, best.point
    if problem.shared:
        levels = [share * parameters.target for share in shares]
        points = [check.suited(replace(point, level=level)) for level in levels]
    elif problem.levels_alone:
        points = [point]
    else:
        lower = [replace(check, parameters=at_share(parameters, share)) for share in shares]
        points = [one.suited(point) for one in lower]
    return entered(problem, parameters, points, shares)[..., _used(check)]


def _used(check: InstanceCheck) -> list[int]:
    """Which of all slots are used and have a level, in the order of `Surroundings.levelled`."""
    first = [0, *accumulate(slots.count for slots in check.problem.slots)]
    return [first[k] + place for _, k, place, _ in check.around.levelled]


def content(check: InstanceCheck, level: Array, dimension: int) -> Array:
    """Content that each level stands for; 0 for the paper's unbounded level below 0, (N, O)."""
    found = np.zeros_like(level)
    columns: dict[int, list[int]] = {}
    for column, (_, k, _, _) in enumerate(check.around.levelled):
        columns.setdefault(k, []).append(column)
    for k, own in columns.items():
        kind = check.around.kinds[k]
        assert isinstance(kind, LevelledKind)
        found[:, own] = _contents(kind, level[:, own], dimension)
    return found


def _contents(kind: LevelledKind, level: Array, dimension: int) -> Array:
    flat = tuple(level.ravel().tolist())
    try:
        found = _known_contents(kind, flat, dimension)
    except TypeError:  # a third party's region may not be hashable
        found = _contents_of(kind, flat, dimension)
    return found.reshape(level.shape)


def _contents_of(kind: LevelledKind, levels: tuple[float, ...], dimension: int) -> Array:
    known = {v: 1.0 - kind.tail(v, "content", dimension) if v > 0 else 0.0 for v in set(levels)}
    return np.array([known[v] for v in levels])


_known_contents = lru_cache(maxsize=16)(_contents_of)
"""Plans that keep the levels aimed at ask for the same at every decision."""


def out_of_reach(check: InstanceCheck, level: Array) -> tuple[Array, Array, Array]:
    """Level held, level aimed at, and content of what needs no slot, (N, B) each.

    The level aimed at is kept, whatever the plan; where the level is shared, it is that of the
    slots, ``level`` (N, O).
    """
    none = np.zeros((check.problem.horizon, 0))
    kept, aimed_at, contents = [none], [none], [none]
    for kind, one in check.around.out_of_reach:
        shared = check.problem.shared and level.size
        kept.append(np.broadcast_to(level[:, :1], one.level.shape) if shared else one.level)
        aimed_at.append(one.level)
        contents.append(_contents(kind, kept[-1], check.robot.dimension))
    found = (np.concatenate(some, axis=1) for some in (kept, aimed_at, contents))
    held_at, aim, content_of = found
    return held_at, aim, content_of


def auxiliaries(check: InstanceCheck, point: Guess) -> Array:
    """Auxiliaries of all used slots with a level, (N, O, A); nan where one has fewer than A."""
    columns = [point.auxiliaries[k][:, place] for _, k, place, _ in check.around.levelled]
    wide = max((own.shape[1] for own in columns), default=0)
    found = np.full((check.problem.horizon, len(columns), wide), np.nan)
    for column, own in enumerate(columns):
        found[:, column, : own.shape[1]] = own
    return found
