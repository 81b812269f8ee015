"""The base of the planar filters: which sample leads to which update, and samples out of order."""

from abc import abstractmethod
from bisect import bisect_right
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple, TypeAlias

import numpy as np

from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.values.arrays import Array, assembled, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.sensing.perceived import InertialSample, MotionEstimate, WheelSample

from ..state_estimator import Sample, StateEstimator, checked_start
from .model import BIAS, FORWARD, LATERAL, SIZE, SPEED, YAW_RATE, corrected, doubted, wrapped
from .noise import MotionNoise, noise_of

Key: TypeAlias = tuple[float, int, str]
"""Time, kind and sensor: samples are used in this order, whatever order they come in."""
_QUIET = 2e-5
"""rad/s, what the bias may wander by while it is calibrated."""
_STIRRED = 1e-3
"""m, way of a wheel's rim from which on the robot no longer stands."""
_STEP = 1.0
"""m/s^2, deviation by which the acceleration steps with a command: the gate allows for it."""
_WILDEST = 1e6
"""m/s, rad/s, m/s^2. Measurements beyond are none, gate or not."""
_LOST = 1e3
"""s. Over a longer jump of the clock nothing is left to carry on."""


class Belief(NamedTuple):
    """All that a filter has concluded; each sample gives a new one.

    Attributes
    ----------
    time : s, instant of mean and covariance.
    mean, covariance : (9,) and (9, 9), see `model.STATE`.
    resting : until when the robot is believed to stand, s; minus infinity once it drives.
    rest : (samples, sum of yaw rates) while it surely stood.
    unit : name of the inertial unit; "" before its first sample.
    wheels : the last sample of the wheels.
    stood : the first sample of the wheels.
    inertial : (samples, sum of yaw rates, of forward accelerations) since the last update.
    """

    time: float
    mean: Array
    covariance: Array
    resting: float
    rest: tuple[int, float] = (0, 0.0)
    unit: str = ""
    wheels: WheelSample | None = None
    stood: WheelSample | None = None
    inertial: tuple[int, float, float] = (0, 0.0, 0.0)


_GATE = 1e-3
"""Probability with which a good measurement is left out: nu^2 / S beyond the chi-squared quantile
of one degree of freedom, 10.8. An acceleration steps with the
command, of which the model knows nothing: for its test (1 m/s^2)^2 are added to S. What was left
out makes the filter doubt itself, see `model.doubted`: a push that goes on is believed at the next
update."""
_MEMORY = 0.5
"""s, how late a sample may come."""
_INTERVAL = 0.025
"""s, the shortest time between two updates. Wheels that are read more often lose nothing by it,
since their angles are counted from the start."""
_PATIENCE = 0.25
"""s, the longest time over which angles are compared."""
_OUTAGE = 1.0
"""s, how far ahead the estimate is carried, and a clock may jump."""


