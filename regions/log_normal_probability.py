"""Logarithms of normal probabilities in CasADi, accurate far out in the tails."""

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.values.arrays import Scalar
from . import gaussian

_KNEE = 3.0
_SMALLEST_PROBABILITY = 1e-100
"""Below this a probability of an interval counts as this: its square still is a float."""
_COEFFICIENTS = (
    1.1775625741965599,
    0.005353904539615918,
    -0.09377550342284227,
    0.05436652555744358,
    -0.018976596707845482,
    0.004453426061462804,
    -0.0006335531710553907,
    1.7661719523261284e-05,
    1.2841532864148083e-05,
    -2.0072285658908476e-06,
    -1.8075227930513262e-07,
    7.549828338144028e-08,
    1.885670032507389e-09,
    -2.6995117569057906e-09,
    -1.462061929155e-11,
    1.0343476189149154e-10,
    1.6835090552747082e-12,
)
"""Chebyshev coefficients of (1 + 2x) erfcx(x) in t = (x - 3) / (x + 3), x from 0 on."""


def erfcx(x: Scalar) -> Scalar:
    """exp(x^2) erfc(x) for x at or above 0, relative error below 1e-11.

    CasADi knows erf alone, which is 1 to all digits from 6 on.
    """
    t = (x - _KNEE) / (x + _KNEE)
    ahead, after = 0.0 * t, 0.0 * t
    first, *rest = _COEFFICIENTS
    for coefficient in reversed(rest):  # Clenshaw's recurrence
        ahead, after = coefficient + 2.0 * t * ahead - after, ahead
    return (first + t * ahead - after) / (1.0 + 2.0 * x)


def log_interval(centre: Scalar, half: Scalar, deviation: Scalar) -> Scalar:
    """Log Pr(|X - centre| < half) for X ~ N(0, deviation^2), elementwise; centre >= 0.

    With a = (centre - half) / deviation and b = (centre + half) / deviation it is
    log(Phi(b) - Phi(a)): for a > 0 through the upper tails, which do not cancel,

        -a^2 / 2 + log(erfcx(a / sqrt 2) - exp(-(b^2 - a^2) / 2) erfcx(b / sqrt 2)) - log 2,

    and for a <= 0 through erf.

    Parameters
    ----------
    centre, half, deviation : all in m (or all without unit); deviation above 0.
    """
    low, high = (centre - half) / deviation, (centre + half) / deviation
    root = np.sqrt(0.5)
    # Each branch sees arguments from its own side alone: both are finite with all derivatives.
    right, left = ca.fmax(low, 0.0), ca.fmin(low, 0.0)
    drop = 0.5 * (high - right) * (high + right)
    tail = erfcx(root * right) - ca.exp(-drop) * erfcx(root * high)
    outer = ca.log(ca.fmax(0.5 * tail, _SMALLEST_PROBABILITY)) - 0.5 * right**2
    middle = 0.5 * (ca.erf(root * high) - ca.erf(root * left))
    inner = ca.log(ca.fmax(middle, _SMALLEST_PROBABILITY))
    return ca.if_else(low > 0.0, outer, inner)


def deep_inside(x: list[Scalar], longest: Scalar, margin: Scalar, level: Scalar) -> Scalar:
    """Return a term with a slope where the collision probability rounds to 1, 0 elsewhere.

    min(0, (|x| - margin + 4 sigma_1) / margin). Where it is below 0 the disc holds the ball of
    four deviations around the mean, so the probability is above 0.9988 (in 2-D 1 - exp(-8)). A
    constraint on it is then violated anyway, for every level sqrt(-2 ln eps) above 0.05 (the
    term is left out below it), and adding the term changes no sign. For |x| stands
    sqrt(|x|^2 + c margin^2), which is not shorter and keeps the curvature finite at the centre,
    see `gaussian.log_gauge`.

    Parameters
    ----------
    x : coordinates of the disc's centre from the obstacle's mean, m.
    longest : sigma_1, m.
    margin : radius of the disc, m, above 0.
    level : sqrt(-2 ln eps).
    """
    length = ca.sqrt(sum(c**2 for c in x) + gaussian.CENTRE * margin**2)
    return ca.if_else(level > 0.05, ca.fmin(0.0, (length - margin + 4.0 * longest) / margin), 0.0)
