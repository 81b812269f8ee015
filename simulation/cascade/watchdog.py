"""When a robot must not drive on: sensors that are silent, clocks that jump."""

from collections.abc import Iterable

import numpy as np

from ...framework.values.sensing import Sample, Scan


class Watchdog:
    """Says why a robot must stand still; changes with each sample. Times are those of its clock.

    Parameters
    ----------
    sensors : names of those that it needs.
    patience : s, for which a sensor may give nothing that is of use.
    now : s, when all is well.
    """

    def __init__(self, sensors: Iterable[str], patience: float, now: float) -> None:
        self._patience = patience
        self._useful_at = dict.fromkeys(sensors, now)
        self._now = now

    def jumped(self, now: float, passed: float) -> float:
        """Take the clock's time; return by how much it was set, s, 0 where it was not.

        Parameters
        ----------
        now : s.
        passed : s since the last call, by another clock.
        """
        jump = now - self._now - passed
        self._now = now
        if abs(jump) <= self._patience:
            return 0.0
        self._useful_at = {name: time + jump for name, time in self._useful_at.items()}
        return jump

    def note(self, sample: Sample) -> None:
        """Note when a sample came, if it is of use."""
        if sample.sensor in self._useful_at and _useful(sample):
            self._useful_at[sample.sensor] = self._now

    def reason(self) -> str:
        """Return why the robot must stand still; "" if it need not."""
        for name, time in self._useful_at.items():
            if self._now - time > self._patience:
                return f"{name}: nothing of use for more than {self._patience:g} s"
        return ""


def _useful(sample: Sample) -> bool:
    if isinstance(sample, Scan):
        return bool(len(sample.ranges)) and not bool(np.isnan(sample.ranges).all())
    return not sample.flaw
