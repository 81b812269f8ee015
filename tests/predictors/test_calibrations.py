"""Calibrations: the promise of each, in small samples, and what breaks it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
import pytest
from scipy.stats import beta as beta_distribution
from scipy.stats import binom

from wideberth.framework.calibration import (
    Calibration,
    CalibrationScores,
    ConfidentCalibration,
    IntArray,
    MomentCalibration,
    SplitCalibration,
    fewest_ranks,
    largest,
    moments,
    rank_quantile,
    rows_of,
    stretches,
)
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.testing.calibration import check_calibration
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.coverage import Coverage, Event
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.calibrations.boole import Boole
from wideberth.predictors.calibrations.joint_person import JointPerson
from wideberth.predictors.calibrations.joint_plan import JointPlan
from wideberth.predictors.calibrations.per_step import PerStep
from wideberth.predictors.calibrations.sample_and_discard import SampleAndDiscard
from wideberth.predictors.calibrations.task import WholeTask
from wideberth.predictors.core.error_shape import shape_of
from wideberth.tests.helpers.contracts import Contract

SHORT = WholeTask(seconds=3.0)
CONTRACT = Contract.of(
    [
        *(load("calibrations", name)() for name in names("calibrations") if name != "task"),
        SHORT,
        Boole(growth=1.0),
        SampleAndDiscard(beta=0.1),
    ],
    check_calibration.laws,
)


@pytest.mark.parametrize(("calibration", "law"), CONTRACT.cases())
def test_calibrations_keep_their_laws(calibration: str, law: str) -> None:
    CONTRACT.check(calibration, law)


Change = Callable[[CalibrationScores, float, CalibrationScores | None], Array]
Grouping = Callable[[CalibrationScores], IntArray]


def doubled(
    scores: CalibrationScores, tail: float, learnt: CalibrationScores | None
) -> tuple[Array, Array]:
    """Largest error of each moment at any step, and sizes of one shape."""
    return largest(scores.squares, moments(scores)).max(axis=1), np.ones(scores.steps)


def of_rank(shift: int) -> Change:
    """Take another rank than the right one, of all people at all steps of a moment."""

    def sizes(scores: CalibrationScores, tail: float, learnt: CalibrationScores | None) -> Array:
        worst, shape = doubled(scores, tail, learnt)
        rank = int(np.ceil((len(worst) + 1) * (1.0 - tail) - 1e-9)) + shift
        return shape * (np.sort(worst)[rank - 1] if rank <= len(worst) else np.inf)

    return sizes


def each_person(scores: CalibrationScores) -> IntArray:
    """Take the people of one moment for moments of their own."""
    kept = moments(scores) >= 0
    return np.where(kept, np.cumsum(kept) - 1, -1)


@final
@dataclass(frozen=True)
class Wrong(MomentCalibration):
    """Wrong in one way."""

    change: Change = field(default_factory=lambda: of_rank(0))
    grouping: Grouping = moments
    coverage = JointPlan.coverage

    def groups(self, scores: CalibrationScores) -> IntArray:
        return self.grouping(scores)

    def fewest(self, tail: float, steps: int) -> int:
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        return self.change(scores, tail, learnt)


def by_grouping(grouping: Grouping) -> Change:
    """Sizes for all people and steps of a group, whatever a group is."""

    def sizes(scores: CalibrationScores, tail: float, learnt: CalibrationScores | None) -> Array:
        worst = largest(scores.squares.max(axis=1), grouping(scores))
        return np.full(scores.steps, rank_quantile(worst, np.arange(len(worst)), tail))

    return sizes


def broken(calibration: Calibration) -> set[str]:
    found = set()
    for law in check_calibration.laws(calibration):
        try:
            if not law.exception:
                law.check()
        except AssertionError:
            found.add(law.name)
    return found


OFTEN, KEPT = "missed as often as promised", "the tail is not exceeded"


def test_the_right_one_breaks_no_law() -> None:
    assert not broken(Wrong())


@pytest.mark.parametrize("shift", [-1, 1])
def test_a_rank_that_is_one_off_is_seen(shift: int) -> None:
    found = broken(Wrong(of_rank(shift)))
    assert OFTEN in found and (KEPT in found) == (shift < 0)


@pytest.mark.parametrize("grouping", [rows_of, each_person])
def test_a_wrong_split_of_the_data_is_seen(grouping: Grouping) -> None:
    """Rows whose futures overlap, or people of one moment, taken for independent ones."""
    assert OFTEN in broken(Wrong(by_grouping(grouping), grouping))


def test_a_calibration_that_learns_from_what_it_calibrates_with_is_seen() -> None:
    """The shape of the errors has to come from other data."""

    def sizes(scores: CalibrationScores, tail: float, learnt: CalibrationScores | None) -> Array:
        worst = largest(scores.squares, moments(scores))
        shape = worst[np.argmax(worst.max(axis=1))]
        ratios = (worst / shape).max(axis=1)
        return np.asarray(shape * rank_quantile(ratios, np.arange(len(ratios)), tail))

    assert OFTEN in broken(Wrong(sizes))


@final
@dataclass(frozen=True)
class TooMuch(SplitCalibration):
    """Gives every step the whole tail."""

    coverage = Boole.coverage

    def tails(self, tail: float, steps: int) -> Array:
        return np.full(steps, tail)

    def groups(self, scores: CalibrationScores) -> IntArray:
        return moments(scores)

    def fewest(self, tail: float, steps: int) -> int:
        return fewest_ranks(tail)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        worst = largest(scores.squares, moments(scores))
        each = np.arange(len(worst))
        return np.array([rank_quantile(column, each, tail) for column in worst.T])


def test_a_split_that_gives_too_much_is_seen() -> None:
    assert {"shares of the steps", KEPT} <= broken(TooMuch())


@final
@dataclass(frozen=True)
class Discarding(ConfidentCalibration):
    """Discards some moments more than it may."""

    more: int = 0
    beta: float = 0.1
    coverage = SampleAndDiscard.coverage

    def groups(self, scores: CalibrationScores) -> IntArray:
        return moments(scores)

    def fewest(self, tail: float, steps: int) -> int:
        return SampleAndDiscard(self.beta).fewest(tail, steps)

    def sizes(
        self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
    ) -> Array:
        worst = largest(scores.squares.max(axis=1), moments(scores))
        discarded = SampleAndDiscard(self.beta).discarded(len(worst), tail)
        if discarded < 0:
            return np.full(scores.steps, np.inf)
        return np.full(scores.steps, np.sort(worst)[-1 - discarded - self.more])


def test_a_moment_too_many_discarded_is_seen() -> None:
    assert not broken(Discarding())
    assert {OFTEN, "confidence"} <= broken(Discarding(more=1))


def test_people_who_are_alike_count_once_in_a_rank() -> None:
    """Twelve moments of five equal people: pooled, the tail of 0.1 would be missed by 0.154."""
    values = np.repeat(np.arange(12.0), 5)
    groups = np.repeat(np.arange(12), 5)
    assert rank_quantile(values, groups, 0.1) == 11.0  # 1 - 12 / 13 outside
    assert rank_quantile(values, np.arange(60), 0.1) == 10.0  # 1 - 11 / 13 outside


def test_the_rank_of_single_values_is_the_usual_one() -> None:
    rng = np.random.default_rng(0)
    for count in range(1, 40):
        values = rng.permutation(np.arange(1.0, count + 1))
        for tail in (0.05, 0.1, 0.25, 1 / 3, 0.5, 0.9):
            rank = int(np.ceil((count + 1) * (1 - tail) - 1e-9))
            wanted = rank if rank <= count else np.inf
            assert rank_quantile(values, np.arange(count), tail) == wanted
            assert (count < fewest_ranks(tail)) == (wanted == np.inf)
    assert rank_quantile(np.zeros(0), np.zeros(0, dtype=np.int64), 0.5) == np.inf


def scores_of(rows: tuple[int, ...], steps: int = 3) -> CalibrationScores:
    """One person at every row of some recordings."""
    recording = np.repeat(np.arange(len(rows)), rows)
    row = np.concatenate([np.arange(count) for count in rows])
    zeros = np.zeros(len(row), dtype=np.int64)
    whole = np.ones(len(row), dtype=np.bool_)
    return CalibrationScores(np.zeros((len(row), steps)), recording, row, zeros, whole, rows, 0.5)


def test_moments_are_a_horizon_apart() -> None:
    scores = scores_of((8, 4))
    assert moments(scores).tolist() == [0, -1, -1, 1, -1, -1, 2, -1, 3, -1, -1, 4]
    assert rows_of(scores).tolist() == [*range(12)]


def test_tasks_are_a_horizon_apart_and_whole() -> None:
    found = stretches(scores_of((12, 4, 1)), 2)
    assert found.tolist() == [0, 0, -1, -1, -1, 1, 1, -1, -1, -1, 2, 2, 3, 3, -1, -1, -1]
    tasks = WholeTask(seconds=1.0).groups(scores_of((12, 4, 1)))
    assert tasks.tolist() == found.tolist()


def test_nobody_at_some_steps_is_no_error() -> None:
    values = np.array([[1.0, np.nan], [3.0, 2.0], [np.nan, np.nan], [9.0, 9.0]])
    assert largest(values, np.array([0, 0, 1, -1])).tolist() == [[3.0, 2.0], [0.0, 0.0]]


def test_the_shape_follows_the_errors_and_needs_some() -> None:
    rng = np.random.default_rng(1)
    squares = rng.chisquare(2, (4000, 3)) * np.array([1.0, 4.0, 9.0])
    squares[::7, 2] = np.nan
    shape = shape_of(squares, 0.1)
    np.testing.assert_allclose(shape / shape[0], [1.0, 4.0, 9.0], rtol=0.1)
    np.testing.assert_allclose(shape[0], np.quantile(squares[:, 0], 0.9), rtol=0.01)
    assert shape_of(squares[:9], 0.1).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize(("tail", "beta"), [(0.1, 0.01), (0.05, 0.01), (0.2, 0.1), (0.1, 1e-6)])
def test_discarded_moments_are_those_of_the_binomial_and_of_the_beta(
    tail: float, beta: float
) -> None:
    method = SampleAndDiscard(beta)
    least = method.fewest(tail, 12)
    assert method.discarded(least, tail) == 0 and method.discarded(least - 1, tail) == -1
    for count in (least, least + 30, 3 * least, 500):
        k = method.discarded(count, tail)
        assert binom.cdf(k, count, tail) <= beta < binom.cdf(k + 1, count, tail)
        # Probability that the share outside exceeds the tail, as the distribution of its rank.
        assert beta_distribution.sf(tail, k + 1, count - k) <= beta
    assert {(0.1, 0.01): 44, (0.05, 0.01): 90}.get((tail, beta), least) == least


def test_shares_of_steps_and_the_moments_they_need() -> None:
    assert Boole().fewest(0.1, 12) == 119 and JointPlan().fewest(0.1, 12) == 9
    assert Boole(1.0).tails(0.1, 4).tolist() == pytest.approx([0.01, 0.02, 0.03, 0.04])
    assert WholeTask().fewest(0.1, 12) == JointPerson().fewest(0.1, 12) == 9
    assert PerStep().fewest(0.05, 12) == 19


def test_bad_settings_are_refused() -> None:
    for make in (
        lambda: Boole(growth=-1.0), lambda: SampleAndDiscard(beta=0.0),
        lambda: WholeTask(seconds=0.0),
    ):  # fmt: skip
        with pytest.raises(WideberthError, match=r"(boole|sample_and_discard|task)\."):
            make()


def test_the_law_is_that_of_the_event() -> None:
    """One that promises all people, calibrated for one of them, is seen."""
    promised = Coverage(Event.PLAN, "1 - tail", "moments are exchangeable", "lindemann2023safe")

    @final
    @dataclass(frozen=True)
    class Boasting(MomentCalibration):
        coverage = promised

        def groups(self, scores: CalibrationScores) -> IntArray:
            return moments(scores)

        def fewest(self, tail: float, steps: int) -> int:
            return fewest_ranks(tail)

        def sizes(
            self, scores: CalibrationScores, tail: float, learnt: CalibrationScores | None = None
        ) -> Array:
            return JointPerson().sizes(scores, tail, learnt)

    assert KEPT in broken(Boasting())


def test_scores_are_selected_row_by_row() -> None:
    scores = replace(scores_of((3, 2)), squares=np.arange(15.0).reshape(5, 3))
    some = scores.select([4, 1])
    assert some.squares.tolist() == [[12.0, 13.0, 14.0], [3.0, 4.0, 5.0]]
    assert some.recording.tolist() == [1, 0] and some.rows == (3, 2) and len(some) == 2
