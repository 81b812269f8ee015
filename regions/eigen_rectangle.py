"""A forecast rectangle along the eigenvectors of the covariance."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.region import Constraint
from ..framework.values.arrays import Array, Scalar
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
class EigenRectangle(gaussian.Eigenframe, Rectangle):
    """Rectangle with half-widths z sigma_i along the eigenvectors, enlarged by the margin.

    The components x = R^T (p - mu) are independent, so the content is (2 Phi(z) - 1)^K exactly.
    ``correction`` "sidak" solves that for the tail alpha, z = Phi^-1((1 + (1 - alpha)^(1/K)) / 2);
    "bonferroni" takes z = Phi^-1(1 - alpha / (2K)) and keeps (1 - alpha / K)^K, a little more
    than asked. ``enlargement`` "disc" is the exact sum with the disc (rounded corners), "box"
    adds the margin to the half-widths. The level dependence is z sigma_i alone; the constraint
    is 0.5 log(g^2) >= 0 with the gauge g in closed form, see `LuetkepohlRectangle`.

    Before the enlargement it is larger than the ellipse of the same content by the same factor
    for every covariance (content 0.9 in 2-D: 1.050 and 1.062).

    Guarantee CONTENT: outside, the disc does not touch the rectangle, so the collision risk is
    at most the probability that the obstacle leaves it, at most alpha. Relation NONE: the
    corners reach beyond the ellipse, the middles of the sides do not, since z < s.

    Not declared rotation invariant: it turns with the covariance wherever the eigenvalues
    differ, but a round covariance has no preferred axes, and the square around it stands as the
    eigen-decomposition happens to put it. Content and guarantee do not depend on that.

    Parameters
    ----------
    correction : "sidak" or "bonferroni", of the half-widths for the number of components.
    enlargement : "disc" for rounded corners, "box" for mitred ones.

    References
    ----------
    Z. Šidák, Rectangular confidence regions for the means of multivariate normal distributions,
    J. Amer. Statist. Assoc. 62 (1967).
    H. Lütkepohl, New Introduction to Multiple Time Series Analysis (2005), pp. 39-41.
    """

    correction: Correction = "sidak"
    enlargement: Enlargement = "disc"

    reference: ClassVar[str] = "luetkepohl2005new"

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log g^2 >= 0."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        half = [level * deviation for deviation in deviations]
        return Constraint((box_outside(x, half, margin, self.enlargement),))

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside."""
        mean, vectors, *_ = gaussian.unpack(parameters)
        half, margin = self.sides(parameters, level)
        x = gaussian.local(np.asarray(points), mean, vectors)
        return np.asarray(distance_to_box(x, half) - margin)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + sum_i |R^T n|_i h_i + margin, m."""
        mean, vectors, *_ = gaussian.unpack(parameters)
        half, margin = self.sides(parameters, level)
        normals = np.asarray(normals)
        n = np.abs(gaussian.local(normals + mean, mean, vectors))
        return np.asarray((normals * mean + n * half).sum(axis=-1) + margin)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points along the corners' arcs and, for the straight parts, their ends, (count, 2)."""
        mean, vectors, *_ = gaussian.unpack(parameters)
        half, margin = self.sides(parameters, np.asarray(level))
        turned = vectors * np.array([1.0, np.sign(np.linalg.det(vectors))])  # never a mirror
        return np.asarray(mean + box_boundary(half, margin, count) @ turned.T)

    def sides(self, parameters: Array, level: Array) -> tuple[Array, Array]:
        """Half-widths along the eigenvectors, and the margin; see `Rectangle.sides`."""
        _, _, deviations, margin = gaussian.unpack(parameters)
        return self.enlarged(deviations, margin, level)
