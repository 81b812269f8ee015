"""A level that falls over the horizon: what lies farther ahead is decided later."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.mpc.levels.base import LevelPolicy, Promise, checked_promise, mixed_up, spread
from ...framework.region import Region
from ...framework.values.arrays import Array, probability, whole
from ...framework.values.coverage import Coverage, Event
from ...framework.values.errors import WideberthError


@final
@dataclass(frozen=True)
class Discounted(LevelPolicy):
    """Hold the full level at the steps that are driven, and geometrically less after them.

    With c full steps, the tail of step i = 1..N is::

        tail_i = tail                                              i <= c
        tail_i = tail (final_tail / tail)^((i - c) / (N - c))      i > c

    An event later than step c counts the less in the bound, by a constant factor per step, as
    in discounted chance constraints (there the discounted risks are summed).

    What is promised: in a plan that enters no region, each step i <= c keeps ``tail``, under the
    forecast that the plan was made with. With a control period of at most c MPC steps the robot
    only ever drives towards such steps, so that all that is driven was planned at ``tail``. A
    later step i promises tail_i alone: enough to plan a way through, less than what will be
    asked for when it is driven. Nothing promises that a plan at full level will exist by then;
    if none does, the penalty and the fallback ladder decide. A plan that is driven beyond step c
    because no new one was found keeps what its steps promise, no more. An episode is not bounded.

    Forecasts that are honest grow: a level that is full at the last step, 5 to 8 s ahead, closes
    ways that will turn out to be free.

    Parameters
    ----------
    tail : probability in (0, 1) of the full steps.
    final_tail : of the last step, at least ``tail``, below 1.
    full_steps : c, at least 1; it has to cover the time until the next plan is driven.
    promise : whether they are 1 - content, or the highest collision risk of that step.
    """

    reference: ClassVar[str] = "yan2018stochastic"
    coverage: ClassVar[Coverage | None] = Coverage(
        Event.STEP,
        "1 - tail at the full steps, falling to 1 - final_tail at the last",
        "the forecast is right: its Gaussians are the distribution of the truth",
        reference,
    )

    tail: float = 0.05
    final_tail: float = 0.5
    full_steps: int = 1
    promise: Promise = "content"

    def __post_init__(self) -> None:
        probability("level.tail", self.tail)
        probability("level.final_tail", self.final_tail)
        whole("level.full_steps", self.full_steps)
        checked_promise(self.promise)
        if self.final_tail < self.tail:
            words = (
                f"level.final_tail is {self.final_tail:g}; wanted at least level.tail, "
                f"{self.tail:g}: the level falls over the horizon"
            )
            raise WideberthError("; ".join(filter(None, (words, mixed_up(self.tail)))))

    def tails(self, steps: int) -> Array:
        """Tail of each step, (steps,)."""
        later = np.arange(1, steps + 1) - float(self.full_steps)
        share = np.clip(later / max(steps - self.full_steps, 1), 0.0, 1.0)
        return np.asarray(self.tail * (self.final_tail / self.tail) ** share)

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        return spread(region, self.promise, self.tails(steps), obstacles, dimension)
