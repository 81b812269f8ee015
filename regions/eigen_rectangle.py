"""A forecast rectangle along the eigenvectors of the covariance."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.region import Bounded, Constraint, Convex, Guarantee, Relation, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from . import gaussian
from .box import (
    Correction,
    Enlargement,
    box_boundary,
    box_level,
    box_outside,
    box_radius,
    box_tail,
    box_volume,
    check_choices,
    distance_to_box,
)


@final
@dataclass(frozen=True)
class EigenRectangle(gaussian.Eigenframe, Signed, Convex, Bounded):
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

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    rotation_invariant: ClassVar[bool] = False
    reference: ClassVar[str] = "luetkepohl2005new"

    def __post_init__(self) -> None:
        check_choices(self.correction, self.enlargement)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log g^2 >= 0."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        half = [level * deviation for deviation in deviations]
        return Constraint((box_outside(x, half, margin, self.enlargement),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the signed distance is below 0."""
        return np.asarray(self.signed_distance(points, parameters, level) < 0.0)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside."""
        mean, vectors, half, margin = self._frame(parameters, level)
        x = gaussian.local(np.asarray(points), mean, vectors)
        return np.asarray(distance_to_box(x, half) - margin)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + sum_i |R^T n|_i h_i + margin, m."""
        mean, vectors, half, margin = self._frame(parameters, level)
        normals = np.asarray(normals)
        n = np.abs(gaussian.local(normals + mean, mean, vectors))
        return np.asarray((normals * mean + n * half).sum(axis=-1) + margin)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points along the corners' arcs and, for the straight parts, their ends, (count, 2)."""
        mean, vectors, half, margin = self._frame(parameters, np.asarray(level))
        turned = vectors * np.array([1.0, np.sign(np.linalg.det(vectors))])  # never a mirror
        return np.asarray(mean + box_boundary(half, margin, count) @ turned.T)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula for a box: 4 hx hy + 4 margin (hx + hy) + pi margin^2 in 2-D."""
        _, _, half, margin = self._frame(parameters, level)
        return box_volume(half, margin)

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Distance of the farthest corner from the mean, at most, m."""
        return box_radius(deviations, margin, level, self.enlargement)

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level z; not below Phi^-1(1 - 1 / (2K)) for Bonferroni."""
        return box_level(tail, dimension, self.correction)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Return 1 - content for "sidak", a bound on it for "bonferroni"."""
        return box_tail(level, dimension, self.correction)

    def _frame(self, parameters: Array, level: Array) -> tuple[Array, Array, Array, Array]:
        mean, vectors, deviations, margin = gaussian.unpack(parameters)
        half = np.abs(np.asarray(level))[..., None] * deviations
        if self.enlargement == "box":
            return mean, vectors, half + margin[..., None], np.zeros_like(half[..., 0] + margin)
        return mean, vectors, half, margin
