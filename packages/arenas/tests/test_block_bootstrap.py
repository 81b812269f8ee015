"""Means of differences that depend on each other within blocks."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth_arenas.studies.block_bootstrap import block_bootstrap


def test_blocks_of_one_are_the_bootstrap_of_values() -> None:
    """With as many blocks as values the interval and p are the normal law's, for many values."""
    values = np.random.default_rng(4).normal(0.05, 1.0, 2000)
    interval = block_bootstrap(values, range(2000), np.random.default_rng(5), 20000)
    error = values.std() / np.sqrt(len(values))
    assert interval.low == pytest.approx(values.mean() - 1.96 * error, abs=0.1 * error)
    assert interval.high == pytest.approx(values.mean() + 1.96 * error, abs=0.1 * error)
    from scipy.stats import norm

    assert interval.p_value == pytest.approx(2 * norm.sf(values.mean() / error), rel=0.15)


def test_blocks_whose_values_agree_count_as_one_each() -> None:
    """Ten copies of each value say no more than one."""
    values = np.random.default_rng(6).normal(0.2, 1.0, 60)
    blocks = np.repeat(np.arange(60), 10)
    one = block_bootstrap(values, range(60), np.random.default_rng(7))
    ten = block_bootstrap(np.repeat(values, 10), blocks.tolist(), np.random.default_rng(7))
    assert (ten.mean, ten.low, ten.high) == pytest.approx((one.mean, one.low, one.high))
    assert ten.p_value == one.p_value


def test_the_null_is_refused_about_as_often_as_p_says() -> None:
    """Differences of mean 0 with one common part in each of 40 blocks of 4."""
    rng, blocks = np.random.default_rng(8), np.repeat(np.arange(40), 4)
    found = [
        block_bootstrap(
            rng.standard_normal(40)[blocks] + 0.3 * rng.standard_normal(160), blocks, rng, 999
        ).p_value
        for _ in range(300)
    ]
    assert 0.01 < np.mean(np.array(found) < 0.05) < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 300)


def test_few_blocks_cannot_show_much() -> None:
    assert block_bootstrap([1.0] * 8, "aaaabbbb", np.random.default_rng(0)).p_value == 0.5
    assert block_bootstrap([1.0], "a", np.random.default_rng(0)).p_value == 1.0
    assert np.isnan(block_bootstrap([], [], np.random.default_rng(0)).mean)
    with pytest.raises(WideberthError, match="differences"):
        block_bootstrap([1.0], "ab", np.random.default_rng(0))
