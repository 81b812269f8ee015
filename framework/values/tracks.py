"""Tracks: observed positions of each obstacle on a uniform time grid."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, checked, checked_covariance, positive, settle
from .errors import WideberthError
from .measurements import Measurements, measurements_on_grid

ON_GRID = 1e-6
"""Steps by which a measurement may miss a grid time and still count as taken at it."""
LONGEST_LAG = 1e6
"""s since a measurement; a longer time counts as that."""


def resolution(dt: float, time: float) -> float:
    """Seconds by which a time may miss another: a clock that counts since 1970 is coarse.

    Parameters
    ----------
    dt : s, step of the tracks. time : s, about which the clock stands.
    """
    return max(ON_GRID * dt, 4.0 * float(np.spacing(abs(time))))


@dataclass(frozen=True, eq=False)
class Tracks:
    """Past positions of all obstacles.

    Attributes
    ----------
    positions : (O, T, D), m, oldest first, NaN where the obstacle was not observed.
    dt : s between samples.
    ids : identity of each obstacle.
    radius : (O,), m.
    noise : (O, D, D), m^2, covariance of one position measurement.
    stamp : s, time of the newest sample.
    state_covariance : (O, 2D, 2D) covariance of position and velocity from a tracker, or
        None if there is none.
    velocity : (O, D), m/s, at the newest observed sample from the same tracker, or None.
    sightings : every measurement at its own time, up to ``stamp``; None where the samples of the
        grid are all that is known, as of a recording. Filters use them, regressions the grid.

    Raises
    ------
    WideberthError : shapes that do not fit, dt or radius not positive, covariance not PSD,
        repeated ids, infinite positions, a velocity without a state covariance, sightings of
        another number of obstacles or dimension or after ``stamp``.
    """

    positions: Array
    dt: float
    ids: tuple[str, ...]
    radius: Array
    noise: Array
    stamp: float
    state_covariance: Array | None
    velocity: Array | None
    sightings: Measurements | None

    def __init__(
        self,
        positions: ArrayLike,
        dt: float,
        ids: Iterable[object],
        radius: ArrayLike,
        noise: ArrayLike,
        stamp: float = 0.0,
        state_covariance: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        sightings: Measurements | None = None,
    ) -> None:
        positions = checked(
            "tracks.positions",
            positions,
            (None, None, None),
            finite=False,
            reason=": obstacles, samples, coordinates",
        )
        if np.isinf(positions).any():
            raise WideberthError("tracks.positions holds infinity; mark unobserved samples NaN")
        count, _, size = positions.shape
        positive("tracks.dt", dt)
        names = tuple(str(ident) for ident in ids)
        if len(names) != count or len(set(names)) != count:
            raise WideberthError(
                f"tracks.ids is {list(names)}; wanted {count} different identities, one per track"
            )
        radius = checked("tracks.radius", radius, (count,))
        if (radius < 0).any():
            raise WideberthError(f"tracks.radius holds {radius.min():g}; wanted at least 0 m")
        noise = checked_covariance("tracks.noise", noise, (count, size, size))
        if state_covariance is not None:
            shape = (count, 2 * size, 2 * size)
            state_covariance = checked_covariance(
                "tracks.state_covariance", state_covariance, shape
            )
        if velocity is not None:
            if state_covariance is None:
                raise WideberthError("tracks.velocity comes alone; state state_covariance as well")
            velocity = checked("tracks.velocity", velocity, (count, size))
        settle(self, positions=positions, dt=dt, ids=names, radius=radius, noise=noise)
        settle(self, stamp=stamp, state_covariance=state_covariance, velocity=velocity)
        settle(self, sightings=sightings)
        if sightings is not None:
            self._check_sightings(sightings)

    def _check_sightings(self, sightings: Measurements) -> None:
        """Refuse sightings that do not belong to these tracks."""
        if len(sightings) != len(self):
            raise WideberthError(
                f"tracks.sightings are of {len(sightings)} obstacles; wanted {len(self)}"
            )
        if len(sightings) and sightings.size != self.dimension:
            raise WideberthError(f"tracks.sightings need {self.dimension} coordinates each")
        if (sightings.newest > self.stamp).any():
            raise WideberthError(
                f"tracks.sightings end at {sightings.newest.max():g} s; wanted none after "
                f"tracks.stamp, {self.stamp:g} s"
            )

    def __repr__(self) -> str:
        """Say who was tracked, for how long, and how much of it was observed."""
        count, samples, size = self.positions.shape
        names = ", ".join(map(repr, self.ids[:5])) + ", ..." * (count > 5)
        words = f"{count} obstacle{'s' * (count != 1)} in {size} dimensions ({names})"
        seen = 100.0 * np.isfinite(self.positions).all(axis=2).mean() if count * samples else 0.0
        words += f", {samples} samples of {self.dt:g} s up to {self.stamp:g} s"
        return f"Tracks({words}, {seen:.0f} % observed)"

    def __len__(self) -> int:
        """Count the obstacles."""
        return len(self.ids)

    @property
    def dimension(self) -> int:
        """D, 2 or 3."""
        return int(self.positions.shape[2])

    @cached_property
    def measured(self) -> Measurements:
        """The sightings, or the observed samples of the grid, at times relative to ``stamp``."""
        if self.sightings is not None:
            return self.sightings
        return measurements_on_grid(self.positions, self.dt, self.noise)

    @property
    def clock(self) -> float:
        """Time of the newest row as `measured` counts it, s."""
        return 0.0 if self.sightings is None else self.stamp

    @cached_property
    def lag(self) -> Array:
        """Time since each obstacle was measured last, (O,), s; 0 where it never was.

        What is below the resolution of the clock, or 1e-6 of a step, is 0; `LONGEST_LAG` at most.
        """
        lag = self.clock - self.measured.newest
        least = resolution(self.dt, self.clock)
        return np.where((lag > least) & (lag < np.inf), np.minimum(lag, LONGEST_LAG), 0.0)

    def select(self, index: list[int]) -> "Tracks":
        """Return the tracks with these indices, in this order."""
        joint, velocity, sightings = self.state_covariance, self.velocity, self.sightings
        return Tracks(
            self.positions[index],
            self.dt,
            tuple(self.ids[i] for i in index),
            self.radius[index],
            self.noise[index],
            self.stamp,
            None if joint is None else joint[index],
            None if velocity is None else velocity[index],
            None if sightings is None else sightings.select(index),
        )
