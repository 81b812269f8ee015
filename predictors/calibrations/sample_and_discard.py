"""All people at all steps, with confidence in the data: sampled scenarios, the worst discarded."""

import math
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.calibration import CalibrationScores, ConfidentCalibration, IntArray, moments
from ...framework.values.arrays import Array, probability
from ...framework.values.coverage import Coverage, Event
from ..core.error_shape import joint_sizes, shape_of_moments


@final
@dataclass(frozen=True)
class SampleAndDiscard(ConfidentCalibration):
    """Discard as many of the worst moments as leaves the promise in nearly all data.

    q_h = c v_h,   c = the largest of max_ih d^2_ih / v_h but for k of n moments
    k = the largest with    Pr(Bin(n, tail) <= k)  <=  beta

    Then, with confidence 1 - beta over the data, a new moment is missed with probability tail at
    most. `JointPlan` promises the probability over data and future together, so that for one in
    two data it is missed. c is one number, the support of which is one scenario: the bound is the
    binomial sum of scenario optimisation without the factor for more decisions, and it is exact,
    as the share that exceeds the (n - k)-th of n has the distribution Beta(k + 1, n - k).

    Shape and moments are those of `JointPlan`. It needs log beta / log(1 - tail) moments at least:
    44 at 10 %, 90 at 5 %. That the moments are independent is needed here, not exchangeability
    alone.

    Parameters
    ----------
    beta : probability that the data are such that the tail does not hold.
    """

    beta: float = 0.01

    reference: ClassVar[str] = "campi2011sampling"
    coverage: ClassVar[Coverage] = Coverage(
        Event.PLAN,
        "at least 1 - tail, with confidence 1 - beta over the data of the fit",
        "moments one horizon apart are independent and of one distribution, the new one too",
        reference,
    )

    def __post_init__(self) -> None:
        probability("sample_and_discard.beta", self.beta)

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group the people of every N-th row."""
        return moments(scores)

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest moments, of which none is discarded; see `Calibration.fewest`."""
        return math.ceil(math.log(self.beta) / math.log1p(-tail) - 1e-9)

    def discarded(self, count: int, tail: float) -> int:
        """Return k of ``count`` moments, which may be discarded; -1 where they are too few."""
        missed = np.arange(count)
        ways = np.cumsum(np.log((count + 1.0 - missed[1:]) / missed[1:]))
        chance = missed * math.log(tail) + (count - missed) * math.log1p(-tail)
        chance[1:] += ways
        return int(np.count_nonzero(np.cumsum(np.exp(chance)) <= self.beta)) - 1

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""

        def bound(worst: Array) -> float:
            discarded = self.discarded(len(worst), tail)
            return math.inf if discarded < 0 else float(np.sort(worst)[-1 - discarded])

        shape = shape_of_moments(learnt, scores.steps, tail)
        return joint_sizes(scores, self.groups(scores), shape, bound)
