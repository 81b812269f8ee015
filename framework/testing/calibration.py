"""The contract of a Calibration, checked on forecasts whose errors are exchangeable by design.

The errors of a person are sums of independent noise over the steps, one part of it shared by all
people of a moment: steps depend on each other, people of one moment do, and so do rows nearer
than the horizon, whose futures overlap. Rows that are a horizon apart do not. Data sets are
small, where a rank that is one off shows.
"""

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass, replace
from functools import cache, cached_property
from math import floor, sqrt
from typing import Any, cast

import numpy as np

from ..calibration import (
    Calibration,
    CalibrationScores,
    ConfidentCalibration,
    IntArray,
    MomentCalibration,
    SplitCalibration,
    largest,
)
from ..values.arrays import Array
from ..values.coverage import Coverage, Event
from .laws import Contract, Law, law, stated

STEPS, DT = 4, 0.5
TAILS = (0.2, 0.2, 0.28, 0.28)
"""Of the trials; of neither are ranks whole numbers for every number of groups."""
SETS, DRAWS = 1600, 102_400
"""Data sets, and groups that are tried, of all of them together."""
SHARED = 0.6
"""Part of the variance of an error that all people of a moment share."""
DEVIATIONS = 4.5
"""Standard errors by which a share may miss; one check in 150 000 does by chance."""


