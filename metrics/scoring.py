"""Scores of forecasts against the true positions, each defined once. Plain arrays.

K forecasts of N steps are mixtures of M Gaussians: ``mean`` (K, M, N, D) in m, ``covariance``
(K, M, N, D, D) in m^2, ``weight`` (K, M), held against ``truth`` (K, N, D) in m. A step whose
truth is unknown (NaN) scores NaN. ``draws`` (S, K, N, D) are of the forecasts, as
`Forecast.sample` makes them. Nothing here averages over forecasts: which to take together is for
the caller to say.

The region of tail p (content 1 - p) is that of highest density: the smallest set that holds the
content. Of one Gaussian it is the ellipse; of a mixture see `densest_area`. A
planner that keeps clear of the ellipses of all modes keeps clear of more.
"""

import math
import re
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from ..framework.values.arrays import Array, checked_covariance, positive, probability
from .episode import SMALLEST, content_bound, squared_mahalanobis


def displacement(mean: Array, weight: Array, truth: Array) -> Array:
    """Distance from the forecast's mean to the truth, (K, N), m.

    e_h = |sum_m w_m mu_mh - x_h|. Of several modes it is the mixture's mean, which minimises
    the expected squared distance, and not the nearest or the likeliest mode: a planner does
    not know which mode will come true. The mean of e_h over the known steps and over all
    forecasts is the ADE.
    """
    centre = np.einsum("km,kmnd->knd", weight, mean)
    return np.asarray(np.linalg.norm(centre - truth, axis=-1))


def last_known(values: Array) -> Array:
    """Entry of the last known step of each forecast, (K, N) -> (K,).

    Of displacements it is the final displacement error, FDE.
    """
    known = np.isfinite(values)
    last = values.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    return np.asarray(np.take_along_axis(values, last[:, None], axis=1)[:, 0])


def negative_log_likelihood(
    mean: Array, covariance: Array, weight: Array, truth: Array, floor: float
) -> Array:
    """Negative log density of each true position, (K, N), nat (of a density in 1/m^D).

    -log sum_m w_m N(x_h; mu_mh, Sigma_mh + floor^2 I)

    Parameters
    ----------
    floor : m. Without one a single standing obstacle with a certain forecast outweighs all
        others; state it beside every number.

    Raises
    ------
    WideberthError : a floor that is not above 0.
    """
    positive("floor", floor)
    widened = covariance + floor**2 * np.eye(mean.shape[-1])
    return -log_density(mean, widened, weight, truth)


def log_density(mean: Array, covariance: Array, weight: Array, points: Array) -> Array:
    """Log density of the mixtures at points (..., K, N, D) -> (..., K, N), of 1/m^D.

    Raises
    ------
    WideberthError : what is no covariance, see `arrays.checked_covariance`.
    """
    values, vectors = np.linalg.eigh(checked_covariance("covariance", covariance, mean.shape[-1]))
    values = np.maximum(values, SMALLEST)
    turned = np.einsum("kmnji,...kmnj->...kmni", vectors, points[..., None, :, :] - mean)
    square = np.sum(turned**2 / values, axis=-1)
    normal = np.log(values).sum(axis=-1) + mean.shape[-1] * np.log(2 * np.pi)
    share = np.log(np.where(weight > 0, weight, 1.0))[..., None]
    each = np.where((weight > 0)[..., None], share - 0.5 * (square + normal), -np.inf)
    top = each.max(axis=-2, keepdims=True)
    return np.asarray(top[..., 0, :] + np.log(np.exp(each - top).sum(axis=-2)))


def energy_score(draws: Array, truth: Array) -> Array:
    """Energy score of each true position from random draws, (S, ..., D) and (..., D), m.

    E|X - x| - 1/2 E|X - X'|, where X and X' are independent draws of the forecast: proper
    (the true distribution has the least expectation) and, unlike the likelihood, finite and
    in metres. Estimated without bias from S draws, the second term from the S pairs of
    neighbours around the circle of draws.
    """
    error = np.linalg.norm(draws - truth, axis=-1).mean(axis=0)
    spread = np.linalg.norm(draws - np.roll(draws, 1, axis=0), axis=-1).mean(axis=0)
    return np.asarray(error - 0.5 * spread)


def trajectory_energy_score(draws: Array, truth: Array) -> Array:
    """Energy score of whole trajectories, (S, K, N, D) and (K, N, D) -> (K,), m.

    The distance of two trajectories is the root mean square over the steps of known truth.
    It sees whether the steps of a draw belong together, which scores per step cannot.
    """
    known = np.isfinite(truth).all(axis=-1, keepdims=True)
    share = np.sqrt(known / np.maximum(known.sum(axis=1, keepdims=True), 1))
    flat = draws * share
    aim = np.where(known, truth, 0.0) * share
    count = len(truth)
    return energy_score(flat.reshape(len(draws), count, -1), aim.reshape(count, -1))


