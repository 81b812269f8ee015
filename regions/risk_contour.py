"""The exact contour of the collision probability: the smallest region for a risk per step."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.arrays import Array, BoolArray, Scalar, whole
from ..framework.forecast import GaussianObstacle
from ..framework.motion import Pose
from ..framework.region import Constraint, Guarantee, Region, Relation
from ..framework.risk import collision_probability
from ..framework.symbolic import ca
from . import gaussian, rays
from .normal import deep_inside, log_interval

_REACH = 9.0
"""Standard deviations beyond the likeliest point that the integral covers, as in risk.py."""
_TINY = 1e-12
"""Keeps the square root differentiable where P is 1; moves the level by 5e-13 / level."""


@final
@dataclass(frozen=True)
class RiskContour(Region):
    """{p : P(p) > eps}, P the probability that the obstacle is closer than the margin.

    Nothing smaller keeps the risk eps per step. P is log-concave in p (Prekopa), so the region
    is convex. It is empty where P at the mean is at most eps: then `contains` is False
    everywhere and the constraint holds everywhere.

    ``tail`` is eps, the collision risk asked for, ``level`` is sqrt(-2 ln eps). Guarantee
    CONTENT: outside the risk is at most ``tail`` by definition. Relation INNER to the sum of
    content 1 - eps: P is at most the bound of the best half-plane, see `BestHalfPlane`.

    The constraint is sqrt(-2 log P) - level >= 0, about the distance in deviations. log P is the
    integral of `framework.risk.collision_probability` with ``nodes`` Gauss-Legendre nodes, as a
    sum of exponentials of logarithms, so that it keeps its meaning down to any P. Of 4000
    random covariances with conditions up to 1e4 the largest relative error of P was 1.3e-4
    above 1e-12 and below 1e-3 above 1e-18 (99 % of those above 1e-6: 2e-6), with 48 nodes 5e-8;
    farther out log P is right to 0.2 %. `contains` uses 64 nodes, right to 1e-10 there.
    Deep inside, where P is 1 to all digits, `regions.normal.deep_inside` gives the slope.

    Parameters
    ----------
    nodes : of the integral in the constraint.

    References
    ----------
    A. Prekopa, On logarithmic concave measures and functions, Acta Scientiarum Mathematicarum
    34 (1973), for the convexity.
    """

    nodes: int = 32

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    reference: ClassVar[str] = "prekopa1973"

    def __post_init__(self) -> None:
        whole("nodes", self.nodes, least=8)

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin: (...,) -> (..., 9); see `regions.gaussian`."""
        return gaussian.pack(obstacle, margin, self.dimensions)

    def parameter_count(self, dimension: int) -> int:
        """P = 9."""
        return gaussian.packed_count(dimension)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """sqrt(-2 log P) - level >= 0; deep inside with a slope added."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        solid = [ca.sqrt(s**2 + gaussian.FLOOR**2) for s in deviations]
        room = ca.sqrt(margin**2 + gaussian.FLOOR**2)
        logarithm = _log_probability([ca.fabs(c) for c in x], solid, room, self.nodes)
        distance = ca.sqrt(ca.fmax(-2.0 * logarithm, 0.0) + _TINY)
        return Constraint((distance - level + deep_inside(x, solid[0], room, level),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the collision probability exceeds eps."""
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        x = gaussian.local(np.asarray(points), mean, vectors)
        risk = _probability(x, deviations, margin)
        return np.asarray(risk > np.exp(-0.5 * np.asarray(level) ** 2))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points by search along rays, (count, 2), m; the mean where the region is empty."""
        field, upper = _along_rays(parameters, np.asarray(level))
        return rays.boundary(field, upper, parameters, count)

    def area(self, parameters: Array, level: Array) -> Array:
        """Quadrature over the rays, m^2, relative error below 1e-6."""
        return rays.area(*_along_rays(parameters, level))

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level sqrt(-2 ln eps)."""
        return gaussian.ellipse_level(tail)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Collision risk exp(-level^2 / 2) on the boundary."""
        return gaussian.ellipse_tail(level)


def _probability(x: Array, deviations: Array, margin: Array) -> Array:
    return collision_probability(x, deviations[..., None] ** 2 * np.eye(2), margin)


def _along_rays(parameters: Array, level: Array) -> tuple[rays.Field, rays.Field]:
    """Field and outer multiples for `regions.rays`."""
    _, _, deviations, margin = gaussian.unpack(parameters)
    s, room = deviations[..., None, :], margin[..., None]
    size = np.asarray(level, dtype=np.float64)[..., None]

    def field(x: Array) -> Array:
        return np.asarray(-2.0 * np.log(np.maximum(_probability(x, s, room), 1e-300)) - size**2)

    def upper(direction: Array) -> Array:
        """Out to `HalfPlane` of the level: there P is at most Phi(-level), below eps."""
        length = np.hypot.reduce(direction, axis=-1)
        far = room + size * np.hypot.reduce(direction * s, axis=-1) / length
        return np.asarray(1.01 * (far + gaussian.FLOOR) / length)

    return field, upper


def _log_probability(x: list[Scalar], s: list[Scalar], room: Scalar, nodes: int) -> Scalar:
    """Log P in the eigenframe, x >= 0: twin of `framework.risk.collision_probability`."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    half = s[1] * ca.sqrt(_REACH**2 + _nearest(x, s, room) ** 2)
    # Short of 1 by so little that the arc left out has weight 1e-14, and asin has a slope.
    ends = [
        ca.fmin(ca.fmax((-x[1] + side * half) / room, -1 + 1e-14), 1 - 1e-14) for side in (-1, 1)
    ]
    low, high = (ca.asin(end) for end in ends)
    angle = 0.5 * (high + low) + 0.5 * (high - low) * ca.DM(points)
    chord = room * ca.cos(angle)
    offset = (room * ca.sin(angle) + x[1]) / s[1]
    terms = (
        np.log(weights / np.sqrt(2.0 * np.pi))
        + ca.log(chord / s[1])
        - 0.5 * offset**2
        + log_interval(x[0], chord, s[0])
    )
    largest = ca.mmax(terms)
    width = ca.log(ca.fmax(0.5 * (high - low), 1e-100))
    return largest + ca.log(ca.sum1(ca.exp(terms - largest))) + width


def _nearest(x: list[Scalar], s: list[Scalar], room: Scalar) -> Scalar:
    """Bound on the Mahalanobis distance of the disc, as in risk.py: the better of two points."""
    length = ca.sqrt(x[0] ** 2 + x[1] ** 2 + gaussian.FLOOR**2)
    share = ca.fmax(1.0 - room / length, 0.0)
    radial = share * ca.sqrt((x[0] / s[0]) ** 2 + (x[1] / s[1]) ** 2 + 1e-20)
    edge = ca.fmin(x[1], room)
    chord = ca.sqrt(ca.fmax(room**2 - edge**2, 0.0) + gaussian.FLOOR**2)
    rest = ca.fmax(x[0] - chord, 0.0) / s[0]
    straight = ca.sqrt(rest**2 + ((x[1] - edge) / s[1]) ** 2 + 1e-20)
    return ca.fmin(radial, straight)
