"""Sensors of a robot: planar LiDAR, wheel encoders, gyroscope with accelerometer."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import floor, sqrt, tau
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array, positive, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, WheelSample

from ..state_estimator import Sample

GRAVITY = 9.81
"""m/s^2, as in the physics."""
_ROUNDING = 1e-9
"""Share of a period by which a sample may be due too early: sums of time steps are rounded."""

Cast = Callable[[Array, Array, float], Array]
"""Origin (3,) m, unit directions (B, 3) and a longest range m, to ranges (B,) m. A negative one
is none; one beyond the longest may be there or not."""


@final
@dataclass(frozen=True, eq=False)
class BodyState:
    """How a robot's body stands and moves at an instant.

    Attributes
    ----------
    time : s.
    position : (3,), m, of the body's origin between the four wheel hubs.
    attitude : (3, 3), from the body's frame (forward, left, up) to that of the world.
    velocity : (3,), m/s, of the origin in the world frame.
    rates : (3,), rad/s, angular velocity in the body's frame.
    wheels : (4,), rad, angles: left front, left rear, right front, right rear.
    """

    time: float
    position: Array
    attitude: Array
    velocity: Array
    rates: Array
    wheels: Array


class Sampler(ABC):
    """A sensor at work: it is shown the robot after each step and yields samples when due."""

    @abstractmethod
    def sample(self, state: BodyState, cast: Cast) -> list[Sample]:
        """Return the samples that became due since the last call.

        Parameters
        ----------
        state : of the robot that carries the sensor.
        cast : measures along rays.
        """


class Sensor(ABC):
    """What a robot carries. Frozen; `sampler` starts it.

    A sample is due where floor((time - phase) rate) changes, and carries the time of that step:
    rates need not divide that of the physics.
    """

    name: str
    rate: float
    phase: float

    @abstractmethod
    def sampler(self, rng: np.random.Generator, hub: float) -> Sampler:
        """Switch the sensor on.

        Parameters
        ----------
        rng : of this sensor alone.
        hub : m, height of the body's origin above the ground.
        """


def _check_timing(sensor: Sensor) -> None:
    """Refuse a rate that is not above 0 and a phase outside [0, 1 / rate).

    Raises
    ------
    WideberthError : either.
    """
    positive(f"{sensor.name}.rate", sensor.rate)
    positive(f"{sensor.name}.phase", sensor.phase, zero=True)
    if sensor.phase * sensor.rate >= 1.0:
        raise WideberthError(
            f"{sensor.name}.phase is {sensor.phase:g} s; wanted less than the period, "
            f"{1.0 / sensor.rate:g} s"
        )


def _periods(time: float, phase: float, rate: float) -> int:
    """Return how many whole periods have passed since the phase; negative before it."""
    return floor((time - phase) * rate + _ROUNDING)


@final
@dataclass(frozen=True)
class Lidar(Sensor):
    """A planar LiDAR that turns counter-clockwise.

    A beam is cast at the physics step in which it is due, so that a moving robot smears its
    scan. The plane of the beams tilts with the body. The robot does not see itself.

    Parameters
    ----------
    name : unique on its robot.
    rate, phase : turns per s; s, when the first turn begins, within one period.
    beams : of a turn.
    field : rad, angle that the beams cover; they begin at -field / 2.
    longest : m, longest range.
    deviation : m, standard deviation of a range.
    lost : probability that a beam comes to nothing.
    mount : x, y in m and heading in rad on the body.
    height : m above the ground. Other robots have hulls from 0.12 to 0.52 m.

    Raises
    ------
    WideberthError : numbers out of range.
    """

    name: str = "lidar"
    rate: float = 10.0
    phase: float = 0.0
    beams: int = 360
    field: float = tau
    longest: float = 15.0
    deviation: float = 0.01
    lost: float = 0.01
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    height: float = 0.35

    def __post_init__(self) -> None:
        _check_timing(self)
        whole(f"{self.name}.beams", self.beams)
        for entry in ("field", "longest", "deviation", "height"):
            positive(f"{self.name}.{entry}", getattr(self, entry))
        if self.field > tau + _ROUNDING:
            raise WideberthError(f"{self.name}.field is {self.field:g} rad; a turn has 2 pi")
        if not 0.0 <= self.lost <= 1.0:
            raise WideberthError(f"{self.name}.lost is {self.lost:g}; wanted a probability")

    @property
    def bearings(self) -> Array:
        """Directions of the beams of a turn, (B,), rad, in the sensor's frame.

        A full turn has no two beams in the same direction; a part of one has a beam at
        either end.
        """
        whole_turn = self.field > tau - _ROUNDING
        half = 0.5 * self.field
        return np.linspace(-half, half, self.beams, endpoint=not whole_turn)

    def sampler(self, rng: np.random.Generator, hub: float) -> Sampler:
        """Switch it on."""
        return _LidarAtWork(self, rng, hub)


@final
class _LidarAtWork(Sampler):
    def __init__(self, lidar: Lidar, rng: np.random.Generator, hub: float) -> None:
        self._lidar = lidar
        self._rng = rng
        self._bearings = lidar.bearings
        x, y, heading = lidar.mount
        self._place = np.array([x, y, lidar.height - hub])
        turned = self._bearings + heading
        flat = np.zeros_like(turned)
        self._directions = np.stack([np.cos(turned), np.sin(turned), flat], axis=-1)
        self._cast = 0  # beams since the start
        self._times = np.empty(lidar.beams)
        self._ranges = np.empty(lidar.beams)

    def sample(self, state: BodyState, cast: Cast) -> list[Sample]:
        """Cast the beams that are due, and return the scans that they end."""
        beams = self._lidar.beams
        due = _periods(state.time, self._lidar.phase, self._lidar.rate * beams)
        scans: list[Sample] = []
        while self._cast < due:
            first = self._cast % beams
            last = min(first + due - self._cast, beams)
            self._ranges[first:last] = self._measured(state, cast, slice(first, last))
            self._times[first:last] = state.time
            self._cast += last - first
            if last == beams:
                scans.append(self._scan())
        return scans

    def _measured(self, state: BodyState, cast: Cast, chosen: slice) -> Array:
        lidar, rng = self._lidar, self._rng
        origin = state.position + state.attitude @ self._place
        ranges = cast(origin, self._directions[chosen] @ state.attitude.T, lidar.longest)
        noisy = ranges + lidar.deviation * rng.standard_normal(len(ranges))
        # A body that begins within the longest range is met beyond it too.
        noisy[(ranges < 0.0) | (ranges > lidar.longest)] = np.inf
        noisy[rng.random(len(ranges)) < lidar.lost] = np.nan
        return noisy

    def _scan(self) -> Scan:
        lidar = self._lidar
        return Scan(
            lidar.name, self._times, self._bearings, self._ranges, lidar.deviation,
            lidar.longest, np.array(lidar.mount),
        )  # fmt: skip


@final
@dataclass(frozen=True)
class WheelEncoders(Sensor):
    """Counters at the four wheels.

    Parameters
    ----------
    name : unique on its robot.
    rate, phase : Hz; s, of the first sample, within one period.
    ticks : of a turn of a wheel; angles are rounded to them.

    Raises
    ------
    WideberthError : numbers out of range.
    """

    name: str = "encoders"
    rate: float = 100.0
    phase: float = 0.0
    ticks: int = 4096

    def __post_init__(self) -> None:
        _check_timing(self)
        whole(f"{self.name}.ticks", self.ticks)

    def sampler(self, rng: np.random.Generator, hub: float) -> Sampler:
        """Switch them on."""
        return _EncodersAtWork(self)


@final
class _EncodersAtWork(Sampler):
    def __init__(self, encoders: WheelEncoders) -> None:
        self._encoders = encoders
        self._count = _periods(0.0, encoders.phase, encoders.rate)
        self._tick = tau / encoders.ticks

    def sample(self, state: BodyState, cast: Cast) -> list[Sample]:
        """Return the counted angles if they are due."""
        count = _periods(state.time, self._encoders.phase, self._encoders.rate)
        if count == self._count:
            return []
        self._count = count
        angles = self._tick * np.rint(state.wheels / self._tick)
        return [WheelSample(self._encoders.name, state.time, angles)]


@final
@dataclass(frozen=True)
class InertialUnit(Sensor):
    """A gyroscope and an accelerometer at the body's origin.

    The gyroscope reads the yaw rate about the body's upward axis. The accelerometer reads
    the mean specific force since its last sample, along the body's forward and left axes: the
    change of velocity less gravity, so that a pitched robot feels a share of the latter. Both
    have white noise and a bias, drawn at the start, that walks.

    Parameters
    ----------
    name : unique on its robot.
    rate, phase : Hz; s, of the first sample, within one period.
    rate_deviation : rad/s, of the gyroscope's white noise, per sample.
    rate_bias : rad/s, standard deviation of its bias at the start.
    rate_walk : rad/s/sqrt(s), of the bias.
    acceleration_deviation : m/s^2, of the accelerometer's white noise, per sample.
    acceleration_bias : m/s^2, standard deviation of its bias at the start.
    acceleration_walk : m/s^2/sqrt(s), of the bias.

    Raises
    ------
    WideberthError : numbers out of range.
    """

    name: str = "imu"
    rate: float = 100.0
    phase: float = 0.0
    rate_deviation: float = 0.002
    rate_bias: float = 0.01
    rate_walk: float = 3e-5
    acceleration_deviation: float = 0.05
    acceleration_bias: float = 0.05
    acceleration_walk: float = 1e-4

    def __post_init__(self) -> None:
        _check_timing(self)
        for entry in ("rate", "acceleration"):
            for kind in ("deviation", "bias", "walk"):
                name = f"{entry}_{kind}"
                positive(f"{self.name}.{name}", getattr(self, name), zero=True)

    def sampler(self, rng: np.random.Generator, hub: float) -> Sampler:
        """Switch it on."""
        return _InertialAtWork(self, rng)


@final
class _InertialAtWork(Sampler):
    def __init__(self, unit: InertialUnit, rng: np.random.Generator) -> None:
        self._unit = unit
        self._rng = rng
        self._count = _periods(0.0, unit.phase, unit.rate)
        self._start: tuple[float, Array] | None = None  # time and velocity at the last sample
        felt = unit.acceleration_bias
        self._bias = rng.standard_normal(3) * np.array([unit.rate_bias, felt, felt])
        self._noise = np.array([unit.rate_deviation, *2 * [unit.acceleration_deviation]])
        self._walk = np.array([unit.rate_walk, *2 * [unit.acceleration_walk]])

    def sample(self, state: BodyState, cast: Cast) -> list[Sample]:
        """Return what the unit reads if that is due."""
        if self._start is None:
            self._start = state.time, state.velocity
            return []
        count = _periods(state.time, self._unit.phase, self._unit.rate)
        if count == self._count or state.time <= self._start[0]:
            return []
        self._count = count
        passed = state.time - self._start[0]
        force = (state.velocity - self._start[1]) / passed + np.array([0.0, 0.0, GRAVITY])
        self._start = state.time, state.velocity
        truth = np.array([state.rates[2], *(state.attitude.T @ force)[:2]])
        draws = self._rng.standard_normal((2, 3))
        self._bias = self._bias + sqrt(passed) * self._walk * draws[0]
        read = truth + self._bias + self._noise * draws[1]
        return [InertialSample(self._unit.name, state.time, float(read[0]), read[1:])]
