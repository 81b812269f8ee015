"""The exact region by a separating line with an angle: for discs and for bodies with corners."""

from dataclasses import dataclass
from math import hypot, inf
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import (
    Auxiliary,
    Constraint,
    Guarantee,
    Polygonal,
    Relation,
)
from ..framework.values.arrays import Array, BoolArray, Scalar
from ..framework.values.motion import Pose
from ..metrics.ellipses import closest_point
from . import gaussian
from .minkowski_sum import EllipsePlusDisc

_LEAST_SCALE = 1e-2
"""m. Smallest scale of the constraint, so that a point obstacle gives finite numbers."""


@final
@dataclass(frozen=True)
class SeparatingLine(EllipsePlusDisc, gaussian.ContentLevel, gaussian.LineRisk, Polygonal):
    """The set of `MinkowskiSum`, stated by the angle of a line between body and ellipse.

    The convex body with corners v_i, enlarged by the margin, is clear of the ellipse of level s
    iff some unit normal n(theta) = (cos theta, sin theta) gives, for every corner,

        n . (v_i - mu) - s sqrt(n^T Sigma n) - margin >= 0.

    A disc has one corner, its centre. Each inequality is divided by margin + sigma_1 + reach of
    the corners, a constant length. theta is the auxiliary of each obstacle and step; every
    theta gives a safe constraint, and for one pose those that suffice form a single arc shorter
    than half a turn. Outside the evolute of the ellipse the point's constraint has one maximum
    in theta, inside it a second one that never suffices, so a start on the far side can trap a
    solver: `auxiliary_start` gives the best angle.

    Guarantee RISK, for bodies with corners too: the body lies beyond a line that the obstacle
    crosses with probability Phi(-s), so with `level_for_risk`, s = Phi^-1(1 - risk), the
    collision risk is at most ``risk``. (Where the robot's own heading is uncertain as well, that
    holds for each corner, and for the body at most twice the risk.) Where the body has corners
    nothing is given away to an enclosing disc. `MinkowskiSum` has the smoother constraint where
    the body is a disc.

    References
    ----------
    S. Boyd and L. Vandenberghe, Convex Optimization (2004), section 2.5 for the separating line
    and 4.4 for what it says about the probability.
    """

    relation: ClassVar[Relation] = Relation.EXACT
    guarantee: ClassVar[Guarantee] = Guarantee.RISK
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    reference: ClassVar[str] = "boyd2004convex"

    def auxiliary(self, dimension: int) -> Auxiliary:
        """Declare theta, rad, held near its guess where the constraint is inactive."""
        return Auxiliary((-inf,), (inf,), (0.0,), regularisation=1e-5)

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Best angle, rad, (..., 1)."""
        normals, gaps = _candidates(pose, parameters, level)
        best = gaps.argmax(axis=-1)[..., None, None]
        vectors = gaussian.unpack(parameters)[1]
        normal = vectors @ np.swapaxes(np.take_along_axis(normals, best, axis=-2), -1, -2)
        return np.asarray(np.arctan2(normal[..., 1, :], normal[..., 0, :]))

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """One inequality per corner; see the class."""
        n = (ca.cos(auxiliary[0]), ca.sin(auxiliary[0]))
        tip = Pose((parameters[0] + n[0], parameters[1] + n[1]))
        along, deviations, margin = gaussian.local_symbols(tip, parameters)  # n in the eigenframe
        reach = sum((c * s * level) ** 2 for c, s in zip(along, deviations, strict=True))
        needed = ca.sqrt(reach + gaussian.FLOOR**2) + margin
        scale = margin + deviations[0] + max([hypot(*place) for place in pose.outline] or [0.0])
        room = [
            sum(n[i] * (corner[i] - parameters[i]) for i in range(2)) - needed
            for corner in pose.corners()
        ]
        return Constraint(tuple(gap / ca.fmax(scale, _LEAST_SCALE) for gap in room))

    def overlaps(self, pose: Pose, parameters: Array, level: Array) -> BoolArray:
        """Whether bodies come closer to the ellipse than the margin."""
        margin = gaussian.unpack(parameters)[3]
        return np.asarray(_candidates(pose, parameters, level)[1].max(axis=-1) < margin)


def _candidates(pose: Pose, parameters: Array, level: Array) -> tuple[Array, Array]:
    """Return unit normals in the eigenframe (..., C, 2) and the gap along each (..., C), m.

    The gap is that between body and ellipse, without the margin. Where they are apart, the
    largest is their distance: the nearest point of the body is a corner, with the normal of the
    ellipse there, or lies on an edge, with the normal of the edge. Where they overlap, every gap
    is negative.
    """
    mean, vectors, deviations, _ = gaussian.unpack(parameters)
    corners = gaussian.local_corners(pose, mean, vectors)
    axes = np.hypot(np.asarray(level)[..., None] * deviations, gaussian.FLOOR)[..., None, :]
    normals = closest_point(corners, axes) / axes**2
    if corners.shape[-2] > 1:
        edge = np.roll(corners, -1, axis=-2) - corners
        inward = np.stack([-edge[..., 1], edge[..., 0]], axis=-1)  # the outline turns to the left
        inward = inward * np.linalg.det(vectors)[..., None, None]  # unless the frame is a mirror
        normals = np.concatenate([normals, inward], axis=-2)
    normals = normals / np.hypot.reduce(normals, axis=-1)[..., None]
    nearest = (normals @ np.swapaxes(corners, -1, -2)).min(axis=-1)
    return normals, np.asarray(nearest - np.hypot.reduce(axes * normals, axis=-1))
