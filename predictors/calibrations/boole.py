"""A share of the tail for each step: a whole plan by Boole's inequality."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.calibration import (
    CalibrationScores,
    IntArray,
    SplitCalibration,
    fewest_ranks,
    largest,
    moments,
    rank_quantile,
)
from ...framework.values.arrays import Array, positive
from ...framework.values.coverage import Coverage, Event


@final
@dataclass(frozen=True)
class Boole(SplitCalibration):
    """Give each step a share of the tail, and take the quantile of the worst person there.

    tail_h = tail w_h / sum_j w_j,  w_h = h^growth,    q_h = quantile of max_i d^2_ih at tail_h

    Boole's inequality, which needs no independence, adds the shares of the steps. It is not
    needed for people: the worst of those who are there at a moment is one score, so that the
    number of people has not to be known. Every N-th row of a recording counts
    (`framework.calibration.moments`).

    A small share needs many moments: ceil(N / tail) - 1 of them if all get the same, 119 at 12
    steps and 10 %. Where there are as many, `JointPlan` needs ten times fewer for the same event.

    Parameters
    ----------
    growth : exponent of the weights, at least 0; with 1 the last step gets N times as much as the
        first, as in `RiskAllocation`.
    """

    growth: float = 0.0

    reference: ClassVar[str] = "lindemann2023safe"
    coverage: ClassVar[Coverage] = Coverage(
        Event.PLAN,
        "at least 1 - tail over the draw of data and future together",
        "moments one horizon apart are exchangeable, a new one with those of the fit",
        reference,
    )

    def __post_init__(self) -> None:
        positive("boole.growth", self.growth, zero=True)

    def tails(self, tail: float, steps: int) -> Array:
        """Share of each step, (N,)."""
        weights = (np.arange(1, steps + 1) / steps) ** self.growth
        return np.asarray(tail * weights / weights.sum())

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group the people of every N-th row."""
        return moments(scores)

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest moments, for the smallest share; see `Calibration.fewest`."""
        return fewest_ranks(float(self.tails(tail, steps).min()))

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""
        worst = largest(scores.squares, self.groups(scores))
        each = np.arange(len(worst))
        shares = self.tails(tail, scores.steps)
        columns = zip(worst.T, shares, strict=True)
        return np.array([rank_quantile(column, each, share) for column, share in columns])