def reached_tail(mean: Array, covariance: Array, weight: Array, truth: Array) -> Array:
    """Tail of the smallest region that holds the truth, (K, N).

    One Gaussian:   Q(D/2, d^2 / 2),   d^2 = (x - mu)^T Sigma^-1 (x - mu)
    A mixture f:    P(f(X) < f(x)),   X ~ f     (`mass_below`)

    with Q the upper regularised gamma function (the tail of chi^2). The truth lies in the
    region of any tail p if and only if this is at least p, so that one number per step gives
    the coverage at every content. If the forecast is right it is uniform.
    """
    if mean.shape[1] > 1:
        density = log_density(mean, covariance, weight, truth)
        return mass_below(mean, covariance, weight, density)
    return _chi_square_tail(mean[:, 0], covariance[:, 0], truth)


def joint_tail(
    mean: Array, joint: Array, weight: Array, truth: Array, draws: Array, floor: float
) -> Array:
    """Tail of the smallest region of trajectories that holds the true one, (K,).

    As `reached_tail`, of the N D coordinates of a trajectory together, with the ``joint``
    covariance, (K, M, N D, N D), plus floor^2 I: of smooth trajectories it is nearly
    singular, and a true one that is less smooth by a millimetre would be outside of all. NaN
    for a trajectory that is not known in full.

    Of a mixture f, in so many dimensions, it is a rank among draws, which should hold such an
    error too:   #{s : f(X_s) < f(x)} / (S + 1).   Of a right forecast that is uniform on
    0, 1/(S + 1), ...: 99 draws make every whole percent exact. The coverage of an overconfident
    one comes out too high, by some 1/S.
    """
    positive("floor", floor)
    count, modes, steps, size = mean.shape
    flat = steps * size
    means, truths = mean.reshape(count, modes, 1, flat), truth.reshape(count, 1, flat)
    wide = (joint + floor**2 * np.eye(flat))[:, :, None]
    if modes > 1:
        points = draws.reshape(len(draws), count, 1, flat)
        return _rank(means, wide, weight, truths, points)[:, 0]
    return _chi_square_tail(means[:, 0], wide[:, 0], truths)[:, 0]


def covered(tails: Array, tail: float) -> Array:
    """Tell which truths lie in the region of this tail, as 1 or 0; NaN where unknown."""
    probability("tail", tail)
    return np.where(np.isfinite(tails), tails >= tail * (1 - 1e-9), np.nan)


def inside_throughout(tails: Array, tail: float) -> Array:
    """Tell which trajectories never leave their regions of this tail, (K, N) -> (K,).

    1 or 0; NaN for a trajectory that is not known in full. Steps are not independent, so that
    regions of content 0.95 hold whole trajectories less often than 0.95 and more often than
    0.95^N.
    """
    return np.asarray(covered(tails, tail).min(axis=1))  # the least of any NaN is NaN


def region_area(mean: Array, covariance: Array, weight: Array, tail: float) -> Array:
    """Area of the forecast's region of one tail, (K, N), m^2 (in space its volume, m^3).

    V_D q^(D/2) sqrt(det Sigma) of one Gaussian, with q the quantile of chi^2 and V_D the unit
    ball's volume; `densest_area` of a mixture.
    """
    probability("tail", tail)
    if mean.shape[1] > 1:
        return densest_area(mean, covariance, weight, tail)
    size = mean.shape[-1]
    only = checked_covariance("covariance", covariance[:, 0], size)
    values = np.maximum(np.linalg.eigvalsh(only), SMALLEST)
    quantile = content_bound(size, tail)
    ball = np.pi ** (0.5 * size) / math.gamma(0.5 * size + 1)
    return np.asarray(ball * quantile ** (0.5 * size) * np.sqrt(np.prod(values, axis=-1)))


def reason_kind(reason: str) -> str:
    """Return a fallback's reason without its numbers, so that reasons can be counted.

    Examples
    --------
    >>> reason_kind("var: 12 samples, needs 20; kalman: 1 sample")
    'var: # samples, needs #; kalman: # sample'
    """
    return re.sub(r"-?\b(\d+(\.\d+)?(e[-+]?\d+)?|inf|nan)\b", "#", reason)


def _chi_square_tail(mean: Array, covariance: Array, truth: Array) -> Array:
    """Tail of one Gaussian beyond the truth, (...)."""
    from scipy.special import chdtrc

    square = squared_mahalanobis(mean, covariance, truth)
    return np.asarray(chdtrc(mean.shape[-1], square))


def _rank(mean: Array, covariance: Array, weight: Array, truth: Array, draws: Array) -> Array:
    """Share of draws that are less likely than the truth, (K, N)."""
    density = log_density(mean, covariance, weight, np.concatenate([truth[None], draws]))
    below = (density[1:] < density[0]).sum(axis=0) / len(density)
    return np.where(np.isfinite(truth).all(axis=-1), below, np.nan)


NODES = 512
"""P; the mass below a density of three modes is then known to 0.0015 (root mean square), and the
coverage of overconfident ones, 0.77 and 0.81 instead of 0.95, to 0.002; with 99 draws to 0.005."""


