"""What the outer ellipses share: all but the rule for their semi-axes."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Constraint, Convex, Guarantee, Relation, RiskLevel, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from . import gaussian
from .geometry import UNIT_BALL, distance_to_ellipse

EMPTY = 1e-30
"""Added to divisors that are zero for a point, a flat ellipse or a margin of zero."""
_STEPS = 8
"""Newton steps of `excess`: to 1e-15 while axis / margin < 1e3; beyond that a little large."""


class OuterEllipse(Signed, Convex, RiskLevel):
    """An ellipse along the eigenvectors of Sigma that encloses content ellipse plus disc.

    {p : sum_i (R^T (p - mu))_i^2 / c_i^2 < 1}; a subclass gives the squared semi-axes c_i^2 as
    a function of deviations, margin and level, the same one for NumPy and CasADi. The level
    stays a symbol there: roots come from a fixed number of Newton steps without branches, so
    the constraint is smooth in a level that is a decision variable and its gradient is finite
    at level 0, where the ellipse is the disc of the margin. A level below 0 counts as 0.

    The constraint is 0.5 log(q) >= 0 with q the sum above, as in `MahalanobisEllipse`.

    Relation OUTER is what a subclass proves. Guarantee RISK follows: whoever is outside is
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

    def parameter_count(self, dimension: int) -> int:
        """P, 9 in 2-D and 16 in 3-D."""
        return gaussian.packed_count(dimension)

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

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether q < 1."""
        x = self._local(points, parameters)
        return np.asarray(((x / self.axes(parameters, level)) ** 2).sum(axis=-1) < 1.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the ellipse, m, negative inside."""
        return distance_to_ellipse(self._local(points, parameters), self.axes(parameters, level))

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + |diag(c) R^T n|, m."""
        mean = gaussian.unpack(parameters)[0]
        n = self._local(normals + mean, parameters)
        along = (np.asarray(normals) * mean).sum(axis=-1)
        return np.asarray(along + np.hypot.reduce(self.axes(parameters, level) * n, axis=-1))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points at equal steps of the eccentric angle, (count, 2), m."""
        mean, vectors, _, _ = gaussian.unpack(parameters)
        axes = self.axes(parameters, np.asarray(level))
        return np.asarray(mean + (gaussian.circle(count, vectors) * axes) @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Pi c_1 c_2, or 4/3 pi c_1 c_2 c_3."""
        axes = self.axes(parameters, level)
        return np.asarray(UNIT_BALL[axes.shape[-1]] * axes.prod(axis=-1))

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level s with Pr(d_M > s) = tail."""
        return gaussian.ellipse_level(tail, dimension)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Pr(d_M > s)."""
        return gaussian.ellipse_tail(level, dimension)

    def level_for_risk(self, risk: float) -> float:
        """Level s at which the collision risk per step is at most ``risk`` (below 1/2)."""
        return gaussian.line_level(risk)

    def risk(self, level: float) -> float:
        """Return the bound Phi(-s) on the collision risk outside the region."""
        return gaussian.line_risk(level)

    def axes(self, parameters: Array, level: Array) -> Array:
        """Semi-axes c_i, (..., D), m, from large to small."""
        _, _, deviations, margin = gaussian.unpack(parameters)
        size = np.maximum(np.asarray(level, dtype=np.float64), 0.0)
        squares = self.squares(list(np.moveaxis(deviations, -1, 0)), margin, size)
        stacked = np.stack(np.broadcast_arrays(*squares), axis=-1)
        return np.asarray(np.sqrt(stacked + gaussian.FLOOR**2))

    def _local(self, points: Array, parameters: Array) -> Array:
        mean, vectors, _, _ = gaussian.unpack(parameters)
        return gaussian.local(np.asarray(points), mean, vectors)


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
