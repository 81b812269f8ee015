"""The newest stretch of each history without a jump of the velocity."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ...framework.numerics.chi_square import content_bound
from ...framework.values.arrays import Array
from .history import Histories
from .propagation import joint_covariance, white_acceleration

LONGEST_STRETCH = 10
"""Steps of the longest stretch."""
DOUBT = 1e-7
"""Probability that a line through one stretch is refused although nothing jumped. People in
recordings sway more than that: with 1e-3 their forecasts have 3 % more energy score."""


def since_jump(past: Histories, variance: Array, dt: float, density: float) -> Histories:
    """Begin each history anew at its last jump of the velocity, or `LONGEST_STRETCH` steps ago.

    p_j = a + b t_j + e_j,   sum_j |e_j|^2 / s_w <= chi^2 quantile

    Lines through the newest 3, 4, ... samples (w = 2, 3, ...) are fitted by least squares, until
    the first whose residuals are larger than noise of variance r and white acceleration of
    density q make them on average, s_w = r + q dt^3 g_w. A velocity that jumps at a sample is
    followed one step later; one that jumps between two samples is known two steps later.

    Parameters
    ----------
    past : histories; what was filled in counts as observed.
    variance : (O,), m^2, of a measurement along an axis, r.
    dt : s.
    density : m^2/s^3, q.
    """
    count, rows, size = past.positions.shape
    longest = min(rows - 1, LONGEST_STRETCH)
    recent = past.positions[:, rows - 1 - longest :].transpose(1, 0, 2).reshape(longest + 1, -1)
    residual, bound, drift = _lines(longest, size)
    errors = (residual @ recent).reshape(longest + 1, longest + 1, count, size)
    squares = np.einsum("wtod,wtod->ow", errors, errors)
    fine = squares <= bound * (variance[:, None] + density * dt**3 * drift)
    length = np.where(fine.all(axis=1), longest, np.argmin(fine, axis=1) - 1)
    began = np.maximum(past.began, rows - 1 - length)
    return replace(past, began=began, observed=past.observed & (np.arange(rows) >= began[:, None]))


@lru_cache(maxsize=32)
def _lines(longest: int, size: int) -> tuple[Array, Array, Array]:
    """Least squares through the newest w + 1 of W + 1 samples, w = 0, ..., W.

    Returns
    -------
    residual : (W + 1, W + 1, W + 1), from samples to their residuals, 0 for those before.
    bound : (W + 1,), quantile of chi^2 of the residuals in ``size`` coordinates.
    drift : (W + 1,), g_w, mean square of a residual by white acceleration of density 1.
    """
    total = longest + 1
    residual = np.zeros((total, total, total))
    bound, drift = np.full(total, np.inf), np.zeros(total)
    model = white_acceleration(1.0, 1.0, 1)
    walked = np.zeros((total, total))
    walked[1:, 1:] = joint_covariance(*model, np.zeros((2, 2)), 1, longest)
    for steps in range(2, total):
        design = np.stack([np.ones(steps + 1), np.arange(steps + 1.0)], axis=1)
        rest = np.eye(steps + 1) - design @ np.linalg.pinv(design)
        residual[steps, -steps - 1 :, -steps - 1 :] = rest
        free = steps - 1
        bound[steps] = content_bound(size * free, DOUBT)
        drift[steps] = np.trace(rest @ walked[: steps + 1, : steps + 1]) / free
    return residual, bound, drift
