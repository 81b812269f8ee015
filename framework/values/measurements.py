"""Measurements of each obstacle, all of them, each at its own time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, BoolArray, altered, assembled, checked, checked_covariance, settle
from .errors import WideberthError

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]

NO_LOG = -1
"""Number of the log of an obstacle whose measurements nothing counts."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """Measurements of obstacles, oldest first, each at the time at which it was made.

    It is built from the times, positions and covariances of the measurements of each obstacle, and
    its fields cannot be replaced one by one.

    Attributes
    ----------
    times : of each obstacle (T,), s, strictly increasing; T may differ and be 0.
    values : of each (T, D + D^2), position, m, and its covariance, m^2, of each measurement.
    size : D.
    log : of each the number of its log. Logs with the same number hold the same measurements up
        to the newest that they share: what keeps a log gives it another number when it begins
        anew, and when a measurement is replaced or inserted. `NO_LOG` compares with nothing.

    Raises
    ------
    WideberthError : lengths that do not fit, times that do not increase, positions that are
        not finite, a covariance that is not PSD.
    """

    times: tuple[Array, ...]
    values: tuple[Array, ...]
    size: int
    log: tuple[int, ...]

    def __init__(
        self,
        times: Sequence[ArrayLike],
        positions: Sequence[ArrayLike],
        noise: Sequence[ArrayLike],
        log: Sequence[int] | None = None,
    ) -> None:
        count = len(times)
        log = (NO_LOG,) * count if log is None else tuple(int(number) for number in log)
        for name, given in {"positions": positions, "noise": noise, "log": log}.items():
            if len(given) != count:
                raise WideberthError(
                    f"measurements.{name} has {len(given)} entries; wanted {count}, one per "
                    "obstacle of measurements.times"
                )
        clocks: list[Array] = []
        values: list[Array] = []
        size = None
        for k, (own, place, spread) in enumerate(zip(times, positions, noise, strict=True)):
            clock = checked(f"measurements.times[{k}]", own, (None,))
            if (np.diff(clock) <= 0).any():
                raise WideberthError(
                    f"measurements.times[{k}] must increase strictly; sort the measurements and "
                    "leave repeated ones out"
                )
            place = checked(f"measurements.positions[{k}]", place, (len(clock), size))
            size = place.shape[1]
            spread = checked_covariance(
                f"measurements.noise[{k}]", spread, (len(clock), size, size)
            )
            clocks.append(clock)
            values.append(np.concatenate([place, spread.reshape(len(clock), size**2)], axis=1))
        settle(self, times=tuple(clocks), values=tuple(values), size=size or 2, log=log)

    def __len__(self) -> int:
        """Count the obstacles."""
        return len(self.times)

    @property
    def positions(self) -> tuple[Array, ...]:
        """Of each obstacle (T, D), m."""
        return tuple(own[:, : self.size] for own in self.values)

    @property
    def noise(self) -> tuple[Array, ...]:
        """Of each obstacle (T, D, D), m^2, covariance of each measurement."""
        shape = -1, self.size, self.size
        return tuple(own[:, self.size :].reshape(shape) for own in self.values)

    @cached_property
    def count(self) -> IntArray:
        """Number of measurements of each obstacle, (O,)."""
        return np.array([len(own) for own in self.times], dtype=np.int64)

    @cached_property
    def newest(self) -> Array:
        """Time of the newest measurement of each obstacle, (O,), s; -inf without any."""
        return np.array([own[-1] if len(own) else -np.inf for own in self.times], dtype=np.float64)

    def select(self, index: list[int]) -> "Measurements":
        """Return the measurements of the obstacles with these indices, in this order."""
        return altered(
            self,
            times=tuple(self.times[i] for i in index),
            values=tuple(self.values[i] for i in index),
            log=tuple(self.log[i] for i in index),
        )

    def part(self, rows: Sequence[slice | BoolArray]) -> "Measurements":
        """Return some measurements of each obstacle, by a slice or a mask of each."""
        return altered(
            self,
            times=tuple(own[some] for own, some in zip(self.times, rows, strict=True)),
            values=tuple(own[some] for own, some in zip(self.values, rows, strict=True)),
        )


class AdmittedMeasurements(Measurements):
    """Measurements within the limits of `wideberth.framework.values.number_limits`, one by one."""


def measurements_on_grid(positions: Array, dt: float, noise: Array) -> Measurements:
    """Return the samples of a uniform grid as measurements; the newest row is at 0 s.

    Parameters
    ----------
    positions : (O, T, D), m, NaN where unobserved. dt : s. noise : (O, D, D), m^2.
    """
    count, rows, size = positions.shape
    grid = -dt * np.arange(rows - 1.0, -1.0, -1.0)
    spread = np.broadcast_to(noise.reshape(count, 1, size**2), (count, rows, size**2))
    values = np.concatenate([positions, spread], axis=2)
    every = assembled(
        Measurements,
        times=(grid,) * count,
        values=tuple(values),
        size=size,
        log=(NO_LOG,) * count,
    )
    seen = np.asarray(np.isfinite(positions).all(axis=2), dtype=np.bool_)
    return every if seen.all() else every.part([slice(None) if row.all() else row for row in seen])
