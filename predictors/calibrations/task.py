"""All plans of a whole task at once."""

from dataclasses import dataclass
from typing import ClassVar, final

from ...framework.calibration import (
    CalibrationScores,
    IntArray,
    MomentCalibration,
    fewest_ranks,
    stretches,
)
from ...framework.values.arrays import Array, positive
from ...framework.values.coverage import Coverage, Event
from ..core.error_shape import joint_rank_sizes


@final
@dataclass(frozen=True)
class WholeTask(MomentCalibration):
    """Take the quantile of the largest error over all forecasts of a task.

    q_h = c v_h,   c = quantile of max_tih d^2_tih / v_h,   one score per task

    over all rows t of ``seconds`` in a row, all people i and all steps h. It is the one rung that
    bounds an episode: with probability 1 - tail no person leaves any region of any plan that is
    made in a task of that length, however the horizon shrinks towards its end, if plans are made
    at the pace of the recordings' rows or slower. Splitting the tail over the plans would promise
    the same by Boole's inequality, and needs a quantile at tail / T of moments; the plans of one
    task resemble each other, so that one score for all of them costs far less.

    The tasks of the data are stretches of the recordings one horizon apart
    (`framework.calibration.stretches`). To spend less of the tail on plans that were kept, as a
    feedback of the task so far, would promise no more; it is left out.

    Parameters
    ----------
    seconds : s, length of a task.
    """

    seconds: float = 20.0

    reference: ClassVar[str] = "stamouli2024recursively"
    coverage: ClassVar[Coverage] = Coverage(
        Event.TASK,
        "at least 1 - tail over the draw of data and future together",
        "tasks of that length are exchangeable, a new one with those of the fit",
        reference,
    )

    def __post_init__(self) -> None:
        positive("task.seconds", self.seconds)

    def groups(self, scores: CalibrationScores) -> IntArray:
        """Group the people of all rows of a task."""
        return stretches(scores, max(round(self.seconds / scores.dt), 1))

    def fewest(self, tail: float, steps: int) -> int:
        """Fewest tasks; see `Calibration.fewest`."""
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of each step; see `Calibration.sizes`."""
        return joint_rank_sizes(scores, self.groups(scores), learnt, tail)
