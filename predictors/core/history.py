"""Clean histories from tracks with gaps."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...framework.values.arrays import Array, BoolArray, all_finite
from ...framework.values.measurements import IntArray as IntArray
from ...framework.values.tracks import Tracks

LONGEST_GAP = 5
"""Missing samples in a row that are bridged by a straight line; what lies before a longer
gap is dropped (at the paper's 2 Hz this is a gap of 3 s)."""

NOISE_FLOOR = 0.01
"""m, standard deviation that the measurement noise has beside what is stated."""
ROUNDING = 1e-12
"""Share of its largest eigenvalue below which another one of a covariance is rounding."""


@dataclass(frozen=True, eq=False)
class Histories:
    """Past positions of all obstacles without gaps, aligned at their newest observed samples.

    Column T - 1 (T is at least 1) is the newest observed sample of each obstacle, whenever
    that was. Columns before ``began`` are not part of the history; they repeat its first
    position, so that velocities there are zero.

    Attributes
    ----------
    origin : (O, D), m, the newest observed position; zeros if there is none.
    positions : (O, T, D), m, relative to `origin`, oldest first, last column 0. Working
        relative to the obstacle keeps all digits however far the world's origin is away.
    observed : (O, T), False where a sample was missing and has been interpolated.
    began : (O,), first column of the history; T where nothing was observed.
    late : (O,), steps between the newest observed sample and the newest row of the tracks.
        A forecast made from this history must drop its first ``late`` steps. 0 where
        nothing was observed.
    """

    origin: Array
    positions: Array
    observed: BoolArray
    began: IntArray
    late: IntArray

    @property
    def samples(self) -> IntArray:
        """Number of observed samples, (O,)."""
        return np.asarray(self.observed.sum(axis=1), dtype=np.int64)

    @property
    def length(self) -> IntArray:
        """Number of samples, filled ones included, (O,)."""
        return np.asarray(self.positions.shape[1] - self.began, dtype=np.int64)

    @property
    def present(self) -> BoolArray:
        """Whether a column belongs to the history, (O, T)."""
        columns = np.arange(self.positions.shape[1])
        return np.asarray(columns >= self.began[:, None], dtype=np.bool_)

    def select(self, index: Any) -> "Histories":
        """Return the histories with these indices, or where this mask is True."""
        return Histories(
            self.origin[index],
            self.positions[index],
            self.observed[index],
            self.began[index],
            self.late[index],
        )


def gather(
    tracks: Tracks, *, length: int | None = None, longest_gap: int = LONGEST_GAP
) -> Histories:
    """Prepare the histories of all obstacles.

    A sample with NaN in any coordinate counts as missing. Gaps between two observed
    samples are filled by linear interpolation, p(t) on the straight line between them.

    Parameters
    ----------
    tracks : as observed.
    length : most grid samples to keep, counted back from the newest observed one.
    longest_gap : gaps of more missing samples than this cut the older part off.
    """
    positions = tracks.positions
    count, rows, size = positions.shape
    kept = rows if length is None else min(rows, length)
    if rows == 0:
        positions, rows, kept = np.full((count, 1, size), np.nan), 1, 1
    recent = positions[:, rows - kept :]
    if all_finite(recent):  # the usual case needs none of what follows
        begin = np.zeros(count, dtype=np.int64)
        everything = np.ones((count, kept), dtype=np.bool_)
        return Histories(recent[:, -1], recent - recent[:, -1:], everything, begin, begin)
    row = np.arange(count)[:, None]
    seen, aligned = _observed(recent), recent
    late = np.zeros(count, dtype=np.int64)
    if not seen[:, -1].all():  # some were not seen at the newest sample
        seen = _observed(positions)
        late = np.where(seen.any(axis=1), np.argmax(seen[:, ::-1], axis=1), rows)
        column = np.arange(rows - kept, rows) - late[:, None]
        seen = np.asarray(seen[row, np.maximum(column, 0)] & (column >= 0), dtype=np.bool_)
        aligned = positions[row, np.maximum(column, 0)]
    origin = np.where(seen[:, -1:], aligned[:, -1], 0.0)
    if (seen[:, 1:] >= seen[:, :-1]).all():  # most are seen ever since the first sample
        began = np.asarray(kept - seen.sum(axis=1), dtype=np.int64)
        relative = aligned - origin[:, None]
        first = relative[row[:, 0], np.minimum(began, kept - 1)]
        first[began == kept] = 0.0
        owner, column = np.nonzero(~seen)
        relative[owner, column] = first[owner]
        late = np.where(began < kept, late, 0)
        return Histories(origin, relative, seen, began, late.astype(np.int64))
    began = _beginning(seen, longest_gap)
    seen = np.asarray(seen & (np.arange(kept) >= began[:, None]), dtype=np.bool_)
    relative = np.where(seen[..., None], aligned - origin[:, None], 0.0)
    if not seen.all():
        relative = _filled(relative, seen)
    late = np.where(began < kept, late, 0)
    return Histories(origin, relative, seen, began, late.astype(np.int64))


def _observed(positions: Array) -> BoolArray:
    """Whether every coordinate of each sample is known, (O, T)."""
    finite = np.isfinite(positions)
    seen = finite[..., 0]
    for axis in range(1, positions.shape[2]):  # NumPy is slow over an axis this short
        seen = seen & finite[..., axis]
    return np.asarray(seen, dtype=np.bool_)


def _neighbours(seen: BoolArray) -> tuple[IntArray, IntArray]:
    """Columns of the last observed sample up to each column and of the next from it on, (O, T).

    -1 and T where there is none.
    """
    columns, count = np.arange(seen.shape[1]), seen.shape[1]
    before = np.maximum.accumulate(np.where(seen, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(seen, columns, count)[:, ::-1], axis=1)[:, ::-1]
    return before.astype(np.int64), after.astype(np.int64)


def _beginning(seen: BoolArray, longest_gap: int) -> IntArray:
    """First column of each history: the oldest sample seen after the newest long gap, (O,)."""
    count = seen.shape[1]
    before, after = _neighbours(seen)
    gap = after - before - 1
    columns = np.arange(count)
    long = ~seen & (gap > longest_gap) & (after < count) & (before >= 0)
    cut = np.max(np.where(long, columns, -1), axis=1)
    usable = seen & (columns > cut[:, None])
    first = np.argmax(usable, axis=1)
    return np.asarray(np.where(usable.any(axis=1), first, count), dtype=np.int64)


def _filled(relative: Array, seen: BoolArray) -> Array:
    """Fill missing samples: linearly between samples, and with the first one before it."""
    count = seen.shape[1]
    before, after = _neighbours(seen)
    after = np.minimum(after, count - 1)
    before = np.where(before < 0, after, before)
    width = np.maximum(after - before, 1)
    share = ((np.arange(count) - before) / width)[..., None]
    row = np.arange(len(seen))[:, None]
    first, second = relative[row, before], relative[row, after]
    return np.asarray(np.where(seen[..., None], relative, first + share * (second - first)))


def floored(noise: Array, floor: float) -> Array:
    """Return covariances of measurements (..., D, D) that are never below ``floor``, m^2.

    R + max(floor^2, 1e-12 tr R) I. Adding (rather than clipping eigenvalues) keeps it smooth and
    turns with the world. The share of the trace is for noise of kilometres, whose smallest
    eigenvalue would be rounding, and perhaps negative.
    """
    trace = noise.trace(axis1=-2, axis2=-1)
    least = np.maximum(floor**2, ROUNDING * trace)[..., None, None]
    return np.asarray(noise + least * np.eye(noise.shape[-1]))


def measurement_noise(tracks: Tracks, floor: float) -> Array:
    """Covariance of one position measurement, never below ``floor``: (O, D, D), m^2.

    `floored` of the noise of the tracks.
    """
    return floored(tracks.noise, floor)


def too_short(past: Histories, needed: int, name: str) -> list[str | None]:
    """Say why a history is too short for a method, or None.

    Parameters
    ----------
    needed : samples it must have, at least half of them observed.
    name : of the method.
    """
    reasons: list[str | None] = [None] * len(past.length)
    for index, (length, seen) in enumerate(zip(past.length, past.samples, strict=True)):
        if length < needed:
            plural = "" if length == 1 else "s"
            reasons[index] = f"{name}: {length} sample{plural}, needs {needed}"
        elif 2 * seen < needed:
            reasons[index] = f"{name}: {seen} of {needed} samples observed"
    return reasons
