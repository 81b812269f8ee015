"""Lütkepohl's forecast region: a rectangle on the world axes, by Bonferroni per component."""

from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, Literal, final

import numpy as np
from scipy import special

from ..framework.arrays import Array, BoolArray, Scalar, probability
from ..framework.errors import WideberthError
from ..framework.forecast import GaussianObstacle
from ..framework.motion import Pose
from ..framework.region import Constraint, Convex, Guarantee, Relation, Signed
from ..framework.symbolic import ca
from . import gaussian

_TINY = 1e-13
"""Keeps the logarithm finite at the centre; moves the boundary by 5e-14 of its distance."""


@final
@dataclass(frozen=True)
class LuetkepohlRectangle(Signed, Convex):
    """Rectangle with half-widths z sqrt(Sigma_kk), enlarged by the margin.

    With K = D components and tail alpha each component gets the interval of tail alpha / K,
    z = Phi^-1(1 - alpha / (2K)); by Bonferroni's inequality all hold together with probability
    at least 1 - alpha. The axes are those of the world, so turning the scene does not turn the
    region.

    ``enlargement`` "disc" is the exact sum of rectangle and disc (rounded corners), "box" adds
    the margin to the half-widths (mitred corners, larger by margin^2 (4 - pi), farther by
    margin * sqrt 2 at the corner).

    Guarantee CONTENT: outside, the disc does not touch the rectangle, so the collision risk is
    at most the probability that the obstacle leaves it, at most alpha. Relation NONE: it
    contains the ellipse plus disc in some directions and not in others, since z < s.

    The constraint is 0.5 log(g^2) >= 0 with g the gauge of the enlarged rectangle, the factor
    by which rectangle and disc must grow to reach the point. It has a closed form without
    auxiliaries: component i takes part iff sum_j max(|x_j| h_i - |x_i| h_j, 0)^2 < x_i^2 rho^2,
    and with A = sum h_i^2 - rho^2, B = sum |x_i| h_i, C = sum x_i^2 over those that do
    g = C / (B + sqrt(B^2 - A C)). The gradient is continuous and does not vanish, inside or
    out; the signed distance has neither property inside, and the form with a separating line
    needs an angle and four inequalities. For "box" the gauge has a kink on the diagonals.

    The paper says that the ellipse is less conservative than this rectangle; that holds before
    the enlargement. After it the rounded rectangle can be the smaller one (deviations 1 m and
    0.1 m along the world axes, margin 1.5 m, content 0.9: 0.997 of the area).

    References
    ----------
    H. Lütkepohl, New Introduction to Multiple Time Series Analysis (2005), pp. 39-41.
    """

    enlargement: Literal["disc", "box"] = "disc"

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    rotation_invariant: ClassVar[bool] = False
    reference: ClassVar[str] = "luetkepohl2005new"

    def __post_init__(self) -> None:
        if self.enlargement not in ("disc", "box"):
            raise WideberthError(
                f"enlargement is {self.enlargement!r}; wanted 'disc' (exact) or 'box'"
            )

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean (D), sqrt(Sigma_kk) (D) and margin, all in m: (...,) -> (..., 2D + 1)."""
        room = gaussian.checked_margin(obstacle, margin, self.dimensions)
        variance = np.diagonal(obstacle.covariance, axis1=-2, axis2=-1)
        deviation = np.sqrt(np.clip(variance, 0.0, None))
        return np.concatenate([obstacle.mean, deviation, room[..., None]], axis=-1)

    def parameter_count(self, dimension: int) -> int:
        """P = 2D + 1."""
        return 2 * dimension + 1

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log g^2 >= 0."""
        size = len(pose.position)
        x = [ca.fabs(pose.position[i] - parameters[i]) for i in range(size)]
        half = [level * parameters[size + i] for i in range(size)]
        margin = parameters[2 * size]
        if self.enlargement == "box":
            half, margin = [h + margin for h in half], 0.0
        gauge = _gauge(x, half, margin**2 + gaussian.FLOOR**2)
        return Constraint((0.5 * ca.log(gauge**2 + _TINY),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the signed distance is below 0."""
        return np.asarray(self.signed_distance(points, parameters, level) < 0.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside."""
        mean, half, margin = self._frame(parameters, level)
        return np.asarray(distance_to_box(np.asarray(points) - mean, half) - margin)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + sum_i |n_i| h_i + margin, m."""
        mean, half, margin = self._frame(parameters, level)
        normals = np.asarray(normals)
        return np.asarray((normals * mean + np.abs(normals) * half).sum(axis=-1) + margin)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points along the corners' arcs and, for the straight parts, their ends, (count, 2)."""
        mean, half, margin = self._frame(parameters, np.asarray(level))
        angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
        # Counting from the corners, so that each has at least an equal share of the points.
        quarter = np.floor(angle / (0.5 * np.pi))
        corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])[quarter.astype(int)]
        first = np.searchsorted(quarter, np.arange(4))
        per_corner = np.bincount(quarter.astype(int), minlength=4)
        index = np.arange(count) - first[quarter.astype(int)]
        share = index / np.maximum(per_corner[quarter.astype(int)] - 1, 1)
        turn = 0.5 * np.pi * (quarter + share)
        normal = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        return np.asarray(mean + corner * half + margin * normal)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula for a box: 4 hx hy + 4 margin (hx + hy) + pi margin^2 in 2-D."""
        _, half, margin = self._frame(parameters, level)
        size = half.shape[-1]
        volume, edges = 2.0**size * half.prod(axis=-1), 2.0 * half.sum(axis=-1)
        if size == 2:
            return np.asarray(volume + 2.0 * edges * margin + np.pi * margin**2)
        pairs = sum(half[..., i] * half[..., j] for i, j in combinations(range(size), 2))
        rounded = np.pi * edges * margin**2 + 4.0 / 3.0 * np.pi * margin**3
        return np.asarray(volume + 8.0 * pairs * margin + rounded)

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level z = Phi^-1(1 - tail / (2K)); not below Phi^-1(1 - 1 / (2K))."""
        return -float(special.ndtri(probability("tail", tail) / (2 * dimension)))

    def tail(self, level: float, dimension: int = 2) -> float:
        """Bonferroni's bound 2K Phi(-z) on 1 - content, at most 1 (it is no promise there)."""
        return min(1.0, 2 * dimension * float(special.ndtr(-max(float(level), 0.0))))

    def _frame(self, parameters: Array, level: Array) -> tuple[Array, Array, Array]:
        parameters = np.asarray(parameters, dtype=np.float64)
        size = parameters.shape[-1] // 2
        mean, deviation, margin = np.split(parameters, [size, 2 * size], axis=-1)
        half = np.abs(np.asarray(level))[..., None] * deviation
        if self.enlargement == "box":
            return mean, half + margin, np.zeros_like(half[..., 0] + margin[..., 0])
        return mean, half, margin[..., 0]


