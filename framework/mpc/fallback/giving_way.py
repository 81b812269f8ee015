"""How far a plan holds less than was asked for, from which step on, because of which obstacle."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...values.arrays import Array
from ...values.plan import GivenWay, Rung
from .instance_check import TOLERANCE, Candidate, InstanceCheck
from .verify import violation

if TYPE_CHECKING:
    from .ladder import Ladder

_HALVINGS = 12
"""Of the interval in which the level held lies: to 1/4096 of the level asked for."""


def held(ladder: "Ladder", check: InstanceCheck, best: Candidate) -> tuple[Array, GivenWay | None]:
    """Return the level at which a plan keeps each constraint, and how it gave way, if it did.

    A plan gave way if it enters a region of the level aimed at, by more than `TOLERANCE`: less
    than that is what every plan is allowed. The solver knows the level of an optimal plan whose
    level is shared. For all others, those that were held against the lowest level and those that
    enter a region, it is the largest share of the levels aimed at, the same for all, at which no
    region is entered, found by bisection.

    Parameters
    ----------
    ladder : knows robot and level policy.
    case : what plans are held against.
    best : the plan taken.

    Returns
    -------
    level : (N, O). given_way : None where everything is kept as aimed at.
    """
    places = check.around.levelled()
    asked = aimed(check)
    if not asked.size:
        return asked, None
    entered = _entered(ladder, check, best, 1.0)
    if entered.max() <= TOLERANCE:
        return asked, None
    shared = check.problem.shared
    if shared and best.rung is Rung.OPTIMAL:
        lower, worst, kept = np.full_like(asked, best.point.level), entered, True
    else:
        share, worst, kept = _largest(ladder, check, best, entered)
        lower = share * asked
    level = np.where(shared | (entered > TOLERANCE), lower, asked)
    step, slot = divmod(int(worst.argmax()), worst.shape[1])
    policy, size = ladder.level, ladder.robot.dimension
    kind, _, _, name = places[slot]
    tails = [
        kind.tail(float(value), policy.promise, size)
        for value in (asked[step, slot], level[step, slot])
    ]
    first = int((entered[:, slot] > TOLERANCE).argmax()) + 1
    return level, GivenWay(tails[0], tails[1] if kept else 1.0, policy.promise, first, name)


def aimed(check: InstanceCheck) -> Array:
    """Levels aimed at, of all used slots that have one, (N, O)."""
    levels = [one.level for one in check.parameters.slots]
    columns = [
        own[:, place]
        for _, k, place, _ in check.around.levelled()
        if (own := levels[k]) is not None
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((check.problem.horizon, 0))


def _largest(
    ladder: "Ladder", check: InstanceCheck, best: Candidate, entered: Array
) -> tuple[float, Array, bool]:
    """Return the largest share that is kept, what is entered just above it, and whether any is."""
    low, high, above = 0.0, 1.0, entered
    at_least = _entered(ladder, check, best, 0.0)
    if at_least.max() > TOLERANCE:
        return 0.0, at_least, False
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        found = _entered(ladder, check, best, middle)
        if found.max() > TOLERANCE:
            high, above = middle, found
        else:
            low = middle
    return low, above, True


def _entered(ladder: "Ladder", check: InstanceCheck, best: Candidate, share: float) -> Array:
    """How far each region is entered at a share of the levels aimed at, (N, O)."""
    parameters = check.parameters
    if check.problem.shared:
        point = replace(best.point, level=share * parameters.target)
    else:
        lower = [
            own if own.level is None else replace(own, level=share * own.level)
            for own in parameters.slots
        ]
        parameters = replace(parameters, slots=tuple(lower))
        point = best.point
    point = ladder.suited(parameters, point)
    found = violation(check.problem, parameters, point).regions
    first = np.cumsum([0, *(slots.count for slots in check.problem.slots)])
    return found[:, [first[k] + place for _, k, place, _ in check.around.levelled()]]
