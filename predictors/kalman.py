"""A Kalman filter with a constant-velocity model."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Literal, Self, final

import numpy as np

from ..framework.plugins.extras import check_extra
from ..framework.predictor import Fittable
from ..framework.values.arrays import Array, checked_choice, positive, whole
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.history import Histories, gather, measurement_noise
from .core.kalman_filter import AxisModel, Filtered, filter_axes, on_all_axes, roll_out, started
from .core.pattern_search import fit_numbers
from .core.propagation import white_acceleration

SCALED = ({"acceleration_density": 1.0, "noise_floor": 0.5},)
"""What `fit` multiplies by powers of one number. The ratios stay: with them free, scenes left
out of the fit were forecast worse, as noise against motion is a matter of each recording."""


@final
@dataclass(frozen=True)
class Kalman(Fittable):
    """A Kalman filter on position and velocity, rolled out over the horizon.

    s_{k+1} = F s_k + w,  w ~ N(0, Q);   z_k = p_k + e,  e ~ N(0, R)

    with F and Q of `white_acceleration` (white acceleration of density q) and R the
    tracks' measurement noise plus ``noise_floor``^2 I. It starts at the oldest sample used
    with velocity 0 and P = blkdiag(R, speed^2 I). Missing samples are predicted over, not
    interpolated. The forecast's joint covariance is exact for this model:
    Cov(s_j, s_h) = F^(j-h) P_h. A tracker's ``state_covariance`` takes the place of the
    filter's own where there is one, and so does its velocity (see `roll_out`).

    One sample is enough: the forecast then stays and spreads with ``speed``.

    It works unfitted. `fit` scales ``acceleration_density`` and ``noise_floor``^2 alike, so that
    forecasts of recorded windows are likeliest (`fit_numbers`).

    Parameters
    ----------
    acceleration_density : q, m^2/s^3. On recorded people 0.02 (with 1 cm of noise) covers
        88 % on average with a nominal 95 %, with 2 cm 91 %; slow robots on a smooth floor have
        1e-4.
    speed : m/s per axis, standard deviation of the first velocity.
    noise_floor : m, standard deviation that the measurement noise has in addition.
    history : grid samples to filter; older ones no longer matter to the state.
    backend : "batched" filters all obstacles at once with NumPy; "filterpy" one after the
        other with the library, for reference: the same to rounding, and slow.

    Raises
    ------
    WideberthError : a number that is not positive, or an unknown backend.

    References
    ----------
    R. Labbe, "Kalman and Bayesian Filters in Python" (the book of filterpy).
    """

    acceleration_density: float = 0.02
    speed: float = 1.0
    noise_floor: float = 0.01
    history: int = 40
    backend: Literal["batched", "filterpy"] = "batched"

    reference: ClassVar[str] = "labbe2014kalman"

    def __post_init__(self) -> None:
        for name in ("acceleration_density", "speed", "noise_floor"):
            positive(f"kalman.{name}", getattr(self, name))
        whole("kalman.history", self.history)
        checked_choice("kalman.backend", self.backend, Literal["batched", "filterpy"])
        if self.backend == "filterpy":
            check_extra("filterpy", "oracles", "the backend filterpy needs that library")

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=self.history)
        noise = measurement_noise(tracks, self.noise_floor)
        model = self.model(tracks.dt)
        engine = filter_axes if self.backend == "batched" else filter_one_by_one
        return roll_out(engine(past, noise, model), model, past, tracks, steps, "kalman")

    def model(self, dt: float) -> AxisModel:
        """Return how an axis moves in steps of ``dt`` s, the same object for the same step."""
        return _model(dt, self.acceleration_density, self.speed)

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy with both numbers scaled by `fit_numbers`; see `Fittable.fit`."""
        return fit_numbers(self, SCALED, dataset)


@lru_cache(maxsize=16)
def _model(dt: float, density: float, speed: float) -> AxisModel:
    """Return the model of an axis, the same object for the same numbers."""
    return AxisModel(*white_acceleration(dt, density, 1), np.array([speed**2]))


def filter_one_by_one(past: Histories, noise: Array, model: AxisModel) -> Filtered:
    """Compute `filter_axes` with filterpy, one obstacle and one sample at a time."""
    from filterpy.kalman import KalmanFilter

    count, rows, size = past.positions.shape
    order = len(model.transition)
    state = np.zeros((count, order * size))
    covariance = started(noise, model)
    for i in range(count):
        first = min(int(past.began[i]), rows - 1)
        engine = KalmanFilter(dim_x=order * size, dim_z=size)
        engine.F = on_all_axes(model.transition, size)
        engine.Q = on_all_axes(model.process, size)
        engine.H, engine.R = np.eye(size, order * size), noise[i]
        engine.x, engine.P = state[i], covariance[i]
        engine.x[:size] = past.positions[i, first] if rows else 0.0
        for column in range(first + 1, rows):
            engine.predict()
            if past.observed[i, column]:
                engine.update(past.positions[i, column])
        state[i], covariance[i] = engine.x, 0.5 * (engine.P + engine.P.T)
    return Filtered(state, covariance)
