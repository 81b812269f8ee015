"""The tracker kf_hungarian of Nav2's dynamic obstacles, with its numbers."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive, whole
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle

from ..tracker import Tracker
from .motion import checked_instant, corrected, in_order, out_of_order

GAP = 1e5
"""s between two scans, about a day, beyond which all tracks are dropped. The package carries them
over any gap, and covariances that were carried over 1e9 s are rounding alone."""


@dataclass(frozen=True, eq=False)
class _Track:
    """One obstacle: its filter at the last scan, and where it was corrected last."""

    ident: str
    state: Array
    covariance: Array
    place: Array
    velocity: Array
    radius: float
    seen: float
    missed: int


@final
@dataclass(eq=False)
class KfHungarian(Tracker):
    """Follows obstacles as the ROS 2 package kf_hungarian_tracker does, with its numbers.

    All sightings are assigned at once by their distance from where each obstacle was corrected
    last (Hungarian algorithm), and pairs at ``gate`` or farther dropped afterwards. The filter
    takes accelerations that are constant within a scan,
    Q = a [[dt^4/4, dt^3/2], [dt^3/2, dt^2]], and a position noise of ``noise`` whatever the
    detector states. An obstacle is there at its first sighting, is dropped after ``missed`` scans
    without one, and is handed on only at a speed between ``slowest`` and ``fastest``: one that
    stands disappears. The package is part of navigation2_dynamic, as of June 2024.

    Parameters
    ----------
    acceleration : a, (m/s^2)^2.
    noise : m^2, R.
    speed : (m/s)^2, variance of the first velocity.
    gate : m.
    missed : scans.
    slowest, fastest : m/s.

    Raises
    ------
    WideberthError : a number that is not positive.
    """

    reference: ClassVar[str] = ""

    acceleration: float = 2.0
    noise: float = 1.0
    speed: float = 10.0
    gate: float = 1.0
    missed: int = 3
    slowest: float = 0.1
    fastest: float = 2.0
    _tracks: list[_Track] = field(init=False, repr=False)
    _now: float = field(init=False, repr=False)
    _born: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("acceleration", "noise", "speed", "gate", "fastest"):
            positive(f"kf_hungarian.{name}", getattr(self, name))
        positive("kf_hungarian.slowest", self.slowest, zero=True)
        whole("kf_hungarian.missed", self.missed)
        import filterpy.kalman  # noqa: F401  # it takes a second, which no scan should

        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks, self._now, self._born = [], -np.inf, 0

    def update(self, sightings: Sightings) -> str:
        """Assign the sightings of a scan; see `Tracker.update`."""
        from scipy.optimize import linear_sum_assignment

        note, anew = out_of_order(sightings.time, self._now, 1.0)
        if note and not anew:
            return note
        dt = sightings.time - self._now
        if anew or dt > GAP:
            self._tracks = []
        self._now = sightings.time
        tracks = [self._predicted(track, dt) for track in self._tracks]
        seen = in_order(sightings)
        places = np.reshape([track.place for track in tracks], (-1, 2))
        cost = np.linalg.norm(places[:, None] - seen.positions[None], axis=2)
        rows, columns = linear_sum_assignment(cost)
        near = cost[rows, columns] < self.gate
        pairs = dict(zip(rows[near].tolist(), columns[near].tolist(), strict=True))
        kept = []
        for row, track in enumerate(tracks):
            if row in pairs:
                kept.append(self._hit(track, seen, pairs[row]))
            elif track.missed + 1 < self.missed:
                kept.append(replace(track, missed=track.missed + 1))
        for index in sorted({*range(len(seen.positions))} - {*pairs.values()}):
            kept.append(self._begun(seen, index))
        self._tracks = kept
        return note

    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the obstacles that move at a speed in between; see `Tracker.at`."""
        checked_instant(time)
        found = []
        for track in self._tracks:
            if self.slowest < float(np.hypot(*track.velocity)) < self.fastest:
                one = self._predicted(track, time - self._now)
                found.append(
                    TrackedObstacle(
                        one.ident, time, one.state, one.covariance, one.radius, one.seen
                    )
                )
        return tuple(found)

    def _predicted(self, track: _Track, dt: float) -> _Track:
        """Return a track a while later."""
        moved = np.eye(4) + dt * np.eye(4, k=2)
        axis = np.array([[dt**4 / 4.0, dt**3 / 2.0], [dt**3 / 2.0, dt**2]])
        grown = moved @ track.covariance @ moved.T
        grown = grown + self.acceleration * np.kron(axis, np.eye(2))
        return replace(track, state=moved @ track.state, covariance=grown)

    def _hit(self, track: _Track, seen: Sightings, index: int) -> _Track:
        """Return a track after a sighting."""
        noise = self.noise * np.eye(2)
        state, covariance = corrected(track.state, track.covariance, seen.positions[index], noise)
        return replace(
            track,
            state=state,
            covariance=covariance,
            place=state[:2],
            velocity=state[2:],
            radius=float(seen.radius[index]),
            seen=float(seen.times[index]),
            missed=0,
        )

    def _begun(self, seen: Sightings, index: int) -> _Track:
        """Return a new track at rest."""
        self._born += 1
        place = seen.positions[index]
        covariance = np.diag([self.noise, self.noise, self.speed, self.speed])
        return _Track(
            ident=str(self._born),
            state=np.concatenate([place, np.zeros(2)]),
            covariance=covariance,
            place=place,
            velocity=np.zeros(2),
            radius=float(seen.radius[index]),
            seen=float(seen.times[index]),
            missed=0,
        )
