"""Each step for itself: the marginal promise."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.calibration import (
    Calibration,
    CalibrationScores,
    IntArray,
    fewest_ranks,
    rank_quantile,
)
from ...framework.values.arrays import Array
from ...framework.values.coverage import Coverage, Event


@final
@dataclass(frozen=True)
class PerStep(Calibration):
    """Take the quantile of the errors at each step for itself.

    q_h = d^2_(k),h,   k = ceil((n + 1)(1 - tail))

    the k-th smallest of the squared distances of n windows at step h. A new person at step h is
    within with probability 1 - tail at least, and at most 1 / (n + 1) more. Nothing is said of
    several steps or people together: a plan of N steps among K people is missed by up to N K
    times as much.

    The promise is for people who were seen at all ``observed`` samples before and are seen at all
    steps after, since only such windows count. Who has just appeared is missed more often: among
    everyone seen, .15 to .20 of the steps for a tail of .10 on a recording not used in the fit.
    `JointPlan` and `FunctionalConstant` count everyone who is seen.

    Every fully observed window counts as one, however much it overlaps with others. The share of
    people and steps that are missed over a long time is not biased by that; what is lost is the
    promise in small samples.
    """

    reference: ClassVar[str] = "lindemann2023safe"
    coverage: ClassVar[Coverage] = Coverage(
        Event.STEP,
        "at least 1 - tail over the draw of data and future together",
        "windows are exchangeable, those of a new person with those of the fit",
        reference,
    )

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group nothing: each whole window counts for itself."""
        return np.where(scores.whole, np.cumsum(scores.whole) - 1, -1)

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest windows; see `Calibration.fewest`."""
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""
        groups = self.groups(scores)
        return np.array([rank_quantile(column, groups, tail) for column in scores.squares.T])
