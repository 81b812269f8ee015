"""Every region at the level of one content."""

from dataclasses import dataclass, field
from typing import ClassVar, final

from ...arrays import Array, probability
from ...region import Region
from .base import LevelPolicy, uniform


@final
@dataclass(frozen=True)
class Fixed(LevelPolicy):
    """Hold every region at the level whose content is 1 - tail.

    Parameters
    ----------
    tail : probability in (0, 1) that the obstacle leaves the un-enlarged region.
    """

    shared: ClassVar[bool] = False

    tail: float = 0.05
    minimum: float = field(default=0.0, init=False, repr=False)  # no setting: nothing gives way
    weight: float = field(default=0.0, init=False, repr=False)

    def __post_init__(self) -> None:
        probability("level.tail", self.tail)

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        return uniform(region, self.tail, steps, obstacles, dimension)
