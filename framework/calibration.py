"""The Calibration interface: from the errors of recorded forecasts to the sizes of regions.

A calibration is handed the `CalibrationScores` of recorded forecasts and returns the squared size
of the region of each step. What it may count as one is its own matter: windows of one track that
overlap and people of one moment do not err independently of each other, and a rank among such
scores promises nothing. `groups` states which scores belong together; ranks count groups.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from .values.arrays import Array, BoolArray
from .values.coverage import Coverage

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

ROUNDING = 1e-9
"""By which a rank may miss a whole number and still be that number: 20 * 0.95 is 19."""


@dataclass(frozen=True, eq=False)
class CalibrationScores:
    """Errors of recorded forecasts: one row per person and moment at which a forecast was made.

    Attributes
    ----------
    squares : (W, N), squared distance of the truth from the forecast, in units of the forecast's
        own covariance; NaN where the person was not seen at that step.
    recording : (W,), index of the recording.
    row : (W,), of the newest sample, counted from the first row that was scored.
    track : (W,), index of the person in the recording.
    whole : (W,), whether the person was seen at all samples that a fit asks for, before the
        forecast and after it.
    rows : of each recording, how many forecasts were made, one after the other, whether anyone was
        there or not.
    dt : s, between the rows, and between the steps.
    """

    squares: Array
    recording: IntArray
    row: IntArray
    track: IntArray
    whole: BoolArray
    rows: tuple[int, ...]
    dt: float

    def __len__(self) -> int:
        """Count the scores."""
        return len(self.squares)

    def select(self, index: list[int]) -> "CalibrationScores":
        """Return the scores with these indices, in this order."""
        return CalibrationScores(
            self.squares[index],
            self.recording[index],
            self.row[index],
            self.track[index],
            self.whole[index],
            self.rows,
            self.dt,
        )

    @property
    def steps(self) -> int:
        """N, the number of steps ahead."""
        return int(self.squares.shape[1])


class Calibration(ABC):
    """Turns the errors of recorded forecasts into the sizes of regions.

    A calibration is a frozen dataclass. Laws, checked by
    `wideberth.framework.testing.check_calibration`: where groups are exchangeable, its event is
    missed as often as `coverage` says, also in small samples; with fewer groups than `fewest`
    there is no size.
    """

    reference: ClassVar[str] = ""
    """BibTeX key of the source, for ``wideberth cite``."""

    coverage: ClassVar[Coverage]
    """What the regions of these sizes promise."""

    @abstractmethod
    def groups(self, scores: CalibrationScores) -> IntArray:
        """Return the group of each score, (W,), by a number; below 0 where it does not count.

        CalibrationScores of different groups have to be independent enough to be exchangeable.
        """

    @abstractmethod
    def fewest(self, tail: float, steps: int) -> int:
        """Fewest groups with which regions of finite size keep the promise."""

    @abstractmethod
    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        """Squared size of the region of each step, (N,); infinite with too few groups.

        Parameters
        ----------
        scores : to calibrate with.
        tail : probability that the event is missed.
        learnt : other scores, from which shapes may be learnt; None for none.
        """


class MomentCalibration(Calibration):
    """A calibration whose groups hold whole moments, with all people who are there.

    For it, recordings are cut in time: base and shape are learnt from the first half, and the
    second half calibrates, so that no one of a moment is missing. `learnt` are the scores of the
    first half. A promise to all people counts the moments at which someone is there.
    """


class SplitCalibration(MomentCalibration):
    """A calibration that gives each step a share of the tail, by Boole's inequality."""

    @abstractmethod
    def tails(self, tail: float, steps: int) -> Array:
        """Share of each step, (N,); they sum to the tail at most."""


class ConfidentCalibration(MomentCalibration):
    """A calibration that keeps its promise for all but a share of the data it may be given.

    The others promise their probability over the draw of data and future together: with few
    data one in three may promise too much. Here Pr(Pr(miss | data) > tail) <= `beta`.
    """

    beta: float
    """Probability that the data are such that the tail does not hold."""


