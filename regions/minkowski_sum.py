"""The exact region: the content ellipse plus the disc of the margin."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.geometry import (
    concave_maximiser,
    distance_to_ellipse,
    sum_gauge,
    sum_volume,
)
from ..framework.numerics.symbolic import ca
from ..framework.region import Auxiliary, Constraint, Convex, Guarantee, Relation, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from . import gaussian

_EDGE = 1e-6
"""Bound on t: an interior point method may step 1e-8 over a bound, and t = 0 has no logarithm.
Any t in (0, 1) gives a safe constraint; the bound costs at most 5e-7 of the gauge.
"""


class EllipsePlusDisc(gaussian.Eigenframe, Signed, Convex):
    """The set of points closer than the margin to the ellipse with semi-axes s sigma_i."""

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the distance to the ellipse is below the margin."""
        return np.asarray(self.signed_distance(points, parameters, level) < 0.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m; where the covariance is singular exact outside E alone."""
        x, axes, margin, _ = _frame(points, parameters, level)
        return np.asarray(distance_to_ellipse(x, axes) - margin)

    def gauge(self, points: Array, parameters: Array, level: Array) -> Array:
        """Factor by which ellipse and disc must both grow to reach the points, (...)."""
        x, axes, margin, _ = _frame(points, parameters, level)
        return sum_gauge(x, axes, margin)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + s sqrt(n^T Sigma n) + margin, m."""
        mean = gaussian.unpack(parameters)[0]
        n, axes, margin, _ = _frame(normals + mean, parameters, level)
        along = (np.asarray(normals) * mean).sum(axis=-1)
        return np.asarray(along + np.hypot.reduce(axes * n, axis=-1) + margin)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points x(n) = diag(a^2) n / h + margin n, dense where the boundary bends, (count, 2).

        The normals are those of equal steps of the eccentric angle on the ellipse together with
        equal steps of the normal angle, so that both the flat and the pointed parts are covered.
        """
        mean, vectors, _, _ = gaussian.unpack(parameters)
        _, axes, margin, _ = _frame(mean, parameters, np.asarray(level))
        normals = _normals(count, vectors, axes)
        height = np.maximum(np.hypot.reduce(axes * normals, axis=-1), 1e-300)[:, None]
        points = axes * (axes * normals / height) + margin * normals
        return np.asarray(mean + points @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula: pi a b + perimeter * margin + pi margin^2 in 2-D."""
        _, axes, margin, _ = _frame(gaussian.unpack(parameters)[0], parameters, level)
        return sum_volume(axes, margin)


class BlendedSum(EllipsePlusDisc):
    """Ellipse plus disc, stated by one scalar t per obstacle and step; see `MinkowskiSum`."""

    def auxiliary(self, dimension: int) -> Auxiliary:
        """Declare t in (0, 1), held near its guess where the constraint is inactive."""
        return Auxiliary((_EDGE,), (1.0 - _EDGE,), (0.5,), regularisation=1e-6)

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Return the maximiser of F(t), (..., 1)."""
        x, axes, margin, _ = _frame(pose.points(), parameters, level)
        squares, disc = axes**2 + gaussian.FLOOR**2, margin**2 + gaussian.FLOOR**2
        return concave_maximiser(x, squares, disc, _EDGE, 1.0 - _EDGE)[..., None]

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log F(t) >= 0, by `gaussian.log_gauge`."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        # fatrop keeps to bounds only in the end; log of a negative number would be nan before.
        t = ca.fmin(ca.fmax(auxiliary[0], _EDGE), 1.0 - _EDGE)
        disc = t * margin**2 + gaussian.FLOOR**2
        value = sum(
            coordinate**2 / ((1.0 - t) * (level * deviation) ** 2 + disc)
            for coordinate, deviation in zip(x, deviations, strict=True)
        )
        return Constraint((gaussian.log_gauge(t * (1.0 - t) * value),))


@final
@dataclass(frozen=True)
class MinkowskiSum(BlendedSum, gaussian.ContentLevel, gaussian.LineRisk):
    """E + B: all points closer than the margin to the ellipse E with semi-axes s sigma_i.

    Membership: signed distance to E below the margin rho. As a constraint a point is outside
    iff some t in (0, 1) gives

        F(t) = sum_i x_i^2 t (1 - t) / ((1 - t) s^2 sigma_i^2 + t rho^2) >= 1,

    with x = R^T (p - mu). F is concave in t, so each obstacle and step carries one scalar with a
    single maximum and no local ones; sqrt(max F) is the gauge of the sum. Every t gives an
    ellipse that encloses the sum, so an iterate with a poor t is safe, only conservative. The
    inequality is 0.5 log F(t) >= 0. Zero and singular covariances need no special case.

    Guarantee RISK: on or outside the boundary the disc is separated from the ellipse of level s
    by a line, so the collision risk is at most Phi(-s). With `level_for_risk`,
    s = Phi^-1(1 - risk), it is at most ``risk``, a far smaller region than that of content
    1 - risk (p = 0.95: s = 1.645 instead of 2.448).

    The paper uses the ellipse with longer axes (`MahalanobisEllipse`) as an approximation of
    this set; it lies inside it.

    References
    ----------
    J. W. Perram and M. S. Wertheim, Statistical mechanics of hard ellipsoids, J. Comput. Phys.
    58 (1985), for F. A. B. Kurzhanski and I. Valyi, Ellipsoidal Calculus (1997), for the
    family of enclosing ellipses, t = beta / (1 + beta).
    """

    relation: ClassVar[Relation] = Relation.EXACT
    guarantee: ClassVar[Guarantee] = Guarantee.RISK
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "perram1985"


def _frame(points: Array, parameters: Array, level: Array) -> tuple[Array, Array, Array, Array]:
    mean, vectors, deviations, margin = gaussian.unpack(parameters)
    axes = np.asarray(np.abs(level))[..., None] * deviations
    return gaussian.local(np.asarray(points), mean, vectors), axes, margin, vectors


def _normals(count: int, vectors: Array, axes: Array) -> Array:
    """Return unit normals in the eigenframe, half of them at equal steps of each of two angles."""
    even = gaussian.circle(count, vectors)
    turn = np.sign(np.linalg.det(vectors))
    if not axes[0] > 0:
        return even
    flat = np.maximum(axes, 1e-9 * axes[0])
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    slanted = np.unwrap(np.arctan2(np.sin(angle) / flat[1], np.cos(angle) / flat[0]))
    mixed = 0.5 * (angle + slanted)  # both increase by a full turn: so does their mean
    return np.stack([np.cos(mixed), turn * np.sin(mixed)], axis=-1).astype(np.float64)