def distance_to_box(points: Array, half: Array) -> Array:
    """Distance from points around the centre to a box with these half-widths, (...), m.

    |max(q, 0)| + min(max_i q_i, 0) with q = |x| - half: negative inside.
    """
    q = np.abs(points) - half
    outside = np.hypot.reduce(np.maximum(q, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(q.max(axis=-1), 0.0))


def box_content(half: Array, covariance: Array, nodes: int = 200) -> float:
    """Exact probability that a centred 2-D Gaussian lies in the box with these half-widths.

    The integral of the marginal density over one axis times the conditional probability of the
    other, by Gauss-Legendre; for correlations up to about 0.99.
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    first, second = np.sqrt(np.diagonal(covariance))
    correlation = covariance[0, 1] / (first * second)
    u = half[0] / first * points
    spread = np.sqrt(1.0 - correlation**2)
    upper = special.ndtr((half[1] / second - correlation * u) / spread)
    lower = special.ndtr((-half[1] / second - correlation * u) / spread)
    density = np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi)
    return float(half[0] / first * (weights * density * (upper - lower)).sum())


def _gauge(x: list[Scalar], half: list[Scalar], disc: Scalar) -> Scalar:
    """Gauge of box plus disc in CasADi; ``x`` are absolute values, ``disc`` the margin squared."""
    size = len(x)
    active = [
        sum(ca.fmax(x[j] * half[i] - x[i] * half[j], 0) ** 2 for j in range(size) if j != i)
        < x[i] ** 2 * disc
        for i in range(size)
    ]
    b = sum(active[i] * x[i] * half[i] for i in range(size))
    c = sum(active[i] * x[i] ** 2 for i in range(size))
    # B^2 - A C by Lagrange's identity, which does not cancel.
    cross = sum(
        active[i] * active[j] * (x[i] * half[j] - x[j] * half[i]) ** 2
        for i, j in combinations(range(size), 2)
    )
    root = ca.sqrt(ca.fmax(disc * c - cross, 1e-40))
    return c / (b + root)
