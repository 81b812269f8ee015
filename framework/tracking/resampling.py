"""From measurements at any times to tracks on a uniform grid."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..values.arrays import Array, BoolArray

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
