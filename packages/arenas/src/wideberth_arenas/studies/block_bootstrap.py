"""Means of differences that depend on each other within blocks."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wideberth.framework.values.arrays import checked, whole


@dataclass(frozen=True)
class PairedMean:
    """Mean of paired differences, its 95 % interval, and the p value of "it is 0"."""

    mean: float
    low: float
    high: float
    p_value: float


def block_bootstrap(
    differences: ArrayLike,
    blocks: Sequence[Any],
    rng: np.random.Generator,
    resamples: int = 10000,
) -> PairedMean:
    """Mean of differences that depend on each other within blocks, by drawing whole blocks.

    Of B blocks, B are drawn with replacement; the mean of a draw is that of all differences in
    it. The interval is the percentiles'; with m of the K means at 0 or on its other side::

        p = min(1, max(2 (m + 1) / (K + 1), 2^(1 - B)))

    where the second term is what B blocks can show at all that differ the same way: a bootstrap
    of few blocks knows nothing of others. (Davison and Hinkley 1997.)

    Parameters
    ----------
    differences : (N,), finite. blocks : (N,), which block each belongs to.
    rng : of the draws. resamples : K.

    Raises
    ------
    WideberthError : differences that are not finite, or other numbers of them and of blocks.

    Examples
    --------
    >>> result = block_bootstrap([1.0, 2.0, 3.0], ["a", "a", "b"], np.random.default_rng(0))
    >>> result.mean, result.low, result.high
    (2.0, 1.5, 3.0)
    """
    values = checked("differences", np.asarray(differences, dtype=np.float64), (len(blocks),))
    whole("resamples", resamples)
    if not len(values):
        unknown = float("nan")
        return PairedMean(unknown, unknown, unknown, 1.0)
    names = {block: i for i, block in enumerate(dict.fromkeys(blocks))}
    member = [names[block] for block in blocks]
    sums, counts = np.bincount(member, values), np.bincount(member)
    drawn = rng.integers(len(names), size=(resamples, len(names)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    mean, (low, high) = float(values.mean()), np.quantile(means, (0.025, 0.975))
    opposite = int(np.sum(means <= 0.0 if mean > 0.0 else means >= 0.0))
    p_value = min(1.0, max(2.0 * (opposite + 1) / (resamples + 1), 2.0 ** (1 - len(names))))
    return PairedMean(mean, float(low), float(high), p_value)
