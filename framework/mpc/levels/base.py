"""The LevelPolicy interface."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ...arrays import Array
from ...region import Region


class LevelPolicy(ABC):
    """Chooses the level of every constraint: an array (steps, obstacles).

    A policy may tie all entries to one decision variable of the MPC, the paper's s; then
    ``weight`` and ``minimum`` say what giving way costs and how far it may go.
    """

    shared: ClassVar[bool]
    """Whether one decision variable stands for all levels."""

    tail: float
    """1 - content that is aimed at."""

    minimum: float
    """Lower bound of that variable; -inf where it is free, as the paper has it."""

    weight: float
    """Weight of (level - reference)^2 in the cost."""

    @abstractmethod
    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""


def uniform(region: Region, tail: float, steps: int, obstacles: int, dimension: int) -> Array:
    """Return the region's level for ``tail`` in every entry, (steps, obstacles)."""
    return np.full((steps, obstacles), region.level(tail, dimension))
