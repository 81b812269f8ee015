"""Obstacles that stay where they are."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.arrays import positive
from ..framework.forecast import Forecast, Scene
from ..framework.predictor import Predictor
from ..framework.tracks import Tracks
from .assembly import Gaussian, assemble, never_observed
from .history import histories, measurement_noise


@final
@dataclass(frozen=True)
class Static(Predictor):
    """The obstacle stays at its newest position: what the paper says other planners assume.

    mu_h = p_k,   Cov(p_h, p_j) = R + rate^2 t_h t_j I

    with R the measurement noise plus ``noise_floor``^2 I and t_h the time since the newest
    observed sample. The spread is that of an unknown constant velocity, N(0, rate^2 I).

    Parameters
    ----------
    spread_rate : m/s per axis. The default 0 is the rivals' assumption (a costmap does not
        grow); about 1 is honest for people.
    noise_floor : m, keeps the covariance above zero for noise-free tracks.

    Raises
    ------
    WideberthError : a negative number.
    """

    spread_rate: float = 0.0
    noise_floor: float = 0.01

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        positive("static.spread_rate", self.spread_rate, zero=True)
        positive("static.noise_floor", self.noise_floor)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        size = tracks.dimension
        noise = measurement_noise(tracks, self.noise_floor)
        parts = []
        for index, past in enumerate(histories(tracks, length=1)):
            if not past.samples:
                parts.append(never_observed("static", steps, size))
                continue
            times = tracks.dt * np.arange(past.late + 1, past.late + steps + 1)
            growth = self.spread_rate**2 * np.eye(size)
            joint = np.kron(np.ones((steps, steps)), noise[index])
            joint += np.kron(np.outer(times, times), growth)
            parts.append(Gaussian.from_joint(np.tile(past.origin, (steps, 1)), joint))
        return assemble(parts, tracks, steps)
