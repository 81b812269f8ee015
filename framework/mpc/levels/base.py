"""The LevelPolicy interface, and that of policies whose level is a decision variable."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from typing import ClassVar, Literal, TypeAlias, get_args

import numpy as np

from ...region import Region, RiskLevel
from ...values.arrays import Array
from ...values.coverage import Coverage
from ...values.errors import WideberthError

Promise: TypeAlias = Literal["content", "risk"]
"""What a tail stands for: 1 - content of the un-enlarged region, as in the paper, or the collision
risk that the region guarantees (for the exact sum s = Phi^-1(1 - tail), a smaller region)."""


class LevelPolicy(ABC):
    """Chooses the level of every constraint: an array (steps, obstacles).

    The MPC holds these levels as they are; a `SharedLevel` may give way.
    """

    tail: float
    """Probability that is aimed at."""

    promise: Promise
    """What it is the probability of."""

    coverage: ClassVar[Coverage | None] = None
    """What the regions promise where no plan enters them, at these levels; None: nothing."""

    @abstractmethod
    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles); steps 1..N, and obstacles that are there.

        Pure. Laws, checked by `wideberth.framework.testing.check_level`.
        """


class SharedLevel(LevelPolicy):
    """Ties all levels to one decision variable of the MPC, the paper's s.

    It costs ``weight`` (s - s_ref)^2. All entries of `levels` are s_ref, not below ``minimum``.
    """

    minimum: float
    """Lower bound of s; -inf where it is free, as the paper has it."""

    weight: float
    """Weight of (s - s_ref)^2 in the cost."""


def level_of(region: Region, promise: Promise, tail: float, dimension: int) -> float:
    """Return the region's level for one tail.

    Raises
    ------
    WideberthError : a collision risk is promised that the region guarantees at no level.
    """
    try:
        return _known_level(region, promise, tail, dimension)
    except TypeError:  # a third party's region may not be hashable
        return _level(region, promise, tail, dimension)


def _level(region: Region, promise: Promise, tail: float, dimension: int) -> float:
    if promise == "risk":
        from ...risk.level_for_risk import level_for_risk

        return level_for_risk(region, tail, dimension)
    return region.level(tail, dimension)


_known_level = lru_cache(maxsize=1024)(_level)
"""The same tails are asked for at every decision."""


def tail_of(region: Region, promise: Promise, level: float, dimension: int) -> float:
    """Return the tail that a level stands for, the inverse of `level_of`; 1 below level 0."""
    if level < 0.0:
        return 1.0
    if promise == "risk" and isinstance(region, RiskLevel):
        return float(region.risk(level))
    return float(region.tail(level, dimension))


def mixed_up(tail: float) -> str:
    """Say that a tail looks like a content; "" where it does not.

    A tail above 1/2 is no error: the ellipse of one standard deviation holds 39 % of where an
    obstacle may be. From 0.999 on nothing is left of a region but the forecast's mean, which is
    what is meant by such a number.

    Examples
    --------
    >>> mixed_up(0.95)
    'tail is 1 - content: 0.95 holds 5 % of where an obstacle may be, and 0.05 holds 95 %'
    >>> mixed_up(0.05), mixed_up(0.999999)
    ('', '')
    """
    if not 0.5 < tail < 0.999:
        return ""
    return (
        f"tail is 1 - content: {tail:g} holds {100 * (1 - tail):.4g} % of where an obstacle may "
        f"be, and {1 - tail:.4g} holds {100 * tail:.4g} %"
    )


def uniform(
    policy: LevelPolicy, region: Region, steps: int, obstacles: int, dimension: int
) -> Array:
    """Return the region's level for the policy's tail in every entry, (steps, obstacles).

    Raises
    ------
    WideberthError : as `level_of`.
    """
    level = level_of(region, policy.promise, policy.tail, dimension)
    return np.full((steps, obstacles), level)


def spread(
    region: Region, promise: Promise, tails: Array, obstacles: int, dimension: int
) -> Array:
    """Return the region's levels for a tail per step (steps,), (steps, obstacles).

    Raises
    ------
    WideberthError : as `level_of`.
    """
    try:
        found = _known_levels(region, promise, tuple(tails.tolist()), dimension)
    except TypeError:  # a third party's region may not be hashable
        found = _levels(region, promise, tails.tolist(), dimension)
    return np.repeat(found[:, None], obstacles, axis=1)


def _levels(region: Region, promise: Promise, tails: Sequence[float], dimension: int) -> Array:
    return np.array([level_of(region, promise, tail, dimension) for tail in tails], np.float64)


_known_levels = lru_cache(maxsize=64)(_levels)
"""All steps at once: a region's hash takes as long as its level."""


def checked_promise(promise: str) -> None:
    """Refuse what is no `Promise`.

    Raises
    ------
    WideberthError : neither content nor risk.
    """
    if promise not in get_args(Promise):
        raise WideberthError(f"level.promise is {promise!r}; wanted one of {get_args(Promise)}")
