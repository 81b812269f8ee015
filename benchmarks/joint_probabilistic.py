"""A tracker by joint probabilistic data association, with the probabilities of Stone Soup."""

from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle
from wideberth_perception.tracker import Tracker
from wideberth_perception.tracking.motion import carried, corrected

EPOCH = datetime(2020, 1, 1)
SURE = 0.5
"""Probability above which a track counts as seen, and a sighting as one of a track."""
INTERLEAVED = [0, 2, 1, 3]
"""Stone Soup's x, rate, y, rate, of ours, and back."""


@dataclass(frozen=True, eq=False)
class _Track:
    """One obstacle at the instant of the last scan."""

    ident: str
    state: Array
    covariance: Array
    radius: float
    seen: float
    lately: tuple[bool, ...] = (True,)
    confirmed: bool = False


@dataclass(eq=False)
class JointProbabilistic(Tracker):
    """Follows obstacles as `nearest` does, but by all likely assignments at once.

    Each track is updated by every sighting within its gate, and the results are mixed by the
    probability that the sighting is of it (JPDA, by loopy belief propagation). Births,
    confirmation and memory are those of `nearest`; shadows are not known here.

    Parameters
    ----------
    acceleration_density, speed, needed, window, memory : those of `nearest`.
    found : probability that an obstacle gives a sighting.
    gate : probability that its sighting is within the gate.
    clutter : sightings of no one per m^2.
    """

    acceleration_density: float = 0.2
    speed: float = 1.0
    needed: int = 3
    window: int = 5
    memory: float = 1.0
    found: float = 0.95
    gate: float = 0.999
    clutter: float = 0.01
    _tracks: list[_Track] = field(init=False, repr=False)
    _now: float = field(init=False, repr=False)
    _born: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._tracks, self._now, self._born = [], -np.inf, 0

    def update(self, sightings: Sightings) -> str:
        """Mix the sightings of a scan into the tracks; scans come in order here."""
        now, before = sightings.time, self._now
        chance = self._probabilities(sightings)
        self._now, tracks = now, []
        for row, track in enumerate(self._tracks):
            updated = self._mixed(track, sightings, chance[row], now - before)
            if self._alive(updated):
                tracks.append(updated)
        for index in np.flatnonzero(chance[:, 1:].sum(axis=0) < SURE):
            tracks.append(self._begun(sightings, int(index)))
        self._tracks = tracks
        return ""

    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the confirmed obstacles; see `Tracker.at`."""
        found = []
        for one in self._tracks:
            if one.confirmed:
                state, spread = carried(
                    one.state, one.covariance, time - self._now, self.acceleration_density
                )
                found.append(TrackedObstacle(one.ident, time, state, spread, one.radius, one.seen))
        return tuple(found)

    def _probabilities(self, seen: Sightings) -> Array:
        """Probability of each sighting for each track, (tracks, 1 + O); the first is of none."""
        count = len(seen.positions)
        chance = np.zeros((len(self._tracks), 1 + count))
        chance[:, 0] = 1.0
        if not self._tracks or not count:
            return chance
        from stonesoup.dataassociator.probability import JPDAwithLBP
        from stonesoup.hypothesiser.probability import PDAHypothesiser
        from stonesoup.models.measurement.linear import LinearGaussian
        from stonesoup.models.transition.linear import (
            CombinedLinearGaussianTransitionModel,
            ConstantVelocity,
        )
        from stonesoup.predictor.kalman import KalmanPredictor
        from stonesoup.types.detection import Detection
        from stonesoup.types.state import GaussianState
        from stonesoup.types.track import Track
        from stonesoup.updater.kalman import KalmanUpdater

        axes = [ConstantVelocity(self.acceleration_density)] * 2
        predictor = KalmanPredictor(CombinedLinearGaussianTransitionModel(axes))
        likely = PDAHypothesiser(
            *(predictor, KalmanUpdater(None), self.clutter, self.found, self.gate)
        )
        tracks: dict[Any, int] = {}
        for row, one in enumerate(self._tracks):
            spread = one.covariance[np.ix_(INTERLEAVED, INTERLEAVED)]
            state = GaussianState(one.state[INTERLEAVED], spread, timestamp=_stamp(self._now))
            tracks[Track([state])] = row
        detections = {
            Detection(
                place,
                timestamp=_stamp(time),
                measurement_model=LinearGaussian(4, (0, 2), spread),
            ): index
            for index, (place, spread, time) in enumerate(
                zip(seen.positions, seen.covariance, seen.times, strict=True)
            )
        }
        found = JPDAwithLBP(likely).associate(set(tracks), set(detections), _stamp(seen.time))
        for track, hypotheses in found.items():
            chance[tracks[track]] = 0.0
            for one in hypotheses:
                column = 1 + detections[one.measurement] if one else 0
                chance[tracks[track], column] = float(one.probability)
        return chance

    def _mixed(self, track: _Track, seen: Sightings, chance: Array, dt: float) -> _Track:
        """Return a track after a scan: the mean and covariance of the mixture."""
        density, before = self.acceleration_density, seen.time - dt
        parts = [carried(track.state, track.covariance, dt, density)]
        weights = [chance[0]]
        for index in np.flatnonzero(chance[1:] > 1e-9):
            time = float(seen.times[index])
            here = carried(track.state, track.covariance, time - before, density)
            here = corrected(*here, seen.positions[index], seen.covariance[index])
            parts.append(carried(*here, seen.time - time, density))
            weights.append(chance[1 + index])
        share = np.array(weights) / np.sum(weights)
        mean = sum(w * state for w, (state, _) in zip(share, parts, strict=True))
        spread = sum(
            w * (covariance + np.outer(state - mean, state - mean))
            for w, (state, covariance) in zip(share, parts, strict=True)
        )
        hit = bool(chance[1:].sum() > SURE)
        lately = (*track.lately, hit)[-self.window :]
        return replace(
            track,
            state=mean,
            covariance=spread,
            lately=lately,
            confirmed=track.confirmed or sum(lately) >= self.needed,
            seen=seen.time if hit else track.seen,
        )

    def _alive(self, track: _Track) -> bool:
        """Return whether a track is kept after a scan."""
        if track.confirmed:
            return self._now - track.seen <= self.memory
        return track.lately[-2:] != (False, False) and len(track.lately) < self.window

    def _begun(self, seen: Sightings, index: int) -> _Track:
        """Return a new track at rest, carried to the end of the scan."""
        self._born += 1
        state = np.concatenate([seen.positions[index], np.zeros(2)])
        spread = np.diag([0.0, 0.0, self.speed**2, self.speed**2])
        spread[:2, :2] = seen.covariance[index]
        lag = seen.time - float(seen.times[index])
        moved = carried(state, spread, lag, self.acceleration_density)
        return _Track(str(self._born), *moved, float(seen.radius[index]), seen.time)


def _stamp(seconds: float) -> datetime:
    return EPOCH + timedelta(seconds=seconds)
