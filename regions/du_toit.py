"""The centre-point approximation of du Toit and Burdick: volume of the disc times density."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from ..metrics.ellipses import UNIT_BALL
from . import density, gaussian

_TINY = 1e-13
"""An ellipse with q below this counts as empty."""


@final
@dataclass(frozen=True)
class DuToit(gaussian.ExponentLevel, Bounded):
    """Where V f(p) > eps, f the density of the obstacle's position, V the volume of the disc.

    V is pi margin^2 in 2-D and 4/3 pi margin^3 in 3-D. An ellipse with squared level
    q = -2 ln((2 pi)^(D/2) sqrt(det Sigma) eps / V), empty where q <= 0: then even at the
    obstacle's mean the approximation sees no risk.

    ``tail`` is eps, the collision risk asked for, ``level`` is sqrt(-2 ln eps); q = level^2 - k,
    see `regions.density`. Guarantee NONE: the density at the centre of the disc says little
    about the disc. Where the margin is much larger than the deviations the true risk on the
    boundary reaches 1 (deviations 0.3 m and 0.1 m, margin 1.5 m, eps 0.05: 0.91 to 1.00).
    Relation NONE. A singular covariance has no density: `parameters` raises.

    The constraint is 0.5 log(sum_i x_i^2 / l_i / q) >= 0, its curvature kept finite at the
    centre (`gaussian.log_gauge`); where the region is empty it is 1, which holds everywhere.

    References
    ----------
    N. E. Du Toit and J. W. Burdick, Probabilistic Collision Checking With Chance Constraints,
    IEEE Transactions on Robotics 27(4), 2011.
    """

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.NONE
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    singular_covariances: ClassVar[bool] = False
    reference: ClassVar[str] = "dutoit2011probabilistic"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin, k: (...,) -> (..., P).

        Raises
        ------
        WideberthError : singular covariance, negative margin, neither 2-D nor 3-D.
        """
        return density.pack(obstacle, margin, "du_toit")

    def parameter_count(self, dimension: int) -> int:
        """P, 10 in 2-D and 17 in 3-D."""
        return gaussian.packed_count(dimension) + 1

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log(d_M^2 / q) >= 0, by `gaussian.log_gauge`; where the region is empty 1."""
        x, deviations, _ = gaussian.local_symbols(pose, parameters)
        squared = sum(
            c**2 / (s**2 + gaussian.FLOOR**2) for c, s in zip(x, deviations, strict=True)
        )
        last = gaussian.packed_count(len(x))
        q = level**2 - parameters[last]
        value = gaussian.log_gauge(squared / ca.fmax(q, _TINY))
        return Constraint((ca.if_else(q > _TINY, value, 1.0),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether d_M^2 < q."""
        mean, vectors, deviations, q = _frame(parameters, level)
        x = gaussian.local(np.asarray(points), mean, vectors)
        return np.asarray(((x / deviations) ** 2).sum(axis=-1) < q)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points at equal steps of the eccentric angle, (count, 2), m; the mean where empty."""
        mean, vectors, deviations, q = _frame(parameters, np.asarray(level))
        axes = np.sqrt(q) * deviations
        return np.asarray(mean + (gaussian.circle(count, vectors) * axes) @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Pi q sigma_1 sigma_2, or 4/3 pi q^(3/2) sigma_1 sigma_2 sigma_3."""
        _, _, deviations, q = _frame(parameters, level)
        axes = np.sqrt(q)[..., None] * deviations
        return np.asarray(UNIT_BALL[axes.shape[-1]] * axes.prod(axis=-1))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Longest semi-axis sqrt(q) sigma_1, m."""
        return density.longest(deviations, margin, level)


def _frame(parameters: Array, level: Array) -> tuple[Array, Array, Array, Array]:
    """Mean, eigenvectors, deviations and q, 0 where the region is empty."""
    parameters = np.asarray(parameters, dtype=np.float64)
    mean, vectors, deviations, _ = gaussian.unpack(parameters[..., :-1])
    q = np.asarray(level, dtype=np.float64) ** 2 - parameters[..., -1]
    return mean, vectors, deviations, np.where(q > _TINY, q, 0.0)
