"""Tracks: observed positions of each obstacle on a uniform time grid."""

from dataclasses import dataclass

import numpy as np

from .arrays import Array, checked, checked_covariance, positive, settle
from .errors import WideberthError


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

    Raises
    ------
    WideberthError : shapes that do not fit, dt or radius not positive, covariance not PSD,
        repeated ids, infinite positions, a velocity without a state covariance.
    """

    positions: Array
    dt: float
    ids: tuple[str, ...]
    radius: Array
    noise: Array
    stamp: float = 0.0
    state_covariance: Array | None = None
    velocity: Array | None = None

    def __post_init__(self) -> None:
        positions = checked(
            "tracks.positions",
            self.positions,
            (None, None, None),
            finite=False,
            reason=": obstacles, samples, coordinates",
        )
        if np.isinf(positions).any():
            raise WideberthError("tracks.positions holds infinity; mark unobserved samples NaN")
        count, _, size = positions.shape
        positive("tracks.dt", self.dt)
        ids = tuple(str(ident) for ident in self.ids)
        if len(ids) != count or len(set(ids)) != count:
            raise WideberthError(
                f"tracks.ids is {list(ids)}; wanted {count} different identities, one per track"
            )
        radius = checked("tracks.radius", self.radius, (count,))
        if (radius < 0).any():
            raise WideberthError(f"tracks.radius holds {radius.min():g}; wanted at least 0 m")
        noise = checked_covariance("tracks.noise", self.noise, (count, size, size))
        settle(self, positions=positions, ids=ids, radius=radius, noise=noise)
        if self.state_covariance is not None:
            shape = (count, 2 * size, 2 * size)
            joint = checked_covariance("tracks.state_covariance", self.state_covariance, shape)
            settle(self, state_covariance=joint)
        if self.velocity is not None:
            if self.state_covariance is None:
                raise WideberthError("tracks.velocity comes alone; state state_covariance as well")
            velocity = checked("tracks.velocity", self.velocity, (count, size))
            settle(self, velocity=velocity)

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

    def select(self, index: list[int]) -> "Tracks":
        """Return the tracks with these indices, in this order."""
        joint, velocity = self.state_covariance, self.velocity
        return Tracks(
            self.positions[index],
            self.dt,
            tuple(self.ids[i] for i in index),
            self.radius[index],
            self.noise[index],
            self.stamp,
            None if joint is None else joint[index],
            None if velocity is None else velocity[index],
        )