def mass_below(mean: Array, covariance: Array, weight: Array, log_densities: Array) -> Array:
    """Mass of the mixtures where their log density is below some number, (K, N).

    P(f(X) < f_0),   X ~ f

    Parameters
    ----------
    mean, covariance, weight : (K, M, N, D), (K, M, N, D, D), (K, M).
    log_densities : (K, N), log f_0, of 1/m^D; NaN stays NaN.

    Raises
    ------
    WideberthError : what is no covariance, see `arrays.checked_covariance`.
    """
    total = np.zeros_like(log_densities)
    for share, densities in _at_nodes(mean, covariance, weight):
        total += share[:, None] * (densities < log_densities[..., None]).mean(axis=-1)
    return np.where(np.isnan(log_densities), np.nan, total)


def densest_area(mean: Array, covariance: Array, weight: Array, tail: float) -> Array:
    """Area of the regions of highest density of one tail, (K, N), m^D.

    E [f(X) >= t] / f(X),   X ~ f

    with t where the mass below is the tail. The node at the boundary counts in part.

    Raises
    ------
    WideberthError : as `mass_below`.
    """
    parts = list(_at_nodes(mean, covariance, weight))
    densities = np.concatenate([found for _, found in parts], axis=-1)
    masses = np.repeat(np.stack([share for share, _ in parts], axis=1) / NODES, NODES, axis=1)
    masses = np.broadcast_to(masses[:, None], densities.shape)
    order = np.argsort(densities, axis=-1)
    densities, masses = (np.take_along_axis(one, order, axis=-1) for one in (densities, masses))
    inside = np.clip(np.cumsum(masses, axis=-1) - tail, 0.0, masses)
    return np.asarray((inside * np.exp(-densities)).sum(axis=-1))


def _at_nodes(mean: Array, covariance: Array, weight: Array) -> Iterator[tuple[Array, Array]]:
    """Weight, (K,), and log densities at the nodes, (K, N, P), of each mode.

    The squared distance of a node of one mode from another mode is a polynomial of second degree
    in z, whose coefficients do not depend on the node: all nodes are one matrix product.
    """
    size = mean.shape[-1]
    values, vectors = np.linalg.eigh(checked_covariance("covariance", covariance, size))
    roots = np.sqrt(np.maximum(values, SMALLEST))
    spread, whiten = vectors * roots[..., None, :], vectors / roots[..., None, :]
    powers = _powers(size)
    with np.errstate(divide="ignore"):
        share = np.log(weight)[..., None]
    level = share - np.log(roots).sum(axis=-1) - 0.5 * size * np.log(2 * np.pi)
    for mode in range(mean.shape[1]):
        gap = np.einsum("kmnji,kmnj->kmni", whiten, mean[:, mode, None] - mean)
        turn = np.einsum("kmnji,knjl->kmnil", whiten, spread[:, mode])
        square = np.einsum("kmnil,kmnij->kmnlj", turn, turn)
        slope = 2.0 * np.einsum("kmni,kmnil->kmnl", gap, turn)
        flat = square.reshape(*square.shape[:3], size * size)
        terms = np.concatenate([np.sum(gap**2, axis=-1)[..., None], slope, flat], axis=-1)
        each = level[..., None] - 0.5 * np.maximum(terms @ powers, 0.0)
        top = each.max(axis=1)
        yield weight[:, mode], top + np.log(np.exp(each - top[:, None]).sum(axis=1))


@lru_cache
def _powers(size: int) -> Array:
    """Return 1, z and z z' of every node, (1 + D + D^2, P)."""
    nodes = standard_nodes(size)
    products = (nodes[:, :, None] * nodes[:, None, :]).reshape(NODES, -1)
    return np.asarray(np.concatenate([np.ones((NODES, 1)), nodes, products], axis=1).T)


def standard_nodes(size: int) -> Array:
    """Return points that stand for a standard normal distribution, (P, D), D at most 3.

    Radii are the quantiles of chi at (j + 1/2) / P, j = 0, ..., P - 1, so that every shell holds
    its share. On a line the sign alternates. Else directions follow an additive recurrence: in the
    plane the angle grows by the golden angle; in space the height on the sphere and the angle by
    1/g and 1/g^2 turns, g^3 = g + 1.

    References
    ----------
    H. Niederreiter, "Random Number Generation and Quasi-Monte Carlo Methods", 1992, section 3.2,
    for one coordinate evenly divided beside a sequence in the others.
    """
    from scipy.special import chdtri

    number = np.arange(NODES)
    radius = np.sqrt(chdtri(size, (NODES - number - 0.5) / NODES))
    ratio = 1.618033988749895 if size < 3 else 1.324717957244746
    share = ratio ** -(size - 1.0) if size > 1 else 0.5
    turn = 2.0 * np.pi * ((0.5 + number * share) % 1.0)
    height = np.zeros(NODES) if size < 3 else 1.0 - 2.0 * ((0.5 + number / ratio) % 1.0)
    flat = np.sqrt(1.0 - height**2)
    places = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    return np.asarray(radius[:, None] * places[:, :size])
