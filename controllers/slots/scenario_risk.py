"""The risk of a decision that was made from drawn futures, from how few of them it follows."""

from functools import lru_cache
from math import expm1, lgamma, log

import numpy as np


@lru_cache(maxsize=4096)
def risk_of_support(support: int, scenarios: int, doubt: float) -> float:
    """Return the risk that a decision from drawn futures exceeds with probability ``doubt``.

    A decision is made from S independent draws, k of which alone would lead to the same one, and
    whichever further draws it keeps do not change it. Its risk V, the probability that a new draw
    breaks it, then keeps Pr(V > eps(k)) <= beta over the draws, where eps(k) solves

        (beta / S) sum_{m=k}^{S-1} C(m, k) (1 - eps)^(m-k)  =  C(S, k) (1 - eps)^(S-k)

    for k < S, and eps(S) = 1. Nothing is assumed of how the draws are distributed, nor that the
    decision solves a convex problem.

    Without the second condition, which decisions among nonconvex constraints need not keep, the
    older 1 - (beta / (S C(S, k)))^(1 / (S - k)) holds (Campi, Garatti, Ramponi, "A General
    Scenario Theory for Nonconvex Optimization and Decision Making", 2018), about twice as large.

    Parameters
    ----------
    support : k, at most S. scenarios : S. doubt : beta, in (0, 1).

    References
    ----------
    Campi, Garatti, "Compression, Generalization and Learning", Journal of Machine Learning
    Research 24, 2023.
    """
    if support >= scenarios:
        return 1.0
    m = np.arange(support, scenarios, dtype=np.float64)
    chosen = [_log_choose(of, support) for of in range(support, scenarios)]
    left = np.array(chosen) + log(doubt / scenarios)
    whole = _log_choose(scenarios, support)

    def excess(keep: float) -> float:
        """Logarithm of left over right at log(1 - eps): it falls as 1 - eps grows."""
        terms = left + (m - support) * keep
        most = float(terms.max())
        found = most + log(float(np.exp(terms - most).sum()))
        return found - whole - (scenarios - support) * keep

    low, high = -50.0, 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return -expm1(0.5 * (low + high))


def _log_choose(of: int, some: int) -> float:
    """Logarithm of the binomial coefficient."""
    return lgamma(of + 1.0) - lgamma(some + 1.0) - lgamma(of - some + 1.0)


@lru_cache(maxsize=256)
def largest_support(risk: float, scenarios: int, doubt: float) -> int:
    """Return the largest k with `risk_of_support` of at most ``risk``; -1 where there is none."""
    below, above = -1, scenarios
    while above - below > 1:
        middle = (below + above) // 2
        if risk_of_support(middle, scenarios, doubt) <= risk:
            below = middle
        else:
            above = middle
    return below


def scenarios_wanted(risk: float, support: int, doubt: float) -> int:
    """Return the fewest draws with which ``support`` of them leave a risk of at most ``risk``."""
    below, above = support, 2 * (support + 1)
    while risk_of_support(support, above, doubt) > risk:
        below, above = above, 2 * above
    while above - below > 1:
        middle = (below + above) // 2
        if risk_of_support(support, middle, doubt) <= risk:
            above = middle
        else:
            below = middle
    return above
