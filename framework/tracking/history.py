"""History: gathers detections by identity and lays them onto a uniform time grid."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np

from ..robot import Robot
from ..values.arrays import FARTHEST, Array, all_finite, assembled
from ..values.measurements import AdmittedMeasurements
from ..values.motion import Detection, Observation
from ..values.number_limits import vague_at_most
from ..values.tracks import ON_GRID, Tracks
from .names import FASTEST, Names
from .noise import LENGTH, MEMORY, STRIDE, NoiseEstimate, NoiseEvidence, window_likelihoods
from .resampling import PACE, beside_grid, interpolated
from .stand_ins import OLDEST, LastGood, Sighting, is_sound, sound

MOST = 200
"""Obstacles that are remembered: twice as many as any plan has room for."""
NAMED = 5
"""Detections that are named one by one where they are refused; the others are counted."""
DENSEST = 64
"""Measurements kept per sample of the tracks, so that no clock makes a log grow without bound."""


class _Log(NamedTuple):
    """Measurements of one obstacle, oldest first.

    Attributes
    ----------
    number : of the log, see `Measurements`.
    times : (T,), s.
    values : (T, D + D^2), position, m, and its covariance, m^2, of each measurement. What a sensor
        does not state is estimated when it comes.
    reported : s, when it was reported last.
    radius, covariance, sensor : of the last report.
    fresh : measurements that the estimate of the noise does not know yet.
    looked : whether it knows others.
    motion : velocity, (D,), m/s, and the covariance of position and velocity, (2D, 2D), at the
        newest measurement; None where a sensor reports positions alone.
    """

    number: int
    times: Array
    values: Array
    size: int
    reported: float
    radius: float
    covariance: Array | None
    sensor: str
    fresh: int
    looked: bool
    motion: tuple[Array, Array] | None = None

    @property
    def measured(self) -> float:
        """Time of the newest measurement, s."""
        return float(self.times[-1])

    @property
    def positions(self) -> Array:
        """Measured positions, (T, D), m."""
        return self.values[:, : self.size]

    @property
    def position(self) -> Array:
        """Newest measured position, (D,), m."""
        return np.asarray(self.values[-1, : self.size])

    @classmethod
    def begun(cls, size: int, number: int) -> "_Log":
        """Return one without measurements."""
        values = np.empty((0, size + size**2))
        return cls(number, _NO_TIMES, values, size, -np.inf, 0.0, None, "", 0, looked=False)

    def reported_again(
        self, stamp: float, detection: Detection, clock: "_Clock | None", noise: Array, number: int
    ) -> "_Log":
        """Return the log with a measurement more, and what a detection says beside it.

        Parameters
        ----------
        stamp : s, now.
        detection : of the same obstacle.
        clock : the times with that of the measurement; None where it is left out.
        noise : (D, D), m^2, of the measurement.
        number : of the log where the measurement is not simply appended.
        """
        times, values, fresh, motion = self.times, self.values, self.fresh, self.motion
        if clock is None or clock.place == len(self.times):
            number = self.number
        if clock is not None:
            times, fresh = clock.times, fresh + 1
            measured = np.concatenate([detection.position, noise.ravel()])
            values = clock.inserted(self.values, measured)
            if clock.end == len(self.times):  # the newest one: a motion is past
                motion = None
        velocity, joint = detection.velocity, detection.state_covariance
        moving = motion is not None or velocity is not None
        if moving and times[-1] == stamp - detection.age:  # not of an older one that came late
            motion = None if velocity is None or joint is None else (velocity, joint)
        said = detection.radius, detection.covariance, detection.sensor
        last = max(stamp, self.reported)  # of messages in any order
        return _Log(number, times, values, self.size, last, *said, fresh, self.looked, motion)

    def carried(self, lag: float) -> "_Carried | None":
        """Return where it is ``lag`` s after the newest measurement; None without a motion.

        p + lag v,   F P F',  F = [[I, lag I], [0, I]],   R + lag^2 P_v
        """
        if self.motion is None:
            return None
        velocity, joint = self.motion
        size = len(velocity)
        moved = np.eye(2 * size) + lag * np.eye(2 * size, k=size)
        place = self.positions[-1] + lag * velocity
        return _Carried(place, moved @ joint @ moved.T, lag**2 * joint[size:, size:])


_NO_TIMES, _NO_EVIDENCE = np.empty(0), NoiseEvidence.none()


class _Clock(NamedTuple):
    """Times of a log with one more.

    Attributes
    ----------
    times : (T,), s.
    first : index of the oldest measurement that is kept.
    place, end : the new measurement takes the place of those from ``place`` to ``end`` - 1; where
        both are equal, it is inserted.
    """

    times: Array
    first: int
    place: int
    end: int

    @classmethod
    def advanced(cls, times: Array, time: float, keep: float, dt: float) -> "_Clock | None":
        """Add a time, and leave out those over ``keep`` s before it.

        It takes the last one's place where it is the same to `ON_GRID` steps of ``dt``, or less
        than dt / `DENSEST` after the last but one. One that came late is inserted, unless it is
        too old or less than that from another one: of that there is None.
        """
        count = first = len(times)
        if count and time < times[-1]:
            return cls._late(times, time, keep, dt)
        same = count and time - times[-1] <= ON_GRID * dt
        replaced = same or (count > 1 and time - times[-2] < dt / DENSEST)
        kept = count - int(replaced)
        oldest = time - keep
        if count:  # most who came in lately have no time to leave out
            first = 0 if times[0] >= oldest else min(int(times.searchsorted(oldest)), kept)
        later = np.empty(kept - first + 1)
        later[:-1], later[-1] = times[first:kept], time
        return cls(later, first, kept, count)

    @classmethod
    def _late(cls, times: Array, time: float, keep: float, dt: float) -> "_Clock | None":
        """Add a time before the last one."""
        place = int(times.searchsorted(time))
        if times[place] - time <= ON_GRID * dt:
            return cls(times.copy(), 0, place, place + 1)
        gap = min(times[place] - time, time - times[place - 1] if place else np.inf)
        if gap < dt / DENSEST or time < times[-1] - keep:
            return None
        return cls(np.insert(times, place, time), 0, place, place)

    def inserted(self, values: Array, value: Array) -> Array:
        """Return the values, (T, V), of a log with a new one, (V,), at the new time."""
        before = self.place - self.first
        rows = np.empty((len(self.times), len(value)))
        rows[:before], rows[before] = values[self.first : self.place], value
        rows[before + 1 :] = values[self.end :]
        return rows


class _Carried(NamedTuple):
    """An obstacle shortly after its newest measurement.

    Attributes
    ----------
    position : (D,), m.
    joint : (2D, 2D), covariance of position and velocity.
    wider : (D, D), m^2, by which its place is less known than it was measured.
    """

    position: Array
    joint: Array
    wider: Array


@final
@dataclass(frozen=True, eq=False)
class History:
    """A controller's memory of observed obstacles: a value that `add` replaces.

    Parameters
    ----------
    dt : s, spacing of the tracks it hands out.
    samples : T, their length.
    forget : s after which an obstacle that is no longer reported is dropped. A report of
        something measured longer ago than that is refused.
    gap : s; between two measurements further apart the samples count as unobserved.
    fastest : m/s, speed that no obstacle exceeds, see `Names`.
    logs : measurements of each obstacle.
    evidence : of the noise of each sensor that does not state it.
    names : of the obstacles.
    notes : of the last `add`: which detections were taken as new obstacles, and why.
    number : of the next log.
    """

    dt: float
    samples: int
    forget: float
    gap: float
    fastest: float = FASTEST
    logs: Mapping[str, _Log] = field(default_factory=dict)
    evidence: Mapping[str, NoiseEvidence] = field(default_factory=dict)
    names: Names | None = None
    notes: tuple[str, ...] = ()
    number: int = 0

    @property
    def noise(self) -> dict[str, NoiseEstimate]:
        """The noise of each sensor that does not state it."""
        return {sensor: evidence.estimate for sensor, evidence in self.evidence.items()}

    def known(self, stamp: float) -> dict[str, LastGood]:
        """Return what stands in at a time, s, for an obstacle's numbers of no use, by name.

        Obstacles that `add` drops at that time are not known.
        """
        return {
            name: LastGood(log.radius, log.covariance)
            for name, log in self.logs.items()
            if stamp - log.reported <= self.forget
        }

    def emptied(self) -> "History":
        """Return one that knows nothing."""
        settings = self.dt, self.samples, self.forget, self.gap, self.fastest
        return History(*settings, number=self.number)

    def reported(self, stamp: float) -> frozenset[str]:
        """Return the names of the obstacles that were reported at a time, s."""
        return frozenset(name for name, log in self.logs.items() if log.reported == stamp)

    def add(self, stamp: float, detections: tuple[Detection, ...]) -> "History":
        """Return the history with the detections at ``stamp`` that `admitted` accepts.

        A measurement that came late is inserted at its time, and one of the same time as another
        takes its place. Of more than `MOST` obstacles those are kept that were reported last.
        Obstacles that are always reported together share their times.
        """
        logs, keep = dict(self.logs), self.samples * self.dt + self.gap
        clocks: dict[tuple[int, float], _Clock | None] = {}
        names = self.names or Names(self.fastest)
        recent = [detection for detection in detections if detection.age <= self.forget]
        names, named, notes = names.assigned(stamp, recent, logs)
        for number, (ident, detection) in enumerate(named, self.number):
            log = logs.get(ident) or _Log.begun(len(detection.position), number)
            time, times = stamp - detection.age, log.times
            same = id(times), time
            if same not in clocks:
                clocks[same] = _Clock.advanced(times, time, keep, self.dt)
            noise = detection.covariance
            if noise is None:
                noise = self._estimated(detection.sensor, log.size)
            noise = vague_at_most(noise)
            logs[ident] = log.reported_again(stamp, detection, clocks[same], noise, number)
        gone = [name for name, log in logs.items() if stamp - log.reported > self.forget]
        if len(logs) - len(gone) > MOST:
            oldest_first = sorted(logs, key=lambda name: logs[name].reported)
            gone = oldest_first[: len(logs) - MOST]
        for name in gone:
            del logs[name]
        learnt = _learnt(logs, self.evidence)
        settings = self.dt, self.samples, self.forget, self.gap, self.fastest
        return History(*settings, logs, learnt, names, notes, self.number + len(named))

    def tracks(self) -> Tracks | None:
        """Return tracks that end at the newest measurement; None without any.

        Positions between two measurements are interpolated linearly; an obstacle measured
        before the newest instant has NaN at the end. A measurement with no other one on the far
        side of its nearest instant is carried there, see `beside_grid`; where it shows no motion,
        the noise grows by (`PACE` lag)^2. One whose tracker states a velocity is
        carried to the newest instant where that is at most one sample later: obstacles that
        one tick reports with different ages are then forecast alike. The tracks have velocity
        and state covariance where all obstacles state them, and every measurement as
        `Tracks.sightings`.
        """
        if not self.logs:
            return None
        names = sorted(self.logs)
        logs = [self.logs[name] for name in names]
        times, places = [log.times for log in logs], [log.positions for log in logs]
        newest = max(float(own[-1]) for own in {id(own): own for own in times}.values())
        grid = newest - self.dt * np.arange(self.samples - 1.0, -1.0, -1.0, dtype=np.float64)
        positions = interpolated(times, places, grid, self.gap, ON_GRID * self.dt)
        apart = beside_grid(positions, times, places, grid, self.dt, self.gap)
        stated = [
            self._estimated(log.sensor, log.size) if log.covariance is None else log.covariance
            for log in logs
        ]
        noise = np.concatenate(stated).reshape(len(logs), *stated[0].shape)
        velocity, joint = self._motions(logs, newest, positions, noise, apart)
        if apart.any():
            noise += (PACE * apart[:, None, None]) ** 2 * np.eye(noise.shape[-1])
        return assembled(  # of detections, which were checked one by one
            Tracks,
            positions=positions,
            dt=self.dt,
            ids=tuple(names),
            radius=np.array([log.radius for log in logs]),
            noise=noise,
            stamp=newest,
            state_covariance=joint,
            velocity=velocity,
            sightings=assembled(
                AdmittedMeasurements,
                times=tuple(times),
                values=tuple(log.values for log in logs),
                size=logs[0].size,
                log=tuple(log.number for log in logs),
            ),
        )

    def _motions(
        self, logs: Sequence[_Log], newest: float, positions: Array, noise: Array, apart: Array
    ) -> tuple[Array | None, Array | None]:
        """Carry obstacles to the newest instant in place; return velocities and covariances.

        Velocities are (O, D) and covariances of position and velocity (O, 2D, 2D), where all
        obstacles have them.
        """
        if not any(log.motion for log in logs):
            return None, None
        velocities, joints = [], []
        for row, log in enumerate(logs):
            lag = newest - float(log.times[-1])
            late = lag > ON_GRID * self.dt
            found = log.carried(lag if late and lag <= self.dt else 0.0)
            if found is None or log.motion is None:
                continue
            if late and lag <= self.dt:
                positions[row, -1] = found.position
                noise[row] += found.wider
                apart[row] = 0.0
            velocities.append(log.motion[0])
            joints.append(found.joint)
        if len(joints) < len(logs):
            return None, None
        return np.array(velocities), np.array(joints)

    def _estimated(self, sensor: str, size: int) -> Array:
        """Covariance of a measured position, (D, D), m^2, that a sensor does not state."""
        return self.evidence.get(sensor, _NO_EVIDENCE).estimate.covariance(size)


def _learnt(
    logs: dict[str, _Log], evidence: Mapping[str, NoiseEvidence]
) -> Mapping[str, NoiseEvidence]:
    """Take in the newest windows of measurements whose covariance is not stated.

    The logs that were looked at are replaced in place.
    """
    found: dict[str, list[str]] = {}
    for name, log in logs.items():
        if log.covariance is None:
            ready = found.setdefault(log.sensor, [])
            if log.fresh >= STRIDE and len(log.times) >= LENGTH:
                ready.append(name)
    if not found:
        return evidence
    known = dict(evidence)
    for sensor, names in found.items():
        ready_logs = [logs[name] for name in names]
        windows = [(log.times[-LENGTH:], log.positions[-LENGTH:]) for log in ready_logs]
        likelihood = window_likelihoods(windows)
        samples = sum(min(log.fresh, LENGTH) for log in ready_logs)
        new = sum(not log.looked for log in ready_logs)
        before = known.get(sensor, _NO_EVIDENCE)
        known[sensor] = before.joined(likelihood, samples, new, MEMORY)
        if len(known) > MOST:
            del known[next(name for name in known if name not in found)]
        for name in names:
            logs[name] = logs[name]._replace(fresh=0, looked=True)
    return known


def admitted(
    observation: Observation,
    dimension: int,
    forget: float,
    here: Array | None,
    known: Callable[[], Mapping[str, LastGood]] = dict,
) -> Sighting:
    """Return what a controller can use of all that it sees, and what it cannot use, and why.

    Stand-ins take the place of numbers that are of no use, see `sound`. Refused are detections
    that were measured more than ``forget`` s ago, as if they were no longer reported, and of more
    than `MOST` those farthest from ``here`` (D,) m; without a place to measure from the first ones
    are kept.

    The first word of a note says of what kind it is: warnings are limited by kind.

    ``known`` returns what is remembered, see `History.known`; it is seldom asked for.
    """
    detections, oldest = observation.detections, max(forget, OLDEST)
    reasons: list[str] = []
    placeless: tuple[str, ...] = ()
    if not all(is_sound(one, dimension, oldest) for one in detections):
        detections, reasons, placeless = sound(observation, dimension, known(), here, oldest)
    fitting: list[Detection] = []
    for one in detections:
        if one.age > forget:
            refused = f"detection {one.ident!r} refused:"
            reasons.append(f"{refused} it was measured {one.age:.3g} s ago, at most {forget:g} s")
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
    reasons += _repeated(fitting)
    if len(reasons) > NAMED:
        reasons = [*reasons[:NAMED], f"detections refused: {len(reasons) - NAMED} more"]
    return Sighting(tuple(fitting), reasons, placeless)


def _repeated(detections: Sequence[Detection]) -> list[str]:
    """Say which identities are seen more than once."""
    if len({one.ident for one in detections}) == len(detections):
        return []
    counts = Counter(one.ident for one in detections)
    return [
        f"detection {ident!r} comes {count} times: each is an obstacle of its own"
        for ident, count in counts.items()
        if count > 1
    ]


def viewpoint(robot: Robot, observation: Observation) -> Array | None:
    """Return where a robot is, (D,), m; None where its state is not finite."""
    if not all_finite(observation.state):
        return None
    return robot.pose(tuple(observation.state)).points()
