"""The paper's level: one decision variable, drawn towards its reference by the cost."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...arrays import Array, positive, probability
from ...errors import WideberthError
from ...region import Region
from .base import LevelPolicy, Promise, checked_promise, uniform


@final
@dataclass(frozen=True)
class Relaxed(LevelPolicy):
    """Let one level s give way for all steps and obstacles at the price w (s - s_ref)^2.

    The paper writes the price inside the sum over i = 1..N: read literally its weight is
    N = 15; the recorded instances are reproduced with 1, the default reading. The paper
    leaves s without bounds; then the optimum has s < 0 in 44 % of recorded instances, where
    the ellipse's axes are shorter than r + r_d and the robots may touch. ``minimum`` is
    therefore 0 unless it is set lower (``-.inf`` in YAML is the paper's).

    At level 0 a region around the content ellipse is the disc of the margin, so that bodies
    touch at most. A region made of a risk (`RiskContour`, `WhitenedBox`, `Park`, `DuToit`, of
    level sqrt(-2 ln risk)) is smaller than that there, or empty: its minimum has to be a level
    that stands for a risk, 1.177 for one half, 1.794 for 0.2.

    Parameters
    ----------
    tail : probability in (0, 1) that s_ref stands for. The paper prints
        s_ref = sqrt(5.991), which is 0.050012; exactly 0.05 is s = 2.4477468.
    weight : w, at least 0.
    minimum : lower bound of s.
    promise : whether tail is 1 - content, as in the paper, or the highest collision risk.
    """

    shared: ClassVar[bool] = True

    tail: float = 0.05
    weight: float = 1.0
    minimum: float = 0.0
    promise: Promise = "content"

    def __post_init__(self) -> None:
        probability("level.tail", self.tail)
        checked_promise(self.promise)
        positive("level.weight", self.weight, zero=True)
        if not self.minimum < float("inf"):
            raise WideberthError(f"level.minimum is {self.minimum}; wanted a number or -.inf")

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        target = uniform(self, region, steps, obstacles, dimension)
        if target.size and self.minimum > target.min():
            raise WideberthError(
                f"level.minimum is {self.minimum:g}; wanted at most {target.min():.4g}, the "
                f"level of {type(region).__name__} for the tail {self.tail:g}"
            )
        return target
