"""The paper's ellipse repaired by a larger level."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Array, Scalar
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import GaussianObstacle
from . import gaussian
from .outer_ellipse import OuterEllipse, excess, means

_FLAT = 1e-7
"""Share of the largest deviation below which the smallest is the rounding error of zero."""


@final
@dataclass(frozen=True)
class RepairedLevel(OuterEllipse):
    """Ellipse with semi-axes s' sigma_i + margin, with the smallest s' that encloses the sum.

    With A1, H1 the arithmetic and harmonic mean of the largest and smallest deviation and margin
    rho, s' is the positive root of

        A1 H1 s'^3 + H1 rho s'^2 - s^2 A1 H1 s' - s^2 A1 rho = 0.

    For s' = s (1 + z) the excess z solves e z^3 + (3 e + h) z^2 + 2 (e + h) z = g with
    e = s A1 H1, h = H1 rho, g = (A1 - H1) rho. It is the paper's "choosing larger s". For margins
    much larger than the deviations s' / s tends to sqrt(A1 / H1), 1.34 for a ratio of 5 between
    the deviations, and the axes grow in proportion, so thin covariances pay a high price.

    `level` and `tail` speak of s, the level of the content ellipse that is enclosed.

    Relation OUTER: the argument of `RepairedMargin` with the axes s' sigma_i + rho, in 3-D too.
    Undefined for sigma_D = 0 < sigma_1 with a margin: no s' is large enough. `parameters` raises
    there; as zero counts what is below 1e-7 of the largest deviation, the rounding error of an
    eigenvalue.

    References
    ----------
    The paper, section "Set Construction", for the repair; the equation is derived here.
    """

    singular_covariances: ClassVar[bool] = False
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin: (...,) -> (..., P); see `regions.gaussian`.

        Raises
        ------
        WideberthError : a singular covariance with a margin.
        """
        numbers = gaussian.pack(obstacle, margin, self.dimensions)
        _, _, deviations, room = gaussian.unpack(numbers)
        largest, smallest = deviations[..., 0], deviations[..., -1]
        flat = (largest > 0.0) & (smallest <= _FLAT * largest) & (room > 0.0)
        if flat.any():
            raise WideberthError(
                f"{int(flat.sum())} of {flat.size} covariances are singular (deviations "
                f"{deviations[flat][0]} m, margin {room[flat][0]:g} m): no level is large enough "
                "to enclose ellipse and disc; take repaired_margin or minkowski_sum"
            )
        return numbers

    def parameter_count(self, dimension: int) -> int:
        """P, 9 in 2-D and 16 in 3-D."""
        return gaussian.packed_count(dimension)

    def squares(self, deviations: Sequence[Scalar], margin: Scalar, level: Scalar) -> list[Scalar]:
        """(s' sigma_i + rho)^2."""
        arithmetic, harmonic, gap = means(deviations[0], deviations[-1])
        growth = excess(level * arithmetic * harmonic, harmonic * margin, gap * margin)
        larger = level * (1.0 + growth)
        return [(larger * deviation + margin) ** 2 for deviation in deviations]
