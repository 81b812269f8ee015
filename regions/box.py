"""Boxes: levels per component, distance, gauge and size.

Points are measured from the centre along the axes of the box; ``half`` are its half-widths, m.
"""

import math
from abc import abstractmethod
from itertools import combinations
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Bounded, Convex, Guarantee, Relation, Signed
from ..framework.values.arrays import (
    Array,
    BoolArray,
    Scalar,
    checked_choice,
    checked_covariance,
    probability,
)
from ..framework.values.errors import WideberthError
from . import gaussian

Correction: TypeAlias = Literal["bonferroni", "sidak"]
Enlargement: TypeAlias = Literal["disc", "box"]


def box_level(tail: float, components: int, correction: Correction) -> float:
    """Half-width z in deviations for a joint tail alpha over K components.

    Bonferroni: Phi^-1(1 - alpha / (2K)). Sidak: Phi^-1((1 + (1 - alpha)^(1/K)) / 2), exact for
    independent components and safe for all jointly Gaussian ones (Sidak's inequality).
    """
    from scipy.special import ndtri

    tail = probability("tail", tail)
    if correction == "bonferroni":
        return -float(ndtri(tail / (2 * components)))
    return -float(ndtri(-0.5 * math.expm1(math.log1p(-tail) / components)))


def box_tail(level: float, components: int, correction: Correction) -> float:
    """Inverse of `box_level`: 2K Phi(-z), at most 1, or 1 - (1 - 2 Phi(-z))^K."""
    from scipy.special import ndtr

    outside = 2.0 * float(ndtr(-max(float(level), 0.0)))
    if correction == "bonferroni":
        return min(1.0, components * outside)
    return -math.expm1(components * math.log1p(-outside)) if outside < 1.0 else 1.0


def distance_to_box(points: Array, half: Array) -> Array:
    """Distance from points around the centre to a box with these half-widths, (...), m.

    |max(q, 0)| + min(max_i q_i, 0) with q = |x| - half: negative inside.
    """
    q = np.abs(points) - half
    outside = np.hypot.reduce(np.maximum(q, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(q.max(axis=-1), 0.0))


def box_outside(
    coordinates: list[Scalar], half: list[Scalar], margin: Scalar, enlargement: Enlargement
) -> Scalar:
    """0.5 log g^2 in CasADi, with g the gauge of the enlarged box: >= 0 outside.

    Its curvature is kept finite at the centre, see `gaussian.log_gauge`.
    """
    x = [ca.fabs(coordinate) for coordinate in coordinates]
    if enlargement == "box":
        half, margin = [h + margin for h in half], 0.0
    return gaussian.log_gauge(_gauge(x, half, margin**2 + gaussian.FLOOR**2) ** 2)


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


def box_boundary(half: Array, margin: Array, count: int) -> Array:
    """Points along the corners' arcs and the ends of the straight parts, (count, 2), m.

    Counter-clockwise in the axes of the box, from the corners, so that each corner has at least
    an equal share of the points.
    """
    quarter = np.floor(np.linspace(0.0, 4.0, count, endpoint=False)).astype(int)
    corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])[quarter]
    first = np.searchsorted(quarter, np.arange(4))
    per_corner = np.bincount(quarter, minlength=4)
    index = np.arange(count) - first[quarter]
    share = index / np.maximum(per_corner[quarter] - 1, 1)
    turn = 0.5 * np.pi * (quarter + share)
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return np.asarray(corner * half + margin * normal)


def box_volume(half: Array, margin: Array) -> Array:
    """Steiner's formula for a box: 4 hx hy + 4 margin (hx + hy) + pi margin^2 in 2-D."""
    size = half.shape[-1]
    volume, edges = 2.0**size * half.prod(axis=-1), 2.0 * half.sum(axis=-1)
    if size == 2:
        return np.asarray(volume + 2.0 * edges * margin + np.pi * margin**2)
    pairs = sum(half[..., i] * half[..., j] for i, j in combinations(range(size), 2))
    rounded = np.pi * edges * margin**2 + 4.0 / 3.0 * np.pi * margin**3
    return np.asarray(volume + 8.0 * pairs * margin + rounded)


def box_content(half: Array, covariance: Array, nodes: int = 200) -> float:
    """Exact probability that a centred 2-D Gaussian lies in the box with these half-widths.

    The integral of the marginal density over one axis times the conditional probability of the
    other, by Gauss-Legendre; for correlations up to about 0.99.

    Raises
    ------
    WideberthError : what is no covariance of two coordinates, or a variance of zero.
    """
    from scipy.special import ndtr

    covariance = checked_covariance("covariance", covariance, (2, 2))
    points, weights = np.polynomial.legendre.leggauss(nodes)
    variances = np.diagonal(covariance)
    if not (variances > 0.0).all():
        raise WideberthError("a variance is zero, so that there is no density to integrate")
    first, second = np.sqrt(variances)
    correlation = covariance[0, 1] / (first * second)
    u = half[0] / first * points
    spread = np.sqrt(1.0 - correlation**2)
    upper = ndtr((half[1] / second - correlation * u) / spread)
    lower = ndtr((-half[1] / second - correlation * u) / spread)
    density = np.exp(-0.5 * u**2) / np.sqrt(2.0 * np.pi)
    return float(half[0] / first * (weights * density * (upper - lower)).sum())


class Rectangle(Signed, Convex, Bounded):
    """A box with half-widths z times the deviations along some axes, enlarged by the margin.

    A concrete one has the fields ``correction`` and ``enlargement``, and gives its axes.
    """

    correction: Correction
    enlargement: Enlargement

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    rotation_invariant: ClassVar[bool] = False

    def __post_init__(self) -> None:
        checked_choice("correction", self.correction, Correction)
        checked_choice("enlargement", self.enlargement, Enlargement)

    @abstractmethod
    def sides(self, parameters: Array, level: Array) -> tuple[Array, Array]:
        """Half-widths (..., D) and the margin (...) of the disc beside them, m."""

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the signed distance is below 0."""
        return np.asarray(self.signed_distance(points, parameters, level) < 0.0)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula for a box: 4 hx hy + 4 margin (hx + hy) + pi margin^2 in 2-D."""
        return box_volume(*self.sides(parameters, level))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Distance of the farthest corner from the mean, at most, m.

        The half-widths are z times deviations whose squares add up to the trace of the
        covariance, on whatever axes; the corner of a box adds the margin in each of D coordinates.
        """
        corner = np.asarray(level) * np.hypot.reduce(deviations, axis=-1)
        share = 1.0 if self.enlargement == "disc" else math.sqrt(deviations.shape[-1])
        return np.asarray(corner + share * np.asarray(margin))

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level z; not below Phi^-1(1 - 1 / (2K)) for Bonferroni."""
        return box_level(tail, dimension, self.correction)

    def tail(self, level: float, dimension: int = 2) -> float:
        """Return 1 - content for "sidak" on independent components; else a bound on it."""
        return box_tail(level, dimension, self.correction)

    def enlarged(self, deviations: Array, margin: Array, level: Array) -> tuple[Array, Array]:
        """Half-widths of these deviations and the margin beside them, see `sides`."""
        half = np.abs(np.asarray(level))[..., None] * deviations
        if self.enlargement == "box":
            return half + margin[..., None], np.zeros_like(half[..., 0] + margin)
        return half, margin
