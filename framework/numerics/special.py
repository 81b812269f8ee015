"""Special functions: the normal, gamma and beta distributions, and Carlson's integrals.

They cover what planning needs and no more: orders of gamma are multiples of 1/2, as chi^2 has
them, and both orders of beta are counts.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from ..values.arrays import Array, probability

_ROUNDING = 1e-15
"""A step of Newton's below this share changes nothing any more."""
_ALIKE = 1e-3
"""Where numbers differ by this share of their mean, Carlson's series of degree 5 are exact."""

_FARTHEST = 1400.0
"""Beyond it Q of an order below 100 is 0 in float64."""

_ERFC = np.vectorize(math.erfc, otypes=[np.float64])


def normal_below(x: ArrayLike) -> Array:
    """Phi(x) = erfc(-x / sqrt 2) / 2, the probability below x of a standard normal, (...)."""
    return np.asarray(0.5 * _ERFC(-math.sqrt(0.5) * np.asarray(x, dtype=np.float64)))


def normal_quantile(share: float) -> float:
    """Phi^-1(share); infinite at 0 and 1.

    References
    ----------
    M. J. Wichura, Algorithm AS 241: the percentage points of the normal distribution, Applied
    Statistics 37, 1988, as Python's ``statistics`` has it.
    """
    if share <= 0.0 or share >= 1.0:
        return math.copysign(math.inf, share - 0.5)
    return NormalDist().inv_cdf(float(share))


def upper_gamma(order: float, x: ArrayLike) -> Array:
    """Regularised upper incomplete gamma function Q(order, x), (...) of x at or above 0.

    Q(a + 1, x) = Q(a, x) + x^a exp(-x) / Gamma(a + 1), from Q(1, x) = exp(-x) or
    Q(1/2, x) = erfc(sqrt x): a sum of numbers above 0. The tail of chi^2 with n degrees of
    freedom beyond q is Q(n / 2, q / 2).

    Parameters
    ----------
    order : a multiple of 1/2, above 0 and below 100.
    x : (...), at or above 0.

    References
    ----------
    NIST Digital Library of Mathematical Functions, 8.8.2 and 8.4.
    """
    x = np.minimum(np.asarray(x, dtype=np.float64), _FARTHEST)
    total, _ = _scaled_upper_gamma(order, x)
    return np.asarray(total * np.exp(-0.5 * x))


def _scaled_upper_gamma(order: float, x: Array) -> tuple[Array, Array]:
    """Return Q and the density x^(a - 1) exp(-x) / Gamma(a), both times exp(x / 2)."""
    decay = np.exp(-0.5 * x)
    if order % 1.0:
        total, density, next_order = _ERFC(np.sqrt(x)) / decay, np.zeros_like(x), 1.5
        term = 2.0 * np.sqrt(x / np.pi) * decay
    else:
        total, density, next_order = np.zeros_like(x), np.zeros_like(x), 1.0
        term = decay
    while next_order <= order:
        total, density = total + term, term
        term = term * x / next_order
        next_order += 1.0
    return total, density


def upper_gamma_quantile(order: float, tail: ArrayLike) -> Array:
    """Return the x with Q(order, x) = tail, (...) of tails in (0, 1).

    Closed forms of the orders 1/2 and 1. Else Newton's steps on the logarithm of the smaller
    tail, which is concave, so that they come from one side: from above, from the bound
    a + sqrt(2 a t) + t with t = -log(tail), or from below, from the first term of the series

        P(a, x) = x^a exp(-x) / Gamma(a + 1) (1 + x / (a + 1) + x^2 / ((a + 1) (a + 2)) + ...)

    References
    ----------
    B. Laurent and P. Massart, Adaptive estimation of a quadratic functional by model selection,
    Annals of Statistics 28, 2000, lemma 1, for the bound; NIST Digital Library of Mathematical
    Functions, 8.7.1, for the series.
    """
    tail = np.asarray(tail, dtype=np.float64)
    if order == 1.0:
        return np.asarray(-np.log(tail))
    if order == 0.5:
        roots = np.vectorize(normal_quantile, otypes=[np.float64])(0.5 * tail)
        return np.asarray(0.5 * roots**2)
    rare = tail <= 0.5
    found = np.empty_like(tail)
    found[rare] = _rare_gamma_quantile(order, -np.log(tail[rare]))
    found[~rare] = _common_gamma_quantile(order, np.log1p(-tail[~rare]))
    return found


@lru_cache(maxsize=32)
def content_bound(size: int, tail: float) -> float:
    """Return the q that chi^2 with ``size`` degrees of freedom exceeds with probability ``tail``.

    Raises
    ------
    WideberthError : tail outside (0, 1).
    """
    return 2.0 * float(upper_gamma_quantile(0.5 * size, probability("tail", tail)))


def _rare_gamma_quantile(order: float, depth: Array) -> Array:
    """Return where Q = exp(-depth), for a depth of log 2 and more."""

    def step(x: Array) -> Array:
        total, density = _scaled_upper_gamma(order, x)
        return np.asarray((np.log(total) - 0.5 * x + depth) * total / density)

    return _newton(step, order + np.sqrt(2.0 * order * depth) + depth)


