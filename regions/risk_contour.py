"""The exact contour of the collision probability: the smallest region for a risk per step."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, Constraint, Guarantee, Relation
from ..framework.risk.inversion import log_probability
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from . import gaussian, rays
from .log_normal_probability import deep_inside

_NODES, _FINE_NODES = 24, 40
"""Of the integral in the constraint and in the NumPy twin; see `framework.risk.inversion.rule`."""
_TINY = 1e-12
"""Keeps the square root differentiable where P is 1; moves the level by 5e-13 / level."""


@final
@dataclass(frozen=True)
class RiskContour(gaussian.Eigenframe, gaussian.ExponentLevel, Bounded):
    """{p : P(p) > eps}, P the probability that the obstacle is closer than the margin.

    Nothing smaller keeps the risk eps per step. P is log-concave in p (Prekopa), so the region
    is convex. It is empty where P at the mean is at most eps: then `contains` is False
    everywhere and the constraint holds everywhere.

    ``tail`` is eps, the collision risk asked for, ``level`` is sqrt(-2 ln eps). Guarantee
    CONTENT: outside the risk is at most ``tail`` by definition. Relation INNER to the sum of
    content 1 - eps: P is at most the bound of the best half-plane, see `BestHalfPlane`.

    The constraint is sqrt(-2 log P) - level >= 0, about the distance in deviations. log P is one
    integral in the complex plane for 2-D and 3-D alike,
    `framework.risk.inversion.log_probability`, which keeps its digits far out in the tails: the
    relative error of P is below 1e-6 in the constraint and 5e-9 in `contains`, as measured there.
    Nested Gauss-Legendre quadrature would need 32 nodes per dimension for 1e-4 in the constraint,
    in 3-D some hundred times the operations.
    Deep inside, where P is 1 to all digits, `log_normal_probability.deep_inside` gives the slope.

    References
    ----------
    A. Prekopa, On logarithmic concave measures and functions, Acta Scientiarum Mathematicarum
    34 (1973), for the convexity.
    """

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "prekopa1973"

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """sqrt(-2 log P) - level >= 0; deep inside with a slope added."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        solid = [ca.sqrt(s**2 + gaussian.FLOOR**2) for s in deviations]
        room = ca.sqrt(margin**2 + gaussian.FLOOR**2)
        logarithm = log_probability(x, solid, room, _NODES)
        distance = ca.sqrt(ca.fmax(-2.0 * logarithm, 0.0) + _TINY)
        return Constraint((distance - level + deep_inside(x, solid[0], room, level),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the collision probability exceeds eps."""
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        x = gaussian.local(np.asarray(points), mean, vectors)
        return np.asarray(_log_risk(x, deviations, margin) > -0.5 * np.asarray(level) ** 2)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points by search along rays, (count, 2), m; the mean where the region is empty."""
        field, upper = _along_rays(parameters, np.asarray(level))
        return rays.boundary(field, upper, parameters, count)

    def area(self, parameters: Array, level: Array) -> Array:
        """Quadrature over the rays, m^2 or m^3, relative error below 1e-6."""
        return rays.area(*_along_rays(parameters, level), gaussian.dimension(parameters))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Return margin + level sigma_1, m: beyond `HalfPlane` P is at most Phi(-level)."""
        return np.asarray(level * deviations[..., 0] + margin)


def _log_risk(x: Array, deviations: Array, margin: Array) -> Array:
    """Log P in the eigenframe, (..., D) -> (...)."""
    solid, room = np.hypot(deviations, gaussian.FLOOR), np.hypot(margin, gaussian.FLOOR)
    places, spreads = list(np.moveaxis(x, -1, 0)), list(np.moveaxis(solid, -1, 0))
    return np.asarray(log_probability(places, spreads, room, _FINE_NODES))


def _along_rays(parameters: Array, level: Array) -> tuple[rays.Field, rays.Field]:
    """Field and outer multiples for `regions.rays`."""
    _, _, deviations, margin = gaussian.unpack(parameters)
    s, room = deviations[..., None, :], margin[..., None]
    size = np.asarray(level, dtype=np.float64)[..., None]

    def field(x: Array) -> Array:
        return np.asarray(-2.0 * _log_risk(x, s, room) - size**2)

    def upper(direction: Array) -> Array:
        """Out to `HalfPlane` of the level: there P is at most Phi(-level), below eps."""
        length = np.hypot.reduce(direction, axis=-1)
        far = room + size * np.hypot.reduce(direction * s, axis=-1) / length
        return np.asarray(1.01 * (far + gaussian.FLOOR) / length)

    return field, upper
