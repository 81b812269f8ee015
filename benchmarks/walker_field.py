"""Walkers that come and go, for as long as is asked."""

from dataclasses import dataclass, field
from math import pi

import numpy as np

from wideberth.framework.values.arrays import Array


@dataclass
class Field:
    """Walkers on a disc, each with a velocity that sways about its mean as in `CrossingField`.

    dv = -(v - mean) / tau dt + sqrt(q) dW per axis. One that leaves the disc is away for up to
    ``pause`` s and then comes in elsewhere under a new name, aimed at a place nearer the middle.
    """

    rng: np.random.Generator
    walkers: int = 10
    reach: float = 9.0
    radius: float = 0.4
    pace: tuple[float, float] = (0.3, 0.7)
    density: float = 0.01
    tau: float = 5.0
    pause: float = 10.0
    place: Array = field(init=False)
    mean: Array = field(init=False)
    sway: Array = field(init=False)
    away: Array = field(init=False)
    number: Array = field(init=False)

    def __post_init__(self) -> None:
        size = (self.walkers, 2)
        self.place, self.mean, self.sway = np.zeros(size), np.zeros(size), np.zeros(size)
        self.away = self.rng.uniform(0.0, self.pause, self.walkers)
        self.number = np.arange(self.walkers, dtype=np.float64)

    def advance(self, dt: float) -> None:
        """Walk for ``dt`` s."""
        keep = float(np.exp(-dt / self.tau))
        deviation = np.sqrt(0.5 * self.density * self.tau * (1.0 - keep**2))
        self.sway = keep * self.sway + deviation * self.rng.standard_normal(self.sway.shape)
        velocity = self.mean + self.sway
        self.place = self.place + dt * velocity
        was = self.away > 0.0
        self.away = np.maximum(self.away - dt, 0.0)
        for k in np.flatnonzero(was & (self.away == 0.0)):
            self._enter(int(k))
        outwards = (self.place * velocity).sum(axis=1) > 0.0
        gone = (np.linalg.norm(self.place, axis=1) > self.reach) & outwards & (self.away == 0.0)
        self.away[gone] = self.rng.uniform(0.0, self.pause, int(gone.sum()))

    def present(self) -> list[tuple[str, Array, float]]:
        """Name, place (2,) in m and radius of all that are there."""
        return [
            (f"walker {self.number[k]:.0f}", self.place[k], self.radius)
            for k in np.flatnonzero(self.away == 0.0)
        ]

    def gaps(self, place: Array, radius: float) -> Array:
        """Distances between their surfaces and that of a disc, m; infinite for those away."""
        apart = np.linalg.norm(self.place - place, axis=1) - self.radius - radius
        return np.where(self.away == 0.0, apart, np.inf)

    def _enter(self, k: int) -> None:
        angle = self.rng.uniform(-pi, pi)
        rim = self.reach * np.array([np.cos(angle), np.sin(angle)])
        aim = self.rng.uniform(-0.5, 0.5, 2) * self.reach
        ahead = (aim - rim) / np.linalg.norm(aim - rim)
        self.place[k], self.sway[k] = rim, 0.0
        self.mean[k] = self.rng.uniform(*self.pace) * ahead
        self.number[k] = self.number.max() + 1
