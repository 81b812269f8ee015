"""The linearised chance constraint: a line at right angles to the way to the obstacle."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from ..metrics.ellipses import UNIT_BALL, mean_cubed_support, mean_support, perimeter
from . import gaussian


@final
@dataclass(frozen=True)
class HalfPlane(gaussian.Eigenframe, gaussian.LineLevel, Bounded):
    """Inside the pedal curve |d| = margin + z h(a), h(a) = sqrt(a^T Sigma a), a = d / |d|.

    With d = p - mu, the disc of the margin lies beyond the line through its nearest point at
    right angles to a. The obstacle reaches it with probability Phi(-(|d| - margin) / h(a)), so
    the collision risk is at most eps where

        a . d - margin >= z sqrt(a^T Sigma a),    z = Phi^-1(1 - eps) = sqrt 2 erfinv(1 - 2 eps).

    ``tail`` is eps, the collision risk asked for, ``level`` is z; risks above 1/2 give z = 0,
    the disc. Guarantee CONTENT: the risk outside is at most ``tail`` by the sentence above, for
    every covariance. Relation NONE: for thin covariances the region is not convex and reaches
    beyond the ellipse plus disc of content 1 - eps, for round ones it lies within. It holds
    `BestHalfPlane`, which turns the line to where the bound is smallest.

    The constraint is log(|d|) - log(margin + z h(a)) >= 0, unit-free.

    References
    ----------
    H. Zhu and J. Alonso-Mora, Chance-Constrained Collision Avoidance for MAVs in Dynamic
    Environments, IEEE Robotics and Automation Letters 4(2), 2019.
    """

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "zhu2019chance"

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """Log |d| - log(margin + z h(a)) >= 0, by `gaussian.log_gauge`."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        squared = sum(c**2 for c in x) + gaussian.FLOOR**2
        # At the centre the direction turns without bounds, and so would the curvature, see
        # `gaussian.log_gauge`.
        away = ca.fmax(squared, gaussian.CENTRE * margin**2)
        spread = sum((c * s) ** 2 for c, s in zip(x, deviations, strict=True)) / away
        reach = margin + ca.fmax(level, 0.0) * ca.sqrt(spread + gaussian.FLOOR**2) + gaussian.FLOOR
        return Constraint((gaussian.log_gauge(squared / reach**2),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether |d| < margin + z h(a)."""
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        x = gaussian.local(np.asarray(points), mean, vectors)
        length = np.hypot.reduce(x, axis=-1)
        along = np.hypot.reduce(x * deviations, axis=-1)
        centred = np.broadcast_to(deviations[..., 0], length.shape)
        spread = np.where(length > 0, along / np.where(length > 0, length, 1.0), centred)
        return np.asarray(length < margin + np.asarray(level) * spread)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points (margin + z h(a)) a at equal steps of the polar angle, (count, 2), m."""
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        a = gaussian.circle(count, vectors)
        reach = margin + level * np.hypot.reduce(a * deviations, axis=-1)
        return np.asarray(mean + (reach[:, None] * a) @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Volume of the unit ball times the mean of (margin + z h)^D over directions, m^D.

        By the moments of h over directions: the mean is L / (2 pi) in 2-D, with L the
        perimeter of the ellipse with semi-axes sigma_i, and R_G(l_1, l_2, l_3) in 3-D; the mean
        of the square tr(Sigma) / D; of the cube
        `metrics.ellipses.mean_cubed_support`.
        """
        _, _, deviations, margin = gaussian.unpack(parameters)
        z, size = np.asarray(level), deviations.shape[-1]
        square = z**2 * (deviations**2).mean(axis=-1)
        if size == 2:
            mean = z * perimeter(deviations) / (2.0 * np.pi)
            total = margin**2 + 2.0 * margin * mean + square
        else:
            mean, cube = z * mean_support(deviations), z**3 * mean_cubed_support(deviations)
            total = margin**3 + 3.0 * margin * (margin * mean + square) + cube
        return np.asarray(UNIT_BALL[size] * total)

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Return margin + z sigma_1, m, since h(a) is at most sigma_1."""
        return np.asarray(level * deviations[..., 0] + margin)
