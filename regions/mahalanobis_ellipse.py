"""The paper's region: the ellipse of content p with its axes made longer by the margin."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.region import Constraint, Convex, Guarantee, Relation, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from . import gaussian
from .geometry import UNIT_BALL, distance_to_ellipse


@final
@dataclass(frozen=True)
class MahalanobisEllipse(Signed, Convex):
    """Ellipse with semi-axes a_i = s sigma_i + margin along the eigenvectors of Sigma.

    {p : sum_i (R^T (p - mu))_i^2 / (s sigma_i + margin)^2 < 1}, with s = sqrt(-2 ln(1 - p)) in
    2-D and from the chi-square distribution with three degrees of freedom in 3-D.

    The constraint is 0.5 log(q) >= 0 with q the sum above, its curvature kept finite at the
    centre (`gaussian.log_gauge`). The paper writes q >= 1. The sets are the same; the program
    that the solver gets is not, in the settings called ``paper`` either. The logarithm of the
    gauge grows evenly in all directions and has length about 1 / axis near the boundary, where
    the gradient of q fades towards the centre and grows far outside. Projecting one point onto
    the boundary takes IPOPT the same number of iterations with either (median 7).

    Relation INNER: the region lies inside the exact sum of content ellipse and disc and
    touches it on the axes alone. With a, b the largest and smallest semi-axis s sigma_i,
    A = (a + b) / 2, H = 2ab / (a + b) and margin rho the clearance falls short by up to
    rho (1 - sqrt((H + rho) / (A + rho))), see `regions.inflation`. Guarantee NONE for that
    reason: on the boundary the collision risk can exceed 1 - p (for p = 0.95 and a margin
    much above the deviations from a condition number of 45 on). The paper calls the lengthening an
    approximation that can be compensated; here the plain ellipse stays as the paper has it.

    References
    ----------
    The paper, section "Set Construction", equations (ellipse parts) and (ellipse set).
    """

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.NONE
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin: (...,) -> (..., P); see `regions.gaussian`."""
        return gaussian.pack(obstacle, margin, self.dimensions)

    def parameter_count(self, dimension: int) -> int:
        """P, 9 in 2-D and 16 in 3-D."""
        return gaussian.packed_count(dimension)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log q >= 0, by `gaussian.log_gauge`."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        q = sum(
            coordinate**2 / ((level * deviation + margin) ** 2 + gaussian.FLOOR**2)
            for coordinate, deviation in zip(x, deviations, strict=True)
        )
        return Constraint((gaussian.log_gauge(q),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether q < 1."""
        x, axes, _ = self._frame(points, parameters, level)
        return np.asarray(((x / axes) ** 2).sum(axis=-1) < 1.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the ellipse, m, negative inside."""
        x, axes, _ = self._frame(points, parameters, level)
        return distance_to_ellipse(x, axes)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + |diag(axes) R^T n|, m."""
        mean = gaussian.unpack(parameters)[0]
        n, axes, _ = self._frame(normals + mean, parameters, level)
        along = (np.asarray(normals) * mean).sum(axis=-1)
        return np.asarray(along + np.hypot.reduce(axes * n, axis=-1))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points at equal steps of the eccentric angle, (count, 2), m."""
        mean, vectors, _, _ = gaussian.unpack(parameters)
        _, axes, _ = self._frame(mean, parameters, np.asarray(level))
        return np.asarray(mean + (gaussian.circle(count, vectors) * axes) @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Pi a b, or 4/3 pi a b c."""
        mean = gaussian.unpack(parameters)[0]
        _, axes, _ = self._frame(mean, parameters, level)
        return np.asarray(UNIT_BALL[axes.shape[-1]] * axes.prod(axis=-1))

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level s with Pr(d_M > s) = tail."""
        return gaussian.ellipse_level(tail, dimension)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Pr(d_M > s)."""
        return gaussian.ellipse_tail(level, dimension)

    def _frame(self, points: Array, parameters: Array, level: Array) -> tuple[Array, Array, Array]:
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        length = np.asarray(level)[..., None] * deviations + margin[..., None]
        axes = np.hypot(length, gaussian.FLOOR)
        return gaussian.local(np.asarray(points), mean, vectors), axes, margin
