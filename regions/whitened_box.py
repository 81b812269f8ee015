"""A box around the body, aligned with the eigenvectors: a product of normal probabilities."""

from dataclasses import dataclass
from functools import reduce
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, Constraint, Guarantee, Polygonal, Relation
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from . import gaussian, rays
from .log_normal_probability import deep_inside, log_interval

_TINY = 1e-12
"""Keeps the square root differentiable where the bound is 1; moves the level by 5e-13 / level."""


@final
@dataclass(frozen=True)
class WhitenedBox(Polygonal, gaussian.Eigenframe, gaussian.ExponentLevel, Bounded):
    """Where the collision risk of the box around the body exceeds eps.

    Along each eigenvector e_k of Sigma the body with corners v_i and the disc of the margin cover
    an interval, and the obstacle's coordinates there are independent:

        P <= prod_k [Phi(high_k / sigma_k) - Phi(low_k / sigma_k)],
        low_k = min_i e_k . (v_i - mu) - margin,    high_k = max_i e_k . (v_i - mu) + margin.

    For a disc, one corner p, this is the square of half-width margin around p. Close to the
    exact probability where the body is at most about as large as the deviations. A bound of the
    kind that Hardy and Campbell use for polygons (decorrelate, bound the body by a box,
    multiply); their formula was not compared.

    ``tail`` is eps, the collision risk asked for, ``level`` is sqrt(-2 ln eps). Guarantee
    CONTENT: the risk outside is at most ``tail`` by the inequality above, also where the region
    is empty (the bound at the mean is at most eps). Each factor is log-concave, so the region is
    convex. Relation NONE: its corners can reach beyond the sum of content 1 - eps. It turns
    with the eigenvectors; those of a round covariance are arbitrary, and for that one case alone
    it is not rotation invariant.

    The constraint is sqrt(-2 log P_box) - level >= 0, about the distance in deviations, from
    tails that keep their digits. Deep inside, where the bound is 1 to all digits, the slope is
    that of `log_normal_probability.deep_inside`. For a body with corners the constraint has
    kinks where two corners are equally far along an eigenvector: its gradient jumps there. A body
    that only moves meets none; of 40 projections that may also turn it IPOPT solved 32 and ran
    out of iterations in 8 (`SeparatingLine`: all).

    References
    ----------
    J. Hardy and M. Campbell, Contingency Planning Over Probabilistic Obstacle Predictions for
    Autonomous Road Vehicles, IEEE Transactions on Robotics 29(4), 2013, pp. 913-929, for the
    idea.
    """

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    rotation_invariant: ClassVar[bool] = False
    reference: ClassVar[str] = "hardy2013contingency"

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """sqrt(-2 log P_box) - level >= 0; deep inside with a slope added."""
        corners = [gaussian.local_symbols(Pose(at), parameters)[0] for at in pose.corners()]
        _, deviations, margin = gaussian.local_symbols(pose, parameters)
        solid = [ca.sqrt(s**2 + gaussian.FLOOR**2) for s in deviations]
        low, high = (
            [reduce(extreme, along) for along in zip(*corners, strict=True)]
            for extreme in (ca.fmin, ca.fmax)
        )
        centre = [0.5 * (a + b) for a, b in zip(low, high, strict=True)]
        half = [0.5 * (b - a) + margin for a, b in zip(low, high, strict=True)]
        sides = zip(centre, half, solid, strict=True)
        logarithm = sum(log_interval(ca.fabs(c), h, s) for c, h, s in sides)
        distance = ca.sqrt(ca.fmax(-2.0 * logarithm, 0.0) + _TINY)
        room = ca.sqrt(reduce(ca.fmin, half) ** 2 + gaussian.FLOOR**2)
        return Constraint((distance - level + deep_inside(centre, solid[0], room, level),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the bound exceeds eps."""
        return self.overlaps(Pose.of(points), parameters, level)

    def overlaps(self, pose: Pose, parameters: Array, level: Array) -> BoolArray:
        """Whether the bound for the bodies exceeds eps."""
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        corners = gaussian.local_corners(pose, mean, vectors)
        low, high = corners.min(axis=-2), corners.max(axis=-2)
        half = 0.5 * (high - low) + margin[..., None]
        risk = _log_bound(0.5 * (low + high), half, deviations)
        return np.asarray(risk > -0.5 * np.asarray(level) ** 2)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points by search along rays, (count, 2), m; the mean where the region is empty."""
        field, upper = _along_rays(parameters, np.asarray(level))
        return rays.boundary(field, upper, parameters, count)

    def area(self, parameters: Array, level: Array) -> Array:
        """Quadrature over the rays, m^2 or m^3, relative error below 1e-6."""
        return rays.area(*_along_rays(parameters, level), gaussian.dimension(parameters))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Corner of the box with half-widths margin + level sigma_k, m.

        Beyond one of them a factor is at most Phi(-level), which is below eps.
        """
        half = np.asarray(margin)[..., None] + np.asarray(level)[..., None] * deviations
        return np.asarray(np.hypot.reduce(half, axis=-1))


def _log_bound(centre: Array, half: Array, deviations: Array) -> Array:
    """Logarithm of the product, in the eigenframe; deviations of zero are limits."""
    from scipy.special import ndtr

    solid = np.hypot(deviations, gaussian.FLOOR)
    low, high = (np.abs(centre) - half) / solid, (np.abs(centre) + half) / solid
    factor = np.where(
        low > 0.0,
        ndtr(-low) - ndtr(-high),
        1.0 - ndtr(-high) - ndtr(low),
    )
    return np.asarray(np.log(np.maximum(factor, 1e-300)).sum(axis=-1))


def _along_rays(parameters: Array, level: Array) -> tuple[rays.Field, rays.Field]:
    """Field and outer multiples for `regions.rays`."""
    _, _, deviations, margin = gaussian.unpack(parameters)
    s, room = deviations[..., None, :], margin[..., None, None]
    size = np.asarray(level, dtype=np.float64)[..., None]

    def field(x: Array) -> Array:
        return np.asarray(-2.0 * _log_bound(x, room, s) - size**2)

    def upper(direction: Array) -> Array:
        """Out to where one factor alone is at most Phi(-level), which is below eps."""
        far = np.hypot(room + size[..., None] * s, gaussian.FLOOR)
        share = np.abs(direction)
        with np.errstate(divide="ignore"):
            return np.asarray((2.0 * far / share).min(axis=-1))

    return field, upper
