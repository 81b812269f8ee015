"""From measurements at any times to tracks on a uniform grid."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..values.arrays import Array, BoolArray, checked, positive, whole
from ..values.errors import WideberthError
from ..values.tracks import ON_GRID, Tracks, resolution
from .noise import estimated_noise

IntArray: TypeAlias = NDArray[np.intp]

MOST_CELLS = 100_000_000
"""Most (track, row) cells of a grid; more means that its step is wrong."""
PACE = 1.0
"""m/s per axis, standard deviation of the velocity of a person who may stand or walk."""


def interpolated(
    times: Sequence[Array], positions: Sequence[Array], grid: Array, bridge: float, slack: float
) -> Array:
    """Positions of obstacles at grid times, (O, G, D), m; NaN where one was not observed.

    p(t) lies on the straight line between the measurements before and after t.

    Parameters
    ----------
    times : of each obstacle (T,), s, increasing; those that share an array are looked up once.
    positions : of each (T, D), m.
    grid : (G,), s.
    bridge : s; grid times inside a longer gap are NaN, and those before the first
        measurement or after the last.
    slack : s; a grid time this close to a measurement takes part as if it were at it.
    """
    clocks = {id(own): own for own in times}
    before, after, share, known = _looked_up(list(clocks.values()), grid, bridge, slack)
    row = {key: row for row, key in enumerate(clocks)}
    rows = [row[id(own)] for own in times]
    if len(clocks) > 1:
        before, after = before.take(rows, axis=0), after.take(rows, axis=0)
        share = share.take(rows, axis=0)
    count = np.array([len(own) for own in times])
    first = (np.cumsum(count) - count)[:, None]
    place = np.concatenate(positions)
    sampled, later = (place.take(first + column, axis=0) for column in (before, after))
    sampled *= 1 - share
    later *= share
    sampled += later
    if not known.all():
        sampled[~known.take(rows, axis=0)] = np.nan
    return np.asarray(sampled)


def beside_grid(
    sampled: Array,
    times: Sequence[Array],
    positions: Sequence[Array],
    grid: Array,
    step: float,
    bridge: float,
) -> Array:
    """Fill grid times without a position in place, from the measurement that is nearest.

    A measurement at t whose nearest grid time g has no position, because no other one lies on the
    far side of g, is carried there. With the nearest measurement t' on its other side that is at
    least half a step and at most ``bridge`` away,

    p(g) = p(t) + (p(t) - p(t')) (g - t) / (t - t'),

    which at most doubles the distance, and p(t) where there is none.

    Parameters
    ----------
    sampled : (O, G, D), m, of `interpolated` with the same other arguments.
    step : s, between grid times.

    Returns
    -------
    apart : (O,), s, by which the newest position misses its grid time where it was not carried
        along a motion; else 0.
    """
    apart = np.zeros(len(times))
    if not np.isnan(sampled).any():
        return apart
    last = len(grid) - 1
    count = np.array([len(own) for own in times])
    first, owner = np.cumsum(count) - count, np.repeat(np.arange(len(times)), count)
    moment, place = np.concatenate(times), np.concatenate(positions)
    column = np.rint((moment - grid[last]) / step).astype(np.int64) + last
    beside = np.flatnonzero(column >= 0)
    beside = beside[np.isnan(sampled[owner[beside], column[beside], 0])]
    if not beside.size:
        return apart
    beside = beside[np.argsort(np.abs(moment[beside] - grid[column[beside]]), kind="stable")]
    cells = owner[beside] * len(grid) + column[beside]
    beside = beside[np.unique(cells, return_index=True)[1]]  # the nearest one of each grid time
    row, off = owner[beside], grid[column[beside]] - moment[beside]
    across = [
        _across(times[o], float(moment[k]), float(after), 0.5 * step, bridge)
        for o, k, after in zip(row.tolist(), beside.tolist(), off.tolist(), strict=True)
    ]
    other = first[row] + np.array(across, dtype=np.int64)
    alone = other < first[row]
    width = np.where(alone, 1.0, moment[beside] - moment[other])
    share = np.where(alone, 0.0, off / width)[:, None]
    sampled[row, column[beside]] = place[beside] + share * (place[beside] - place[other])
    newest = last - np.argmax(np.isfinite(sampled[row, ::-1, 0]), axis=1) == column[beside]
    apart[row[newest & alone]] = np.abs(off[newest & alone])
    return apart


def _across(times: Array, time: float, off: float, least: float, most: float) -> int:
    """Return the index of the nearest time on the other side of one than ``off``; -1 for none.

    Parameters
    ----------
    times : increasing, s. time : one of them. least, most : limits of the distance, s.
    """
    if off > 0.0:
        other = int(times.searchsorted(time - least, "right")) - 1
    else:
        other = int(times.searchsorted(time + least))
    near = 0 <= other < len(times) and 0.0 < abs(times[other] - time) <= most
    return other if near else -1


def _looked_up(
    clocks: Sequence[Array], grid: Array, bridge: float, slack: float
) -> tuple[IntArray, IntArray, Array, BoolArray]:
    """Look grid times up in U lists of times, for `interpolated`.

    Returns
    -------
    before, after : (U, G), measurements between which each grid time lies.
    share : (U, G, 1), of the way from one to the other.
    known : (U, G), whether there is a measurement near enough.
    """
    wanted, count = grid - slack, np.array([len(own) for own in clocks])[:, None]
    after = np.empty((len(clocks), len(grid)), dtype=np.intp)
    for row, own in zip(after, clocks, strict=True):
        row[...] = own.searchsorted(wanted)
    after = np.minimum(after, count - 1)
    before = np.maximum(after - 1, 0)
    clock, first = np.concatenate(clocks), np.cumsum(count)[:, None] - count
    begin, end = clock.take(first + before), clock.take(first + after)
    width = end - begin
    # Cut off before it is divided: a width may be as small as 1e-300.
    since, share = np.minimum(np.maximum(grid - begin, 0.0), width), np.ones(width.shape)
    np.divide(since, width, out=share, where=width > 0)
    oldest, newest = clock.take(first), clock.take(first + count - 1)
    known = (grid >= oldest - slack) & (grid <= newest + slack)
    if (gap := width > bridge + slack).any():
        known &= ~gap | (np.abs(grid - end) <= slack)
    return before, after, share[..., None], known


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
