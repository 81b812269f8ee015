"""The laws of `StateEstimator` as a check that any estimator can run on itself."""

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass, replace
from math import cos, inf, nan, sin

import numpy as np

from wideberth.framework.numerics.geometry import plane_turn
from wideberth.framework.testing.laws import Contract, Law, law, refusing, serving, stated
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, MotionEstimate, WheelSample

from ..state_estimator import Sample, StateEstimator

_START = np.array([1.0, -2.0, 0.7])
_REST, _END = 2.5, 10.0
"""s after the start, of the time at rest and of the drive."""
_SPEED, _RATE, _RAMP = 0.5, 0.2, 1.0
"""m/s and rad/s that the drive reaches, and s in which it does."""
_FIRST = 5.0
"""s on the clock at the start."""


@Contract
def check_state_estimator(
    estimator: StateEstimator, *, wheel_radius: float = 0.1
) -> Iterator[Law]:
    """Check every law of `wideberth_perception.state_estimator.StateEstimator`.

    It is fed an arc, driven without slip by wheels and an inertial unit without noise, after 2.5 s
    at rest; and then whatever a bad day brings: numbers that are none, samples that come late,
    twice, from a jumping clock, from sensors that it does not read, and scans that show nothing.

    Parameters
    ----------
    estimator : to be checked; it is reset.
    wheel_radius : m, of the wheels that it expects.

    Raises
    ------
    AssertionError : names every law that does not hold.
    """
    return stated(_Drive, estimator, lambda: [_Drive(estimator, wheel_radius)])


