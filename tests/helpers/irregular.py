"""Tracks of obstacles that are measured at times of their own."""

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.measurements import Measurements
from wideberth.framework.values.tracks import Tracks


def irregular_tracks(
    count: int,
    size: int,
    *,
    number: int = 14,
    dt: float = 0.4,
    seed: int = 0,
    pauses: bool = False,
    far: float = 0.0,
    latest: float = 0.0,
    stamp: float = 100.0,
) -> Tracks:
    """Return random walks measured at irregular times, each time with a covariance of its own.

    Parameters
    ----------
    count, size : O and D.
    number : of measurements; obstacle k has k % 4 fewer.
    dt : s, of the grid.
    pauses : whether every third obstacle has a pause of 7 steps.
    far : m, of the world's origin.
    latest : s before ``stamp`` at which the last obstacle is measured last.
    """
    rng = np.random.default_rng(seed)
    times, places, noise = [], [], []
    for k in range(count):
        lags = dt * rng.uniform(0.05, 3.4, number - k % 4)
        if pauses and k % 3 == 0:
            lags[len(lags) // 2] = 7.0 * dt
        end = stamp - latest * (k + 1) / count
        since = np.cumsum(lags)
        times.append(end + (since - since[-1]))
        places.append(far + np.cumsum(0.3 * rng.standard_normal((len(lags), size)), axis=0))
        root = 0.05 * (np.eye(size) + 0.4 * rng.standard_normal((len(lags), size, size)))
        noise.append(root @ root.swapaxes(1, 2))
    grid = stamp - dt * np.arange(29.0, -1.0, -1.0)
    return Tracks(
        np.stack([_on_grid(grid, *pair) for pair in zip(times, places, strict=True)]),
        dt,
        tuple(f"o{k}" for k in range(count)),
        np.full(count, 0.3),
        np.stack([spread[-1] for spread in noise]),
        stamp,
        sightings=Measurements(times, places, noise, range(10, 10 + count)),
    )


def _on_grid(grid: Array, times: Array, places: Array) -> Array:
    """Return the places at the times of a grid; NaN beyond the measurements."""
    rows = [np.interp(grid, times, axis, left=np.nan, right=np.nan) for axis in places.T]
    return np.stack(rows, axis=1)
