"""The LevelPolicy interface."""

from abc import ABC, abstractmethod
from typing import ClassVar, Literal, TypeAlias, get_args

import numpy as np

from ...arrays import Array
from ...errors import WideberthError
from ...region import Region

Promise: TypeAlias = Literal["content", "risk"]
"""What a tail stands for: 1 - content of the un-enlarged region, as in the paper, or the collision
risk that the region guarantees (for the exact sum s = Phi^-1(1 - tail), a smaller region)."""


class LevelPolicy(ABC):
    """Chooses the level of every constraint: an array (steps, obstacles).

    A policy may tie all entries to one decision variable of the MPC, the paper's s; then
    ``weight`` and ``minimum`` say what giving way costs and how far it may go.
    """

    shared: ClassVar[bool]
    """Whether one decision variable stands for all levels."""

    tail: float
    """Probability that is aimed at."""

    promise: Promise
    """What it is the probability of."""

    minimum: float
    """Lower bound of that variable; -inf where it is free, as the paper has it."""

    weight: float
    """Weight of (level - reference)^2 in the cost."""

    @abstractmethod
    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""


def uniform(
    policy: LevelPolicy, region: Region, steps: int, obstacles: int, dimension: int
) -> Array:
    """Return the region's level for the policy's tail in every entry, (steps, obstacles).

    Raises
    ------
    WideberthError : a collision risk is promised that the region guarantees at no level.
    """
    if policy.promise == "risk":
        from ...risk_meter import level_for_risk

        level = level_for_risk(region, policy.tail, dimension)
    else:
        level = region.level(policy.tail, dimension)
    return np.full((steps, obstacles), level)


def checked_promise(promise: str) -> None:
    """Refuse what is no `Promise`.

    Raises
    ------
    WideberthError : neither content nor risk.
    """
    if promise not in get_args(Promise):
        raise WideberthError(f"level.promise is {promise!r}; wanted one of {get_args(Promise)}")