@dataclass(frozen=True, eq=False)
class _Drive:
    """An estimator and what it is fed."""

    estimator: StateEstimator
    wheel_radius: float

    def samples(self, end: float = _END) -> Iterator[Sample]:
        """Yield the samples of an arc, 100 of the inertial unit and 33 of the wheels per s."""
        for count in range(1, round(end * 100) + 1):
            time = 0.01 * count
            pace = min(max(time - _REST, 0.0) / _RAMP, 1.0)
            push = _SPEED / _RAMP if 0.0 < pace < 1.0 else 0.0
            felt = np.array([push, pace**2 * _SPEED * _RATE])
            yield InertialSample("unit", _FIRST + time, pace * _RATE, felt)
            if count % 3 == 0:
                yield self.wheels(time)

    def wheels(self, time: float) -> WheelSample:
        """Return the sample of the wheels at a time since the start, s."""
        return WheelSample(
            "wheels", _FIRST + time, np.full(4, _SPEED * _driven(time) / self.wheel_radius)
        )

    def started(self, pose: Array = _START) -> StateEstimator:
        self.estimator.reset(pose, _FIRST)
        return self.estimator

    def driven(self, pose: Array = _START, end: float = _END) -> StateEstimator:
        """Return the estimator after a drive."""
        estimator = self.started(pose)
        for sample in self.samples(end):
            _given(estimator, sample)
        return estimator

    @law("refuses what comes before a start, and a start that is none")
    def check_unready(self) -> None:
        for pose, time in (((0.0, 0.0), 0.0), ((0.0, nan, 0.0), 0.0), ((0.0, 0.0, 0.0), inf)):
            with refusing("a wrong reset"):
                self.estimator.reset(np.array(pose), time)
        if is_dataclass(self.estimator):
            new = replace(self.estimator)
            with refusing("take, before reset,"):
                new.take(self.wheels(0.0))
            with refusing("at, before reset,"):
                new.at(_FIRST)

    @law("begins at the start, at rest")
    def check_start(self) -> None:
        found = _asked(self.started(), _FIRST)
        wanted = np.concatenate([_START, np.zeros(3)])
        assert np.allclose(found.mean, wanted, atol=1e-9), (
            f"after reset to {_START.tolist()} the estimate is {found.mean.tolist()}"
        )
        assert found.time == _FIRST and found.frame, f"its time is {found.time}, not {_FIRST}"

    @law("follows a drive without noise")
    def check_arc(self) -> None:
        found = _asked(self.driven(), _FIRST + _END)
        pose, way = _arc(_END)
        error = float(np.hypot(*(found.mean[:2] - pose[:2])))
        turn = abs(float(np.angle(np.exp(1j * (found.mean[2] - pose[2])))))
        assert error < 0.02 * way, f"it is {error:.3f} m off after {way:.2f} m; wanted 2 %"
        assert turn < 0.05, f"its heading is {turn:.3f} rad off; wanted below 0.05"
        speeds = np.abs(found.mean[3:] - (_SPEED, 0.0, _RATE)).max()
        assert speeds < 0.03, f"its speeds are {speeds:.3f} off; wanted below 0.03"

    @law("asking changes nothing")
    def check_asking(self) -> None:
        silent = [_asked(self.driven(end=t), _FIRST + t) for t in (4.0, 5.0)]
        estimator, asked = self.started(), []
        for sample in self.samples(5.0):
            _given(estimator, sample)
            now = _time(sample)
            for time in (now, now + 0.3, 0.0, 1e9, -inf, inf, nan):
                _asked(estimator, time)
            if isinstance(sample, InertialSample) and abs(_time(sample) - _FIRST - 4.0) < 1e-9:
                asked.append(_asked(estimator, _FIRST + 4.0))
        asked.append(_asked(estimator, _FIRST + 5.0))
        for one, other in zip(silent, asked, strict=True):
            _same(one, other, "asked in between")

    @law("no number changes nothing")
    def check_numbers(self) -> None:
        silent = _asked(self.driven(end=4.0), _FIRST + 4.0)
        estimator = self.started()
        for sample in self.samples(4.0):
            _given(estimator, sample)
            for broken in _broken(_time(sample)):
                assert _given(estimator, broken), f"no reason for leaving out {broken}"
        _same(silent, _asked(estimator, _FIRST + 4.0), "given numbers that are none")

    @law("nothing that is measured raises")
    def check_odd(self) -> None:
        """Feed what a clock, a cable or a wrong configuration may send."""
        estimator = self.driven()
        now = _FIRST + _END
        still = self.wheels(_END).angles
        nothing = np.zeros(2)
        for sample in (
            Scan("lidar", np.zeros(0), np.zeros(0), np.zeros(0)),
            Scan("lidar", np.full(9, now), np.arange(9.0), np.full(9, inf)),
            Scan("lidar", np.full(9, now), np.arange(9.0), np.full(9, nan)),
            Scan("lidar", np.full(9, now), np.arange(9.0), np.full(9, 1e-9)),
            Scan("lidar", np.full(9, 1e12), np.arange(9.0), np.full(9, 2.0)),
            WheelSample("wheels", now + 0.03, still + 1e9),
            WheelSample("wheels", now + 0.06, still[:2]),
            WheelSample("others", now + 0.09, still),
            WheelSample("wheels", now - 3.0, still),
            WheelSample("wheels", now + 0.03 + 1e-12, still),
            InertialSample("unit", now + 0.1, 1e200, nothing),
            InertialSample("unit", now + 0.2, 0.0, np.full(2, -1e200)),
            InertialSample("other", now + 0.2, 0.0, nothing),
            InertialSample("unit", -1e300, 0.0, nothing),
            InertialSample("unit", 1e300, 0.0, nothing),
            WheelSample("wheels", now + 10.0, still),
            WheelSample("wheels", now + 12.0, still),
            InertialSample("unit", now + 14.0, 0.1, nothing),
        ):
            _given(estimator, sample)
            for time in (now, _time(sample)):
                _asked(estimator, time)

    @law("a sample twice changes nothing")
    def check_twice(self) -> None:
        once = _asked(self.driven(end=4.0), _FIRST + 4.0)
        estimator = self.started()
        for sample in self.samples(4.0):
            _given(estimator, sample)
            assert _given(estimator, sample), "the same sample again is used without a word"
        _same(once, _asked(estimator, _FIRST + 4.0), "given every sample twice")

    @law("uncertainty does not shrink by itself")
    def check_growth(self) -> None:
        estimator = self.driven()
        size = [
            float(np.trace(_asked(estimator, _FIRST + _END + ahead).covariance[:2, :2]))
            for ahead in (0.0, 0.2, 0.4)
        ]
        assert size[0] <= size[1] <= size[2], f"variance of the position over 0.4 s: {size}, m^2"

    @law("turning and shifting the start")
    def check_turned(self) -> None:
        here = _asked(self.driven(), _FIRST + _END)
        turn, shift = 1.1, np.array([-3.0, 8.0])
        matrix = np.eye(6)
        matrix[:2, :2] = plane_turn(turn)
        start = np.array([*(matrix[:2, :2] @ _START[:2] + shift), _START[2] + turn])
        there = _asked(self.driven(start), _FIRST + _END)
        wanted = matrix @ here.mean + np.array([*shift, turn, 0.0, 0.0, 0.0])
        off = there.mean - wanted
        off[2] = np.angle(np.exp(1j * off[2]))
        assert np.abs(off).max() < 1e-4, f"the turned estimate is {np.abs(off).max():.3g} off"
        spread = matrix @ here.covariance @ matrix.T
        error = np.abs(there.covariance - spread).max() / np.abs(spread).max()
        assert error < 0.01, f"the covariance does not turn with the start: {error:.3g} of it"

    @law("same estimates after reset")
    def check_repeats(self) -> None:
        first = _asked(self.driven(), _FIRST + _END)
        self.check_odd()
        _same(first, _asked(self.driven(), _FIRST + _END), "reset after a bad day")


