"""The half-plane chance constraint with the line turned to its best: the exact sum at level z."""

from dataclasses import dataclass
from typing import ClassVar, final

from scipy import special

from ..framework.region import Auxiliary, Constraint, Convex, Guarantee, Relation, Signed
from ..framework.values.arrays import Array, BoolArray, Scalar, probability
from ..framework.values.forecast import GaussianObstacle
from ..framework.values.motion import Pose
from .minkowski_sum import MinkowskiSum

_SUM = MinkowskiSum()


@final
@dataclass(frozen=True)
class BestHalfPlane(Signed, Convex):
    """`MinkowskiSum` sized by the collision risk: ellipse of level z = Phi^-1(1 - eps) plus disc.

    The obstacle reaches a disc beyond the line with normal n with probability at most
    Phi(-(n . d - margin) / sqrt(n^T Sigma n)). Its minimum over n is Phi(-m), and m is the level
    at which the disc touches the ellipse. So {p : min_n ... > eps} is the exact sum at the level
    z = Phi^-1(1 - eps); geometry, constraint and auxiliary are those of `MinkowskiSum`.

    ``tail`` is eps, the collision risk asked for, not the content of the ellipse; risks above
    1/2 give z = 0, the disc. Guarantee CONTENT: the risk outside is at most ``tail``. Relation
    INNER, to the sum of content 1 - eps: z is below the s of that content, since
    Phi(-s) < exp(-s^2 / 2) and, in 3-D, s is larger still (1.645 against 2.448 at eps = 0.05).
    It lies inside `HalfPlane`, whose line is one of those it chooses from.

    References
    ----------
    As `HalfPlane`, with the normal optimised; `framework.risk.half_plane_level` computes m.
    """

    relation: ClassVar[Relation] = Relation.INNER
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    reference: ClassVar[str] = "perram1985"

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Those of `MinkowskiSum`: (...,) -> (..., P)."""
        return _SUM.parameters(obstacle, margin)

    def parameter_count(self, dimension: int) -> int:
        """P, 9 in 2-D and 16 in 3-D."""
        return _SUM.parameter_count(dimension)

    def auxiliary(self, dimension: int) -> Auxiliary:
        """One scalar t, see `MinkowskiSum`."""
        return _SUM.auxiliary(dimension)

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Best t for given positions, (..., 1)."""
        return _SUM.auxiliary_start(pose, parameters, level)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """0.5 log F(t) >= 0, see `MinkowskiSum`."""
        return _SUM.constraint(pose, parameters, level, auxiliary)

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether the distance to the ellipse is below the margin."""
        return _SUM.contains(points, parameters, level)

    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside."""
        return _SUM.signed_distance(points, parameters, level)

    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Return n . mu + z sqrt(n^T Sigma n) + margin, m."""
        return _SUM.support(normals, parameters, level)

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points on the boundary, (count, 2), m."""
        return _SUM.boundary(parameters, level, count)

    def area(self, parameters: Array, level: Array) -> Array:
        """Steiner's formula, m^2 or m^3."""
        return _SUM.area(parameters, level)

    def level(self, tail: float, dimension: int = 2) -> float:
        """Level z = Phi^-1(1 - tail), at least 0."""
        return max(0.0, -float(special.ndtri(probability("tail", tail))))

    def tail(self, level: float, dimension: int = 2) -> float:
        """Collision risk Phi(-z) that the region keeps."""
        return float(special.ndtr(-max(float(level), 0.0)))
