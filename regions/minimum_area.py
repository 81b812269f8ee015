"""The outer ellipse with the smallest area (volume in 3-D)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Scalar
from . import gaussian
from .outer_ellipse import EMPTY, OuterEllipse

_STEPS = {2: 5, 3: 12}
"""Newton steps that reach 1e-15 for every shape; any other beta would be safe as well."""


@final
@dataclass(frozen=True)
class MinimumArea(OuterEllipse, gaussian.Eigenframe):
    """The smallest member of the family (1 + 1/beta) s^2 Sigma + (1 + beta) rho^2 I.

    beta is the positive root of sum_i 1 / (beta + a_i^2 / rho^2) = D / (beta (beta + 1)), which in
    2-D is beta^3 + S beta^2 - S beta - u v = 0 with u = a^2 / rho^2, v = b^2 / rho^2,
    S = (u + v) / 2. Here with beta = s m y / rho, m^2 = tr(Sigma) / D, w_i = sigma_i^2 / m^2 and
    e : f = rho : s m, so that neither margin nor level is a divisor: y in (0, 1] solves

        2-D   e y^3 + f y^2 - e y - f w_1 w_2 = 0
        3-D   3 e^2 y^4 + 6 e f y^3 + (f^2 e_2 - 3 e^2) y^2 - 2 e f e_2 y - 3 f^2 w_1 w_2 w_3 = 0

    with e_2 = w_1 w_2 + w_1 w_3 + w_2 w_3, and the squared semi-axes are

        c_i^2 = s^2 sigma_i^2 + s rho (sigma_i^2 / (m y) + m y) + rho^2.

    y = 1 is `MinimumTrace`; for a level of 0 both are the disc of the margin.

    Relation OUTER: for every beta > 0 (h + rho)^2 <= (1 + 1/beta) h^2 + (1 + beta) rho^2 with h
    the support function of the ellipse. An imprecise root would therefore give a larger ellipse,
    never one that is not safe. Every tight outer ellipse on the same axes is a member, and the
    smallest ellipse around a set with these symmetries is on these axes, so this is the smallest
    ellipse of all. Zero and singular covariances need no special case; for a flat ellipse the
    long axis tends to sqrt(2) a as the margin tends to 0.

    References
    ----------
    A. B. Kurzhanski and I. Valyi, Ellipsoidal Calculus for Estimation and Control (1997).
    A. Halder, On the parameterized computation of minimum volume outer ellipsoid of Minkowski
    sum of ellipsoids, CDC (2018), for beta in D dimensions.
    """

    reference: ClassVar[str] = "kurzhanski1997ellipsoidal,halder2018parameterized"

    def squares(self, deviations: Sequence[Scalar], margin: Scalar, level: Scalar) -> list[Scalar]:
        """s^2 sigma_i^2 + s rho (sigma_i^2 / (m y) + m y) + rho^2."""
        mean = sum(deviation**2 for deviation in deviations) / len(deviations) + EMPTY**2
        shares = [deviation**2 / mean for deviation in deviations]
        length = mean**0.5
        chosen = length * _root(shares, margin + EMPTY, level * length)
        return [
            (level * deviation) ** 2
            + level * margin * (deviation**2 / chosen + chosen)
            + margin**2
            for deviation in deviations
        ]


def _root(shares: list[Scalar], disc: Scalar, ellipse: Scalar) -> Scalar:
    """Y by Newton, which falls towards the only positive root from the second step on."""
    whole = (disc**2 + ellipse**2) ** 0.5
    e, f = disc / whole, ellipse / whole
    if len(shares) == 2:
        product = shares[0] * shares[1]
        coefficients = [e, f, -e, -f * product]
        thin, thick = 2.0 * e / (f + (f**2 + 4.0 * e**2) ** 0.5), product
    else:
        first, second, third = shares
        pairs, product = first * second + (first + second) * third, first * second * third
        coefficients = [
            3.0 * e**2, 6.0 * e * f, f**2 * pairs - 3.0 * e**2,
            -2.0 * e * f * pairs, -3.0 * f**2 * product,
        ]  # fmt: skip
        thin = 4.0 * e / (f + (f**2 + 16.0 * e**2) ** 0.5)
        thick = 3.0 * product / (pairs + EMPTY)
    y = (thin**2 + thick) ** 0.5  # the root without margin and that of a flat ellipse
    for _ in range(_STEPS[len(shares)]):
        value, slope = coefficients[0], 0.0
        for coefficient in coefficients[1:]:
            slope = slope * y + value
            value = value * y + coefficient
        y = y - value / slope
    return y
