"""Measurements of all obstacles, one round after the other, for filters in NumPy."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.measurements import IntArray, Measurements
from .kalman_filter import MOST_STEPS


class Round(NamedTuple):
    """The next measurement of each obstacle that has one.

    Attributes
    ----------
    rows : (R,), of the obstacles, increasing.
    time : (R,), s, of the measurements.
    lag : (R,), s, since the last one of the same obstacle; inf where the filter begins with it.
    place : (R, D), m. noise : (R, D, D), m^2.
    """

    rows: IntArray
    time: Array
    lag: Array
    place: Array
    noise: Array


def rounds(
    sightings: Measurements, first: IntArray, newest: Array, pause: float
) -> Iterator[Round]:
    """Deal out the measurements that were not used yet, the oldest of each obstacle first.

    Parameters
    ----------
    sightings : of all obstacles.
    first : (O,), index of the first one of each that was not used.
    newest : (O,), s, time of the newest one that was; -inf without any.
    pause : s; after a longer one a filter begins anew.
    """
    number = sightings.count - first
    rows = np.flatnonzero(number)
    if not rows.size:
        return
    begins = list(zip(rows.tolist(), first[rows].tolist(), strict=True))
    times = np.concatenate([sightings.times[row][begin:] for row, begin in begins])
    values = np.concatenate([sightings.values[row][begin:] for row, begin in begins])
    size = sightings.size
    places, noise = values[:, :size], values[:, size:].reshape(-1, size, size)
    number, last = number[rows], newest[rows]
    index = np.cumsum(number) - number
    for _ in range(int(number.max())):
        time = times[index]
        lag = time - last
        lag[lag > pause] = np.inf
        yield Round(rows, time, lag, places[index], noise[index])
        more = number > 1
        rows, index, number, last = rows[more], index[more] + 1, number[more] - 1, time[more]


def in_steps(lag: Array, dt: float) -> Iterator[tuple[IntArray, Array]]:
    """Divide times (O,) > 0 into steps of nearly ``dt`` s; whose next step it is, and how long.

    Longer times than `MOST_STEPS` of them are divided into that many.
    """
    number = np.minimum(np.maximum(np.rint(lag / dt), 1.0), MOST_STEPS)
    times = lag / number
    for done in range(int(number.max(initial=0.0))):
        rows = np.flatnonzero(number > done)
        yield rows, times[rows]
