"""All steps of one person at once."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.calibration import (
    CalibrationScores,
    IntArray,
    MomentCalibration,
    fewest_ranks,
    moments,
    rank_quantile,
)
from ...framework.values.arrays import Array
from ...framework.values.coverage import Coverage, Event
from ..core.error_shape import shape_of


@final
@dataclass(frozen=True)
class JointPerson(MomentCalibration):
    """Take the quantile of each person's largest error over the steps.

    q_h = c v_h,   c = quantile of max_h d^2_ih / v_h

    with v_h the shape (`shape_of`) of the errors of persons in the first half of the recordings,
    so that sizes grow with the time ahead as errors do. Only the quantile c is promised, of data
    that v_h does not know; any shape keeps it, and a poor one makes regions larger.

    Those whose future was seen at all N steps count, of every N-th row. The people of one moment
    are alike: each moment counts as one, shared by its people. So the promise is for a random
    person of a new moment.
    """

    reference: ClassVar[str] = "cleaveland2023conformal"
    coverage: ClassVar[Coverage] = Coverage(
        Event.PERSON,
        "at least 1 - tail over the draw of data and future together",
        "moments one horizon apart are exchangeable, and so are the people of one",
        reference,
    )

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group those seen at all steps ahead, of every N-th row."""
        seen = np.isfinite(scores.squares).all(axis=1)
        return np.where(seen, moments(scores), -1)

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest moments; see `Calibration.fewest`."""
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""
        flat = np.ones(scores.steps)
        shape = flat if learnt is None else shape_of(learnt.squares, tail)
        worst = (scores.squares / shape).max(axis=1)
        return shape * rank_quantile(worst, self.groups(scores), tail)
