"""Lütkepohl's forecast region: a rectangle on the world axes from an interval per component."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import ClosedForm, Constraint
from ..framework.values.arrays import Array, Scalar
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from . import gaussian
from .box import (
    Correction,
    Enlargement,
    Rectangle,
    box_boundary,
    box_outside,
    distance_to_box,
)


@final
@dataclass(frozen=True)
class LuetkepohlRectangle(ClosedForm, Rectangle):
    """Rectangle with half-widths z sqrt(Sigma_kk), enlarged by the margin.

    With K = D components and tail alpha each component gets the interval of tail alpha / K,
    z = Phi^-1(1 - alpha / (2K)); by Bonferroni's inequality all hold together with probability
    at least 1 - alpha. ``correction`` "sidak" takes z = Phi^-1((1 + (1 - alpha)^(1/K)) / 2)
    instead, a little smaller and still safe for any correlation by Šidák's inequality. The axes
    are those of the world, so turning the scene does not turn the region (`EigenRectangle` does).

    ``enlargement`` "disc" is the exact sum of rectangle and disc (rounded corners), "box" adds
    the margin to the half-widths (mitred corners, larger by margin^2 (4 - pi), farther by
    margin * sqrt 2 at the corner).

    Guarantee CONTENT: outside, the disc does not touch the rectangle, so the collision risk is
    at most the probability that the obstacle leaves it, at most alpha. Relation NONE: it
    contains the ellipse plus disc in some directions and not in others, since z < s (with
    "bonferroni" for contents above 0.45).

    The constraint is 0.5 log(g^2) >= 0 with g the gauge of the enlarged rectangle, the factor
    by which rectangle and disc must grow to reach the point. It has a closed form without
    auxiliaries: component i takes part iff sum_j max(|x_j| h_i - |x_i| h_j, 0)^2 < x_i^2 rho^2,
    and with A = sum h_i^2 - rho^2, B = sum |x_i| h_i, C = sum x_i^2 over those that do
    g = C / (B + sqrt(B^2 - A C)). The gradient is continuous and does not vanish, inside or
    out; the signed distance has neither property inside, and the form with a separating line
    needs an angle and four inequalities. For "box" the gauge has a kink on the diagonals.

    The paper says that the ellipse is less conservative than this rectangle, and that holds after
    the enlargement too. With d_i = sqrt(Sigma_ii), eigenvalues sigma_i^2 and margin rho the areas
    of rounded rectangle and of the paper's enlarged ellipse are

        4 z^2 d_1 d_2 + 4 z rho (d_1 + d_2) + pi rho^2,
        pi s^2 sigma_1 sigma_2 + pi s rho (sigma_1 + sigma_2) + pi rho^2.

    The ellipse is the smallest set of its content and for Sigma = I the square holds at least that
    content, so 4 z^2 >= pi s^2; hence 4 z >= 2 sqrt(pi) s > pi s. By Hadamard's inequality
    sigma_1 sigma_2 <= d_1 d_2, and with the same trace sigma_1 + sigma_2 <= d_1 + d_2. Every term
    is at least as large. The exact sum of ellipse and disc has the ellipse's perimeter
    L <= 4 s (sigma_1 + sigma_2) in its second term, pi s (sigma_1 + sigma_2) <= L, and can
    be the larger one where z < s: the rounded rectangle has more than z / s of its area (0.913 at
    content 0.9, approached by thin covariances along a world axis), 0.997 for deviations of 1 m
    and 0.1 m and a margin of 1.5 m.

    Parameters
    ----------
    correction : "sidak" or "bonferroni", of the half-widths for the number of components.
    enlargement : "disc" for rounded corners, "box" for mitred ones.

    References
    ----------
    H. Lütkepohl, New Introduction to Multiple Time Series Analysis (2005), pp. 39-41.
    Z. Šidák, Rectangular confidence regions for the means of multivariate normal distributions,
    J. Amer. Statist. Assoc. 62 (1967).
    """

    enlargement: Enlargement = "disc"
    correction: Correction = "bonferroni"

    reference: ClassVar[str] = "luetkepohl2005new"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Mean (D), sqrt(Sigma_kk) (D) and margin, all in m: (...,) -> (..., 2D + 1)."""
        room = gaussian.checked_margin(obstacle, margin, self.dimensions)
        variance = np.diagonal(obstacle.covariance, axis1=-2, axis2=-1)
        deviation = np.sqrt(np.clip(variance, 0.0, None))
        return np.concatenate([obstacle.mean, deviation, room[..., None]], axis=-1)

    def closed_form(self, mean: Scalar, covariance: Scalar, margin: Scalar) -> Scalar:
        """Return the same in CasADi."""
        deviation = ca.sqrt(ca.fmax(ca.diag(covariance), 0.0))
        return ca.vertcat(mean, deviation, margin)

    def parameter_count(self, dimension: int) -> int:
        """P = 2D + 1."""
        return 2 * dimension + 1

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log g^2 >= 0."""
        size = len(pose.position)
        x = [pose.position[i] - parameters[i] for i in range(size)]
        half = [level * parameters[size + i] for i in range(size)]
        return Constraint((box_outside(x, half, parameters[2 * size], self.enlargement),))

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside."""
        mean, (half, margin) = _parts(parameters)[0], self.sides(parameters, level)
        return np.asarray(distance_to_box(np.asarray(points) - mean, half) - margin)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + sum_i |n_i| h_i + margin, m."""
        mean, (half, margin) = _parts(parameters)[0], self.sides(parameters, level)
        normals = np.asarray(normals)
        return np.asarray((normals * mean + np.abs(normals) * half).sum(axis=-1) + margin)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points along the corners' arcs and, for the straight parts, their ends, (count, 2)."""
        mean, (half, margin) = _parts(parameters)[0], self.sides(parameters, np.asarray(level))
        return np.asarray(mean + box_boundary(half, margin, count))

    def sides(self, parameters: Array, level: Array) -> tuple[Array, Array]:
        """Half-widths along the world's axes, and the margin; see `Rectangle.sides`."""
        _, deviation, margin = _parts(parameters)
        return self.enlarged(deviation, margin, level)


def _parts(parameters: Array) -> tuple[Array, Array, Array]:
    """Mean (..., D), deviations (..., D) and margin (...), m."""
    parameters = np.asarray(parameters, dtype=np.float64)
    size = parameters.shape[-1] // 2
    mean, deviation, margin = np.split(parameters, [size, 2 * size], axis=-1)
    return mean, deviation, margin[..., 0]
