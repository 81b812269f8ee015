"""Statistics of episodes: how sure a share is, and whether two controllers differ.

Episodes of one seed are paired: both controllers met the same situation, and a comparison
seed by seed sees differences that shares alone would hide.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..framework.values.arrays import Array, BoolArray, checked, probability, whole
from ..framework.values.errors import WideberthError


def clopper_pearson(successes: int, trials: int, tail: float = 0.05) -> tuple[float, float]:
    """Interval that holds the true share with probability 1 - tail or more, the exact one.

    With k of n, its ends are the shares at which k or more, or k or fewer, have probability
    tail / 2::

        low = B^-1(tail / 2; k, n - k + 1),    high = B^-1(1 - tail / 2; k + 1, n - k)

    where B is the regularised incomplete beta function; low is 0 where k = 0, high is 1 where
    k = n, and without trials the interval is (0, 1). (Clopper and Pearson 1934.)

    Parameters
    ----------
    successes, trials : k and n, counts.
    tail : 1 - confidence, both sides together.

    Raises
    ------
    WideberthError : counts that are negative or not whole, more successes than trials, a tail
        outside (0, 1).

    Examples
    --------
    >>> low, high = clopper_pearson(0, 20)
    >>> low, round(high, 4)
    (0.0, 0.1684)
    """
    from statsmodels.stats.proportion import proportion_confint

    k, n = whole("successes", successes, least=0), whole("trials", trials, least=0)
    probability("tail", tail)
    if k > n:
        raise WideberthError(f"successes is {k} of {n} trials; wanted no more than the trials")
    if not n:
        return 0.0, 1.0
    interval: Any = proportion_confint(k, n, alpha=tail, method="beta")
    return float(interval[0]), float(interval[1])


def mcnemar(first: ArrayLike, second: ArrayLike) -> float:
    """P value of "both succeed equally often", from the pairs in which they differ.

    Of n pairs in which exactly one succeeded, how many were the first one's is binomial with
    share 1/2 if neither is better; with b the rarer count, the exact two-sided p value is::

        p = min(1, 2 Pr(X <= b)),    X ~ Bin(n, 1/2)

    It is 1 where no pair differs. (McNemar 1947, in its exact form.)

    Parameters
    ----------
    first, second : (K,), success of each in the same situations, true or false.

    Raises
    ------
    WideberthError : lengths that differ, or entries other than true and false.

    Examples
    --------
    >>> mcnemar([1, 1, 1, 1, 1, 0], [0, 0, 0, 0, 0, 0])
    0.0625
    """
    from statsmodels.stats.contingency_tables import mcnemar as exact

    one = checked("first", np.asarray(first, dtype=np.float64), (None,))
    two = checked("second", np.asarray(second, dtype=np.float64), (len(one),))
    if not np.isin(np.concatenate([one, two]), (0.0, 1.0)).all():
        raise WideberthError("first and second must hold successes: true or false in every pair")
    differing = [[0, int(np.sum(one > two))], [int(np.sum(two > one)), 0]]
    test: Any = exact(differing, exact=True)
    return float(test.pvalue)


def signed_rank(differences: Array) -> float:
    """P value of "neither is larger" by Wilcoxon's signed-rank test of paired differences.

    Two-sided, exact of few pairs; pairs without a difference do not count, and 1 is returned where
    there are no others. Unknown differences (NaN) are no pairs; NaN without any pair.
    (Wilcoxon 1945.)
    """
    from scipy.stats import wilcoxon

    pairs = differences[np.isfinite(differences)]
    if not pairs.any():
        return 1.0 if len(pairs) else float("nan")
    return float(wilcoxon(pairs[pairs != 0.0]).pvalue)


def known_mean(values: Any) -> float:
    """Mean of the finite ones among some values; NaN without any."""
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    return float(known.mean()) if known.size else float("nan")


def quartiles(values: Array) -> tuple[float, float, float]:
    """Return lower quartile, median and upper quartile of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    if not known.size:
        return float("nan"), float("nan"), float("nan")
    low, middle, high = map(float, np.quantile(known, (0.25, 0.5, 0.75)))
    return low, middle, high


def mean_of_rows(values: Array) -> Array:
    """Mean over the last axis."""
    return np.asarray(values.mean(axis=-1))


def bootstrap_interval(
    values: ArrayLike,
    rng: np.random.Generator,
    statistic: Callable[[Array], Array] = mean_of_rows,
    tail: float = 0.05,
    resamples: int = 4000,
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of independent values.

    The values are drawn anew with replacement, as many as there are; the interval reaches from
    the tail / 2 to the 1 - tail / 2 quantile of the statistic over the resamples. Of paired
    episodes the values are the differences, so that the pairs stay together; of episodes with
    many steps each, one value per episode. With few values it is too short: for a mean of 10
    about 90 % instead of 95 %. (Efron and Tibshirani 1993.)

    Parameters
    ----------
    values : (K,), finite.
    rng : of the draws.
    statistic : (..., K) -> (...); the mean by default.
    tail : 1 - confidence, both sides together.
    resamples : how many.

    Returns
    -------
    Both ends; NaN without values.

    Raises
    ------
    WideberthError : values that are not finite, a tail outside (0, 1).
    """
    from scipy.stats import bootstrap

    known = checked("values", np.asarray(values, dtype=np.float64), (None,))
    probability("tail", tail)
    whole("resamples", resamples)
    if len(known) < 2:
        alone = float(statistic(known)) if len(known) else float("nan")
        return alone, alone
    found = bootstrap(
        (known,), lambda drawn, axis: statistic(drawn), n_resamples=resamples, batch=500,
        vectorized=True, confidence_level=1.0 - tail, method="percentile", rng=rng,
    ).confidence_interval  # fmt: skip
    return float(found.low), float(found.high)


def ratio(part: Any, whole_of: Any) -> Any:
    """Ratio of numbers or arrays, 0 where there is nothing to divide by."""
    return np.where(whole_of > 0, part / np.where(whole_of > 0, whole_of, 1.0), 0.0)[()]


def ratio_interval(parts: Array, wholes: Array) -> tuple[float, float]:
    """Bootstrap interval of sum(parts) / sum(wholes), drawing whole episodes or blocks.

    Parameters
    ----------
    parts, wholes : (K,), of each of them.

    Examples
    --------
    >>> ratio_interval(np.array([1.0, 1.0, 1.0]), np.array([2.0, 2.0, 2.0]))
    (0.5, 0.5)
    """

    def share(drawn: Array) -> Array:
        rows = drawn.astype(np.int64)
        return np.asarray(ratio(parts[rows].sum(axis=-1), wholes[rows].sum(axis=-1)))

    numbers = np.arange(len(parts), dtype=np.float64)
    return bootstrap_interval(numbers, np.random.default_rng(0), share, resamples=1000)


def pareto(costs: Array | Sequence[Sequence[float]]) -> BoolArray:
    """Mark the rows that none dominates: as low in every column and lower in one, (K, M) -> (K,).

    A row with something unknown (NaN) is beaten by all and beats none.

    Examples
    --------
    >>> pareto([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0]]).tolist()
    [True, True, False]
    """
    table = np.asarray(costs, dtype=np.float64)
    below = (table[:, None] <= table).all(axis=2) & (table[:, None] < table).any(axis=2)
    return np.asarray(~below.any(axis=0) & np.isfinite(table).all(axis=1), dtype=np.bool_)
