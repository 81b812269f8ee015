"""What robots measure of their own motion, and what they conclude from their sensors."""

from dataclasses import dataclass, field
from math import inf, isfinite

import numpy as np
from numpy.typing import ArrayLike

from ...framework.values.arrays import (
    Array,
    all_finite,
    checked,
    checked_covariance,
    number,
    positive,
    settle,
)
from ...framework.values.errors import WideberthError

MOTION = ("x", "y", "heading", "forward speed", "lateral speed", "yaw rate")
"""Entries of a `MotionEstimate`: m, m, rad, m/s, m/s, rad/s. Speeds are in the body frame."""
_NO_POINTS, _NO_MATRICES = np.zeros((0, 2)), np.zeros((0, 2, 2))


@dataclass(frozen=True, eq=False)
class WheelSample:
    """Angles that wheel encoders have counted.

    Attributes
    ----------
    sensor : name of the encoders.
    time : s.
    angles : (W,), rad since they were switched on; the left wheels, then as many right ones.
    flaw : what makes it useless; "" where nothing does.
    """

    sensor: str
    time: float
    angles: Array
    flaw: str = field(init=False, repr=False)

    def __init__(self, sensor: str, time: float, angles: ArrayLike) -> None:
        angles = checked("wheel_sample.angles", angles, (None,), finite=False)
        if not len(angles) or len(angles) % 2:
            raise WideberthError(
                f"wheel_sample.angles has {len(angles)} entries; wanted the left wheels' angles, "
                "then as many of right ones"
            )
        time = number("wheel_sample.time", time)
        flaw = "" if all_finite(angles) else f"angles are {angles.tolist()}"
        settle(self, sensor=sensor, time=time, angles=angles, flaw=flaw or _timeless(time))


@dataclass(frozen=True, eq=False)
class InertialSample:
    """One reading of a gyroscope and an accelerometer.

    Attributes
    ----------
    sensor : name of the unit.
    time : s.
    yaw_rate : rad/s, with its bias.
    acceleration : (2,), m/s^2, forward and lateral in the body frame, with its bias.
    flaw : what makes it useless; "" where nothing does.
    """

    sensor: str
    time: float
    yaw_rate: float
    acceleration: Array
    flaw: str = field(init=False, repr=False)

    def __init__(self, sensor: str, time: float, yaw_rate: float, acceleration: ArrayLike) -> None:
        felt = checked("inertial_sample.acceleration", acceleration, (2,), finite=False)
        time = number("inertial_sample.time", time)
        yaw_rate = number("inertial_sample.yaw_rate", yaw_rate)
        flaw = "" if all_finite(felt) else f"acceleration is {felt.tolist()}"
        if not isfinite(yaw_rate):
            flaw = f"yaw rate is {yaw_rate}"
        flaw = flaw or _timeless(time)
        settle(self, sensor=sensor, time=time, yaw_rate=yaw_rate, acceleration=felt, flaw=flaw)


def _timeless(time: float) -> str:
    return "" if -inf < time < inf else f"time is {time}"


