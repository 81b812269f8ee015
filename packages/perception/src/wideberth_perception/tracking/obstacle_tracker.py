"""The tracker of the ROS package obstacle_detector, with its numbers."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle

from ..tracker import Tracker
from .motion import checked_instant, in_order, out_of_order

NO_MATCH = -1
"""Index where nothing corresponds."""


@dataclass(frozen=True, eq=False)
class _Track:
    """One obstacle: a filter of (position, rate) on both axes and one of the radius.

    Attributes
    ----------
    predicted, state : (2, 3): row 0 x, y, radius; row 1 their rates (that of the radius is 0).
    covariance : (2, 2), of an axis. spread : m^2, of the radius.
    measured : (3,), x, y, radius, that each step of the loop corrects by.
    """

    ident: str
    predicted: Array
    state: Array
    covariance: Array
    spread: float
    measured: Array
    seen: float


@final
@dataclass(eq=False)
class ObstacleTracker(Tracker):
    """Follows obstacles as the ROS package obstacle_detector does, with its numbers.

    The cost of a sighting for an obstacle is sqrt(dx^2 + dy^2 + dr^2), with r the radius (as
    published; later versions of the package weigh it by the covariance). Each sighting takes the
    cheapest obstacle below ``gate``, each on its own: where several obstacles find the same
    sighting cheapest they are fused, where several sightings find the same obstacle cheapest it
    is split, and the identities are new ones each time. A second sighting near a first one makes
    an obstacle. A loop at ``rate`` carries all filters on and corrects them by the last
    measurement again and again. An obstacle fades ``fade`` s after its last sighting.

    Parameters
    ----------
    gate : m.
    rate : Hz.
    variance, rate_variance : m^2 and (m/s)^2 per step of the loop.
    noise : m^2.
    fade : s.

    Raises
    ------
    WideberthError : a number that is not positive.
    """

    reference: ClassVar[str] = "przybyla2017detection"

    gate: float = 0.3
    rate: float = 100.0
    variance: float = 0.01
    rate_variance: float = 0.1
    noise: float = 1.0
    fade: float = 2.0
    _tracks: list[_Track] = field(init=False, repr=False)
    _loose: Array = field(init=False, repr=False)
    _now: float = field(init=False, repr=False)
    _born: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("gate", "rate", "variance", "rate_variance", "noise", "fade"):
            positive(f"obstacle_tracker.{name}", getattr(self, name))
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks, self._loose = [], np.zeros((0, 3))
        self._now, self._born = -np.inf, 0

    def update(self, sightings: Sightings) -> str:
        """Find correspondences of the sightings of a scan; see `Tracker.update`."""
        note, anew = out_of_order(sightings.time, self._now, self.fade)
        if note and not anew:
            return note
        if anew:
            self._tracks, self._loose = [], np.zeros((0, 3))
        gap = sightings.time - self._now
        self._now = sightings.time
        tracks = [track for track in self._tracks if self._now - track.seen <= self.fade]
        tracks = [self._looped(track, gap) for track in tracks]
        seen = in_order(sightings)
        new = np.column_stack([seen.positions, seen.radius])
        self._tracks, self._loose = self._corresponding(tracks, new)
        return note

    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the obstacles that have not faded; see `Tracker.at`."""
        checked_instant(time)
        if not self._tracks:
            return ()
        dt, found = time - self._now, []
        moved = np.array([[1.0, dt], [0.0, 1.0]])
        growth = abs(dt) * self.rate * np.diag([self.variance, self.rate_variance])
        for track in self._tracks:
            if time - track.seen > self.fade:
                continue
            axis = moved @ track.covariance @ moved.T + growth
            state = (moved @ track.state[:, :2]).ravel()
            radius = max(float(track.state[0, 2]), 0.0)
            spread = np.asarray(np.kron(0.5 * (axis + axis.T), np.eye(2)), dtype=np.float64)
            found.append(TrackedObstacle(track.ident, time, state, spread, radius, track.seen))
        return tuple(found)

    def _corresponding(self, tracks: list[_Track], new: Array) -> tuple[list[_Track], Array]:
        """Return the tracks after a scan, and the sightings that belong to none."""
        old = np.reshape([track.state[0] for track in tracks], (-1, 3))
        before = np.concatenate([old, self._loose])
        cost = np.linalg.norm(new[:, None] - before[None], axis=2)
        mine, theirs = _cheapest(cost, self.gate), _cheapest(cost.T, self.gate)
        used_old: set[int] = set()
        used_new: set[int] = set()
        made: list[_Track] = []
        for index in range(len(new)):
            fused = [row for row in range(len(tracks)) if theirs[row] == index]
            if len(fused) > 1:
                made.append(self._fused([tracks[row] for row in fused], new[index]))
                used_old |= {*fused}
                used_new.add(index)
        for row in range(len(tracks)):
            split = [k for k in range(len(new)) if mine[k] == row and k not in used_new]
            if len(split) > 1 and row not in used_old:
                rates = tracks[row].state[1, :2]
                made += [self._begun(new[k], rates, new[k]) for k in split]
                used_old.add(row)
                used_new |= {*split}
        kept = {row: track for row, track in enumerate(tracks) if row not in used_old}
        loose = []
        for index in sorted({*range(len(new))} - used_new):
            row = int(mine[index])
            if row == NO_MATCH:
                loose.append(new[index])
            elif row >= len(tracks):
                made.append(self._begun(before[row], np.zeros(2), new[index]))
            elif row in kept:
                again = replace(kept[row], measured=new[index], seen=self._now)
                kept[row] = self._corrected(again)
        return [*kept.values(), *made], np.reshape(loose, (-1, 3))

    def _begun(self, place: Array, rates: Array, measured: Array) -> _Track:
        """Return a new obstacle, corrected by a measurement, after a tenth of a second."""
        self._born += 1
        state = np.stack([place, np.append(rates, 0.0)])
        track = _Track(str(self._born), state, state, np.eye(2), 1.0, measured, self._now)
        return self._looped(self._corrected(track), 0.1)

    def _fused(self, tracks: list[_Track], measured: Array) -> _Track:
        """Return one obstacle in place of several, their mean by their variances."""
        weight = np.array([1.0 / track.covariance[0, 0] for track in tracks])
        state = np.tensordot(weight / weight.sum(), [track.state for track in tracks], 1)
        return self._begun(state[0], state[1, :2], measured)

    def _looped(self, track: _Track, seconds: float) -> _Track:
        """Run the loop, which corrects by the same measurement at each step."""
        moved = np.array([[1.0, 1.0 / self.rate], [0.0, 1.0]])
        process = np.diag([self.variance, self.rate_variance])
        for _ in range(round(min(seconds, self.fade) * self.rate)):
            track = self._corrected(
                replace(
                    track,
                    predicted=moved @ track.state,
                    covariance=moved @ track.covariance @ moved.T + process,
                    spread=track.spread + self.variance,
                )
            )
        return track

    def _corrected(self, track: _Track) -> _Track:
        """Correct what was predicted last by the measurement."""
        gain = track.covariance[:, 0] / (track.covariance[0, 0] + self.noise)
        share = track.spread / (track.spread + self.noise)
        gap = track.measured - track.predicted[0]
        state = track.predicted + np.outer(gain, gap)
        state[0, 2], state[1, 2] = track.predicted[0, 2] + share * gap[2], 0.0
        left = track.covariance - np.outer(gain, track.covariance[0])
        return replace(track, state=state, covariance=left, spread=(1.0 - share) * track.spread)


def _cheapest(cost: Array, gate: float) -> Array:
    """Column of the smallest cost in each row; `NO_MATCH` where none is below the gate."""
    if not cost.shape[1]:
        return np.full(len(cost), NO_MATCH)
    best = cost.argmin(axis=1)
    return np.where(cost[np.arange(len(cost)), best] < gate, best, NO_MATCH)
