"""Every region at one level."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...region import Region
from ...values.arrays import Array, probability
from ...values.coverage import Coverage, Event
from .base import LevelPolicy, Promise, checked_promise, uniform


@final
@dataclass(frozen=True)
class Fixed(LevelPolicy):
    """Hold every region at the level that stands for one probability.

    That is the probability of one obstacle at one step. It bounds neither a plan, where it is
    missed by up to N K times as much, nor an episode.

    Parameters
    ----------
    tail : probability in (0, 1).
    promise : whether it is that of the obstacle leaving the un-enlarged region (content), or
        the highest collision risk.
    """

    coverage: ClassVar[Coverage | None] = Coverage(
        Event.STEP,
        "1 - tail",
        "the forecast is right: its Gaussians are the distribution of the truth",
        "schoeneberg2025trajectory",
    )

    tail: float = 0.05
    promise: Promise = "content"

    def __post_init__(self) -> None:
        probability("level.tail", self.tail)
        checked_promise(self.promise)

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        return uniform(self, region, steps, obstacles, dimension)
