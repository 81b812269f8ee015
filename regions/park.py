"""The bound of Park, Park and Manocha: volume of the disc times the largest density in it."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Auxiliary, Bounded, Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from . import density, gaussian
from .minkowski_sum import MinkowskiSum

_SUM = MinkowskiSum()
_EMPTY = 1e-12
"""Squared level q below which the region counts as empty."""


@final
@dataclass(frozen=True)
class Park(gaussian.ExponentLevel, Bounded):
    """Where V max f > eps, the maximum taken over the disc around p, V its volume.

    The disc holds a point of density above eps / V iff it meets the ellipse of du Toit and
    Burdick (`DuToit`). So the region is that ellipse, of squared level
    q = -2 ln((2 pi)^(D/2) sqrt(det Sigma) eps / V), plus the disc, and geometry, constraint and
    auxiliary are those of `MinkowskiSum` at the level sqrt(q). It is empty where q <= 0.

    ``tail`` is eps, the collision risk asked for, ``level`` is sqrt(-2 ln eps), see
    `regions.density`. Guarantee CONTENT: the integral of the density over the disc is at most
    volume times maximum, so the risk outside is at most ``tail``, also where the region is empty.
    Where the margin is much larger than the deviations the bound is 50 to 2500 times too large.
    Relation NONE. A singular covariance has no density: `parameters` raises.

    As q falls through 0 the region shrinks to the disc of the margin and then vanishes: a
    planner that varies the level meets a jump there.

    References
    ----------
    J. S. Park, C. Park and D. Manocha, Efficient Probabilistic Collision Detection for
    Non-Convex Shapes (2017), and their later work, for the bound.
    """

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    singular_covariances: ClassVar[bool] = False
    reference: ClassVar[str] = "park2017efficient"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin, k: (...,) -> (..., P).

        Raises
        ------
        WideberthError : singular covariance, negative margin, neither 2-D nor 3-D.
        """
        return density.pack(obstacle, margin, "park")

    def parameter_count(self, dimension: int) -> int:
        """P, 10 in 2-D and 17 in 3-D."""
        return gaussian.packed_count(dimension) + 1

    def auxiliary(self, dimension: int) -> Auxiliary:
        """One scalar t, see `MinkowskiSum`."""
        return _SUM.auxiliary(dimension)

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Best t for given positions, (..., 1)."""
        inner, size, _ = _inner(parameters, level)
        return _SUM.auxiliary_start(pose, inner, size)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log F(t) >= 0 of the sum; where it is empty 1, which holds everywhere."""
        last = _SUM.parameter_count(len(pose.position))
        q = level**2 - parameters[last]
        size = ca.sqrt(ca.fmax(q, _EMPTY))
        (value,) = _SUM.constraint(pose, parameters[:last], size, auxiliary).inequalities
        return Constraint((ca.if_else(q > _EMPTY, value, 1.0),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the distance to the ellipse is below the margin."""
        inner, size, there = _inner(parameters, level)
        return np.asarray(_SUM.contains(points, inner, size) & there)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points on the boundary, (count, 2), m; the mean where the region is empty."""
        inner, size, there = _inner(parameters, np.asarray(level))
        points = _SUM.boundary(inner, float(size), count)
        return np.asarray(np.where(there, points, inner[:2]))

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula, m^2 or m^3."""
        inner, size, there = _inner(parameters, level)
        return np.asarray(np.where(there, _SUM.area(inner, size), 0.0))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Return sqrt(q) sigma_1 + margin, m; where the region is empty the margin."""
        return np.asarray(density.longest(deviations, margin, level) + margin)


def _inner(parameters: Array, level: Array) -> tuple[Array, Array, BoolArray]:
    """Parameters and level of the sum, and whether the sum is non-empty."""
    parameters = np.asarray(parameters, dtype=np.float64)
    q = np.asarray(level, dtype=np.float64) ** 2 - parameters[..., -1]
    return parameters[..., :-1], np.sqrt(np.maximum(q, _EMPTY)), np.asarray(q > _EMPTY)