@dataclass(frozen=True, eq=False)
class MotionEstimate:
    """Where a robot believes it is and how it moves.

    Attributes
    ----------
    time : s.
    mean : (6,), see `MOTION`.
    covariance : (6, 6) of it.
    frame : name of the frame of the pose: "odom", where the robot switched on, or "map".

    Raises
    ------
    WideberthError : shapes that do not fit, numbers that are not finite, no covariance.
    """

    time: float
    mean: Array
    covariance: Array
    frame: str

    def __init__(
        self, time: float, mean: ArrayLike, covariance: ArrayLike, frame: str = "odom"
    ) -> None:
        mean = checked("motion_estimate.mean", mean, (6,))
        covariance = checked_covariance("motion_estimate.covariance", covariance, (6, 6))
        settle(self, time=time, mean=mean, covariance=covariance, frame=frame)

    @property
    def pose(self) -> Array:
        """x, y, heading, (3,), m and rad."""
        return self.mean[:3]


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight pieces of what stands still, as points on it have shown them.

    What is met goes on beyond the ends by up to the distance between two beams.

    Attributes
    ----------
    ends : (S, 2, 2), m, first and last end of each, counter-clockwise around the sensor.
    covariance : (S, 2, 2), m^2, of how far the two ends lie across what they stand for; along the
        line of sight for a segment of no length.

    Raises
    ------
    WideberthError : shapes that do not fit, numbers that are not finite, no covariance.
    """

    ends: Array
    covariance: Array

    def __init__(
        self, ends: ArrayLike = _NO_MATRICES, covariance: ArrayLike = _NO_MATRICES
    ) -> None:
        ends = checked("segments.ends", ends, (None, 2, 2))
        shape = (len(ends), 2, 2)
        covariance = checked_covariance("segments.covariance", covariance, shape)
        settle(self, ends=ends, covariance=covariance)

    def __len__(self) -> int:
        """Count the segments."""
        return len(self.ends)

    def and_those(self, others: "Segments") -> "Segments":
        """Return these and others."""
        return Segments(
            np.concatenate([self.ends, others.ends]),
            np.concatenate([self.covariance, others.covariance]),
        )


_NO_SEGMENTS = Segments()


@dataclass(frozen=True, eq=False)
class Sightings:
    """What a detector finds in one scan, in the frame of the poses that it was given.

    The covariances are relative to the robot: they do not hold the error of its own pose, which
    all of them share. Each body was measured at an instant of its own within the scan. A tracker
    brings all of them to the common instant, since it knows how they move.

    Attributes
    ----------
    time : s, instant of the scan, common to all; NaN for a scan without beams.
    positions : (O, 2), m, centres of what may move.
    covariance : (O, 2, 2), m^2.
    radius : (O,), m, of a disc that encloses each.
    static : (S, 2), m, points of what stands still.
    note : why the scan gave less than it should; "" where it did not.
    times : (O,), s, when each was measured; () where all were at `time`.
    origin : (2,), m, where the sensor was; None where that is not known.
    lasting : m per axis, standard deviation of the part of the errors that stays while a body is
        seen from one side: that of a box whose heading is unknown. No filter averages it away.
    segments : through the points of ``static``; each point is on one, or beside the end of one.

    Raises
    ------
    WideberthError : shapes that do not fit, numbers that are not finite, no covariance.
    """

    time: float
    positions: Array
    covariance: Array
    radius: Array
    static: Array
    note: str
    times: Array
    origin: Array | None
    lasting: float
    segments: Segments

    def __init__(
        self,
        time: float,
        positions: ArrayLike,
        covariance: ArrayLike,
        radius: ArrayLike,
        static: ArrayLike = _NO_POINTS,
        note: str = "",
        times: ArrayLike = (),
        origin: ArrayLike | None = None,
        lasting: float = 0.0,
        segments: Segments = _NO_SEGMENTS,
    ) -> None:
        positive("sightings.lasting", lasting, zero=True)
        positions = checked("sightings.positions", positions, (None, 2))
        count = len(positions)
        if count and not isfinite(number("sightings.time", time)):
            raise WideberthError(f"sightings.time is {time}; wanted the instant of the scan")
        if origin is not None:
            origin = checked("sightings.origin", origin, (2,))
        times = times if np.size(times) or not count else np.full(count, time)
        times = checked("sightings.times", times, (count,))
        covariance = checked_covariance("sightings.covariance", covariance, (count, 2, 2))
        radius = checked("sightings.radius", radius, (count,))
        static = checked("sightings.static", static, (None, 2))
        settle(self, time=time, positions=positions, covariance=covariance, radius=radius)
        settle(self, static=static, note=note, times=times, origin=origin)
        settle(self, lasting=lasting, segments=segments)


@dataclass(frozen=True, eq=False)
class TrackedObstacle:
    """An obstacle as a tracker believes in it.

    Attributes
    ----------
    ident : identity, never used again for another one.
    time : s, instant of the state.
    state : (4,), x, y in m and their rates in m/s.
    covariance : (4, 4) of the state, relative to the robot as in `Sightings`.
    radius : m.
    seen : s, when it was measured last.
    times : (K,), s, of the measurements that were taken to be of it, oldest first; () where a
        tracker keeps none.
    measured : (K, 2), m, these measurements, as the detector gave them.
    noise : (K, 2, 2), m^2, their covariances.

    Raises
    ------
    WideberthError : shapes that do not fit, numbers that are not finite, no covariance.
    """

    ident: str
    time: float
    state: Array
    covariance: Array
    radius: float
    seen: float
    times: Array
    measured: Array
    noise: Array

    def __init__(
        self,
        ident: str,
        time: float,
        state: ArrayLike,
        covariance: ArrayLike,
        radius: float,
        seen: float,
        times: ArrayLike = (),
        measured: ArrayLike = _NO_POINTS,
        noise: ArrayLike = _NO_MATRICES,
    ) -> None:
        state = checked("tracked_obstacle.state", state, (4,))
        covariance = checked_covariance("tracked_obstacle.covariance", covariance, (4, 4))
        positive("tracked_obstacle.radius", radius, zero=True)
        times = checked("tracked_obstacle.times", times, (None,))
        shape = (len(times), 2)
        measured = checked("tracked_obstacle.measured", measured, shape)
        noise = checked_covariance("tracked_obstacle.noise", noise, (*shape, 2))
        settle(self, ident=ident, time=time, state=state, covariance=covariance, radius=radius)
        settle(self, seen=seen, times=times, measured=measured, noise=noise)
