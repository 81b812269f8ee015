"""The StateEstimator interface: samples of sensors in, the robot's own motion out."""

from abc import ABC, abstractmethod

from .values.arrays import Array
from .values.sensing import MotionEstimate, Sample


class StateEstimator(ABC):
    """Estimates a robot's own pose and velocity from its sensors.

    An estimator's settings are the fields of a dataclass; what it has concluded is its state.
    Laws:

    - `take` never raises because of what a sensor measured: a sample that is of no use (NaN, too
      old, outside the gate) is left out, and the return value says why;
    - `at` changes nothing, whatever time it is asked for;
    - after `reset` it behaves as new.
    """

    @abstractmethod
    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose (3,), m and rad, at rest."""

    @abstractmethod
    def take(self, sample: Sample) -> str:
        """Use a sample; return why it was left out, "" where it was used."""

    @abstractmethod
    def at(self, time: float) -> MotionEstimate:
        """Return the estimate, carried on to a time, s."""
