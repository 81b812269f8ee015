"""Poses, twists, commands and observations."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .arrays import (
    FARTHEST,
    Array,
    Scalar,
    all_finite,
    checked,
    checked_covariance,
    number,
    of_covariances,
    settle,
    stacked,
)
from .errors import WideberthError
from .polygon import Polygon
from .sensing import PlacedScan

T = TypeVar("T")


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
        shape, *others = [getattr(values, "shape", ()) for values in self.position]
        if others.count(shape) != len(others):
            shape = np.broadcast_shapes(shape, *others)
        found = np.empty((*shape, len(self.position)))
        for axis, values in enumerate(self.position):
            found[..., axis] = values
        return found

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

    Values that are no measurement (NaN, a negative radius or age, a covariance that is none) are
    accepted here, since a sensor may report them at any time; `flaw` names them. Controllers put
    something else in their place and say so, see `wideberth.framework.tracking.stand_ins`: who was
    seen stays an obstacle.

    Attributes
    ----------
    ident : stable identity of the obstacle.
    position : (D,), m.
    covariance : (D, D), m^2, of the measured position. None where the sensor does not state it:
        a planner then estimates it from all that this sensor has reported (`NoiseEvidence`).
    radius : m, of the disc that encloses the obstacle.
    age : s, how long ago the position was measured.
    sensor : name of the sensor. Detections of one sensor share their noise.
    velocity : (D,), m/s, at that instant, from a tracker; None from a sensor that has none.
    state_covariance : (2D, 2D), of position and velocity, from the same tracker.
    flaw : which of its numbers is of no use; "" where all are.

    Raises
    ------
    WideberthError : a wrong type or shape, or only one of velocity and state_covariance.
    """

    ident: str
    position: Array
    covariance: Array | None
    radius: float
    age: float
    sensor: str
    velocity: Array | None
    state_covariance: Array | None
    flaw: str = field(init=False, repr=False)

    def __init__(
        self,
        ident: str,
        position: ArrayLike,
        covariance: ArrayLike | None,
        radius: float,
        age: float = 0.0,
        sensor: str = "",
        velocity: ArrayLike | None = None,
        state_covariance: ArrayLike | None = None,
    ) -> None:
        if not isinstance(ident, str):
            raise WideberthError(f"detection.ident is {ident!r}; wanted a str")
        position, flaw = checked("detection.position", position, (None,), finite=False), ""
        if covariance is not None:
            covariance, flaw = _covariance("covariance", covariance, len(position))
        if not isinstance(sensor, str):
            raise WideberthError(f"detection.sensor is {sensor!r}; wanted a str")
        radius, age = number("detection.radius", radius), number("detection.age", age)
        if velocity is not None or state_covariance is not None:
            velocity, state_covariance, useless = _state(velocity, state_covariance, len(position))
            flaw = flaw or useless
        if not (0.0 <= radius < inf and 0.0 <= age < inf):
            flaw = flaw or (f"age is {age:g}" if 0.0 <= radius < inf else f"radius is {radius:g}")
        if not all_finite(position):
            flaw = f"position is {position.tolist()}"
        settle(
            self, ident=ident, position=position, covariance=covariance, radius=radius, age=age,
            sensor=sensor, velocity=velocity, state_covariance=state_covariance, flaw=flaw,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Truth:
    """True future positions, from a simulation or a recording, for the oracle predictor.

    Attributes
    ----------
    times : (T,), s, increasing, on the clock of `Observation.stamp`.
    positions : identity -> (T, D), m.
    """

    times: Array
    positions: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class Observation:
    """A controller's observation at one instant.

    Numbers that are none (NaN, infinite ones, a covariance that is none) are accepted here, since
    a robot may meet them at any time; controllers answer with a safe command, see
    `checked_numbers`.

    Attributes
    ----------
    stamp : s.
    state : (n,) the robot's own estimated state, in the robot's own units.
    covariance : (n, n) of that estimate, relative to the detections; None if unknown (taken as
        exact).
    polygons : what stands still and where, all of it (a map), or what is known of it.
    detections : obstacles seen now; a missing one was not seen.
    truth : the future, where a simulation grants it (the oracle predictor alone reads it).
    map_covariance : (n, n) of the state relative to the polygons, where these are known in another
        frame than the detections: on a map, while the robot's own sensors see the others, whose
        places share the error of its pose. None where ``covariance`` holds for both.
    scan : newest turn of its LiDAR, in the frame of the state, for controllers that keep a costmap
        of their own; None where it has none.
    flaw : what makes its own numbers useless; "" where nothing does.

    Raises
    ------
    WideberthError : a wrong type or shape.
    """

    stamp: float
    state: Array
    detections: tuple[Detection, ...]
    covariance: Array | None
    polygons: tuple[Polygon, ...]
    truth: Truth | None
    map_covariance: Array | None
    scan: PlacedScan | None
    flaw: str = field(init=False)

    def __init__(
        self,
        stamp: float,
        state: ArrayLike,
        detections: Iterable[Detection] = (),
        covariance: ArrayLike | None = None,
        polygons: Iterable[Polygon] = (),
        truth: Truth | None = None,
        map_covariance: ArrayLike | None = None,
        scan: PlacedScan | None = None,
    ) -> None:
        stamp = number("observation.stamp", stamp)
        state, flaw = checked("observation.state", state, (None,), finite=False), ""
        if map_covariance is not None:
            map_covariance, flaw = _covariance("map_covariance", map_covariance, len(state))
        if covariance is not None:
            covariance, wrong = _covariance("covariance", covariance, len(state))
            flaw = wrong or flaw
        if not all_finite(state):
            flaw = f"state is {state.tolist()}"
        if not np.isfinite(stamp):
            flaw = f"stamp is {stamp}"
        detections = _all("detections", detections, Detection)
        polygons = _all("polygons", polygons, Polygon)
        if not isinstance(truth, Truth | None):
            raise WideberthError(f"observation.truth is {truth!r}; wanted a Truth or None")
        if not isinstance(scan, PlacedScan | None):
            raise WideberthError(f"observation.scan is {scan!r}; wanted a PlacedScan or None")
        settle(
            self, stamp=stamp, state=state, detections=detections, covariance=covariance,
            polygons=polygons, truth=truth, map_covariance=map_covariance, scan=scan, flaw=flaw,
        )  # fmt: skip

    def __repr__(self) -> str:
        """Say when, where the robot is, and whom it sees, a line each for the first eight."""
        state = ", ".join(f"{value:.4g}" for value in self.state.ravel()[:12])
        count = len(self.detections)
        words = [f"stamp {self.stamp:g} s", f"state ({state})"]
        words += [f"{count} detection{'s' * (count != 1)}"]
        words += [f"{len(self.polygons)} polygons"] * bool(self.polygons)
        words += [f"of no use: {self.flaw}"] * bool(self.flaw)
        lines = [f"  {one.ident!r} at {one.position.round(3).tolist()}, radius {one.radius:g} m"
                 for one in self.detections[:8]]  # fmt: skip
        lines += [f"  and {count - 8} more"] * (count > 8)
        return "\n".join([f"Observation({', '.join(words)})", *lines])


def checked_numbers(observation: Observation) -> None:
    """Refuse an observation with numbers that are not finite; a controller turns it into a status.

    Raises
    ------
    WideberthError : stamp, state or covariance of the robot itself are of no use, or larger than
        `FARTHEST`.
    """
    if observation.flaw:
        raise WideberthError(f"the observation's {observation.flaw}")
    limits = {"state": FARTHEST, "covariance": FARTHEST**2, "map_covariance": FARTHEST**2}
    for name, limit in limits.items():
        value = getattr(observation, name)
        if value is not None and (largest := np.abs(value).max(initial=0.0)) > limit:
            raise WideberthError(
                f"the observation's {name} holds {largest:.3g}; wanted at most {limit:g}"
            )


def _state(
    velocity: ArrayLike | None, covariance: ArrayLike | None, size: int
) -> tuple[Array, Array, str]:
    """Return a tracker's velocity and covariance, and what makes them useless."""
    if velocity is None or covariance is None:
        given = "velocity" if covariance is None else "state_covariance"
        raise WideberthError(
            f"detection.{given} comes alone; state velocity and state_covariance together, or "
            "neither"
        )
    speed = checked("detection.velocity", velocity, (size,), finite=False)
    joint, flaw = _covariance("state_covariance", covariance, 2 * size)
    return speed, joint, flaw if all_finite(speed) else f"velocity is {speed.tolist()}"


def _covariance(name: str, value: ArrayLike, size: int) -> tuple[Array, str]:
    """Return a matrix of that size, and why it is no covariance, if so."""
    shape = (size, size)
    try:
        return checked_covariance(name, value, shape), ""
    except WideberthError as error:
        reason = of_covariances(size)
        return checked(name, value, shape, finite=False, reason=reason), str(error)


def _all(name: str, values: Iterable[T], kind: type[T]) -> tuple[T, ...]:
    """Return values as a tuple if all are of that kind."""
    try:
        found = tuple(values)
    except TypeError:
        raise WideberthError(f"observation.{name} is {values!r}; wanted a tuple") from None
    for one in found:
        if not isinstance(one, kind):
            raise WideberthError(
                f"observation.{name} holds a {type(one).__name__}; wanted {kind.__name__}"
            )
    return found
