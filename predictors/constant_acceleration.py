"""Constant acceleration, filtered, and forgotten after a while (Singer's model)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.history import FILTERED, gather, measurement_noise
from .core.kalman_filter import AxisModel, filter_axes, roll_out
from .core.pattern_search import fit_numbers

SCALED = ({"acceleration": 1.0, "noise_floor": 1.0},)
"""What `fit` multiplies by powers of one number. The ratios stay: with them free, scenes left
out of the fit were forecast worse, as noise against motion is a matter of each recording."""


@final
@dataclass(frozen=True)
class ConstantAcceleration(Fittable):
    """A Kalman filter on position, velocity and an acceleration that decays.

    da = -a / tau dt + dw,   E[a^2] = sigma^2 per axis in the long run

    so that an acceleration seen now is expected to be exp(-t / tau) of itself t seconds on
    (`singer`). A lasting one, tau much longer than the horizon, is the textbook's constant
    acceleration: on recorded people its mean error over 4.8 s is 0.78 m against 0.44 m with
    the defaults (1.5 m where the newest second difference is taken as it is), because people
    accelerate for a step or two, not for 5 s. With tau far below dT the model is `kalman`
    with acceleration_density 2 sigma^2 tau.

    It starts at the oldest sample used with velocity 0 and acceleration 0 and
    P = blkdiag(R, speed^2 I, sigma^2 I). Missing samples are predicted over. The forecast's
    joint covariance is exact for the model; one sample is enough.

    `fit` scales ``acceleration`` and ``noise_floor`` alike (`fit_numbers`).

    Parameters
    ----------
    acceleration : sigma, m/s^2 per axis.
    time_constant : tau, s.
    speed : m/s per axis, standard deviation of the first velocity.
    noise_floor : m, added in quadrature to the measurement noise.

    Raises
    ------
    WideberthError : a number that is not positive.

    References
    ----------
    R. A. Singer, "Estimating Optimal Tracking Filter Performance for Manned Maneuvering
    Targets", 1970.
    """

    acceleration: float = 0.2
    time_constant: float = 0.3
    speed: float = 1.0
    noise_floor: float = 0.03

    reference: ClassVar[str] = "singer1970estimating"

    def __post_init__(self) -> None:
        for name in ("acceleration", "time_constant", "speed", "noise_floor"):
            positive(f"constant_acceleration.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy fitted by `fit_numbers`; see `Fittable.fit`."""
        return fit_numbers(self, SCALED, dataset)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=FILTERED)
        noise = measurement_noise(tracks, self.noise_floor)
        model = _model(tracks.dt, self.acceleration, self.time_constant, self.speed)
        filtered = filter_axes(past, noise, model)
        return roll_out(filtered, model, past, tracks, steps, "constant_acceleration")


@lru_cache(maxsize=16)
def _model(dt: float, acceleration: float, time_constant: float, speed: float) -> AxisModel:
    """Return the model of an axis, the same object for the same numbers."""
    start = np.array([speed**2, acceleration**2])
    return AxisModel(*singer(dt, acceleration, time_constant), start)


def singer(dt: float, acceleration: float, time_constant: float) -> tuple[Array, Array]:
    """Transition and process covariance of (p, v, a) of one axis, (3, 3) each.

    f = [[1, dT, c_1(dT)], [0, 1, c_2(dT)], [0, 0, c_3(dT)]],
    q = 2 sigma^2 / tau * integral from 0 to dT of c(t) c(t)' dt,

    with x = t / tau and c(t) = (t^2 phi_2(x), t phi_1(x), exp(-x)), what a unit acceleration
    has done after t. The integral is summed by Gauss and Legendre's rule, a sum of squares:
    positive semi-definite where the textbook's closed form loses all digits (dT << tau).
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    times = 0.5 * dt * (nodes + 1.0)
    effect = _effect(times, time_constant)
    density = 2.0 * acceleration**2 / time_constant
    process = density * 0.5 * dt * (effect * weights) @ effect.T
    transition = np.eye(3)
    transition[0, 1] = dt
    transition[:, 2] = _effect(np.array([dt]), time_constant)[:, 0]
    return transition, np.asarray(process)


def _effect(times: Array, time_constant: float) -> Array:
    """Position, velocity and acceleration after a unit acceleration at time 0, (3, T)."""
    x = times / time_constant
    first = -np.expm1(-x) / x
    # phi_2 = (1 - phi_1) / x cancels for small x; its series 1/2 - x/6 + x^2/24 - ...
    series = 1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x / 720)))
    second = np.where(x < 1e-3, series, (1.0 - first) / x)
    return np.stack([times**2 * second, times * first, np.exp(-x)])
