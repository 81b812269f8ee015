"""A separating line between body and polygon, described by one angle."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.numerics.symbolic import ca
from ...framework.region import Auxiliary, Constraint
from ...framework.static_region import StaticRegion
from ...framework.values.arrays import Array, Scalar
from ...framework.values.motion import Pose
from . import packing


@final
@dataclass(frozen=True)
class StaticSeparatingLine(StaticRegion):
    """Constraint that a line with unit normal n(theta) separates body and polygon.

        (n . (v_i - w_j) - sqrt(n^T M n) - margin) / scale >= 0

    for all corners v_i of the body and all vertices w_j of the polygon, M the spread. One angle
    per polygon and step; for W corners and V vertices W V inequalities, of which those of
    the two touching vertices are active. Any angle whose inequalities hold proves the
    clearance, so an iterate with a poor one is safe, only conservative; the best angle gives
    the signed distance, so there is a slope inside as well. For bodies apart the best angle is
    the only local one; in an overlap each edge may have its own.

    Scale is the margin plus half the diameter of the polygon, the latter within [0.1, 1] m.

    References
    ----------
    T. Mercy, R. Van Parys and G. Pipeleers, Spline-based motion planning for autonomous guided
    vehicles in a dynamic environment, IEEE Trans. Control Syst. Technol. 26 (2018), for
    separating lines as variables; they keep (a, b) with |a| <= 1, here an angle holds |n| = 1.
    """

    reference: ClassVar[str] = "mercy2018spline"

    def parameters(self, parts: Array, margin: Array, spread: Array) -> Array:
        """Vertices, root of the spread, margin, scale; see `packing.pack`."""
        return packing.pack(parts, margin, spread)

    def parameter_count(self, corners: int) -> int:
        """P = 2 V + 5."""
        return packing.packed_count(corners)

    def auxiliary(self, corners: int, outline: int) -> Auxiliary:
        """Declare the angle theta, rad, without bounds: they would cut the circle open."""
        return Auxiliary((-np.inf,), (np.inf,), (0.0,), regularisation=1e-5)

    def auxiliary_start(self, pose: Pose, parameters: Array) -> Array:
        """Return the angle of `wideberth.framework.values.polygon.best_direction`, (..., 1)."""
        normal = packing.PackedPolygons(parameters, _corners(parameters.shape[-1])).best_normal(
            pose
        )
        return np.arctan2(normal[..., 1], normal[..., 0])[..., None]

    def constraint(self, pose: Pose, parameters: Scalar, auxiliary: Scalar) -> Constraint:
        """State that the line lies between every corner and every vertex."""
        packed = packing.PackedPolygons(parameters, _corners(parameters.numel()))
        normal = (ca.cos(auxiliary[0]), ca.sin(auxiliary[0]))
        taken = packed.deviation(normal) + packed.margin
        return Constraint(
            tuple(
                (normal[0] * (x - w[0]) + normal[1] * (y - w[1]) - taken) / packed.scale
                for x, y in pose.corners()
                for w in packed.vertices
            )
        )


def _corners(count: int) -> int:
    """V, the inverse of `StaticSeparatingLine.parameter_count`."""
    return (count - packing.packed_count(0)) // 2
