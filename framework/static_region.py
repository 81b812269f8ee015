"""The StaticRegion interface: from a convex polygon that stands still to constraints."""

from abc import ABC, abstractmethod
from typing import ClassVar

from .region import Auxiliary, Constraint
from .values.arrays import Array, Scalar
from .values.motion import Pose


class StaticRegion(ABC):
    """How a body keeps clear of a convex polygon without uncertainty, in the plane.

    The body is the convex hull of the pose's corners (its position alone where it has no
    outline) enlarged by a disc of radius ``margin``. Where the robot's own position is uncertain,
    ``spread`` is s^2 times its covariance, and the body is enlarged by that ellipse as
    well: with s = Phi^-1(1 - risk) the line that separates body and polygon keeps the
    collision risk at most ``risk``; with an uncertain heading that holds for each corner of an
    outline, and for the body at most twice the risk.

    Laws, checked by `wideberth.framework.testing.check_static_region`: with the auxiliaries of
    ``auxiliary_start`` the constraint holds exactly where body and polygon are at least the
    margin apart (`wideberth.framework.values.polygon.best_direction`), equalities are met to 1e-9,
    values and gradients are finite everywhere, and the gradient does not vanish at the
    boundary. Other auxiliaries that keep bounds and equalities may prove less, never more: what
    an optimiser calls clear is clear, whichever it found.
    """

    reference: ClassVar[str] = ""

    @abstractmethod
    def parameters(self, parts: Array, margin: Array, spread: Array) -> Array:
        """Numbers of convex polygons: (..., V, 2) m, (...) m, (..., 2, 2) m^2 -> (..., P).

        Vertices run counter-clockwise; a polygon with fewer than V repeats its last one.
        """

    @abstractmethod
    def parameter_count(self, corners: int) -> int:
        """P, for polygons of V = ``corners`` vertices."""

    @abstractmethod
    def auxiliary(self, corners: int, outline: int) -> Auxiliary:
        """Extra variables per polygon and step; ``outline`` is the number of body corners."""

    @abstractmethod
    def auxiliary_start(self, pose: Pose, parameters: Array) -> Array:
        """Best auxiliaries for NumPy poses: batch (...), (..., P) -> (..., A)."""

    @abstractmethod
    def constraint(self, pose: Pose, parameters: Scalar, auxiliary: Scalar) -> Constraint:
        """State "the body is clear of the polygon" in CasADi; unit-free inequalities."""
