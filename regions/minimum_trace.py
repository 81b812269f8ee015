"""The outer ellipse with the smallest sum of squared semi-axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Scalar
from . import gaussian
from .outer_ellipse import EMPTY, OuterEllipse


@final
@dataclass(frozen=True)
class MinimumTrace(OuterEllipse, gaussian.Eigenframe):
    """The member of least trace of the family (1 + 1/beta) s^2 Sigma + (1 + beta) rho^2 I.

    beta = sqrt(tr(s^2 Sigma) / (D rho^2)). With m^2 = tr(Sigma) / D the squared semi-axes are a
    polynomial in level and margin, without roots and without a division by the margin:

        c_i^2 = s^2 sigma_i^2 + s rho (sigma_i^2 / m + m) + rho^2.

    Relation OUTER: for every beta > 0 (h + rho)^2 <= (1 + 1/beta) h^2 + (1 + beta) rho^2 with h
    the support function of the ellipse, so each member encloses the sum (in 3-D too); and every
    tight outer ellipse on the same axes is a member. Zero and singular covariances need no
    special case. For thin ellipses it is far from the smallest (axes of 10 m and 1 m, margin
    1 m: 1.40 of the area of the sum, where `MinimumArea` needs 1.10).

    References
    ----------
    A. B. Kurzhanski and I. Valyi, Ellipsoidal Calculus for Estimation and Control (1997).
    """

    reference: ClassVar[str] = "kurzhanski1997ellipsoidal"

    def squares(self, deviations: Sequence[Scalar], margin: Scalar, level: Scalar) -> list[Scalar]:
        """s^2 sigma_i^2 + s rho (sigma_i^2 / m + m) + rho^2."""
        mean = sum(deviation**2 for deviation in deviations) / len(deviations)
        length = (mean + EMPTY**2) ** 0.5
        return [
            (level * deviation) ** 2
            + level * margin * (deviation**2 / length + length)
            + margin**2
            for deviation in deviations
        ]
