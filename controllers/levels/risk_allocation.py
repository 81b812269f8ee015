"""One risk for the whole plan, split over its steps and obstacles by Boole's inequality."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.mpc.levels.base import LevelPolicy, Promise, checked_promise, spread
from ...framework.region import Region
from ...framework.values.arrays import Array, positive, probability
from ...framework.values.coverage import Coverage, Event


@final
@dataclass(frozen=True)
class RiskAllocation(LevelPolicy):
    """Hold each region at its share of one risk that the whole plan may take.

    For steps i = 1..N and K obstacles, with w_i = i^growth::

        tail_ik = tail w_i / (K sum_j w_j),      sum_ik tail_ik = tail

    Boole's inequality, which needs no independence, then gives

        Pr(some obstacle collides at some step)  <=  sum_ik Pr(k collides at i)  <=  tail

    for the plan as a whole, driven to its end without planning anew, at its steps (not between
    them), if the forecast is right. It holds with regions that bound the collision risk (all
    with a guarantee); for the others, tail bounds the probability that any obstacle leaves
    any of its un-enlarged regions. The next plan takes a ``tail`` of its own: an episode is not
    bounded.

    With growth 0 all steps get the same. Those far ahead, whose forecasts are wide, gain most
    from a larger share: among all splits the one with the smallest sum of enlargements has
    tail_i nearly proportional to the forecast's deviation sigma_i, which grows as i for an
    uncertain velocity and as i^1.5 for random acceleration.

    The forecast modes of one obstacle share its part: they exclude each other, so that their
    risks, weighted, do not exceed the largest. Obstacles that were left out, static polygons
    and all bodies of a robot but one are not counted; a robot of B discs risks at most B tail.

    Parameters
    ----------
    tail : probability in (0, 1) for all steps and obstacles together; before a static
        polygon, the robot's own uncertainty is held at it step by step.
    growth : exponent of the weights, at least 0.
    promise : whether tail is that of leaving the un-enlarged regions (content), or the collision
        risk.
    """

    reference: ClassVar[str] = "ono2008iterative"
    coverage: ClassVar[Coverage | None] = Coverage(
        Event.PLAN,
        "at least 1 - tail",
        "the forecast is right at each step; independence is not needed",
        reference,
    )

    tail: float = 0.05
    growth: float = 1.0
    promise: Promise = "content"

    def __post_init__(self) -> None:
        probability("level.tail", self.tail)
        positive("level.growth", self.growth, zero=True)
        checked_promise(self.promise)

    def tails(self, steps: int, obstacles: int) -> Array:
        """Tail of each step with one obstacle of so many, (steps,)."""
        weights = (np.arange(1, steps + 1) / steps) ** self.growth
        return np.asarray(self.tail * weights / (weights.sum() * max(obstacles, 1)))

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        """Levels aimed at, (steps, obstacles)."""
        tails = self.tails(steps, obstacles)
        return spread(region, self.promise, tails, obstacles, dimension)
