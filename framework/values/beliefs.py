"""Beliefs: what a filter knows of each obstacle after its newest measurement."""

from dataclasses import dataclass

import numpy as np

from .arrays import Array
from .measurements import NO_LOG, IntArray, Measurements


@dataclass(frozen=True, eq=False)
class Beliefs:
    """State of a filter for each obstacle; made by `Filtering.filtered`, and a cache of it.

    Attributes
    ----------
    log : of each obstacle the number of the log that was filtered, see `Measurements`.
    newest : (O,), s, time of the newest measurement used; -inf where there was none.
    count : (O,), measurements used since the filter began with this obstacle.
    values : arrays of the filter's own, with the obstacles on the last axis.
    """

    log: tuple[int, ...]
    newest: Array
    count: IntArray
    values: tuple[Array, ...] = ()

    @classmethod
    def none(cls) -> "Beliefs":
        """Return those of a predictor that does not filter."""
        return cls((), np.empty(0), np.empty(0, dtype=np.int64))

    def __len__(self) -> int:
        """Count the obstacles."""
        return len(self.log)

    def continued(self, sightings: Measurements) -> tuple[list[int], list[int]]:
        """Find these beliefs in newer sightings.

        A belief counts where its log is in the sightings and they hold the newest measurement that
        it used, so that a clock that went back, an identity used again and missed updates end
        alike: that obstacle is filtered from its first measurement on.

        Returns
        -------
        rows : of each obstacle of the sightings its row in these beliefs; -1 where none counts.
        first : of each the index of its first measurement that was not used.
        """
        rows, first, newest = [-1] * len(sightings), [0] * len(sightings), self.newest.tolist()
        place = {log: row for row, log in enumerate(self.log) if log != NO_LOG}
        for k, (log, times) in enumerate(zip(sightings.log, sightings.times, strict=True)):
            row, used = place.get(log, -1), len(times)
            if row < 0 or not used:
                continue
            if times[-1] != newest[row]:  # most have one new measurement
                used -= 1
                if not used or times[used - 1] != newest[row]:
                    used = int(times.searchsorted(newest[row], side="right"))
            if used and times[used - 1] == newest[row]:
                rows[k], first[k] = row, used
        return rows, first

    def resumed(
        self, sightings: Measurements, shapes: tuple[tuple[int, ...], ...]
    ) -> tuple[IntArray, Array, IntArray, tuple[Array, ...]]:
        """Return where a filter goes on in newer sightings.

        Parameters
        ----------
        sightings : of O obstacles.
        shapes : of the filter's own values, without the last axis.

        Returns
        -------
        first : (O,), index of the first measurement of each obstacle that was not used.
        newest, count, values : as in `Beliefs`, of these obstacles; -inf and 0 where none counts.
            Where there is nothing new, ``values`` are those of these beliefs; else copies.
        """
        rows, used = self.continued(sightings)
        first, size = np.array(used, dtype=np.int64), len(rows)
        if size and rows == list(range(len(self))):
            if (first == sightings.count).all():
                return first, self.newest, self.count, self.values
            values = tuple(part.copy() for part in self.values)
            return first, self.newest.copy(), self.count.copy(), values
        index = np.array(rows, dtype=np.int64)
        known = np.flatnonzero(index >= 0)
        newest, count = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)
        values = tuple(np.zeros((*shape, size)) for shape in shapes)
        if known.size:
            index = index[known]
            newest[known], count[known] = self.newest[index], self.count[index]
            for whole, part in zip(values, self.values, strict=True):
                whole[..., known] = part[..., index]
        return first, newest, count, values
