"""Forecasts by a process of one time step for tracks of another."""

from collections.abc import Callable
from dataclasses import replace
from math import ceil
from typing import TypeAlias

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.tracks import Tracks
from .assembly import Gaussians
from .history import gather, measurement_noise

SAME_STEP = 0.01
"""Share by which the step of tracks may differ from that of the recordings."""
FARTHEST = 10.0
"""Largest factor between the two steps; beyond it forecasts mean little and cost much."""
ForecastFn: TypeAlias = tuple[Gaussians, list[str | None]]
"""Gaussians of all obstacles, and why each of them cannot be used, or None."""


def at_own_step(
    says: Callable[[Tracks, int], ForecastFn],
    tracks: Tracks,
    steps: int,
    *,
    dt: float | None,
    rows: int,
    noise_floor: float,
    who: str,
) -> ForecastFn:
    """Forecast at the process's own step, and resample the forecast to the tracks' step.

    Histories are read at the process's step back from each obstacle's newest sample, and means
    and covariances at the tracks' steps ahead, on straight lines between two samples or steps,
    as `framework.values.forecast.resample` does. The joint covariance is then not known. Where the
    steps agree within 1 % nothing of this happens; where they differ more than tenfold, no
    obstacle can be served.

    Parameters
    ----------
    says : what the process says of tracks at its own step, so many of its steps ahead.
    tracks, steps : as in `Predictor.predict`.
    dt : s, step of the process; None if it has that of any tracks.
    rows : most samples at its own step that the process looks back.
    noise_floor : m, added in quadrature to the measurement noise of the newest position.
    who : name of the predictor.
    """
    if dt is None or abs(tracks.dt / dt - 1) <= SAME_STEP:
        return says(tracks, steps)
    if not 1 / FARTHEST <= tracks.dt / dt <= FARTHEST:
        own, _ = says(tracks, steps)
        reason = f"{who}: fitted at steps of {dt:g} s, tracks have {tracks.dt:g} s"
        return own, [reason] * len(tracks)
    past = gather(tracks)
    last = past.positions.shape[1] - 1
    count = min(rows, int(last * tracks.dt / dt + 1e-9) + 1)
    place = last - dt / tracks.dt * np.arange(count - 1.0, -1.0, -1.0)
    known = place >= past.began[:, None] - 1e-9
    read = past.origin[:, None] + _between(past.positions, np.broadcast_to(place, known.shape))
    seen = replace(tracks, positions=np.where(known[..., None], read, np.nan), dt=dt)
    late = past.late
    ahead = ceil((steps + int(late.max(initial=0))) * tracks.dt / dt - 1e-9)
    own, missing = says(seen, max(ahead, 1))
    times = tracks.dt / dt * (late[:, None] + np.arange(1.0, steps + 1))
    noise = measurement_noise(tracks, noise_floor)
    mean = np.concatenate([past.origin[:, None], own.mean], axis=1)
    covariance = np.concatenate([noise[:, None], own.covariance], axis=1)
    return Gaussians(_between(mean, times), _between(covariance, times), own.reasons), missing


def _between(values: Array, place: Array) -> Array:
    """Interpolate rows of (O, T, ...) linearly at fractional indices (O, N)."""
    below = np.clip(np.floor(place + 1e-9).astype(np.int64), 0, values.shape[1] - 1)
    above = np.minimum(below + 1, values.shape[1] - 1)
    share = np.clip(place - below, 0.0, 1.0).reshape(*place.shape, *(1,) * (values.ndim - 2))
    row = np.arange(len(values))[:, None]
    return np.asarray((1 - share) * values[row, below] + share * values[row, above])
