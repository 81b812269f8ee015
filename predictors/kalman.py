"""A Kalman filter with a constant-velocity model."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.values.arrays import Array, positive
from .core.kalman_filter import ModeStep, Motion
from .core.motion_filter import MotionFilter
from .core.pattern_search import Powers
from .core.propagation import white_steps


@final
@dataclass(frozen=True)
class Kalman(MotionFilter):
    """A Kalman filter on position and velocity, rolled out over the horizon.

        s_{k+1} = F s_k + w,  w ~ N(0, Q);   z_k = p_k + e,  e ~ N(0, R)

    with F and Q of white acceleration of density q (`white_acceleration`) and R the
    covariance of a measurement plus ``noise_floor``^2 I. Each measurement is taken at its own
    time. The filter starts at an obstacle's first one, and after a pause of more than 6 steps
    of the tracks, with velocity 0 and P = blkdiag(R, speed^2 I). The forecast's joint covariance
    is exact for this model: Cov(s_j, s_h) = F^(j-h) P_h.

    Where the tracks carry a tracker's ``state_covariance``, their positions are estimates
    that hold all earlier measurements, with errors that are not independent as R takes them
    to be. The newest one is then the position, and the tracker's covariance takes the place
    of the filter's own for position and velocity. The mean of the velocity is the tracker's
    where the tracks carry it, else the filter's.

    One measurement is enough: the forecast then stays and spreads with ``speed``.

    It works unfitted. `fit` scales ``acceleration_density`` and ``noise_floor``^2 alike, so that
    forecasts of recorded windows are likeliest (`fit_numbers`).

    Parameters
    ----------
    acceleration_density : q, m^2/s^3. On recorded people 0.02 (with 1 cm of noise) covers
        88 % on average with a nominal 95 %, with 2 cm 91 %; slow robots on a smooth floor have
        1e-4.
    speed : m/s per axis, standard deviation of the first velocity.
    noise_floor : m, standard deviation that the measurement noise has in addition.

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

    reference: ClassVar[str] = "labbe2014kalman"
    _name: ClassVar[str] = "kalman"
    _scaled: ClassVar[Powers] = {"acceleration_density": 1.0, "noise_floor": 0.5}

    def __post_init__(self) -> None:
        for name in ("acceleration_density", "speed", "noise_floor"):
            positive(f"kalman.{name}", getattr(self, name))

    def _moves(self) -> "DriftingVelocity":
        return DriftingVelocity(self.acceleration_density, self.speed)


@dataclass(frozen=True)
class DriftingVelocity(Motion):
    """Position and velocity under white acceleration, a single mode; see `white_steps`.

    Parameters
    ----------
    density : m^2/s^3. speed : m/s, standard deviation of the first velocity.
    """

    density: float
    speed: float

    @property
    def start(self) -> tuple[float, ...]:
        """See `Motion.start`."""
        return (self.speed**2,)

    def step(self, times: Array) -> ModeStep:
        """See `Motion.step`."""
        transition, process = white_steps(times, self.density)
        return ModeStep(transition[:, :, None], process[:, :, None], np.ones((1, 1, len(times))))
