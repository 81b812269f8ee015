"""History: gathers detections by identity and lays them onto a uniform time grid."""

from collections.abc import Sequence

import numpy as np

from ..robot import Robot
from ..values.arrays import FARTHEST, Array
from ..values.motion import Detection, Observation, sound
from ..values.tracks import Tracks
from .noise import LENGTH, MEMORY, STRIDE, NoiseEstimate, NoiseEvidence, window_likelihoods
from .resampling import ON_GRID, interpolated

MOST = 200
"""Obstacles that are remembered: twice as many as any plan has room for."""
NAMED = 5
"""Detections that are named one by one where they are refused; the others are counted."""
DENSEST = 64
"""Measurements kept per sample of the tracks, so that no clock makes a log grow without bound."""
_ROOM = 64
"""Measurements for which a log has room at first."""


class _Log:
    """Measurements of one obstacle, oldest first, in arrays that grow and are moved up."""

    def __init__(self, dimension: int) -> None:
        self.radius, self.reported, self.sensor = 0.0, 0.0, ""
        # Measurements not yet in the estimate of the noise, and whether others are.
        self.fresh, self.looked = 0, False
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

    def append(self, time: float, position: Array, oldest: float, apart: float) -> None:
        """Add a measurement and drop all before ``oldest``.

        One that comes less than ``apart`` s after the last but one takes the last one's place.
        """
        if self._end - self._first > 1 and time - self._times[self._end - 2] < apart:
            self._end -= 1
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
    """A controller's memory of observed obstacles.

    Parameters
    ----------
    dt : s, spacing of the tracks it hands out.
    samples : T, their length.
    forget : s after which an obstacle that is no longer reported is dropped. A report of
        something measured longer ago than that is refused.
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
        """Record the detections at ``stamp`` that `admitted` accepts.

        Measurements out of order are left out. Of more than `MOST` obstacles those are kept that
        were reported last.
        """
        keep = self._samples * self._dt + self._gap
        for ident, detection in named_apart(detections):
            if detection.age > self._forget:
                continue
            measured = stamp - detection.age
            log = self._logs.setdefault(ident, _Log(len(detection.position)))
            log.reported = stamp
            log.radius, log.covariance = detection.radius, detection.covariance
            log.sensor = detection.sensor
            if not len(log.times) or measured > log.times[-1]:
                apart = self._dt / DENSEST
                log.append(measured, detection.position, measured - keep, apart)
        gone = [name for name, log in self._logs.items() if stamp - log.reported > self._forget]
        if len(self._logs) - len(gone) > MOST:
            oldest_first = sorted(self._logs, key=lambda name: self._logs[name].reported)
            gone = oldest_first[: len(self._logs) - MOST]
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
            if len(self._noise) > MOST:
                del self._noise[next(name for name in self._noise if name not in found)]
            for log in logs:
                log.fresh, log.looked = 0, True

    def tracks(self) -> Tracks | None:
        """Return tracks that end at the newest measurement; None without any.

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


def named_apart(detections: Sequence[Detection]) -> list[tuple[str, Detection]]:
    """Give the second detection of one identity a name of its own, so that none is lost."""
    taken = {detection.ident for detection in detections}
    seen: dict[str, int] = {}
    named = []
    for detection in detections:
        name, count = detection.ident, seen.get(detection.ident, 0) + 1
        while count > 1 and (name := f"{detection.ident}#{count}") in taken:
            count += 1
        seen[detection.ident] = count
        taken.add(name)
        named.append((name, detection))
    return named


def admitted(
    observation: Observation, dimension: int, forget: float, here: Array | None
) -> tuple[tuple[Detection, ...], list[str]]:
    """Return the detections that a controller can use, and why it cannot use the others.

    Refused are those that are of no use (`sound`) or larger than `FARTHEST`, those measured more
    than ``forget`` s ago, and of more than `MOST` those farthest from ``here`` (D,) m; without
    a place to measure from the first ones are kept.

    The first word of a reason says of what kind it is: warnings are limited by kind.
    """
    fitting: list[Detection] = []
    detections, reasons = sound(observation, dimension)
    for one in detections:
        refused = f"detection {one.ident!r} refused:"
        if one.age > forget:
            reasons.append(f"{refused} it was measured {one.age:.3g} s ago, at most {forget:g} s")
        elif (coordinate := np.abs(one.position).max()) > FARTHEST:
            reasons.append(f"{refused} it is at {coordinate:.3g} m, at most {FARTHEST:g} m")
        elif one.radius > FARTHEST:
            reasons.append(f"{refused} its radius is {one.radius:.3g} m, at most {FARTHEST:g} m")
        else:
            fitting.append(one)
    if len(fitting) > MOST:
        reasons.append(
            f"detections refused: {len(fitting) - MOST} of {len(fitting)} beyond the nearest"
        )
        if here is not None:
            places = np.array([one.position for one in fitting])
            away = np.linalg.norm(places - np.clip(here, -FARTHEST, FARTHEST), axis=1)
            nearest = np.sort(np.argsort(away, kind="stable")[:MOST])
            fitting = [fitting[int(index)] for index in nearest]
        fitting = fitting[:MOST]
    if len(reasons) > NAMED:
        reasons = [*reasons[:NAMED], f"detections refused: {len(reasons) - NAMED} more"]
    return tuple(fitting), reasons


def viewpoint(robot: Robot, observation: Observation) -> Array | None:
    """Return where a robot is, (D,), m; None where its state is not finite."""
    if not np.isfinite(observation.state).all():
        return None
    return robot.pose(tuple(observation.state)).points()
