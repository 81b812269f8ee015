"""Stages of the cascade that are given the truth: with each, a study removes one error."""

from bisect import bisect_right
from typing import final

import numpy as np

from ...framework.state_estimator import StateEstimator
from ...framework.values.arrays import Array
from ...framework.values.sensing import MotionEstimate, Sample

KEPT = 2.0
"""s for which true poses are remembered."""


@final
class TrueState(StateEstimator):
    """A robot that knows its own pose and velocity exactly."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._means: list[Array] = []

    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose, at rest."""
        self._times, self._means = [time], [np.concatenate([pose, np.zeros(3)])]

    def note(self, time: float, pose: Array, twist: Array) -> None:
        """Take the robot's true pose and twist at a time, s, later than the last one."""
        self._times.append(time)
        self._means.append(np.concatenate([pose, twist]))
        if self._times[0] < time - 2.0 * KEPT:
            first = bisect_right(self._times, time - KEPT)
            del self._times[:first], self._means[:first]

    def take(self, sample: Sample) -> str:
        """Need no sensor."""
        return ""

    def at(self, time: float) -> MotionEstimate:
        """Return the truth, in a straight line between two instants."""
        index = min(max(bisect_right(self._times, time), 1), len(self._times) - 1)
        if len(self._times) == 1:
            return MotionEstimate(self._times[0], self._means[0], np.zeros((6, 6)))
        first, last = self._times[index - 1], self._times[index]
        share = min(max((time - first) / (last - first), 0.0), 1.0) if last > first else 1.0
        change = self._means[index] - self._means[index - 1]
        change[2] = (change[2] + np.pi) % (2.0 * np.pi) - np.pi
        mean = self._means[index - 1] + share * change
        return MotionEstimate(first + share * (last - first), mean, np.zeros((6, 6)))
