"""The paper's ellipse repaired by a larger margin: the outer ellipse of equal enlargement."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from ..framework.values.arrays import Scalar
from . import gaussian
from .outer_ellipse import OuterEllipse, excess, means


@final
@dataclass(frozen=True)
class RepairedMargin(OuterEllipse, gaussian.Eigenframe):
    """Ellipse with semi-axes s sigma_i + delta, with the smallest delta that encloses the sum.

    With a, b the largest and smallest s sigma_i, A = (a + b) / 2, H = 2ab / (a + b) and margin
    rho, delta is the positive root of delta^3 + H delta^2 - rho^2 delta - rho^2 A = 0. For
    delta = rho (1 + z) the excess z solves rho z^3 + (3 rho + H) z^2 + 2 (rho + H) z = A - H;
    the level enters through H and A - H, both proportional to s. It is the paper's "expanding
    the ellipse by more than r + r_d" and, in one, the outer ellipse of equal enlargement: of all
    ellipses with axes s sigma_i + delta it is the smallest that encloses the sum.

    Relation OUTER: all p, q with p^2 t + q^2 (1 - t) >= (sqrt(a^2 t + b^2 (1 - t)) + rho)^2 for
    t in [0, 1] enclose the sum (squared support functions, t the squared cosine of the normal
    angle). The left is linear in t and the right concave; the root is where they touch, at the
    member beta = A / delta of the family in `MinimumArea`. In 3-D the same delta, from the
    largest and the smallest axis, is enough and needed: the points (a_i, a_i^2) lie below the
    chord between the extreme ones. rho <= delta <= rho + (A - H) / 2. Without a margin it is the
    content ellipse itself, flat ones included.

    References
    ----------
    The paper, section "Set Construction", for the repair; the equation is derived here.
    B. Brito, B. Floor, L. Ferranti and J. Alonso-Mora, Model predictive contouring control for
    collision avoidance in unstructured dynamic environments, RA-L 4 (2019), for the idea of an
    equal enlargement; their own formula for delta may be another one.
    """

    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def squares(self, deviations: Sequence[Scalar], margin: Scalar, level: Scalar) -> list[Scalar]:
        """(s sigma_i + delta)^2."""
        _, harmonic, gap = means(deviations[0], deviations[-1])
        delta = margin * (1.0 + excess(margin, level * harmonic, level * gap))
        return [(level * deviation + delta) ** 2 for deviation in deviations]
