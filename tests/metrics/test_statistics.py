"""Intervals and paired tests against SciPy, statsmodels, closed forms and coverage."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.statistics import (
    bootstrap_interval,
    clopper_pearson,
    known_mean,
    mcnemar,
    quartiles,
)


@pytest.mark.parametrize(("count", "trials"), [(0, 1), (1, 1), (3, 10), (213, 500), (500, 500)])
@pytest.mark.parametrize("tail", [0.05, 1e-3])
def test_the_interval_of_a_share_is_scipys(count: int, trials: int, tail: float) -> None:
    from scipy.stats import binomtest

    theirs = binomtest(count, trials).proportion_ci(1.0 - tail, "exact")
    assert clopper_pearson(count, trials, tail) == pytest.approx((theirs.low, theirs.high))


def test_the_ends_are_the_shares_at_which_the_count_is_rare() -> None:
    from scipy.stats import binom

    low, high = clopper_pearson(7, 40, 0.1)
    assert binom.sf(6, 40, low) == pytest.approx(0.05)
    assert binom.cdf(7, 40, high) == pytest.approx(0.05)


def test_of_nothing_nothing_is_known() -> None:
    assert clopper_pearson(0, 0) == (0.0, 1.0)
    assert clopper_pearson(0, 9)[0] == 0.0 and clopper_pearson(9, 9)[1] == 1.0
    # Where none of n failed the other end has a closed form.
    assert clopper_pearson(0, 500)[1] == pytest.approx(1.0 - 0.025 ** (1 / 500))
    # A tail so small that 1 - tail is 1: the interval is wide, not empty.
    assert clopper_pearson(10, 20, 1e-30)[1] > 0.99


def test_intervals_of_shares_hold_the_truth_as_often_as_they_say() -> None:
    """Over all counts, weighted by their probability: at least 95 % for any share."""
    from scipy.stats import binom

    ends = np.array([clopper_pearson(k, 25) for k in range(26)])
    for share in np.linspace(0.01, 0.99, 33):
        held = (ends[:, 0] <= share) & (share <= ends[:, 1])
        assert binom.pmf(np.arange(26), 25, share)[held].sum() >= 0.95


def test_paired_successes_against_statsmodels() -> None:
    from statsmodels.stats.contingency_tables import mcnemar as theirs

    rng = np.random.default_rng(3)
    for count in (5, 40, 500):
        one, two = rng.random(count) < 0.8, rng.random(count) < 0.7
        table = [
            [np.sum(one & two), np.sum(one & ~two)],
            [np.sum(~one & two), np.sum(~one & ~two)],
        ]
        expected = float(theirs(table, exact=True).pvalue)
        assert mcnemar(one, two) == pytest.approx(min(expected, 1.0))
        assert mcnemar(one, two) == mcnemar(two, one)


def test_paired_successes_that_do_not_differ() -> None:
    assert mcnemar([], []) == 1.0
    assert mcnemar([1, 0, 1], [1, 0, 1]) == 1.0
    assert mcnemar([1, 0], [0, 1]) == 1.0
    assert mcnemar(np.ones(10), np.zeros(10)) == pytest.approx(2 * 0.5**10)


def test_the_bootstrap_of_a_mean_is_that_of_the_normal_law() -> None:
    """For many values the percentile interval is mean +- 1.96 standard errors."""
    values = np.random.default_rng(4).exponential(2.0, 4000)
    low, high = bootstrap_interval(values, np.random.default_rng(5))
    error = values.std() / np.sqrt(len(values))
    assert low == pytest.approx(values.mean() - 1.96 * error, abs=0.15 * error)
    assert high == pytest.approx(values.mean() + 1.96 * error, abs=0.15 * error)


def test_the_bootstrap_holds_the_true_mean_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(6)
    ends = [bootstrap_interval(rng.standard_normal(30), rng, resamples=500) for _ in range(400)]
    share = np.mean([low <= 0.0 <= high for low, high in ends])
    # 30 normal values: 93.6 % (normal quantiles with the plug-in deviation), 4 sigma below.
    assert 0.936 - 4 * 0.0123 < share < 0.975


def test_the_bootstrap_of_every_resample_of_two_values() -> None:
    """Of the resamples of {0, 1} a quarter have mean 0 and a quarter mean 1."""
    rng = np.random.default_rng(7)
    assert bootstrap_interval([0.0, 1.0], rng) == (0.0, 1.0)
    assert bootstrap_interval([0.0, 1.0], rng, tail=0.6) == (0.5, 0.5)
    assert bootstrap_interval([3.0], rng) == (3.0, 3.0)
    assert np.isnan(bootstrap_interval([], rng)).all()
    medians = bootstrap_interval(np.arange(101.0), rng, lambda rows: np.median(rows, axis=-1))
    assert medians == pytest.approx((40.0, 60.0), abs=2.0)


def test_the_same_draws_give_the_same_interval() -> None:
    values = np.random.default_rng(8).standard_normal(20)
    first, second = (bootstrap_interval(values, np.random.default_rng(9)) for _ in range(2))
    assert first == second


def test_bad_input_is_refused() -> None:
    with pytest.raises(WideberthError, match="5 of 4 trials"):
        clopper_pearson(5, 4)
    with pytest.raises(WideberthError, match="successes"):
        clopper_pearson(-1, 4)
    with pytest.raises(WideberthError, match="tail"):
        clopper_pearson(1, 4, 0.0)
    with pytest.raises(WideberthError, match="second"):
        mcnemar([1, 0], [1])
    with pytest.raises(WideberthError, match="true or false"):
        mcnemar([0.5], [1])
    with pytest.raises(WideberthError, match="values"):
        bootstrap_interval([np.nan], np.random.default_rng(0))


def test_what_is_not_known_does_not_count() -> None:
    values = np.array([4.0, np.nan, 1.0, 2.0, np.inf, 3.0, 0.0])
    assert quartiles(values) == (1.0, 2.0, 3.0) and known_mean(values) == 2.0
    assert np.isnan([*quartiles(values[[1, 4]]), known_mean([]), known_mean([np.nan])]).all()
