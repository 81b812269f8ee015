"""How errors grow over the steps, and sizes of that shape from the largest error of each group."""

from collections.abc import Callable

import numpy as np

from ...framework.calibration import CalibrationScores, IntArray, largest, rank_quantile, rows_of
from ...framework.values.arrays import Array
from ...metrics.episode import SMALLEST

FEWEST = 10
"""Errors at a step, below which the shape of all steps is flat."""


def shape_of(squares: Array, tail: float) -> Array:
    """Relative squared size of each step, (N,), from errors (K, N) set aside for it.

    v_h = quantile of d^2_h at 1 - tail

    NaN are passed over; with fewer than `FEWEST` errors at a step all sizes are equal.
    """
    known = np.isfinite(squares).sum(axis=0)
    if known.min() < FEWEST:
        return np.ones(squares.shape[1])
    rank = np.ceil(known * (1.0 - tail)).astype(np.int64)
    ordered = np.sort(squares, axis=0)  # NaN last
    return np.asarray(np.maximum(ordered[rank - 1, np.arange(len(rank))], SMALLEST))


def joint_sizes(
    scores: CalibrationScores,
    groups: IntArray,
    shape: Array,
    quantile: Callable[[Array], float],
) -> Array:
    """Squared sizes (N,) of one shape (N,), from the largest error of each group.

    q_h = c v_h,   c = quantile of max over the group of d^2_ih / v_h

    Parameters
    ----------
    quantile : of the largest errors (G,).
    """
    most = np.fmax.reduce(scores.squares / shape, axis=1, initial=0.0)
    return shape * quantile(largest(most, groups))


def joint_rank_sizes(
    scores: CalibrationScores, groups: IntArray, learnt: CalibrationScores | None, tail: float
) -> Array:
    """`joint_sizes` of the quantile that a new group exceeds with probability ``tail`` at most."""

    def quantile(worst: Array) -> float:
        return rank_quantile(worst, np.arange(len(worst)), tail)

    return joint_sizes(scores, groups, shape_of_moments(learnt, scores.steps, tail), quantile)


def shape_of_moments(learnt: CalibrationScores | None, steps: int, tail: float) -> Array:
    """`shape_of` the worst errors of each moment; equal sizes where nothing was set aside."""
    if learnt is None:
        return np.ones(steps)
    return shape_of(largest(learnt.squares, rows_of(learnt)), tail)
