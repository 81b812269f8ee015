"""The StateEstimator interface: samples of sensors in, the robot's own motion out."""

from abc import ABC, abstractmethod

import numpy as np

from wideberth.framework.values.arrays import Array, checked, number
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, MotionEstimate, WheelSample

Sample = Scan | WheelSample | InertialSample
"""Anything that a sensor on the robot reports."""
KNOT = 0.02
"""s. Between instants closer than this a pose is interpolated."""


class StateEstimator(ABC):
    """Estimates a robot's own pose and velocity from its sensors.

    An estimator's settings are the fields of a dataclass; what it has concluded is its state.
    Laws, checked by `wideberth_perception.check_state_estimator`:

    - `take` and `at` before `reset`, and a pose or time of `reset` that is not finite, raise a
      `WideberthError`; nothing else raises, whatever a sensor measured and whatever its clock
      says;
    - a sample that is of no use (NaN, too old, twice, outside the gate, of a sensor that is not
      read) is left out, and the return value of `take` says why; NaN and samples that come twice
      change nothing;
    - `at` changes nothing, whatever time it is asked for;
    - turning and shifting the start turns and shifts the estimates that need no map;
    - while nothing is measured the covariance of the pose does not shrink;
    - after `reset` it behaves as new.
    """

    @abstractmethod
    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose (3,), m and rad, at rest."""

    @abstractmethod
    def take(self, sample: Sample) -> str:
        """Use a sample; return why it, or a part of it, was left out, "" where all was used."""

    @abstractmethod
    def at(self, time: float) -> MotionEstimate:
        """Return the estimate of a time, s, past or to come.

        An estimator forgets, and does not carry an estimate on for ever: the ``time`` of what it
        returns is the nearest one that it can speak of. A caller that acts on the estimate
        compares that time with now.
        """


def checked_start(pose: Array, time: float) -> tuple[Array, float]:
    """Return the arguments of `StateEstimator.reset`.

    Raises
    ------
    WideberthError : a pose that is not three finite numbers, a time that is not finite.
    """
    start = checked("reset: pose", pose, (3,), reason=": x, y in m and heading in rad")
    clock = number("reset: time", time)
    if not np.isfinite(clock):
        raise WideberthError(f"reset: time is {clock}; wanted seconds on the sensors' clock")
    return start, clock


def poses_at(estimator: StateEstimator, times: Array) -> Array:
    """Return the poses at many instants, (B,) s -> (B, 3), m and rad, as of the beams of a scan.

    The estimator is asked every 20 ms at most; between, the pose is interpolated. With 1.5 m/s
    and 1 rad/s that errs by v w dt^2 / 8, less than 0.1 mm.
    """
    if not len(times):
        return np.zeros((0, 3))
    first, last = float(np.min(times)), float(np.max(times))
    knots = np.linspace(first, last, 2 + int((last - first) / KNOT))
    poses = np.array([estimator.at(float(knot)).pose for knot in knots])
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.stack([np.interp(times, knots, poses[:, axis]) for axis in range(3)], axis=1)
