"""Obstacles that stay where they are."""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import Gaussians, finish
from .core.history import NOISE_FLOOR, gather, measurement_noise


@final
@dataclass(frozen=True)
class Static(Predictor):
    """Keeps each obstacle at its newest position, as the paper says of other planners.

    mu_h = p_k,   Cov(p_h, p_j) = R + rate^2 t_h t_j I

    with R the measurement noise plus `NOISE_FLOOR`^2 I and t_h the time since the newest
    observed sample. The spread is that of an unknown constant velocity, N(0, rate^2 I).

    Parameters
    ----------
    spread_rate : m/s per axis. The default 0 is the rivals' assumption (a costmap does not
        grow); about 1 is honest for people.

    Raises
    ------
    WideberthError : a negative number.
    """

    spread_rate: float = 0.0

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        positive("static.spread_rate", self.spread_rate, zero=True)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=1)
        noise = measurement_noise(tracks, NOISE_FLOOR)
        times = tracks.dt * (past.late[:, None] + np.arange(1.0, steps + 1))
        growth = self.spread_rate**2 * np.eye(tracks.dimension)
        covariance = noise[:, None] + times[:, :, None, None] ** 2 * growth
        mean = np.repeat(past.origin[:, None], steps, axis=1)
        joint = partial(_joint, noise, times, growth)
        own = Gaussians(mean, covariance, (None,) * len(tracks), joint)
        return finish(own, past, tracks, "static")


def _joint(noise: Array, times: Array, growth: Array) -> Array:
    """R + rate^2 t_h t_j I for all pairs of steps, (O, N*D, N*D)."""
    count, steps = times.shape
    flat = steps * len(growth)
    blocks = noise[:, None, None] + np.einsum("oh,oj,ab->ohjab", times, times, growth)
    return np.asarray(blocks.swapaxes(2, 3).reshape(count, flat, flat))
