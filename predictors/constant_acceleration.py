"""Constant acceleration, filtered, and forgotten after a while (Singer's model)."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.values.arrays import Array, positive
from .core.kalman_filter import ModeStep, Motion
from .core.motion_filter import MotionFilter
from .core.pattern_search import Powers


@final
@dataclass(frozen=True)
class ConstantAcceleration(MotionFilter):
    """A Kalman filter on position, velocity and an acceleration that decays.

    da = -a / tau dt + dw,   E[a^2] = sigma^2 per axis in the long run

    so that an acceleration seen now is expected to be exp(-t / tau) of itself t seconds on
    (`singer`). A lasting one, tau much longer than the horizon, is the textbook's constant
    acceleration: on recorded people its mean error over 4.8 s is 0.78 m against 0.44 m with
    the defaults (1.5 m where the newest second difference is taken as it is), because people
    accelerate for a step or two, not for 5 s. With tau far below dT the model is `kalman`
    with acceleration_density 2 sigma^2 tau.

    It starts at the first measurement with velocity 0 and acceleration 0 and
    P = blkdiag(R, speed^2 I, sigma^2 I), and goes on as `Kalman`, a tracker's numbers included.
    The forecast's joint covariance is exact for the model; one measurement is enough.

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
    _name: ClassVar[str] = "constant_acceleration"
    _scaled: ClassVar[Powers] = {"acceleration": 1.0, "noise_floor": 1.0}

    def __post_init__(self) -> None:
        for name in ("acceleration", "time_constant", "speed", "noise_floor"):
            positive(f"constant_acceleration.{name}", getattr(self, name))

    def _moves(self) -> "DecayingAcceleration":
        return DecayingAcceleration(self.acceleration, self.time_constant, self.speed)


@dataclass(frozen=True)
class DecayingAcceleration(Motion):
    """Position, velocity and an acceleration that decays, a single mode; see `singer`.

    Parameters
    ----------
    acceleration : m/s^2. time_constant : s. speed : m/s, deviation of the first velocity.
    """

    acceleration: float
    time_constant: float
    speed: float

    @property
    def start(self) -> tuple[float, ...]:
        """See `Motion.start`."""
        return (self.speed**2, self.acceleration**2)

    def step(self, times: Array) -> ModeStep:
        """See `Motion.step`."""
        transition, process = singer(times, self.acceleration, self.time_constant)
        return ModeStep(transition[:, :, None], process[:, :, None], np.ones((1, 1, len(times))))


NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
"""Gauss and Legendre's rule on [-1, 1]."""


def singer(times: Array, acceleration: float, time_constant: float) -> tuple[Array, Array]:
    """Transition and process covariance of (p, v, a) of one axis in times (L,), (3, 3, L) each.

    f = [[1, t, c_1(t)], [0, 1, c_2(t)], [0, 0, c_3(t)]],
    q = 2 sigma^2 / tau * integral from 0 to t of c(u) c(u)' du,

    with x = u / tau and c(u) = (u^2 phi_2(x), u phi_1(x), exp(-x)), what a unit acceleration
    has done after u. The integral is summed by Gauss and Legendre's rule, a sum of squares:
    positive semi-definite where the textbook's closed form loses all digits (t << tau).
    """
    effect = _effect(0.5 * times * (NODES[:, None] + 1.0), time_constant)
    density = acceleration**2 / time_constant
    process = density * times * np.einsum("inl,n,jnl->ijl", effect, WEIGHTS, effect)
    transition = np.zeros((3, 3, len(times)))
    transition[0, 0] = transition[1, 1] = 1.0
    transition[0, 1] = times
    transition[:, 2] = _effect(times, time_constant)
    return transition, np.asarray(process)


def _effect(times: Array, time_constant: float) -> Array:
    """Position, velocity and acceleration after a unit acceleration at time 0, (3, ...)."""
    x = times / time_constant
    first = -np.expm1(-x) / x
    # phi_2 = (1 - phi_1) / x cancels for small x; its series 1/2 - x/6 + x^2/24 - ...
    series = 1 / 2 - x * (1 / 6 - x * (1 / 24 - x * (1 / 120 - x / 720)))
    second = np.where(x < 1e-3, series, (1.0 - first) / x)
    return np.stack([times**2 * second, times * first, np.exp(-x)])
