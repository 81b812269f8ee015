"""Limits on the numbers that predictors compute with, and the treatment of larger ones."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from .arrays import FARTHEST, Array, BoolArray, altered
from .forecast import Scene
from .measurements import AdmittedMeasurements, Measurements
from .tracks import Tracks

LEAP, FASTEST, LONGEST_LEAP = 1e4, 1e3, 1e6
"""m, m/s and m: an obstacle that moves farther than `LEAP` + `FASTEST` t in t seconds, or than
`LONGEST_LEAP` between two samples, counts as another one."""
VAGUEST = 1e6
"""m, largest standard deviation of a measurement (and m/s, of a tracked velocity)."""
FINEST = 1e-30
"""m, below which a coordinate counts as 0; m^2 its square."""
SHORTEST, LONGEST = 1e-6, 1e4
"""s, between two samples."""


@dataclass(frozen=True, eq=False)
class LimitedNumbers:
    """Tracks and scene within the limits.

    Attributes
    ----------
    tracks, scene : with everything beyond the limits replaced.
    reasons : (O,), per obstacle what was beyond them, or None.
    """

    tracks: Tracks
    scene: Scene | None
    reasons: tuple[str | None, ...]


def bounded(tracks: Tracks, scene: Scene | None) -> LimitedNumbers | None:
    """Bring tracks and scene within the limits, or return None where they are.

    Within them velocities are about `LEAP` / `SHORTEST` = 1e10 m/s at most, so that no method
    leaves the range of a float by squares, fourth powers or inverses, nor do the rounding
    errors of the largest number drown the smallest. Beyond them

    - a sample or measurement farther than `FARTHEST` from the origin counts as not observed;
    - so do those before a leap, see `LEAP`;
    - of measurements less than `SHORTEST` apart the last one counts;
    - an eigenvalue of a covariance above `VAGUEST`^2 counts as that much, so that the obstacle
      is still forecast near the place where it was seen;
    - a radius counts as `FARTHEST` at most, and so does a tracked velocity along an axis;
    - what is below `FINEST` counts as 0, without a reason: nothing is that exact;
    - a time step counts as the nearest limit, for all obstacles;
    - a goal of the scene counts as one in the same direction at the limit, its plan or state
      of the robot as unknown.
    """
    limited = _limited(tracks)
    near = None if scene is None else _scene(scene)
    if limited is None and near is scene:
        return None
    if limited is None:
        return LimitedNumbers(tracks, near, (None,) * len(tracks))
    return LimitedNumbers(limited[0], near, limited[1])


@lru_cache(maxsize=8)
def _limited(tracks: Tracks) -> tuple[Tracks, tuple[str | None, ...]] | None:
    """Return tracks within the limits, and the reasons; None where they are.

    Kept for the calls that one decision makes with the same tracks.
    """
    positions, far = _places(tracks.positions)
    positions, leapt = _after_leaps(positions, tracks.dt)
    noise, vague = _spreads(tracks.noise)
    tracker = tracks.state_covariance
    if tracker is not None:
        tracker, drifting = _spreads(tracker)
        vague = vague | drifting
    wide = np.asarray(tracks.radius > FARTHEST, dtype=np.bool_)
    radius = np.minimum(tracks.radius, FARTHEST) if wide.any() else tracks.radius
    dt = min(max(tracks.dt, SHORTEST), LONGEST)
    velocity, fast = _speeds(tracks.velocity, len(tracks))
    sightings, hasty = tracks.sightings, np.zeros(len(tracks), dtype=np.bool_)
    if sightings is not None:
        sightings, faults = _sightings(sightings)
        far, leapt, vague = far | faults[0], leapt | faults[1], vague | faults[2]
        hasty = faults[3]
    new: dict[str, Any] = {
        **{"positions": positions, "noise": noise, "state_covariance": tracker},
        **{"velocity": velocity, "radius": radius, "dt": dt, "sightings": sightings},
    }
    if all(value is getattr(tracks, name) for name, value in new.items()):
        return None
    causes = {
        f"steps of {tracks.dt:.3g} s, taken as {dt:g} s": np.full(len(tracks), dt != tracks.dt),
        f"samples beyond {FARTHEST:g} m, taken as not observed": far,
        f"a leap of more than {LEAP:g} m, taken as a new beginning": leapt,
        f"measurements less than {SHORTEST:g} s apart, the last one taken": hasty,
        f"known to more than {VAGUEST:g} m, taken as that": vague,
        f"a radius above {FARTHEST:g} m, taken as that": wide,
        f"a velocity above {FARTHEST:g} m/s, taken as that": fast,
    }
    reasons = tuple(
        "; ".join(cause for cause, where in causes.items() if where[index]) or None
        for index in range(len(tracks))
    )
    return replace(tracks, **new), reasons


def _sightings(sightings: Measurements) -> tuple[Measurements, BoolArray]:
    """Return sightings within the limits, and which obstacles had others.

    The latter are (4, O): those with measurements too far away, after a leap, too vague, and too
    soon after each other.
    """
    faults: BoolArray = np.zeros((4, len(sightings)), dtype=np.bool_)
    if isinstance(sightings, AdmittedMeasurements) or not len(sightings):
        return sightings, faults
    size = np.abs(np.concatenate(sightings.values))
    places, spreads = size[:, : sightings.size], size[:, sightings.size :]
    soon = [np.append(np.diff(times) < SHORTEST, False)[: len(times)] for times in sightings.times]
    fine = _largest(places) <= 0.25 * LEAP and _largest(spreads) <= VAGUEST**2
    fine &= not any(early.any() for early in soon)
    if fine and not _tiny(places, FINEST) and not _tiny(spreads, FINEST**2):  # the usual case
        return sightings, faults
    kept: list[BoolArray] = []
    values: list[Array] = []
    parts = zip(sightings.times, sightings.positions, sightings.noise, strict=True)
    for row, (times, place, noise) in enumerate(parts):
        far = np.abs(place).max(axis=1, initial=0.0) > FARTHEST
        near = ~(far | soon[row])
        seen = np.flatnonzero(near)
        way = np.linalg.norm(np.diff(place[seen], axis=0), axis=1)
        leap = way > np.minimum(LEAP + FASTEST * np.diff(times[seen]), LONGEST_LEAP)
        if leap.any():
            near[: seen[np.flatnonzero(leap)[-1] + 1]] = False
        spread, vague = _spreads(noise)
        faults[:, row] = far.any(), leap.any(), vague.any(), soon[row].any()
        exact = np.where(np.abs(place) < FINEST, 0.0, place)
        values.append(
            np.concatenate([exact, spread.reshape(len(times), sightings.size**2)], axis=1)
        )
        kept.append(near)
    return altered(sightings, values=tuple(values)).part(kept), faults


def _tiny(size: Array, limit: float) -> bool:
    """Whether any of some numbers of at least 0 is below a limit, but not 0."""
    return bool(((size < limit) & (size > 0)).any())


def _places(positions: Array) -> tuple[Array, BoolArray]:
    """Return samples within the limits, (O, T, D), and which obstacles had others, (O,)."""
    size = np.abs(positions)
    least = np.fmin.reduce(size, axis=None, initial=FINEST)
    if least >= FINEST and _largest(size) <= FARTHEST:  # the usual case
        return positions, np.zeros(len(positions), dtype=np.bool_)
    large, tiny = size > FARTHEST, (size < FINEST) & (size > 0)
    if not large.any() and not tiny.any():
        return positions, np.zeros(len(positions), dtype=np.bool_)
    beyond = np.asarray(large.any(axis=2), dtype=np.bool_)
    far = np.asarray(beyond.any(axis=1), dtype=np.bool_)
    kept = np.where(beyond[:, :, None], np.nan, positions)
    return np.where(tiny, 0.0, kept), far


def _after_leaps(positions: Array, dt: float) -> tuple[Array, BoolArray]:
    """Return the samples from the last leap on, (O, T, D), and which obstacles leapt, (O,)."""
    none_leapt = np.zeros(len(positions), dtype=np.bool_)
    if not _beyond(positions, 0.25 * LEAP):  # the usual case: no room for a leap
        return positions, none_leapt
    columns = np.arange(positions.shape[1])
    seen = np.asarray(np.isfinite(positions).all(axis=2), dtype=np.bool_)
    newest = np.maximum.accumulate(np.where(seen, columns, -1), axis=1)
    before = np.concatenate([np.full((len(seen), 1), -1), newest[:, :-1]], axis=1)
    way = positions - np.take_along_axis(positions, np.maximum(before, 0)[:, :, None], axis=1)
    limit = np.minimum(LEAP + FASTEST * dt * (columns - before), LONGEST_LEAP)
    leap = seen & (before >= 0) & (np.linalg.norm(np.nan_to_num(way), axis=2) > limit)
    leapt = np.asarray(leap.any(axis=1), dtype=np.bool_)
    if not leapt.any():
        return positions, none_leapt
    first = np.where(leap, columns, 0).max(axis=1)
    return np.where((columns < first[:, None])[:, :, None], np.nan, positions), leapt


def vague_at_most(covariance: Array) -> Array:
    """Return a covariance, (S, S), with no eigenvalue above `VAGUEST`^2."""
    if max(covariance.ravel().tolist()) <= VAGUEST**2:  # its largest entry is on the diagonal
        return covariance
    return np.asarray(_spreads(covariance[None])[0][0])


def _spreads(covariance: Array) -> tuple[Array, BoolArray]:
    """Return covariances within the limits, (O, S, S), and which had larger values, (O,)."""
    size = np.abs(covariance)
    tiny = (size < FINEST**2) & (size > 0)
    if _largest(size) <= VAGUEST**2 and not tiny.any():
        return covariance, np.zeros(len(covariance), dtype=np.bool_)
    largest = size.max(axis=(1, 2), initial=0.0)
    vague = np.asarray(largest > VAGUEST**2)
    kept = np.where(tiny, 0.0, covariance)
    if vague.any():
        scale = largest[vague, None, None]
        values, vectors = np.linalg.eigh(kept[vague] / scale)
        most = (1.0 - 1e-12) * VAGUEST**2  # a limit that rounding does not cross a second time
        values = np.clip(values, 0.0, most / scale[..., 0]) * scale[..., 0]
        capped = (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2)
        kept[vague] = 0.5 * (capped + capped.swapaxes(1, 2))
    return kept, vague


def _speeds(velocity: Array | None, count: int) -> tuple[Array | None, BoolArray]:
    """Return velocities within the limits, (O, D), and which were larger, (O,)."""
    if velocity is None or not _beyond(velocity, FARTHEST):
        return velocity, np.zeros(count, dtype=np.bool_)
    fast = np.asarray((np.abs(velocity) > FARTHEST).any(axis=1), dtype=np.bool_)
    return np.clip(velocity, -FARTHEST, FARTHEST), fast


@lru_cache(maxsize=8)
def _scene(scene: Scene) -> Scene:
    """Return the scene within the limits; itself where it is."""
    changes: dict[str, Any] = {}
    if scene.ego is not None and _beyond(scene.ego, FARTHEST):
        changes["ego"] = None
    if scene.plan is not None:
        times = scene.plan_times
        hasty = times is not None and (
            _beyond(times, FARTHEST**2) or bool((np.diff(times) < SHORTEST).any())
        )
        if hasty or _beyond(scene.plan, FARTHEST):
            changes |= {"plan": None, "plan_times": None}
    if scene.goals is not None and _beyond(scene.goals, FARTHEST):
        reach = np.abs(scene.goals).max(axis=1, keepdims=True)
        changes["goals"] = scene.goals * (FARTHEST / np.maximum(reach, FARTHEST))
    if scene.radius > FARTHEST:
        changes["radius"] = FARTHEST
    return replace(scene, **changes) if changes else scene


def _beyond(values: Array, limit: float) -> bool:
    return bool(_largest(np.abs(values)) > limit)


def _largest(size: Array) -> float:
    """Return the largest of some numbers of at least 0; NaN and no number at all count as 0."""
    return float(np.fmax.reduce(size, axis=None, initial=0.0))
