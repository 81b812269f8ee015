"""Parameters in the eigenframe of a covariance, levels, and the bases of elliptic regions.

Layout of the parameters, P = D + D^2 + D + 1 numbers: mean (D), eigenvectors row by row
(D^2, one vector per column), deviations sqrt(eigenvalue) from large to small (D), margin.
"""

import math
from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from ..framework.numerics.chi_square import content_bound
from ..framework.numerics.eigenframe import eigen_axes
from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, ClosedForm, Convex, Region, RiskLevel, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar, all_finite, probability
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from ..metrics.ellipses import UNIT_BALL, distance_to_ellipse

FLOOR = 1e-9
"""m. Added in quadrature to every axis, so that a point obstacle without margin gives finite
numbers. An axis of 1 m or more does not change in float64, one of 1 mm by 1e-12 of its length.
"""
CENTRE = 1e-4
"""Keeps the curvature of a gauge's logarithm finite at the centre, see `log_gauge`."""


def log_gauge(squared: Scalar) -> Scalar:
    """0.5 log((g^2 + c) / (1 + c)) in CasADi, with c = `CENTRE`: >= 0 outside, where g >= 1.

    The boundary g = 1 is met exactly; the gradient there is 1 / (1 + c) of that of log g. Without
    c the second derivative grows as 1 / g^2 towards the centre. A start on top of an obstacle
    then gives second derivatives, times the price of slack, of 1e12 and more, with which the
    inertia correction of fatrop does not terminate.
    """
    return 0.5 * (ca.log(squared + CENTRE) - math.log1p(CENTRE))


def checked_margin(obstacle: GaussianObstacle, margin: Array, dimensions: Sequence[int]) -> Array:
    """Broadcast the margin, m, over the batch of obstacles.

    Raises
    ------
    WideberthError : margin negative or not finite, or a dimension the region does not know.
    """
    size = obstacle.mean.shape[-1]
    if size not in dimensions:
        raise WideberthError(
            f"the obstacle has {size} coordinates; this region takes {tuple(dimensions)}"
        )
    values = np.asarray(margin, dtype=np.float64)
    if not all_finite(values) or (values < 0).any():
        raise WideberthError(
            f"margin is {margin}; wanted the sum of two radii in m, finite and at least 0"
        )
    batch = obstacle.mean.shape[:-1]
    if values.shape == batch:
        return values
    try:
        return np.broadcast_to(values, batch)
    except ValueError:
        raise WideberthError(
            f"margin has shape {values.shape}; wanted {batch}, one for each obstacle, or a number"
        ) from None


def pack(obstacle: GaussianObstacle, margin: Array, dimensions: Sequence[int]) -> Array:
    """Parameters of an elliptic region, (...,) -> (..., P); raises as `checked_margin`."""
    room = checked_margin(obstacle, margin, dimensions)
    deviations, vectors = eigen_axes(obstacle.covariance)
    flat = vectors.reshape(*vectors.shape[:-2], -1)
    return np.concatenate([obstacle.mean, flat, deviations, room[..., None]], axis=-1)


def pack_symbols(mean: Scalar, covariance: Scalar, margin: Scalar) -> Scalar:
    """CasADi twin of `pack` in the plane, by the closed form of a matrix [[a, b], [b, c]].

    Its eigenvalues are l1 = (a + c + sqrt((a - c)^2 + 4 b^2)) / 2 and (a c - b^2) / l1, negative
    ones 0; the first eigenvector stands at the angle atan2(2 b, a - c) / 2.

    Raises
    ------
    WideberthError : not two coordinates.
    """
    if mean.numel() != 2:
        raise WideberthError(
            f"axes of a covariance in {mean.numel()} dimensions have no closed form here; wanted 2"
        )
    a, b, c = covariance[0, 0], covariance[1, 0], covariance[1, 1]
    first = ca.fmax(0.5 * (a + c + ca.hypot(a - c, 2.0 * b)), 0.0)
    second = ca.fmax(a * c - b * b, 0.0) / ca.fmax(first, _LEAST)
    angle = 0.5 * ca.atan2(2.0 * b, a - c)
    cosine, sine = ca.cos(angle), ca.sin(angle)
    axes = [cosine, -sine, sine, cosine, ca.sqrt(first), ca.sqrt(second)]
    return ca.vertcat(mean, *axes, margin)


