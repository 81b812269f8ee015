"""All people at all steps of a plan at once."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...framework.calibration import (
    CalibrationScores,
    IntArray,
    MomentCalibration,
    fewest_ranks,
    moments,
)
from ...framework.values.arrays import Array
from ...framework.values.coverage import Coverage, Event
from ..core.error_shape import joint_rank_sizes


@final
@dataclass(frozen=True)
class JointPlan(MomentCalibration):
    """Take the quantile of the largest error over all people and steps of a moment.

    q_h = c v_h,   c = quantile of max_ih d^2_ih / v_h,   one score per moment

    with v_h the shape (`shape_of`) of the worst errors in the first half of the recordings.
    Everyone who is seen at the newest row counts, whatever was seen of him before, and for as
    long as he is seen after it. Every N-th row of a recording counts
    (`framework.calibration.moments`): the people of one moment make one score, and rows nearer
    than the horizon share their futures.

    Who appears after the newest row is in no forecast and in no promise. `FunctionalConstant`
    counts him when it is asked to.
    """

    reference: ClassVar[str] = "cleaveland2023conformal"
    coverage: ClassVar[Coverage] = Coverage(
        Event.PLAN,
        "at least 1 - tail over the draw of data and future together",
        "moments one horizon apart are exchangeable, a new one with those of the fit",
        reference,
    )

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group the people of every N-th row."""
        return moments(scores)

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest moments; see `Calibration.fewest`."""
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""
        return joint_rank_sizes(scores, self.groups(scores), learnt, tail)
