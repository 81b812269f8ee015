"""The base of outer ellipses: everything but the rule for their semi-axes."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, Scalar
from ..framework.values.motion import Pose
from . import gaussian

EMPTY = 1e-30
"""Added to divisors that are zero for a point, a flat ellipse or a margin of zero."""
_STEPS = 8
"""Newton steps of `excess`: to 1e-15 while axis / margin < 1e3; beyond that a little large."""


class OuterEllipse(gaussian.Ellipse, gaussian.ContentLevel, gaussian.LineRisk):
    """An ellipse along the eigenvectors of Sigma that encloses content ellipse plus disc.

    {p : sum_i (R^T (p - mu))_i^2 / c_i^2 < 1}; a subclass gives the squared semi-axes c_i^2 as
    a function of deviations, margin and level, the same one for NumPy and CasADi. The level
    stays a symbol there: roots come from a fixed number of Newton steps without branches, so
    the constraint is smooth in a level that is a decision variable and its gradient is finite
    at level 0, where the ellipse is the disc of the margin. A level below 0 counts as 0.

    The constraint is 0.5 log(q) >= 0 with q the sum above, as in `MahalanobisEllipse`.

    Relation OUTER is what a subclass proves. Guarantee RISK follows: a point outside is
    outside the exact sum, so a line separates the disc from the ellipse of level s and the
    collision risk is at most Phi(-s), which is below the tail of level s.
    """

    relation: ClassVar[Relation] = Relation.OUTER
    guarantee: ClassVar[Guarantee] = Guarantee.RISK
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)

    @abstractmethod
    def squares(self, deviations: Sequence[Scalar], margin: Scalar, level: Scalar) -> list[Scalar]:
        """Squared semi-axes c_i^2, m^2, from large to small.

        Parameters
        ----------
        deviations : D square roots of the eigenvalues, m, from large to small.
        margin : rho, m.
        level : s, at least 0.
        """

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log q >= 0, by `gaussian.log_gauge`."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        squares = self.squares(deviations, margin, ca.fmax(level, 0.0))
        q = sum(
            coordinate**2 / (square + gaussian.FLOOR**2)
            for coordinate, square in zip(x, squares, strict=True)
        )
        return Constraint((gaussian.log_gauge(q),))

    def axes(self, parameters: Array, level: Array) -> Array:
        """Semi-axes c_i, (..., D), m, from large to small."""
        _, _, deviations, margin = gaussian.unpack(parameters)
        return self._axes(deviations, margin, level)

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Longest semi-axis, m."""
        return np.asarray(self._axes(deviations, margin, level).max(axis=-1))

    def _axes(self, deviations: Array, margin: Array, level: Array) -> Array:
        size = np.maximum(np.asarray(level, dtype=np.float64), 0.0)
        squares = self.squares(list(np.moveaxis(deviations, -1, 0)), margin, size)
        stacked = np.stack(np.broadcast_arrays(*squares), axis=-1)
        return np.asarray(np.sqrt(stacked + gaussian.FLOOR**2))


def means(largest: Scalar, smallest: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Arithmetic mean A, harmonic mean H and A - H of two lengths, without cancellation."""
    total = largest + smallest
    below = total + EMPTY
    return 0.5 * total, 2.0 * largest * smallest / below, (largest - smallest) ** 2 / (2.0 * below)


def excess(cubic: Scalar, harmonic: Scalar, gap: Scalar) -> Scalar:
    """Non-negative root z of e z^3 + (3 e + h) z^2 + 2 (e + h) z = g, for e, h, g >= 0.

    With x = 1 + z this is e x^3 + h x^2 - e x - (h + g) = 0, the equation of both repairs of the
    paper's ellipse. All coefficients have one sign, so nothing cancels. Newton starts from the
    root without the cubic term, which is larger than z, and falls towards z because the
    polynomial is convex: stopped early it gives too large a region, never too small a one.
    """
    cubic = cubic + EMPTY
    square, linear = 3.0 * cubic + harmonic, 2.0 * (cubic + harmonic)
    z = 2.0 * gap / (linear + (linear**2 + 4.0 * square * gap) ** 0.5)
    for _ in range(_STEPS):
        value = ((cubic * z + square) * z + linear) * z - gap
        z = z - value / ((3.0 * cubic * z + 2.0 * square) * z + linear)
    return z