@dataclass(eq=False)
class PlanarFilter(StateEstimator):
    """Estimates pose, speeds, accelerations and the gyro's bias from wheels and inertial unit.

    State and prediction are those of `model.moved`; how mean and covariance are carried on is the
    affair of the concrete class. Every sample of the wheels is one update, in this order::

        forward speed   mean wheel increment * wheel_radius / time between,  R = wheels^2
        lateral speed   0,                                                   R = slip^2
        yaw rate + bias mean of the m gyro samples since the last update,    R = gyro^2 / m
                                                                                 + jitter^2
        acceleration    likewise,                    R = accelerometer^2 / m + its bias^2

    The difference of the wheels says nothing of the yaw rate of a skid-steered robot and is not
    used. For the first ``rest`` s the robot has to stand: pose and speeds stay what they are, and
    the mean of the gyro becomes its bias, with the variance gyro^2 / n + (2e-5 rad/s)^2. The rest
    ends early, with the samples that came before, when a wheel's rim has moved 1 mm.

    What is left out, each with its reason: numbers that are none; a measurement outside the gate;
    a sensor that this filter does not read, or a second one of a kind; the same sample twice; the
    speed of wheels of which nothing came for `_PATIENCE` s (the inertial unit alone then makes
    the updates). A sample that comes late, at most `_MEMORY` s after newer ones, is used: these
    are filtered again, so that the order in which they arrive makes no difference at all. One
    that comes later still is left out. So is one whose clock is ahead by more than `_OUTAGE` s,
    until for that long no sample of another clock has come.

    Parameters
    ----------
    wheel_radius : m.
    noise : a name in `noise.SETTINGS`, or the numbers.
    rest : s after `reset` in which the gyro is calibrated; 0 for none.

    Raises
    ------
    WideberthError : a number out of its range, an unknown noise.
    """

    wheel_radius: float = 0.1
    noise: str | MotionNoise = "small"
    rest: float = 2.0

    def __post_init__(self) -> None:
        name = type(self).__name__.lower()
        positive(f"{name}.wheel_radius", self.wheel_radius)
        positive(f"{name}.rest", self.rest, zero=True)
        self._farthest = content_bound(1, _GATE)
        self._noise = noise = noise_of(self.noise)
        self._growth = np.array([
            *(noise.position, noise.position, noise.heading, noise.speed, noise.lateral_speed),
            *(noise.yaw_rate, noise.acceleration, noise.acceleration, noise.bias_walk**2),
        ])  # fmt: skip
        self._keys: list[Key] = []

    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose (3,), m and rad, at rest."""
        pose, time = checked_start(pose, time)
        noise = self._noise
        mean = np.zeros(SIZE)
        mean[:3] = pose
        mean[2] = wrapped(mean[2])
        spread = np.repeat(
            (noise.start, noise.start_speed, noise.start_acceleration, noise.gyro_bias**2),
            (3, 3, 2, 1),
        )
        resting = time + self.rest if self.rest else -inf
        start = Belief(time, mean, np.diag(spread), resting)
        self._keys = [(time, -1, "")]
        self._samples: list[Sample | None] = [None]
        self._beliefs = [start]
        self._stray: float | None = None

    def take(self, sample: Sample) -> str:
        """Use a sample; return why it, or a part of it, was left out."""
        self._check_started()
        if not isinstance(sample, WheelSample | InertialSample):
            return "wheels and inertial units alone are read here"
        if sample.flaw:
            return f"the {sample.flaw}"
        key = (sample.time, 1 if isinstance(sample, WheelSample) else 0, sample.sensor)
        if reason := self._untimely(key):
            return reason
        place = bisect_right(self._keys, key)
        self._keys.insert(place, key)
        self._samples.insert(place, sample)
        del self._beliefs[place:]
        found = ""
        for index in range(place, len(self._keys)):
            again = self._samples[index]
            assert again is not None  # only the start is none, and nothing comes before it
            belief, reason = self._used(self._beliefs[-1], again)
            self._beliefs.append(belief)
            found = reason if index == place else found
        self._forget()
        return found

    def at(self, time: float) -> MotionEstimate:
        """Return the estimate of a time, s, carried on from the last sample before it.

        Its own time is another one where it cannot be of that time: the oldest that is remembered,
        or `_OUTAGE` s beyond the newest sample.
        """
        self._check_started()
        newest = self._keys[-1][0]
        time = min(time, newest + _OUTAGE) if time == time else newest
        belief = self._beliefs[max(bisect_right(self._keys, (time, 9, "")) - 1, 0)]
        time = max(time, belief.time)
        mean, covariance = self._carried_on(belief, time)
        square = covariance[:6, :6]
        return assembled(
            MotionEstimate,
            time=time, mean=mean[:6].copy(), covariance=0.5 * (square + square.T), frame="odom",
        )  # fmt: skip

    @abstractmethod
    def carried(self, mean: Array, covariance: Array, dt: float) -> tuple[Array, Array]:
        """Return mean and covariance ``dt`` s later, without the growth of the noise."""

    def _check_started(self) -> None:
        if not self._keys:
            raise WideberthError("a filter starts from a known pose: call reset first")

    def _untimely(self, key: Key) -> str:
        """Return why a sample cannot be used at its time, "" where it can."""
        time, newest = key[0], self._keys[-1][0]
        settled = max(self._keys[0], (newest - _MEMORY, -1, ""))
        if time > newest + _OUTAGE:
            self._stray = min(time, self._stray if self._stray is not None else time)
            if time > newest + _LOST:
                return f"its clock is {time - newest:.4g} s ahead: reset from a known pose"
            if time < self._stray + _OUTAGE:
                return f"its clock is {time - newest:.4g} s ahead of all samples so far"
        if key <= settled:
            return (
                f"it is of {time:.6g} s; all before {settled[0]:.6g} s is settled: come sooner, "
                "or reset where the clock was set back"
            )
        if key in self._keys:
            return "the same sensor has reported for this time before"
        self._stray = None
        return ""

    def _forget(self) -> None:
        """Drop what is older than the memory, but for the last belief before."""
        settled = bisect_right(self._keys, (self._keys[-1][0] - _MEMORY, -1, "")) - 1
        if settled > 0:
            del self._keys[:settled], self._samples[:settled], self._beliefs[:settled]

    def _used(self, belief: Belief, sample: Sample) -> tuple[Belief, str]:
        """Return the belief after a sample, and why a part of it was left out."""
        if isinstance(sample, WheelSample):
            return self._with_wheels(belief, sample)
        assert isinstance(sample, InertialSample)
        if belief.unit not in ("", sample.sensor):
            return belief, f"it is of {sample.sensor!r}; the inertial unit read is {belief.unit!r}"
        count, rate, forward = belief.inertial
        felt = (count + 1, rate + sample.yaw_rate, forward + float(sample.acceleration[0]))
        belief = belief._replace(inertial=felt, unit=sample.sensor)
        if belief.resting > -inf:
            waited = sample.time >= belief.resting
            return (self._rested(_settled(belief), sample.time) if waited else belief), ""
        if sample.time - belief.time <= _PATIENCE:
            return belief, ""
        return self._updated(belief, sample.time, None)

    def _with_wheels(self, belief: Belief, sample: WheelSample) -> tuple[Belief, str]:
        before = belief.wheels
        if before is None:
            return belief._replace(wheels=sample, stood=sample), ""
        if before.sensor != sample.sensor or len(before.angles) != len(sample.angles):
            return belief, (
                f"it is of {len(sample.angles)} wheels of {sample.sensor!r}; those read are "
                f"{len(before.angles)} of {before.sensor!r}"
            )
        if belief.resting > -inf:
            assert belief.stood is not None  # set with the first sample of the wheels
            if self.wheel_radius * max(map(abs, _turns(sample, belief.stood))) < _STIRRED:
                belief = _settled(belief)._replace(wheels=sample)
                waited = sample.time >= belief.resting
                return (self._rested(belief, sample.time) if waited else belief), ""
            belief = self._rested(belief, before.time)
        if sample.time - belief.time < _INTERVAL:
            return belief, ""
        since = sample.time - before.time
        belief = belief._replace(wheels=sample)
        if since > _PATIENCE:
            belief, reason = self._updated(belief, sample.time, None)
            silent = f"no wheels for {since:.3g} s: their speed is unknown"
            return belief, "; ".join(filter(None, (silent, reason)))
        turns = _turns(sample, before)
        speed = self.wheel_radius * sum(turns) / (len(turns) * since)
        return self._updated(belief, sample.time, speed)

    def _rested(self, belief: Belief, time: float) -> Belief:
        """Let the robot drive from now on, with the bias that the gyro had at rest."""
        count, total = belief.rest
        mean, covariance = belief.mean, belief.covariance
        if count:
            mean, covariance = mean.copy(), covariance.copy()
            mean[BIAS[0]] = total / count
            covariance[BIAS[0], BIAS[0]] = self._noise.gyro**2 / count + _QUIET**2
        return belief._replace(
            time=time, mean=mean, covariance=covariance, resting=-inf, inertial=(0, 0.0, 0.0)
        )

    def _updated(self, belief: Belief, time: float, speed: float | None) -> tuple[Belief, str]:
        """Carry the belief on to a time and use what was measured since the last update."""
        noise = self._noise
        mean, covariance = self._carried_on(belief, time)
        measured: list[tuple[str, tuple[int, ...], float, float]] = []
        if speed is not None:
            measured.append(("wheel speed", SPEED, speed, noise.wheels**2))
        measured.append(("lateral speed", LATERAL, 0.0, noise.slip**2))
        count, rate, forward = belief.inertial
        if count:
            turn, push = noise.gyro**2 / count, noise.accelerometer**2 / count
            measured += [
                ("yaw rate", YAW_RATE, rate / count, turn + noise.jitter**2),
                ("acceleration", FORWARD, forward / count, push + noise.accelerometer_bias**2),
            ]
        reasons = []
        for name, entries, value, variance in measured:
            if not abs(value) < _WILDEST:
                reasons.append(f"{name} {value:.4g} is none that a robot has")
                continue
            mean, covariance, surprise, distance = corrected(
                mean, covariance, entries, value, variance, self._farthest,
                _STEP**2 if entries is FORWARD else 0.0,
            )  # fmt: skip
            if distance > self._farthest:
                away, dt = sqrt(distance), time - belief.time
                covariance = doubted(covariance, belief.mean.tolist(), dt, entries[0], surprise)
                reasons.append(f"{name} {value:.4g} is {away:.1f} deviations from the expected")
        mean[2] = wrapped(mean[2])
        belief = belief._replace(
            time=time, mean=mean, covariance=covariance, inertial=(0, 0.0, 0.0)
        )
        return belief, "; ".join(reasons)

    def _carried_on(self, belief: Belief, time: float) -> tuple[Array, Array]:
        """Return mean and covariance at a later time; a robot at rest does not move."""
        dt = time - max(belief.time, min(belief.resting, time))
        if dt <= 0.0:
            return belief.mean.copy(), belief.covariance
        mean, covariance = self.carried(belief.mean, belief.covariance, dt)
        covariance.reshape(-1)[:: SIZE + 1] += dt * self._growth
        mean[2] = wrapped(mean[2])
        return mean, covariance


def _settled(belief: Belief) -> Belief:
    """Count the gyro samples since the last one of the wheels as made at rest."""
    count, total = belief.rest
    more, rate, _ = belief.inertial
    return belief._replace(rest=(count + more, total + rate), inertial=(0, 0.0, 0.0))


def _turns(sample: WheelSample, before: WheelSample) -> list[float]:
    """Return by what angle each wheel has turned, rad; infinite beyond all numbers."""
    both = zip(sample.angles.tolist(), before.angles.tolist(), strict=True)
    return [float(after) - float(start) for after, start in both]