_LEAST = 1e-300
"""m^2, so that nothing is divided by a variance of 0."""


def packed_count(dimension: int) -> int:
    """P for obstacles in D dimensions."""
    return dimension * (dimension + 2) + 1


def dimension(parameters: Array) -> int:
    """D of packed parameters, from P = (D + 1)^2."""
    return math.isqrt(np.shape(parameters)[-1]) - 1


def unpack(parameters: Array) -> tuple[Array, Array, Array, Array]:
    """Mean (..., D), eigenvectors (..., D, D), deviations (..., D) and margin (...)."""
    parameters = np.asarray(parameters, dtype=np.float64)
    size = dimension(parameters)
    mean, flat, deviations, margin = np.split(
        parameters, [size, size + size**2, size * (size + 2)], axis=-1
    )
    return mean, flat.reshape(*flat.shape[:-1], size, size), deviations, margin[..., 0]


def local(points: Array, mean: Array, vectors: Array) -> Array:
    """Points in the eigenframe, R^T (p - mu), (..., D) m."""
    return np.asarray(np.einsum("...ij,...i->...j", vectors, points - mean))


def local_corners(pose: Pose, mean: Array, vectors: Array) -> Array:
    """Corners of NumPy poses in the eigenframe, (..., V, D) m; V is 1 for a point."""
    return local(pose.corner_points(), mean[..., None, :], vectors[..., None, :, :])


def local_symbols(pose: Pose, parameters: Scalar) -> tuple[list[Scalar], list[Scalar], Scalar]:
    """CasADi twin of `unpack` and `local`: coordinates, deviations, margin."""
    size = len(pose.position)
    shift = [pose.position[i] - parameters[i] for i in range(size)]
    coordinates = [
        sum(parameters[size + size * i + j] * shift[i] for i in range(size)) for j in range(size)
    ]
    start = size + size**2
    deviations = [parameters[start + j] for j in range(size)]
    return coordinates, deviations, parameters[start + size]


def ellipse_level(tail: float, dimension: int = 2) -> float:
    """Level s with Pr(d_M > s) = tail, the root of the upper chi-square quantile.

    In 2-D sqrt(-2 ln tail), the paper's sqrt(-2 ln(1 - p)); in 3-D the root of
    erf(s / sqrt 2) - sqrt(2 / pi) s exp(-s^2 / 2) = 1 - tail. The tail is the argument, since
    1 - 1e-12 as a float has lost four digits of it.
    """
    return math.sqrt(content_bound(dimension, tail))


def ellipse_tail(level: float, dimension: int = 2) -> float:
    """Pr(d_M > s), the inverse of `ellipse_level`; 1 for s at or below 0."""
    size = max(float(level), 0.0)
    if dimension == 2:
        return float(np.exp(-0.5 * size**2))
    from scipy.special import chdtrc

    return float(chdtrc(dimension, size**2))


def line_level(risk: float) -> float:
    """Level s = Phi^-1(1 - risk), at least 0: how many deviations a line is from the mean.

    A normal coordinate lies beyond it with probability ``risk``.
    """
    from scipy.special import ndtri

    return max(0.0, -float(ndtri(probability("risk", risk))))


def line_risk(level: float) -> float:
    """Phi(-s), the inverse of `line_level`; 1/2 for s at or below 0."""
    from scipy.special import ndtr

    return float(ndtr(-max(float(level), 0.0)))


