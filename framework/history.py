"""History: gathers detections by identity and lays them onto a uniform time grid."""

import numpy as np

from .arrays import Array
from .motion import Detection
from .noise import LENGTH, MEMORY, STRIDE, NoiseEstimate, NoiseEvidence, window_likelihoods
from .resampling import ON_GRID, interpolated
from .tracks import Tracks

_ROOM = 64
"""Measurements for which a log has room at first."""


class _Log:
    """Measurements of one obstacle, oldest first, in arrays that grow and are moved up."""

    def __init__(self, dimension: int) -> None:
        self.radius, self.reported, self.sensor = 0.0, 0.0, ""
        self.fresh, self.looked = 0, False  # measurements new to the noise's estimate; any old
        self.covariance: Array | None = None
        self._times, self._positions = np.empty(_ROOM), np.empty((_ROOM, dimension))
        self._first = self._end = 0

    @property
    def times(self) -> Array:
        """(T,), s."""
        return self._times[self._first : self._end]

    @property
    def positions(self) -> Array:
        """(T, D), m."""
        return self._positions[self._first : self._end]

    def append(self, time: float, position: Array, oldest: float) -> None:
        """Add a measurement and forget those from before ``oldest``."""
        if self._end == len(self._times):
            kept, room = self._end - self._first, len(self._times)
            bigger = room if 2 * kept <= room else 2 * room
            times, positions = np.empty(bigger), np.empty((bigger, self._positions.shape[1]))
            times[:kept], positions[:kept] = self.times, self.positions
            self._times, self._positions, self._first, self._end = times, positions, 0, kept
        self._times[self._end], self._positions[self._end] = time, position
        self._end += 1
        self._first += int(np.searchsorted(self.times, oldest))
        self.fresh += 1


class History:
    """What a controller remembers of the obstacles that it has seen.

    Parameters
    ----------
    dt : s, spacing of the tracks it hands out.
    samples : T, their length.
    forget : s after which an obstacle that is no longer reported is dropped; a report of
        something measured long ago counts.
    gap : s; between two measurements further apart the samples count as unobserved.
    """

    def __init__(self, dt: float, samples: int, forget: float, gap: float) -> None:
        self._dt, self._samples, self._forget, self._gap = dt, samples, forget, gap
        self._logs: dict[str, _Log] = {}
        self._noise: dict[str, NoiseEvidence] = {}

    @property
    def noise(self) -> dict[str, NoiseEstimate]:
        """The noise of each sensor that does not state it."""
        return {sensor: evidence.estimate for sensor, evidence in self._noise.items()}

    def add(self, stamp: float, detections: tuple[Detection, ...]) -> None:
        """Take in what was seen at ``stamp``; measurements out of order are left out."""
        keep = self._samples * self._dt + self._gap
        for ident, detection in told_apart(detections):
            measured = stamp - detection.age
            log = self._logs.setdefault(ident, _Log(len(detection.position)))
            log.reported = stamp
            log.radius, log.covariance = detection.radius, detection.covariance
            log.sensor = detection.sensor
            if not len(log.times) or measured > log.times[-1]:
                log.append(measured, detection.position, measured - keep)
        gone = [name for name, log in self._logs.items() if stamp - log.reported > self._forget]
        for name in gone:
            del self._logs[name]
        self._learn()

    def _learn(self) -> None:
        """Take in the newest windows of measurements whose covariance is not stated."""
        found: dict[str, list[_Log]] = {}
        for log in self._logs.values():
            if log.covariance is None:
                ready = found.setdefault(log.sensor, [])
                if log.fresh >= STRIDE and len(log.times) >= LENGTH:
                    ready.append(log)
        for sensor, logs in found.items():
            windows = [(log.times[-LENGTH:], log.positions[-LENGTH:]) for log in logs]
            likelihood = window_likelihoods(windows)
            samples = sum(min(log.fresh, LENGTH) for log in logs)
            new = sum(not log.looked for log in logs)
            before = self._noise.get(sensor, NoiseEvidence.none())
            self._noise[sensor] = before.joined(likelihood, samples, new, MEMORY)
            for log in logs:
                log.fresh, log.looked = 0, True

    def tracks(self) -> Tracks | None:
        """Return tracks that end at the newest measurement; None when nothing is known.

        Positions between two measurements are interpolated linearly; an obstacle measured
        before the newest instant has NaN at the end.
        """
        if not self._logs:
            return None
        newest = max(float(log.times[-1]) for log in self._logs.values())
        grid = newest - self._dt * np.arange(self._samples - 1.0, -1.0, -1.0, dtype=np.float64)
        logs = [self._logs[name] for name in sorted(self._logs)]
        return Tracks(
            np.stack([self._sampled(log, grid) for log in logs]),
            self._dt,
            tuple(sorted(self._logs)),
            np.array([log.radius for log in logs]),
            np.stack([self._covariance(log) for log in logs]),
            newest,
        )

    def _covariance(self, log: _Log) -> Array:
        """Covariance of a measured position, (D, D), m^2: stated, else the sensor's estimate."""
        if log.covariance is not None:
            return log.covariance
        return self._noise[log.sensor].estimate.covariance(log.positions.shape[1])

    def _sampled(self, log: _Log, grid: Array) -> Array:
        """Positions of one obstacle on the grid, (T, D), NaN where unobserved."""
        return interpolated(log.times, log.positions, grid, self._gap, ON_GRID * self._dt)


def told_apart(detections: tuple[Detection, ...]) -> list[tuple[str, Detection]]:
    """Give the second detection of one identity a name of its own, so that none is lost."""
    seen: dict[str, int] = {}
    named = []
    for detection in detections:
        count = seen[detection.ident] = seen.get(detection.ident, 0) + 1
        named.append((detection.ident if count == 1 else f"{detection.ident}#{count}", detection))
    return named