def _common_gamma_quantile(order: float, logarithm: Array) -> Array:
    """Return where P has this logarithm, for P below 1/2, by steps of log x."""
    first = math.lgamma(order + 1.0)

    def step(log_x: Array) -> Array:
        x = np.exp(log_x)
        total, term, count = np.ones_like(x), np.ones_like(x), 1.0
        while (term > 0.1 * _ROUNDING * total).any():
            term = term * x / (order + count)
            total, count = total + term, count + 1.0
        value = order * log_x - x - first + np.log(total)
        return np.asarray((logarithm - value) * total / order)

    return np.exp(_newton(step, (logarithm + first) / order))


def beta_quantile(successes: int, failures: int, share: float) -> float:
    """Return the x with I_x(successes, failures) = share, I the regularised incomplete beta.

    In n = a + b - 1 trials of probability x, a or more succeed with probability

        I_x(a, b) = C(n, a) x^a (1 - x)^(b - 1) (1 + z (b - 1) / (a + 1)
            + z^2 (b - 1) (b - 2) / ((a + 1) (a + 2)) + ...),    z = x / (1 - x)

    Newton's steps of log x on its logarithm, which is concave, from C(n, a) x^a = share.

    Parameters
    ----------
    successes, failures : a and b, counts of at least 1.
    share : in (0, 1/2]; for more take 1 - x of 1 - share with a and b exchanged.

    References
    ----------
    NIST Digital Library of Mathematical Functions, 8.17.5.
    """
    a, b = successes, failures
    fewer = np.arange(1.0, min(a, b - 1) + 1.0)
    ways = float(np.log((a + b - fewer) / fewer).sum())  # log C(n, a)
    ratios = np.arange(b - 1.0, 0.0, -1.0) / np.arange(a + 1.0, a + b)

    def step(log_x: Array) -> Array:
        x = math.exp(log_x)
        total = 1.0 + float(np.cumprod(ratios * (x / (1.0 - x))).sum())
        value = ways + a * log_x + (b - 1) * math.log1p(-x) + math.log(total)
        return np.asarray((math.log(share) - value) * total / a)

    return math.exp(_newton(step, np.asarray((math.log(share) - ways) / a)))


def _newton(step: Callable[[Array], Array], start: Array) -> Array:
    """Add steps until all are rounding errors, (...)."""
    place = start
    for _ in range(100):
        moved = step(place)
        place = place + moved
        if not (np.abs(moved) > _ROUNDING * np.abs(place)).any():
            break
    return place


def carlson_rf(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    """Carlson's R_F(x, y, z), symmetric, of numbers at or above 0, at most one of them 0, (...).

    R_F = 1/2 int_0^inf dt / sqrt((t + x) (t + y) (t + z)), by duplication.

    References
    ----------
    B. C. Carlson, Numerical computation of real or complex elliptic integrals, Numerical
    Algorithms 10, 1995.
    """
    return _duplicated(*_in_order(x, y, z))[0]


def carlson_rg(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    """Carlson's R_G(x, y, z), symmetric, of numbers at or above 0, (...).

    With z between x and y no term is negative, and no digits are lost:

        2 R_G = z R_F(x, y, z) + (x - z) (z - y) R_D(x, y, z) / 3 + sqrt(x y / z)

    References
    ----------
    NIST Digital Library of Mathematical Functions, 19.21.10; see `carlson_rf`.
    """
    least, middle, most = _in_order(x, y, z)
    solid = middle > 0.0  # else R_G = sqrt(most) / 2
    z = np.where(solid, middle, 1.0)
    x, y = np.where(solid, least, 1.0), np.where(solid, most, 1.0)
    first, second = _duplicated(x, y, z)
    twice = z * first + (z - x) * (y - z) * second / 3.0 + np.sqrt(x) * np.sqrt(y / z)
    return np.asarray(0.5 * np.where(solid, twice, np.sqrt(most)))


def _in_order(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Array:
    """Return three numbers from small to large, (3, ...)."""
    return np.sort(np.stack(np.broadcast_arrays(x, y, z)).astype(np.float64), axis=0)


def _duplicated(x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """R_F(x, y, z) and R_D(x, y, z) by Carlson's duplication and his series of degree 5."""
    rest, share = np.zeros_like(x), 1.0
    while True:
        mean = (x + y + z) / 3.0
        apart = np.maximum(np.maximum(abs(x - mean), abs(y - mean)), abs(z - mean))
        if not (apart > _ALIKE * mean).any():
            break
        a, b, c = np.sqrt(x), np.sqrt(y), np.sqrt(z)
        crossed = a * b + a * c + b * c
        rest = rest + share / (c * (z + crossed))
        share *= 0.25
        x, y, z = (0.25 * (value + crossed) for value in (x, y, z))
    p, q = 1.0 - x / mean, 1.0 - y / mean
    second, third = p * q - (p + q) ** 2, -p * q * (p + q)
    first_kind = (
        1.0 - second / 10 + third / 14 + second**2 / 24 - 3 * second * third / 44
    ) / np.sqrt(mean)
    mean = (x + y + 3.0 * z) / 5.0
    p, q = 1.0 - x / mean, 1.0 - y / mean
    r, pq = -(p + q) / 3.0, p * q
    second, third = pq - 6 * r**2, (3 * pq - 8 * r**2) * r
    fourth, fifth = 3 * (pq - r**2) * r**2, pq * r**3
    series = 1.0 - 3 * second / 14 + third / 6 + 9 * second**2 / 88 - 3 * fourth / 22
    series = series - 9 * second * third / 52 + 3 * fifth / 26
    return first_kind, 3.0 * rest + share * series / (mean * np.sqrt(mean))