@Contract
def check_calibration(
    calibration: Calibration, *, rng: np.random.Generator | None = None
) -> Iterator[Law]:
    """Check the laws of a calibration.

    It is a frozen dataclass that states its coverage. With the fewest groups that it asks for
    all sizes are finite, with one fewer they are not, and a larger tail makes none larger. Over
    100 000 draws or more the share of groups that leave their regions is what ranks of
    exchangeable groups say, floor((n + 1) tail) / (n + 1), also of a few groups: for one step, for
    a person, for all people or for a whole task, as `Coverage.event` says. For a
    `SplitCalibration` that is the share of each step, and they sum to the tail at most. For a
    `ConfidentCalibration` the share of data sets with too large a share is that of the binomial
    distribution, at most beta. The tail is never exceeded.

    Parameters
    ----------
    calibration : to be checked.
    rng : for the errors; seeded with 0 by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    generator = np.random.default_rng(0) if rng is None else rng

    @cache
    def trials() -> list[_Trial]:
        several = 3 if isinstance(calibration, MomentCalibration) else 1
        cases = ((1, 0), (several, 2), (several, 0), (1, 2))
        seeds = generator.integers(2**31, size=len(cases)).tolist()
        return [
            _Trial(calibration, tail, *case, seed)
            for tail, case, seed in zip(TAILS, cases, seeds, strict=True)
        ]

    yield from stated(_Stated, calibration, lambda: [_Stated(calibration)])
    yield from stated(_Trial, calibration, trials)


@dataclass(frozen=True, eq=False)
class _Stated:
    """What a calibration says of itself."""

    calibration: Calibration

    @law("fields and coverage")
    def check_fields(self) -> None:
        calibration = self.calibration
        assert is_dataclass(calibration), "a calibration is a dataclass"
        assert isinstance(calibration.coverage, Coverage), "it has to state its coverage"
        assert replace(cast(Any, calibration)) == calibration, "its fields must rebuild it"

    @law("shares of the steps", SplitCalibration, "it gives the steps no shares")
    def check_shares(self) -> None:
        calibration = cast(SplitCalibration, self.calibration)
        for tail in TAILS:
            shares = calibration.tails(tail, STEPS)
            assert shares.shape == (STEPS,) and (shares > 0.0).all(), f"shares are {shares}"
            whole = shares.sum()
            assert whole <= tail * (1.0 + 1e-9), f"shares sum to {whole:.6g}; wanted {tail:g}"


@dataclass(frozen=True, eq=False)
class _Trial:
    """Many small data sets of one layout, each tried on groups of its own.

    Attributes
    ----------
    people : at each moment.
    more : groups beyond the fewest that are needed.
    """

    calibration: Calibration
    tail: float
    people: int
    more: int
    seed: int

    @property
    def _where(self) -> str:
        least = self.calibration.fewest(self.tail, STEPS)
        return f"tail {self.tail:g}, {least} + {self.more} groups, {self.people} people a moment"

    @cached_property
    def count(self) -> int:
        """Groups of a data set."""
        return self.calibration.fewest(self.tail, STEPS) + self.more

    @cached_property
    def small(self) -> CalibrationScores:
        """Layout of a data set; its errors are zeros."""
        return self._layout(self.count)

    def _layout(self, wanted: int) -> CalibrationScores:
        """Two recordings with that many groups; their errors are zeros."""
        rows = max(wanted // 2, 1)
        while True:
            found = _layout(rows, self.people, isinstance(self.calibration, MomentCalibration))
            groups = self.calibration.groups(found)
            assert groups.shape == (len(found),), f"{self._where}: a group for each score"
            if len(np.unique(groups[groups >= 0])) >= wanted:
                return found.select(np.flatnonzero(groups < wanted).tolist())
            rows += rows // 8 + 1
            assert rows < 1000 * wanted, f"{self._where}: no recording makes {wanted} groups"

    def _large(self, wanted: int) -> tuple[CalibrationScores, IntArray]:
        """Layout of as many groups to try sizes on, nothing else in it, and the groups."""
        layout = self._layout(wanted)
        groups = self.calibration.groups(layout)
        kept = np.flatnonzero(groups >= 0)
        return layout.select(kept.tolist()), groups[kept]

    def _drawn(
        self, layout: CalibrationScores, number: int, seed: int
    ) -> Iterator[CalibrationScores]:
        """Draw data sets of a layout."""
        rng = np.random.default_rng([self.seed, seed])
        for _ in range(number):
            yield replace(layout, squares=_errors(layout, rng))

    @cached_property
    def shares(self) -> tuple[Array, Array]:
        """Share of groups outside at any step (S,), and at each (S, N), by data set."""
        large, groups = self._large(DRAWS // SETS)
        outside = []
        parts = zip(
            self._drawn(self.small, SETS, 1),
            self._drawn(self.small, SETS, 2),
            self._drawn(large, SETS, 3),
            strict=True,
        )
        for learnt, scores, test in parts:
            sizes = self.calibration.sizes(scores, self.tail, learnt)
            outside.append(self._outside(test, groups, sizes))
        each = np.array(outside)
        return each[:, -1], each[:, :-1]

    def _outside(self, test: CalibrationScores, groups: IntArray, sizes: Array) -> Array:
        """Share of groups outside at each step, and at any of them, (N + 1,)."""
        out = test.squares > sizes
        out = np.concatenate([out, out.any(axis=1, keepdims=True)], axis=1)
        if self.calibration.coverage.event in (Event.STEP, Event.PERSON):
            return np.asarray(out[test.track == 0].mean(axis=0))  # any person of a group
        return np.asarray(largest(out.astype(np.float64), groups).mean(axis=0))

    @law("as many groups as it asks for")
    def check_fewest(self) -> None:
        (scores,) = self._drawn(self.small, 1, 4)
        sizes = self.calibration.sizes(scores, self.tail)
        assert sizes.shape == (STEPS,), f"{self._where}: sizes are {sizes.shape}"
        assert np.isfinite(sizes).all(), f"{self._where}: no finite size with enough groups"
        least = self.calibration.fewest(self.tail, STEPS)
        fewer = self.calibration.groups(scores) < least - 1
        sizes = self.calibration.sizes(scores.select(np.flatnonzero(fewer).tolist()), self.tail)
        assert np.isinf(sizes).any(), f"{self._where}: finite sizes with one group too few"

    @law("a larger tail, no larger size")
    def check_tail(self) -> None:
        (scores,) = self._drawn(self.small, 1, 5)
        strict, loose = (self.calibration.sizes(scores, t) for t in (self.tail, 1.3 * self.tail))
        assert (loose <= strict).all(), f"{self._where}: sizes {loose} above {strict}"

    @law("missed as often as promised")
    def check_missed(self) -> None:
        any_step, each = self.shares
        event = self.calibration.coverage.event
        aims, found = [self._of_ranks(self.tail)], [any_step]
        if isinstance(self.calibration, SplitCalibration):
            aims = [self._of_ranks(share) for share in self.calibration.tails(self.tail, STEPS)]
            found = list(each.T)
        elif event is Event.STEP:
            aims, found = aims * STEPS, list(each.T)
        alike = self.people > 1 and event is Event.PERSON
        for share, aim in zip(found, aims, strict=True):
            mean, error = _mean(share)
            text = f"{self._where}: {mean:.4f} +- {error:.4f} outside; ranks say {aim:.4f}"
            assert mean < (self.tail if alike else aim) + error, text
            assert alike or mean > aim - error, text

    @law("the tail is not exceeded")
    def check_tail_kept(self) -> None:
        any_step, each = self.shares
        single = self.calibration.coverage.event is Event.STEP
        for share in list(each.T) if single else [any_step]:
            mean, error = _mean(share)
            assert mean < self.tail + error, f"{self._where}: {mean:.4f} +- {error:.4f} outside"

    def _of_ranks(self, tail: float) -> float:
        """Share of new groups outside, of exchangeable ones."""
        if isinstance(self.calibration, ConfidentCalibration):
            chances = _binomial(self.count, tail).cumsum()
            return float(np.count_nonzero(chances <= self.calibration.beta)) / (self.count + 1)
        return floor((self.count + 1) * tail + 1e-9) / (self.count + 1)

    @law("confidence", ConfidentCalibration, "its promise is over data and future together")
    def check_confidence(self) -> None:
        beta = cast(ConfidentCalibration, self.calibration).beta
        large, groups = self._large(1500)
        learnt, test = self._drawn(large, 2, 6)
        wrong = [
            self._outside(test, groups, self.calibration.sizes(now, self.tail, learnt))[-1]
            > self.tail
            for now in self._drawn(self.small, SETS, 7)
        ]
        chances = _binomial(self.count, self.tail).cumsum()
        aim = float(chances[chances <= beta].max(initial=0.0))
        share, error = float(np.mean(wrong)), DEVIATIONS * sqrt(max(aim, 1.0 / SETS) / SETS)
        text = f"{self._where}: {share:.4f} of data sets promise too much; wanted {aim:.4f}"
        assert aim <= beta and abs(share - aim) < error, text


def _mean(shares: Array) -> tuple[float, float]:
    """Return the mean of independent shares, and by how much it may miss."""
    return float(shares.mean()), DEVIATIONS * float(shares.std()) / sqrt(len(shares))


def _layout(rows: int, people: int, moments: bool) -> CalibrationScores:
    """Two recordings of some rows with some people at each; windows that do not overlap.

    Where a calibration counts moments, rows follow each other; else they are a horizon apart.
    """
    pace = 1 if moments else STEPS
    kept = np.tile(np.repeat(np.arange(rows) * pace, people), 2)
    track = np.tile(np.arange(people), 2 * rows)
    recording = np.repeat(np.arange(2), rows * people)
    whole = np.ones(len(kept), dtype=np.bool_)
    zeros = np.zeros((len(kept), STEPS))
    return CalibrationScores(zeros, recording, kept, track, whole, (rows * pace,) * 2, DT)


def _errors(layout: CalibrationScores, rng: np.random.Generator) -> Array:
    """Squared errors (W, N) of a random walk, of which people share a part."""
    people = int(layout.track.max()) + 1
    length = max(layout.rows) + STEPS
    own, common = rng.standard_normal((2, len(layout.rows), length, people))
    noise = np.sqrt(1.0 - SHARED) * own + np.sqrt(SHARED) * common[..., :1]
    ahead = layout.row[:, None] + np.arange(STEPS)
    walked = noise[layout.recording[:, None], ahead, layout.track[:, None]].cumsum(axis=1)
    return np.asarray(walked**2)


def _binomial(count: int, tail: float) -> Array:
    """Probability of 0..count successes in so many trials."""
    found = np.ones(1)
    for _ in range(count):
        found = np.convolve(found, [1.0 - tail, tail])
    return found