def rows_of(scores: CalibrationScores) -> IntArray:
    """Group the people of each row, however near rows are to each other."""
    return _numbered(scores, np.ones(len(scores), dtype=np.bool_), scores.row)


def moments(scores: CalibrationScores) -> IntArray:
    """Group the people of every N-th row, for `Calibration.groups`.

    Futures of rows that are N steps apart have no sample in common, so that only what lasts
    longer than a horizon still ties them. Rows are kept by their number alone: to keep the first
    row after a pause would prefer moments at which people arrive.
    """
    kept = scores.row % scores.steps == 0
    return _numbered(scores, kept, scores.row)


def stretches(scores: CalibrationScores, length: int) -> IntArray:
    """Group the people of ``length`` rows in a row, for `Calibration.groups`.

    The N rows between two stretches belong to none: their futures would reach into both. A
    stretch that the recording ends in is left out.
    """
    number, place = np.divmod(scores.row, length + scores.steps)
    rows = np.array(scores.rows, dtype=np.int64)[scores.recording]
    ends = number * (length + scores.steps) + length
    return _numbered(scores, (place < length) & (ends <= rows), number)


def _numbered(scores: CalibrationScores, kept: BoolArray, inside: IntArray) -> IntArray:
    """Count pairs of recording and number inside it from 0; -1 for what is not kept."""
    pairs = scores.recording * (inside.max(initial=0) + 1) + inside
    groups = np.full(len(scores), -1, dtype=np.int64)
    groups[kept] = np.unique(pairs[kept], return_inverse=True)[1]
    return groups


def largest(values: Array, groups: IntArray) -> Array:
    """Largest value in each group, (W, ...) -> (G, ...); NaN is passed over, of all it is 0."""
    found = np.zeros((int(groups.max(initial=-1)) + 1, *values.shape[1:]))
    order = np.argsort(groups, kind="stable")[np.count_nonzero(groups < 0) :]
    if len(order):
        own, first = np.unique(groups[order], return_index=True)
        found[own] = np.fmax(np.fmax.reduceat(values[order], first, axis=0), 0.0)
    return found


def rank_quantile(values: Array, groups: IntArray, tail: float) -> float:
    """Return the value that a new one exceeds with probability ``tail`` at most.

    The least v with    sum over groups g of #{i in g : x_i <= v} / (n_g (G + 1))  >=  1 - tail,

    infinite where there is none. With one value in each of G groups that is the one of rank
    ceil((G + 1)(1 - tail)), and a new value exceeds it with probability floor((G + 1) tail) /
    (G + 1). With several, each group counts as much as the others: if groups are exchangeable, and
    so are the values within one, a random value of a new group exceeds it with probability tail at
    most, however alike those of a group are.

    Parameters
    ----------
    values : (W,).
    groups : (W,), below 0 where a value does not count.

    References
    ----------
    Lee, Barber, Willett, "Distribution-free inference with hierarchical data", 2023.

    Examples
    --------
    >>> rank_quantile(np.array([3.0, 1.0, 2.0, 4.0]), np.arange(4), 0.4)
    3.0
    >>> rank_quantile(np.array([3.0, 1.0, 2.0, 4.0]), np.arange(4), 0.1)
    inf
    """
    kept = groups >= 0
    values, groups = values[kept], groups[kept]
    counts = np.bincount(groups)
    weights = 1.0 / ((np.count_nonzero(counts) + 1) * counts[groups])
    order = np.argsort(values, kind="stable")
    place = np.searchsorted(np.cumsum(weights[order]), 1.0 - tail - ROUNDING)
    return float(values[order][place]) if place < len(values) else math.inf


def fewest_ranks(tail: float) -> int:
    """Fewest groups of which the largest bounds a new one at ``tail``: ceil(1 / tail) - 1."""
    return math.ceil(1.0 / tail - ROUNDING) - 1