def _driven(time: float) -> float:
    """Return the integral of the pace of a drive, s."""
    since = max(time - _REST, 0.0)
    return since**2 / (2.0 * _RAMP) if since < _RAMP else since - 0.5 * _RAMP


def _arc(time: float) -> tuple[Array, float]:
    """Return the exact pose, (3,), and the way, m: speed and yaw rate stay in proportion."""
    way, turn = _SPEED * _driven(time), _RATE * _driven(time)
    radius, heading = _SPEED / _RATE, _START[2]
    x = _START[0] + radius * (sin(heading + turn) - sin(heading))
    y = _START[1] - radius * (cos(heading + turn) - cos(heading))
    return np.array([x, y, heading + turn]), way


def _broken(time: float) -> Iterator[Sample]:
    yield WheelSample("wheels", time + 0.001, np.array([0.0, nan, 0.0, 0.0]))
    yield WheelSample("wheels", nan, np.zeros(4))
    yield InertialSample("unit", time + 0.001, nan, np.zeros(2))
    yield InertialSample("unit", time + 0.001, 0.0, np.array([inf, 0.0]))
    yield InertialSample("unit", inf, 0.0, np.zeros(2))


def _time(sample: Sample) -> float:
    return sample.stamp if isinstance(sample, Scan) else sample.time


def _given(estimator: StateEstimator, sample: Sample) -> str:
    with serving("take", f"; wanted a reason, for {sample}"):
        reason = estimator.take(sample)
    assert isinstance(reason, str), f"take returned {reason!r}; wanted a reason, or ''"
    return reason


def _asked(estimator: StateEstimator, time: float) -> MotionEstimate:
    with serving(f"at({time})", "; wanted an estimate with a covariance"):
        found = estimator.at(time)
        return MotionEstimate(found.time, found.mean, found.covariance, found.frame)


def _same(one: MotionEstimate, other: MotionEstimate, what: str) -> None:
    equal = np.array_equal(one.mean, other.mean)
    assert equal and np.array_equal(one.covariance, other.covariance), (
        f"{what} the estimate is another one, by up to {np.abs(one.mean - other.mean).max():.3g}"
    )
