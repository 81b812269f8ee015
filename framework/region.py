"""The Region interface: from a Gaussian obstacle to the set that the robot must keep out of."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import numpy as np

from .values.arrays import Array, BoolArray, Scalar
from .values.forecast import GaussianObstacle
from .values.motion import Pose


class Relation(StrEnum):
    """How a region lies to the exact set, the content ellipse plus the disc of the margin."""

    INNER = "inner"
    EXACT = "exact"
    OUTER = "outer"
    NONE = "none"


class Guarantee(StrEnum):
    """What staying outside a region promises.

    CONTENT: the collision risk is at most ``tail(level)``: the probability that the
    obstacle leaves the un-enlarged region, or the risk that the region was asked for.
    RISK: that, and a lower level, of `RiskLevel`, keeps an asked risk. NONE: no such promise
    holds for every covariance. `framework.risk.level_for_risk` serves the first two.
    """

    CONTENT = "content"
    RISK = "collision risk"
    NONE = "none"


@dataclass(frozen=True)
class Auxiliary:
    """Extra decision variables that a region needs per obstacle and step.

    Attributes
    ----------
    lower, upper : bounds, one entry per variable.
    start : starting values.
    regularisation : weight of (auxiliary - guess)^2 in the cost, which keeps the Hessian
        regular where the constraint is inactive.
    """

    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()
    start: tuple[float, ...] = ()
    regularisation: float = 0.0

    def __len__(self) -> int:
        """Count the variables."""
        return len(self.start)


@dataclass(frozen=True, eq=False)
class Constraint:
    """What `Region.constraint` returns; entries are CasADi expressions.

    Attributes
    ----------
    inequalities : each >= 0 where the pose is outside the region; unit-free, and with a
        gradient that does not vanish at the boundary.
    equalities : each == 0; they tie auxiliaries down.
    """

    inequalities: tuple[Scalar, ...]
    equalities: tuple[Scalar, ...] = ()


class Region(ABC):
    """The set that the robot's centre must keep out of.

    A region is a frozen dataclass. ``level`` is its own monotone size: s for ellipses
    (a larger level is a larger region, 0 the smallest). ``margin`` is r + r_d, the radii of
    robot and obstacle together, m. Laws, checked by
    `wideberth.framework.testing.check_region`: symbolic constraint and NumPy twin agree;
    the region grows with level and margin; ``level`` and ``tail`` are inverse to each
    other; area agrees with the boundary; the declared relation and guarantee hold; the
    constraint is finite wherever a solver may look, also where level and auxiliaries are
    beyond their bounds.
    """

    relation: ClassVar[Relation]
    guarantee: ClassVar[Guarantee]
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    rotation_invariant: ClassVar[bool] = True
    """False for a region tied to the world axes: turning the scene does not turn it."""
    singular_covariances: ClassVar[bool] = True
    """False for a region that is undefined there: `parameters` may raise a WideberthError."""
    reference: ClassVar[str] = ""

    @abstractmethod
    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Numbers that describe the region: batch (...,) -> (..., P).

        Eigenvectors are computed here, in NumPy, never symbolically: differentiating an
        eigen-decomposition gives NaN for round covariances.
        """

    @abstractmethod
    def parameter_count(self, dimension: int) -> int:
        """P, for obstacles in D dimensions."""

    def auxiliary(self, dimension: int) -> Auxiliary:
        """Declare extra variables; none unless a region says otherwise."""
        return Auxiliary()

    def auxiliary_start(self, pose: Pose, parameters: Array, level: Array) -> Array:
        """Best auxiliaries for given poses: batch (...), (..., P), (...) -> (..., A).

        ``pose`` holds NumPy arrays. The solver starts from these auxiliaries, and the law
        check and the re-check of a plan maximise with them.
        """
        start = self.auxiliary(len(pose.position)).start
        batch = np.shape(pose.position[0])
        return np.broadcast_to(np.asarray(start), (*batch, len(start)))

    @abstractmethod
    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """State "the pose is outside" in CasADi; arguments are SX or MX vectors."""

    @abstractmethod
    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether points (..., D) lie strictly inside; parameters (..., P) broadcast."""

    @abstractmethod
    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Points on the boundary of one 2-D region, (count, 2), m, counter-clockwise."""

    @abstractmethod
    def area(self, parameters: Array, level: Array) -> Array:
        """Area in m^2 (volume in m^3 where D is 3): (..., P) -> (...)."""

    @abstractmethod
    def level(self, tail: float, dimension: int = 2) -> float:
        """Level at which the un-enlarged region keeps the obstacle but for ``tail``."""

    @abstractmethod
    def tail(self, level: float, dimension: int = 2) -> float:
        """1 - content of the un-enlarged region; the inverse of `level`."""


class Signed(Region):
    """A region that knows how far a point is from its boundary."""

    @abstractmethod
    def signed_distance(self, points: Array, parameters: Array, level: Array) -> Array:
        """Distance to the boundary, m, negative inside: (..., D) -> (...)."""


class Convex(Region):
    """A convex region, described by its support function."""

    @abstractmethod
    def support(self, normals: Array, parameters: Array, level: Array) -> Array:
        """Max of n . x over the region, m, for unit normals (..., D) -> (...)."""


class Bounded(Region):
    """A region that lies within a disc (a ball) around the obstacle's mean.

    A planner leaves out what no plan can meet, see `framework.mpc.slots.reachability`; obstacles
    of regions without this ability always take part.
    """

    @abstractmethod
    def outer_radius(self, deviations: Array, margin: Array, level: Array) -> Array:
        """Radius of a disc that holds the region at this level and at lower ones from 0 on, m.

        Of a `Polygonal` region: bodies overlap it only if the box along some axes around each
        holds a place that is no farther from the mean.

        Parameters
        ----------
        deviations : (..., D), m, along the eigenvectors of the covariance, from large to small.
        margin, level : (...), of the region.
        """


class RiskLevel(Region):
    """A region with a level of its own for a collision risk, lower than that for the tail."""

    @abstractmethod
    def level_for_risk(self, risk: float) -> float:
        """Level at which the collision risk outside is at most ``risk``, per step."""

    @abstractmethod
    def risk(self, level: float) -> float:
        """Bound on the collision risk outside at this level; the inverse of `level_for_risk`."""


class ClosedForm(Region):
    """A region whose parameters are a CasADi expression as well, for code that leaves Python.

    Python itself takes `parameters`. Law: both state the same constraint, unless the covariance is
    round, whose axes are arbitrary; the parameters may differ by what the constraint does not see,
    such as the sign of an eigenvector.
    """

    @abstractmethod
    def closed_form(self, mean: Scalar, covariance: Scalar, margin: Scalar) -> Scalar:
        """Parameters of one Gaussian: SX (D, 1), (D, D), (1, 1) -> (P, 1).

        Raises
        ------
        WideberthError : a dimension for which there is no such expression.
        """


class Polygonal(Region):
    """A region that knows bodies with corners.

    Where the pose has an outline, ``constraint`` keeps the whole body, the convex hull of its
    corners enlarged by the margin, clear of the obstacle; ``margin`` is then what is
    added around the outline. Regions without this ability are given the enclosing disc.
    """

    @abstractmethod
    def overlaps(self, pose: Pose, parameters: Array, level: Array) -> BoolArray:
        """Whether bodies overlap the region: NumPy poses (...), (..., P), (...) -> (...)."""
