"""Pose, twist, command and what a controller observes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from .arrays import Array, Scalar, checked, checked_covariance, positive, stacked
from .polygon import Polygon


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a body is. Entries are floats, NumPy arrays or CasADi expressions.

    Attributes
    ----------
    position : D coordinates in the world frame, m.
    heading : rad, counter-clockwise from the x axis; None for a robot without one.
    outline : (x, y) of the corners of a convex body in its own frame, m; () for a point (a
        disc is a point with a margin).
    """

    position: tuple[Scalar, ...]
    heading: Scalar | None = None
    outline: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, points: Array) -> "Pose":
        """Poses at points (..., D), m, without heading."""
        return cls(tuple(np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)))

    def points(self) -> Array:
        """Positions of NumPy poses, (..., D), m."""
        return np.stack(np.broadcast_arrays(*self.position), axis=-1).astype(np.float64)

    def offset(self, place: tuple[float, float]) -> tuple[Scalar, ...]:
        """World coordinates of a place in the body's frame, p + Rot(heading) place, m."""
        if place == (0.0, 0.0) or self.heading is None:  # a body without heading is its centre
            return self.position
        cosine, sine = np.cos(self.heading), np.sin(self.heading)
        along, aside = place
        return (
            self.position[0] + cosine * along - sine * aside,
            self.position[1] + sine * along + cosine * aside,
        )

    def corners(self) -> tuple[tuple[Scalar, ...], ...]:
        """World coordinates of the corners, m; the position alone where there are none."""
        return tuple(self.offset(place) for place in self.outline or ((0.0, 0.0),))

    def corner_points(self) -> Array:
        """Corners of NumPy poses, (..., V, D), m; V is 1 for a point."""
        return stacked(self.corners())


@dataclass(frozen=True, eq=False)
class Twist:
    """How a body moves, or (as an acceleration) how its motion changes.

    Attributes
    ----------
    linear : (forward, lateral) in the body frame, m/s; for a robot without heading the
        D world components.
    angular : yaw rate, rad/s; 0 for a robot without heading.
    """

    linear: tuple[Scalar, ...]
    angular: Scalar = 0.0


@dataclass(frozen=True)
class Command:
    """A velocity for the low-level controller (a ROS twist).

    Attributes
    ----------
    linear : D components, m/s: (vx, vy) in the body frame.
    omega : yaw rate, rad/s.
    ramp : s, the time in which the velocity smoother should reach it; 0 means at once.
    """

    linear: tuple[float, ...]
    omega: float = 0.0
    ramp: float = 0.0

    @property
    def twist(self) -> Twist:
        """The same velocity as a `Twist`."""
        return Twist(self.linear, self.omega)


@dataclass(frozen=True, eq=False)
class Detection:
    """One obstacle as a sensor or tracker reports it.

    Attributes
    ----------
    ident : stable identity of the obstacle.
    position : (D,), m.
    covariance : (D, D), m^2, of the measured position.
    radius : m, of the disc that encloses the obstacle.
    age : s, how long ago the position was measured.
    """

    ident: str
    position: Array
    covariance: Array
    radius: float
    age: float = 0.0

    def __post_init__(self) -> None:
        position = checked("detection.position", self.position, (None,))
        size = len(position)
        covariance = checked_covariance("detection.covariance", self.covariance, (size, size))
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "covariance", covariance)
        positive("detection.radius", self.radius, zero=True)
        positive("detection.age", self.age, zero=True)


@dataclass(frozen=True, eq=False)
class Truth:
    """The future as only a simulation or a recording knows it; for the oracle predictor.

    Attributes
    ----------
    times : (T,), s, increasing, on the clock of `Observation.stamp`.
    positions : identity -> (T, D), m.
    """

    times: Array
    positions: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Observation:
    """All that a controller is told at one instant.

    Attributes
    ----------
    stamp : s.
    state : (n,) the robot's own estimated state, in the robot's own units.
    covariance : (n, n) of that estimate; None if unknown (taken as exact).
    polygons : what stands still and where, all of it (a map), or what is known of it.
    detections : obstacles seen now; a missing one was not seen.
    truth : the future, where a simulation grants it (the oracle predictor alone reads it).
    """

    stamp: float
    state: Array
    detections: tuple[Detection, ...] = ()
    covariance: Array | None = None
    polygons: tuple[Polygon, ...] = ()
    truth: Truth | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        checked("observation.stamp", self.stamp, ())
        state = checked("observation.state", self.state, (None,))
        object.__setattr__(self, "state", state)
        if self.covariance is not None:
            size = len(state)
            covariance = checked_covariance(
                "observation.covariance", self.covariance, (size, size)
            )
            object.__setattr__(self, "covariance", covariance)
