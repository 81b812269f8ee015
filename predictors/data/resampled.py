"""Measurements at any times as tracks on a uniform grid."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ...framework.tracking.noise import estimated_noise
from ...framework.tracking.resampling import MOST_CELLS, PACE, beside_grid, interpolated
from ...framework.values.arrays import Array, checked, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.tracks import ON_GRID, Tracks, resolution


def resampled_tracks(
    measurements: Mapping[str, tuple[ArrayLike, ArrayLike]],
    dt: float,
    *,
    bridge: float = 1.0,
    length: int | None = None,
    radius: float = 0.3,
    noise: float | None = None,
) -> Tracks:
    """Lay measurements that came at any times onto a uniform grid.

    The grid ends at the newest measurement of all obstacles and is theirs in common; an
    obstacle that was last measured before it has NaN at the end, one that came later NaN at
    the start. A measurement with no other one on the far side of its nearest grid time is carried
    there, see `beside_grid`; where it shows no motion, the noise grows by (`PACE` lag)^2.
    Interpolation averages two measurements and so has less noise than one: at most
    by half, which is not counted.

    Parameters
    ----------
    measurements : per identity times, (n,), s, strictly increasing on one clock for all, and
        positions, (n, D), m.
    dt : s between rows.
    bridge : s; positions are interpolated linearly across gaps up to this long, grid times
        inside longer ones are NaN.
    length : rows; by default as many as reach back to the oldest measurement.
    radius : m, given to every obstacle (0.3 m: a person).
    noise : m per axis, standard deviation of a position; by default estimated from the tracks
        that result.

    Raises
    ------
    WideberthError : nothing measured, times that do not increase, positions of another
        number or dimension, not finite, or a grid of more than `MOST_CELLS` cells.

    Examples
    --------
    >>> tracks = resampled_tracks({"a": ([0.0, 0.7, 1.1], [[0, 0], [7, 0], [11, 0]])}, dt=0.5)
    >>> tracks.positions[0, :, 0].round(6).tolist(), tracks.stamp
    ([1.0, 6.0, 11.0], 1.1)
    """
    positive("dt", dt)
    positive("bridge", bridge, zero=True)
    clocks, places = _checked(measurements)
    newest = max(times[-1] for times in clocks)
    oldest = min(times[0] for times in clocks)
    rows = np.floor((newest - oldest) / dt + ON_GRID) + 1 if length is None else length
    if rows * len(clocks) > MOST_CELLS:
        raise WideberthError(
            f"{newest - oldest:g} s in steps of {dt:g} s are {rows:.3g} rows for {len(clocks)} "
            "obstacles; state a larger dt or a length"
        )
    grid = -dt * np.arange(whole("length", int(rows)) - 1.0, -1.0, -1.0, dtype=np.float64)
    slack = resolution(dt, max(abs(newest), abs(oldest)))
    clocks = [times - newest for times in clocks]
    positions = interpolated(clocks, places, grid, bridge, slack)
    apart = beside_grid(positions, clocks, places, grid, dt, bridge)
    count, size = len(clocks), places[0].shape[1]
    deviation = estimated_noise(positions).deviation if noise is None else noise
    variance = deviation**2 + (PACE * apart) ** 2
    spread = variance[:, None, None] * np.tile(np.eye(size), (count, 1, 1))
    return Tracks(
        positions, dt, tuple(measurements), np.full(count, radius), spread, float(newest)
    )


def _checked(
    measurements: Mapping[str, tuple[ArrayLike, ArrayLike]],
) -> tuple[list[Array], list[Array]]:
    """Return times and positions of each obstacle, once they fit each other."""
    clocks: list[Array] = []
    places: list[Array] = []
    for ident, (times, positions) in measurements.items():
        name = f"measurements[{ident!r}]"
        clock = checked(f"{name} times", times, (None,))
        if not len(clock) or (np.diff(clock) <= 0).any():
            raise WideberthError(
                f"{name} times must hold one number at least and increase strictly; sort them "
                "and leave repeated ones out"
            )
        size = places[0].shape[1] if places else None
        clocks.append(clock)
        places.append(checked(f"{name} positions", positions, (len(clock), size)))
    if not clocks:
        raise WideberthError("measurements is empty; wanted one obstacle at least")
    return clocks, places
