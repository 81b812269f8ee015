"""Constant velocity, filtered: as smooth as the measurement noise asks for."""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.arrays import Array, positive, whole
from ..framework.forecast import Forecast, Scene
from ..framework.predictor import Predictor
from ..framework.tracks import Tracks
from .assembly import Gaussians, finish
from .history import Histories, gather, measurement_noise
from .propagation import after, readings, step_covariances, step_joint, white_acceleration


@final
@dataclass(frozen=True)
class Kalman(Predictor):
    """A Kalman filter on position and velocity (filterpy), rolled out over the horizon.

    s_{k+1} = F s_k + w,  w ~ N(0, Q);   z_k = p_k + e,  e ~ N(0, R)

    with F and Q of `white_acceleration` (white acceleration of density q) and R the
    tracks' measurement noise plus ``noise_floor``^2 I. It starts at the oldest sample used
    with velocity 0 and P = blkdiag(R, speed^2 I). Missing samples are predicted over, not
    interpolated. The forecast's joint covariance is exact for this model:
    Cov(s_j, s_h) = F^(j-h) P_h.

    One sample is enough: the forecast then stays and spreads with ``speed``.

    Parameters
    ----------
    acceleration_density : q, m^2/s^3. On recorded people 0.02 (with 1 cm of noise) covers
        89 % on average with a nominal 95 %; slow robots on a smooth floor have 1e-4.
    speed : m/s per axis, standard deviation of the first velocity.
    noise_floor : m.
    history : grid samples to filter; older ones no longer matter to the state.

    Raises
    ------
    WideberthError : a number that is not positive.

    References
    ----------
    R. Labbe, "Kalman and Bayesian Filters in Python" (the book of filterpy).
    """

    acceleration_density: float = 0.02
    speed: float = 1.0
    noise_floor: float = 0.01
    history: int = 40

    reference: ClassVar[str] = "labbe2014kalman"

    def __post_init__(self) -> None:
        for name in ("acceleration_density", "speed", "noise_floor"):
            positive(f"kalman.{name}", getattr(self, name))
        whole("kalman.history", self.history)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        size = tracks.dimension
        past = gather(tracks, length=self.history)
        noise = measurement_noise(tracks, self.noise_floor)
        model = white_acceleration(tracks.dt, self.acceleration_density, size)
        state, start = self._filter(past, noise, model)
        ahead = steps + int(past.late.max(initial=0))
        reads = readings(model[0], size, ahead)
        moved = after(np.einsum("nds,os->ond", reads, state), steps, past.late)
        covariance = after(step_covariances(*model, start, size, ahead), steps, past.late)
        joint = partial(step_joint, *model, start, size, steps, past.late)
        mean = past.origin[:, None] + moved
        own = Gaussians(mean, covariance, (None,) * len(tracks), joint)
        return finish(own, past, tracks, "kalman")

    def _filter(
        self, past: Histories, noise: Array, model: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """States (O, 2D) and covariances (O, 2D, 2D) after the newest observed sample."""
        from filterpy.kalman import KalmanFilter

        count, rows, size = past.positions.shape
        zero = np.zeros((size, size))
        state, covariance = np.zeros((count, 2 * size)), np.zeros((count, 2 * size, 2 * size))
        for i in range(count):
            first = min(int(past.began[i]), rows - 1)
            engine = KalmanFilter(dim_x=2 * size, dim_z=size)
            engine.F, engine.Q = model
            engine.H = np.eye(size, 2 * size)
            engine.R = noise[i]
            engine.x = np.concatenate([past.positions[i, first], np.zeros(size)])
            engine.P = np.block([[noise[i], zero], [zero, self.speed**2 * np.eye(size)]])
            for column in range(first + 1, rows):
                engine.predict()
                if past.observed[i, column]:
                    engine.update(past.positions[i, column])
            state[i], covariance[i] = engine.x, 0.5 * (engine.P + engine.P.T)
        return state, covariance
