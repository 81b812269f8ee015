"""One level for all: a decision variable, drawn towards its reference by the cost."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...region import Region
from ...values.arrays import Array, positive, probability
from ...values.coverage import Coverage, Event
from ...values.errors import WideberthError
from .base import Promise, SharedLevel, checked_promise, mixed_up, uniform


@final
@dataclass(frozen=True)
class Relaxed(SharedLevel):
    """Let one level s give way for all steps and obstacles at the price w (s - s_ref)^2.

    The paper's relaxation at a price that keeps what is asked wherever there is room, and down
    to a level that still stands for something: the defaults are what we recommend, and what the
    shipped experiments use where they name no numbers. The paper's own numbers are those of
    `Paper`. With the ellipse, minimum 1 holds 39 % content.

    What a level promises is that of one obstacle at one step, neither of a plan nor of an episode;
    a level that gave way promises less than ``tail``.

    At level 0 a region around the content ellipse is the disc of the margin, so that bodies
    touch at most. A region made of a risk (`RiskContour`, `WhitenedBox`, `Park`, `DuToit`, of
    level sqrt(-2 ln risk)) is smaller than that there, or empty: its minimum has to be a level
    that stands for a risk, 1.177 for one half, 1.794 for 0.2.

    Parameters
    ----------
    tail : probability in (0, 1) that s_ref stands for.
    weight : w, at least 0.
    minimum : lower bound of s, in the region's own unit; at most s_ref. ``-.inf`` for none.
    promise : whether tail is 1 - content, as in the paper, or the highest collision risk.
    """

    coverage: ClassVar[Coverage | None] = Coverage(
        Event.STEP,
        "1 - tail where the level stays at its reference, else what the plan's level stands for",
        "the forecast is right: its Gaussians are the distribution of the truth",
        "schoeneberg2025trajectory",
    )

    tail: float = 0.05
    weight: float = 1000.0
    minimum: float = 1.0
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
            words = (
                f"level.minimum is {self.minimum:g}; wanted at most {target.min():.4g}, the "
                f"level of {type(region).__name__} for the tail {self.tail:g}"
            )
            raise WideberthError("; ".join(filter(None, (words, mixed_up(self.tail)))))
        return target