def circle(count: int, vectors: Array) -> Array:
    """Return unit vectors in the eigenframe, counter-clockwise in the world, (count, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    turn = np.sign(np.linalg.det(vectors))  # eigenvectors may form a left-handed frame
    return np.stack([np.cos(angle), turn * np.sin(angle)], axis=-1)


class Eigenframe(ClosedForm):
    """A region whose parameters are those of `pack`."""

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean, eigenvectors, deviations, margin: (...,) -> (..., P); see `regions.gaussian`."""
        return pack(obstacle, margin, self.dimensions)

    def closed_form(self, mean: Scalar, covariance: Scalar, margin: Scalar) -> Scalar:
        """Return the same in CasADi, see `pack_symbols`."""
        return pack_symbols(mean, covariance, margin)

    def parameter_count(self, dimension: int) -> int:
        """P, 9 in 2-D and 16 in 3-D."""
        return packed_count(dimension)


class ContentLevel(Region):
    """A region whose level is the Mahalanobis distance s of its content ellipse."""

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level s with Pr(d_M > s) = tail."""
        return ellipse_level(tail, dimension)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Pr(d_M > s)."""
        return ellipse_tail(level, dimension)


class ExponentLevel(Region):
    """A region of a collision risk eps whose level is sqrt(-2 ln eps), in every dimension."""

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level sqrt(-2 ln eps)."""
        return ellipse_level(tail)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Collision risk exp(-level^2 / 2)."""
        return ellipse_tail(level)


class LineLevel(Region):
    """A region of a collision risk eps whose level is z = Phi^-1(1 - eps), at least 0."""

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level z = Phi^-1(1 - tail), at least 0."""
        return line_level(probability("tail", tail))

    def tail(self, level: float, dimension: int = 2) -> float:
        """Collision risk Phi(-z) outside the region."""
        return line_risk(level)


class LineRisk(RiskLevel):
    """A region that a line separates from the robot, so that the risk is at most Phi(-s)."""

    def level_for_risk(self, risk: float) -> float:
        """Level s at which the collision risk per step is at most ``risk`` (below 1/2)."""
        return line_level(risk)

    def risk(self, level: float) -> float:
        """Return the bound Phi(-s) on the collision risk outside the region."""
        return line_risk(level)


class Ellipse(Signed, Convex, Bounded):
    """An ellipse {p : sum_i (R^T (p - mu))_i^2 / c_i^2 < 1} on parameters of `pack`."""

    @abstractmethod
    def axes(self, parameters: Array, level: Array) -> Array:
        """Semi-axes c_i, (..., D), m, from large to small."""

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the sum is below 1."""
        x = _centred(points, parameters)
        return np.asarray(((x / self.axes(parameters, level)) ** 2).sum(axis=-1) < 1.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the ellipse, m, negative inside."""
        return distance_to_ellipse(_centred(points, parameters), self.axes(parameters, level))

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + |diag(c) R^T n|, m."""
        mean = unpack(parameters)[0]
        n = _centred(normals + mean, parameters)
        along = (np.asarray(normals) * mean).sum(axis=-1)
        return np.asarray(along + np.hypot.reduce(self.axes(parameters, level) * n, axis=-1))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points at equal steps of the eccentric angle, (count, 2), m."""
        mean, vectors, _, _ = unpack(parameters)
        axes = self.axes(parameters, np.asarray(level))
        return np.asarray(mean + (circle(count, vectors) * axes) @ vectors.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Pi c_1 c_2, or 4/3 pi c_1 c_2 c_3."""
        axes = self.axes(parameters, level)
        return np.asarray(UNIT_BALL[axes.shape[-1]] * axes.prod(axis=-1))


def _centred(points: Array, parameters: Array) -> Array:
    """Points in the eigenframe of packed parameters, (..., D), m."""
    mean, vectors, _, _ = unpack(parameters)
    return local(np.asarray(points), mean, vectors)
