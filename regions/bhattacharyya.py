"""A bound on the Bhattacharyya distance between the Gaussians of robot and obstacle."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.numerics.symbolic import ca
from ..framework.region import Auxiliary, Bounded, Constraint, Guarantee, Relation
from ..framework.values.arrays import Array, BoolArray, Scalar, positive, probability
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from . import density, gaussian
from .minkowski_sum import MinkowskiSum

_SUM = MinkowskiSum()
_TINY = 1e-12
"""Keeps the root differentiable where the ellipse is empty (adds 1e-6 deviations there)."""


@final
@dataclass(frozen=True)
class Bhattacharyya(Bounded):
    """Where D_B < tau, enlarged by the disc of the margin.

    The robot is a Gaussian too, N(p, v I) with v = ``robot_deviation``^2. With d = p - mu and
    S = (Sigma + v I) / 2 the Bhattacharyya distance is

        D_B = 1/8 d^T S^-1 d + tau_0,    tau_0 = 1/2 ln(det S / sqrt(det Sigma det(v I))),

    so D_B < tau is the ellipse of S with squared level 8 (tau - tau_0), empty for tau <= tau_0.
    Bhatt et al. constrain the overlap of the two Gaussians in an MPC by D_B >= -ln eps; their
    formula was not compared. Their method has no rigid bodies; here the disc is added as in
    `MinkowskiSum`, whose geometry, constraint and auxiliary are used. Where the ellipse is empty,
    the disc stays. Their robot has a covariance of its own at every step, here it is one number.

    ``level`` is tau and ``tail`` is exp(-tau), the Bhattacharyya coefficient, which bounds the
    error of telling the two Gaussians apart. It is no collision risk: Guarantee NONE. Relation
    NONE, since the size depends on the robot's deviation. For a singular covariance D_B is
    infinite, which would say that nothing can be hit: `parameters` raises.

    Parameters
    ----------
    robot_deviation : m, deviation of the robot's own position (or shape) per coordinate.

    References
    ----------
    A. Bhattacharyya, On a measure of divergence between two statistical populations defined by
    their probability distributions, Bulletin of the Calcutta Mathematical Society 35 (1943).
    D. Bhatt, A. Garg, B. Gopalakrishnan and K. M. Krishna, Probabilistic Obstacle Avoidance and
    Object Following: An Overlap of Gaussians Approach, IEEE RO-MAN 2019, for its use in an MPC.
    """

    robot_deviation: float = 0.3

    relation: ClassVar[Relation] = Relation.NONE
    guarantee: ClassVar[Guarantee] = Guarantee.NONE
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    singular_covariances: ClassVar[bool] = False
    reference: ClassVar[str] = "bhattacharyya1943,bhatt2019probabilistic"

    def __post_init__(self) -> None:
        positive("robot_deviation", self.robot_deviation)

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Parameters of `MinkowskiSum` for S, and tau_0: (...,) -> (..., P).

        Raises
        ------
        WideberthError : singular covariance, negative margin, neither 2-D nor 3-D.
        """
        room = gaussian.checked_margin(obstacle, margin, self.dimensions)
        variances = density.checked_spread(obstacle, "bhattacharyya")
        own = self.robot_deviation**2
        blend = 0.5 * (obstacle.covariance + own * np.eye(obstacle.mean.shape[-1]))
        packed = _SUM.parameters(GaussianObstacle(obstacle.mean, blend), room)
        return np.concatenate([packed, self._least(variances)[..., None]], axis=-1)

    def _least(self, variances: Array) -> Array:
        """Return tau_0 of variances (..., D), m^2."""
        own = self.robot_deviation**2
        ratio = 0.5 * (variances + own) / np.sqrt(variances * own)
        return np.asarray(0.5 * np.log(ratio).sum(axis=-1))

    def parameter_count(self, dimension: int) -> int:
        """P, 10 in 2-D and 17 in 3-D."""
        return _SUM.parameter_count(dimension) + 1

    def auxiliary(self, dimension: int) -> Auxiliary:
        """One scalar t, see `MinkowskiSum`."""
        return _SUM.auxiliary(dimension)

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Best t for given positions, (..., 1)."""
        return _SUM.auxiliary_start(pose, *_inner(parameters, level))

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log F(t) >= 0 of the sum."""
        last = _SUM.parameter_count(len(pose.position))
        size = ca.sqrt(8.0 * ca.fmax(level - parameters[last], 0.0) + _TINY)
        return _SUM.constraint(pose, parameters[:last], size, auxiliary)

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the distance to the ellipse is below the margin."""
        return _SUM.contains(points, *_inner(parameters, level))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points on the boundary, (count, 2), m."""
        inner, size = _inner(parameters, np.asarray(level))
        return _SUM.boundary(inner, float(size), count)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula, m^2 or m^3."""
        return _SUM.area(*_inner(parameters, level))

    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Longest semi-axis of the ellipse of S and the margin, m."""
        with np.errstate(divide="ignore"):  # for a singular covariance tau_0 is infinite
            size = _size(level, self._least(deviations**2))
        blend = 0.5 * (deviations[..., 0] ** 2 + self.robot_deviation**2)
        return np.asarray(size * np.sqrt(blend) + margin)

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level tau = -ln tail, the tail being the Bhattacharyya coefficient."""
        return -float(np.log(probability("tail", tail)))

    def tail(self, level: float, dimension: int = 2) -> float:
        """Bhattacharyya coefficient exp(-tau)."""
        return float(np.exp(-max(float(level), 0.0)))


def _inner(parameters: Array, level: Array) -> tuple[Array, Array]:
    """Parameters and level of the sum."""
    parameters = np.asarray(parameters, dtype=np.float64)
    return parameters[..., :-1], _size(level, parameters[..., -1])


def _size(level: Array, least: Array) -> Array:
    """Level of the ellipse of S, from tau and tau_0."""
    rest = np.maximum(np.asarray(level, dtype=np.float64) - least, 0.0)
    return np.asarray(np.sqrt(8.0 * rest + _TINY))
