"""The paper's region: the ellipse of content p with its axes made longer by the margin."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.region import Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, Scalar
from ..framework.values.motion import Pose
from . import gaussian


@final
@dataclass(frozen=True)
class MahalanobisEllipse(gaussian.Ellipse, gaussian.Eigenframe, gaussian.ContentLevel):
    """Ellipse with semi-axes a_i = s sigma_i + margin along the eigenvectors of Sigma.

    {p : sum_i (R^T (p - mu))_i^2 / (s sigma_i + margin)^2 < 1}, with s = sqrt(-2 ln(1 - p)) in
    2-D and from the chi-square distribution with three degrees of freedom in 3-D.

    The constraint is 0.5 log(q) >= 0 with q the sum above, its curvature kept finite at the
    centre (`gaussian.log_gauge`). The paper writes q >= 1. The sets are the same; the program
    that the solver gets is not, in the settings called ``paper`` either. The logarithm of the
    gauge grows evenly in all directions and has length about 1 / axis near the boundary, where
    the gradient of q fades towards the centre and grows far outside. Projecting one point onto
    the boundary takes IPOPT the same number of iterations with either (median 7).

    Relation INNER: the region lies inside the exact sum of content ellipse and disc and
    touches it on the axes alone. With a, b the largest and smallest semi-axis s sigma_i,
    A = (a + b) / 2, H = 2ab / (a + b) and margin rho the clearance falls short by up to
    rho (1 - sqrt((H + rho) / (A + rho))), see `regions.inflation`. Guarantee NONE for that
    reason: on the boundary the collision risk can exceed 1 - p (for p = 0.95 and a margin
    much above the deviations from a condition number of 45 on). The paper calls the lengthening an
    approximation that can be compensated; here the plain ellipse stays as the paper has it.

    References
    ----------
    The paper, section "Set Construction", equations (ellipse parts) and (ellipse set).
    """

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.NONE
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log q >= 0, by `gaussian.log_gauge`."""
        x, deviations, margin = gaussian.local_symbols(pose, parameters)
        q = sum(
            coordinate**2 / ((level * deviation + margin) ** 2 + gaussian.FLOOR**2)
            for coordinate, deviation in zip(x, deviations, strict=True)
        )
        return Constraint((gaussian.log_gauge(q),))

    def axes(self, parameters: Array, level: Array) -> Array:
        """Semi-axes s sigma_i + margin, (..., D), m."""
        _, _, deviations, margin = gaussian.unpack(parameters)
        length = np.asarray(level)[..., None] * deviations + margin[..., None]
        return np.asarray(np.hypot(length, gaussian.FLOOR))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Longest semi-axis s sigma_1 + margin, m."""
        return np.asarray(level * deviations[..., 0] + margin)
