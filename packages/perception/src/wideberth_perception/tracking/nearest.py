"""Global nearest neighbour: the likeliest assignment of sightings to constant-velocity tracks."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple, final

import numpy as np

from wideberth.framework.values.arrays import Array, BoolArray, positive, whole
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle

from ..tracker import Tracker
from .motion import carried, checked_instant, corrected, in_order, out_of_order

FORBIDDEN = 1e6
"""Cost of a pair outside the gate."""
RADII = 20
"""Sightings that a radius is averaged over."""
RAYS, HIDDEN, POINT = 9, 0.7, 0.1
"""Rays over the width of a track, the share of them that hides it, and m around a static point
that hide."""


class _Measured(NamedTuple):
    """A sighting of a track.

    Attributes
    ----------
    scan, time : s, instant of the scan, and when it was measured within it.
    place, noise : (2,), m, and (2, 2), m^2.
    velocity, drift : (2,), m/s, and (2, 2), how the track moved then, and how sure that was.
    """

    scan: float
    time: float
    place: Array
    noise: Array
    velocity: Array
    drift: Array


@dataclass(frozen=True, eq=False)
class _Track:
    """One obstacle, at its newest measurement.

    Attributes
    ----------
    state, covariance : (4,) and (4, 4) at ``time``, s.
    lately : whether it was seen in each of the last scans, newest last.
    hits : sightings so far.
    measured : its sightings, oldest first.
    """

    ident: str
    time: float
    state: Array
    covariance: Array
    radius: float
    lately: tuple[bool, ...]
    hits: int
    confirmed: bool
    measured: tuple[_Measured, ...]


GATE = 13.8
"""Of d^2: lets 99.9 % of the right ones through."""
NEEDED = 3
"""Sightings that confirm a track."""
MEMORY, HIDING = 1.0, 2.0
"""s for which a track is kept after it was seen last, and behind something nearer."""
HISTORY = 10.0
"""s of measurements that are handed on."""
SPEED = 1.0
"""m/s per axis, standard deviation of the first velocity."""


@final
@dataclass(eq=False)
class Nearest(Tracker):
    """Follows obstacles by Kalman filters and the cheapest assignment of each scan to them.

    Each track is carried to the instant of each sighting, straight on under white acceleration.
    With innovation v and its covariance S, all sightings are assigned at once (Hungarian
    algorithm) at the cost

    d^2 + ln det S,   d^2 = v' S^-1 v,   allowed where d^2 < `GATE`

    (minus twice the log likelihood, but for a constant). The filter is updated in Joseph's form.
    A sighting without a track begins one, which is confirmed after `NEEDED` sightings in the
    last ``window`` scans, and dropped after 2 scans without one in a row, or ``window`` scans
    without being confirmed. A confirmed one is kept `MEMORY` s after it was seen last, and
    `HIDING` s where something nearer stands before it.

    Measurements are handed on as of the instant of their scan, which all of them share:
    z + v (T - t) with covariance R + (T - t)^2 P_v. Two obstacles of one scan then have one age.
    What of the errors lasts (`Sightings.lasting`) is added to the covariance of each state.

    Parameters
    ----------
    acceleration_density : q, m^2/s^3. 0.2 suits people who walk and turn; a slow robot has 0.02.
    window : scans of which `NEEDED` confirm a track.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    Blackman and Popoli, "Design and Analysis of Modern Tracking Systems", 1999, chapter 6.
    """

    reference: ClassVar[str] = "blackman1999design"

    acceleration_density: float = 0.2
    window: int = 5
    _tracks: list[_Track] = field(init=False, repr=False)
    _now: float = field(init=False, repr=False)
    _born: int = field(init=False, repr=False)
    _lasting: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positive("nearest.acceleration_density", self.acceleration_density)
        whole("nearest.window", self.window, least=NEEDED)
        import filterpy.kalman  # noqa: F401  # it takes a second, which no scan should

        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks, self._now, self._born = [], -np.inf, 0
        self._lasting = 0.0

    def update(self, sightings: Sightings) -> str:
        """Assign the sightings of a scan; see `Tracker.update`."""
        note, anew = out_of_order(sightings.time, self._now, MEMORY)
        if note and not anew:
            return note
        if anew:
            self._tracks = []
        self._now, self._lasting = sightings.time, sightings.lasting
        # Carried over a long gap a track would be so vague that any sighting fits it.
        held = max(MEMORY, HIDING)
        self._tracks = [one for one in self._tracks if self._now - one.time <= held]
        seen = in_order(sightings)
        pairs = self._assigned(seen)
        shadow = self._shadowed(seen)
        tracks = []
        for row, track in enumerate(self._tracks):
            updated = self._hit(track, seen, pairs[row]) if row in pairs else _missed(track)
            if self._alive(updated, bool(shadow[row])):
                tracks.append(updated)
        for index in sorted({*range(len(seen.positions))} - {*pairs.values()}):
            tracks.append(self._begun(seen, index))
        self._tracks = tracks
        return note

    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the confirmed obstacles; see `Tracker.at`."""
        checked_instant(time)
        found = []
        for track in self._tracks:
            if track.confirmed and time - track.time <= max(MEMORY, HIDING):
                found.append(self._handed(track, time))
        return tuple(found)

    def _assigned(self, seen: Sightings) -> dict[int, int]:
        """Return track -> sighting of the cheapest assignment within the gates."""
        from scipy.optimize import linear_sum_assignment

        if not self._tracks or not len(seen.positions):
            return {}
        cost = np.array([self._costs(track, seen) for track in self._tracks])
        rows, columns = linear_sum_assignment(cost)
        chosen = cost[rows, columns] < FORBIDDEN
        return dict(zip(rows[chosen].tolist(), columns[chosen].tolist(), strict=True))

    def _costs(self, track: _Track, seen: Sightings) -> Array:
        """Cost of each sighting for a track, (O,)."""
        dt = seen.times - track.time
        span, cross = np.abs(dt), track.covariance[:2, 2:] + track.covariance[2:, :2]
        grown = (
            track.covariance[:2, :2]
            + dt[:, None, None] * cross
            + (dt**2)[:, None, None] * track.covariance[2:, 2:]
            + (self.acceleration_density * span**3 / 3.0)[:, None, None] * np.eye(2)
        )
        total = grown + seen.covariance
        gap = seen.positions - track.state[:2] - dt[:, None] * track.state[2:]
        determinant = total[:, 0, 0] * total[:, 1, 1] - total[:, 0, 1] * total[:, 1, 0]
        determinant = np.maximum(determinant, np.finfo(np.float64).tiny)
        square = (
            total[:, 1, 1] * gap[:, 0] ** 2
            - 2.0 * total[:, 0, 1] * gap[:, 0] * gap[:, 1]
            + total[:, 0, 0] * gap[:, 1] ** 2
        ) / determinant
        return np.where(square < GATE, square + np.log(determinant), FORBIDDEN)

    def _shadowed(self, seen: Sightings) -> BoolArray:
        """Return which tracks are hidden, as seen from the sensor, by something nearer.

        It is if `HIDDEN` of the rays over its width meet a nearer body, or pass a nearer static
        point within `POINT`.
        """
        shadow = np.zeros(len(self._tracks), dtype=np.bool_)
        if seen.origin is None:
            return shadow
        points = np.concatenate([seen.positions, seen.static]) - seen.origin
        sizes = np.concatenate([seen.radius, np.full(len(seen.static), POINT)])
        away = np.hypot(points[:, 0], points[:, 1])
        for row, track in enumerate(self._tracks):
            place = track.state[:2] + (self._now - track.time) * track.state[2:] - seen.origin
            distance = max(float(np.hypot(*place)), 1e-9)
            half = np.arcsin(min(track.radius / distance, 1.0))
            angle = np.arctan2(place[1], place[0]) + half * np.linspace(-1.0, 1.0, RAYS)
            unit = np.stack([np.cos(angle), np.sin(angle)])
            aside = np.abs(points[:, :1] * unit[1] - points[:, 1:] * unit[0])
            nearer = (points @ unit > 0.0) & (away < distance - track.radius)[:, None]
            hidden = (nearer & (aside < sizes[:, None])).any(axis=0)
            shadow[row] = bool(hidden.mean() >= HIDDEN)
        return shadow

    def _alive(self, track: _Track, shadowed: bool) -> bool:
        """Return whether a track is kept after a scan."""
        if track.confirmed:
            return self._now - track.time <= (HIDING if shadowed else MEMORY)
        return track.lately[-2:] != (False, False) and len(track.lately) < self.window

    def _begun(self, seen: Sightings, index: int) -> _Track:
        """Return a new track at rest where something was seen for the first time."""
        self._born += 1
        state = np.concatenate([seen.positions[index], np.zeros(2)])
        covariance = np.diag([0.0, 0.0, SPEED**2, SPEED**2])
        covariance[:2, :2] = seen.covariance[index]
        time, radius = float(seen.times[index]), float(seen.radius[index])
        track = _Track(
            str(self._born), time, state, covariance, radius, (), 0, confirmed=False, measured=()
        )
        return self._kept(track, seen, index)

    def _hit(self, track: _Track, seen: Sightings, index: int) -> _Track:
        """Return a track after a sighting."""
        time = float(seen.times[index])
        moved = carried(
            track.state, track.covariance, time - track.time, self.acceleration_density
        )
        state, covariance = corrected(*moved, seen.positions[index], seen.covariance[index])
        weight = 1.0 / min(track.hits + 1, RADII)
        radius = track.radius + weight * (float(seen.radius[index]) - track.radius)
        track = replace(track, time=time, state=state, covariance=covariance, radius=radius)
        return self._kept(track, seen, index)

    def _kept(self, track: _Track, seen: Sightings, index: int) -> _Track:
        """Count a sighting and keep its measurement."""
        lately = (*track.lately, True)[-self.window :]
        confirmed = track.confirmed or sum(lately) >= NEEDED
        motion = track.state[2:], track.covariance[2:, 2:]
        place, noise = seen.positions[index], seen.covariance[index]
        new = _Measured(seen.time, float(seen.times[index]), place, noise, *motion)
        measured = [one for one in track.measured if one.scan >= seen.time - HISTORY]
        if confirmed and not track.confirmed:  # now it is known how it moved all the while
            measured = [_Measured(*one[:4], *motion) for one in measured]
        return replace(
            track,
            lately=lately,
            hits=track.hits + 1,
            confirmed=confirmed,
            measured=(*measured, new),
        )

    def _handed(self, track: _Track, time: float) -> TrackedObstacle:
        """Return what is handed on of a track."""
        dt = time - track.time
        state, covariance = carried(track.state, track.covariance, dt, self.acceleration_density)
        covariance[:2, :2] += self._lasting**2 * np.eye(2)
        scans, times, places, noises, velocities, drifts = map(
            np.array, zip(*track.measured, strict=True)
        )
        late = (scans - times)[:, None]
        return TrackedObstacle(
            ident=track.ident,
            time=time,
            state=state,
            covariance=covariance,
            radius=track.radius,
            seen=track.time,
            times=scans,
            measured=places + late * velocities,
            noise=noises + late[..., None] ** 2 * drifts,
        )


def _missed(track: _Track) -> _Track:
    """Return a track after a scan without it."""
    return replace(track, lately=(*track.lately, False))
