"""Place and velocity from the longest straight stretch up to now, so that a jump is followed."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...framework.values.arrays import Array
from .history import Histories, IntArray

LONGEST_STRETCH = 10
"""Steps of the longest stretch."""
DOUBT = 0.05
"""Probability that a stretch which is straight is taken for one that is not."""


@dataclass(frozen=True, eq=False)
class Stretches:
    """Straight lines through the newest samples of each obstacle.

    Attributes
    ----------
    place : (O, D), m, at the newest observed sample, relative to the origin of the history.
    velocity : (O, D), m/s; 0 with a single sample.
    length : (O,), steps of each stretch; 0 with a single sample.
    shares : (O, 3), by which the variance of a measurement is multiplied for those of place, of
        place with velocity (1/s), and of velocity (1/s^2).
    """

    place: Array
    velocity: Array
    length: IntArray
    shares: Array


def straight_stretches(past: Histories, variance: Array, dt: float) -> Stretches:
    """Fit a line to the longest newest stretch of each history that can be straight.

    p_j = a + b t_j + e_j,   e ~ N(0, r I),   sum_j |e_j|^2 / r <= chi^2 quantile

    Lines through the newest 3, 4, ... samples are fitted by least squares, until the first whose
    residuals are larger than noise makes them. A velocity that jumps at a sample is followed one
    step later; one that jumps between two samples is known two steps later.

    Parameters
    ----------
    past : histories; what was filled in counts as observed.
    variance : (O,), m^2, of a measurement along an axis, r.
    dt : s.
    """
    count, rows, size = past.positions.shape
    longest = min(rows - 1, LONGEST_STRETCH)
    recent = past.positions[:, rows - 1 - longest :].transpose(1, 0, 2).reshape(longest + 1, -1)
    fits = _fits(longest, size)
    residual = (fits.residual @ recent).reshape(longest + 1, longest + 1, count, size)
    squares = np.einsum("wtod,wtod->ow", residual, residual)
    known = np.minimum(past.length - 1, longest)
    fine = squares <= fits.bound * variance[:, None]
    fine &= np.arange(longest + 1) <= known[:, None]
    length = np.where(fine.all(axis=1), longest, np.argmin(fine, axis=1) - 1)
    length = np.maximum(length, 0)
    row = np.arange(count)
    lines = (fits.line @ recent).reshape(longest + 1, 2, count, size)
    shares = fits.shares[length] / dt ** np.arange(3)
    return Stretches(lines[length, 0, row], lines[length, 1, row] / dt, length, shares)


@dataclass(frozen=True, eq=False)
class _Fits:
    """Least squares through the newest w + 1 of W + 1 samples, w = 0, ..., W, in steps.

    residual : (W + 1, W + 1, W + 1), from samples to their residuals, 0 for those before.
    line : (W + 1, 2, W + 1), from samples to the place at the newest one, and to the velocity.
    shares : (W + 1, 3), as in `Stretches`, in steps.
    bound : (W + 1,), quantile of chi^2 of the residuals.
    """

    residual: Array
    line: Array
    shares: Array
    bound: Array


@lru_cache(maxsize=32)
def _fits(longest: int, size: int) -> _Fits:
    """Return the fits of all stretches of up to ``longest`` steps in ``size`` coordinates."""
    from scipy.special import gammainccinv

    total = longest + 1
    residual, line = np.zeros((total, total, total)), np.zeros((total, 2, total))
    shares, bound = np.zeros((total, 3)), np.full(total, np.inf)
    line[0, 0, -1], shares[0, 0] = 1.0, 1.0
    for steps in range(1, total):
        design = np.stack([np.ones(steps + 1), np.arange(-steps, 1.0)], axis=1)
        solve = np.linalg.pinv(design)
        line[steps, :, -steps - 1 :] = solve
        residual[steps, -steps - 1 :, -steps - 1 :] = np.eye(steps + 1) - design @ solve
        inverse = np.linalg.inv(design.T @ design)
        shares[steps] = inverse[0, 0], inverse[0, 1], inverse[1, 1]
        if steps > 1:
            bound[steps] = 2.0 * gammainccinv(0.5 * size * (steps - 1), DOUBT)
    return _Fits(residual, line, shares, bound)
