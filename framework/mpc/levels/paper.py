"""The paper's own numbers for a level that gives way."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...region import Region
from ...values.arrays import Array
from ...values.coverage import Coverage
from .base import Promise, SharedLevel
from .relaxed import Relaxed


@final
@dataclass(frozen=True)
class Paper(SharedLevel):
    """Let the level give way as the paper has it: nearly for free, down to nothing.

    `Relaxed` with the price (s - s_ref)^2 once, and s_ref = sqrt(5.991) as printed. The paper
    writes the price inside the sum over i = 1..N: read literally its weight is N = 15
    (``weight: 15.0``); the recorded instances are reproduced with 1. It leaves s without bounds
    (``minimum: -.inf``); then the optimum has s < 0 in 44 % of recorded instances, where the
    ellipse's axes are shorter than r + r_d and the robots may touch. ``minimum`` is therefore 0
    unless it is set lower. For use on a robot take `Relaxed`: with these numbers a person ahead
    leaves nearly nothing of the 95 % that are asked for.

    Parameters
    ----------
    tail : probability in (0, 1) that s_ref stands for; exactly 0.05 is s = 2.4477468.
    weight, minimum, promise : as in `Relaxed`.
    """

    reference: ClassVar[str] = "schoeneberg2025trajectory"

    coverage: ClassVar[Coverage | None] = Relaxed.coverage

    tail: float = 0.050012
    weight: float = 1.0
    minimum: float = 0.0
    promise: Promise = "content"

    def __post_init__(self) -> None:
        self._relaxed()

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        return self._relaxed().levels(region, steps, obstacles, dimension)

    def _relaxed(self) -> Relaxed:
        return Relaxed(self.tail, self.weight, self.minimum, self.promise)
