"""Interacting multiple models: walking on, manoeuvring and stopping, each as likely as it fits.

Notation: M models, which the code calls modes, and pi_ij the probability that j follows i.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal, final

import numpy as np

from ..framework.values.arrays import Array, checked_choice, positive, probability
from ..framework.values.beliefs import Beliefs
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_acceleration import singer
from .core.kalman_filter import ModeStep, Motion, forecast, started
from .core.motion_filter import MotionFilter
from .core.pattern_search import Powers
from .core.propagation import white_steps

MODES = ("steady", "manoeuvring", "stopping")
TRUSTED = 1
"""Measurements up to which a tracker's numbers are taken: a filter begins with them."""


@final
@dataclass(frozen=True)
class InteractingModels(MotionFilter):
    """A bank of three Kalman filters on position and velocity that interact (IMM).

    - steady: white acceleration of density ``steady``;
    - manoeuvring: white acceleration of density ``manoeuvring``;
    - stopping: the velocity decays, dv = -v / braking dt + dw, to one of deviation
      ``standing`` per axis (`singer`, one derivative lower).

    The model in force is a Markov chain: each is left after ``dwell`` seconds on average. A
    moving obstacle then stops with probability ``stopping`` (half would make a forecast slow
    down at once), and one that stopped goes on by either of the others alike. At each step
    the states of the models are mixed (omega_ij = pi_ij mu_i / c_j), predicted, updated, and
    the model probabilities weighted by the likelihoods, mu_j = c_j Lambda_j / sum
    (`mixed`, `updated`), each measurement at its own time. They start as likely as they are in
    the long run: who has only just appeared is not one in three to stop.

    The forecast, by ``modes``:

    - "merged": one Gaussian per step, with the exact mean, covariance and joint covariance
      of the chain's own future, switches ahead included, given the newest beliefs.
    - "kept": three modes with the newest model probabilities as weights, in the order above;
      each keeps its model over the whole horizon. A planner then keeps clear of each.

    An obstacle of a single measurement starts with the velocity that its tracker states, and with
    the tracker's covariance of position and velocity, under all models: who has only just been
    seen would otherwise be forecast to go anywhere at 1 m/s. From two measurements on the
    tracker's numbers are not used, as they belong to no one model.

    The defaults suit walking people whose measurement noise is known or estimated (`Recording`,
    `NoiseEvidence`). ``standing`` is far below the speed of a slow robot: with 0.03 m/s, half of
    0.06, such a robot was believed to be stopping and its error nearly doubled. `fit` scales the
    two densities, ``standing``^2 and ``noise_floor``^2 alike (`fit_numbers`).

    Parameters
    ----------
    steady, manoeuvring : m^2/s^3.
    standing : m/s per axis.
    braking : s.
    dwell : s.
    stopping : of all switches from a model that moves, the share to the one that stops.
    speed : m/s per axis, standard deviation of the first velocity; 95 % are then slower than
        2.0 m/s. Of people who had just appeared 95 % went less than 6.6 to 9.2 m in 4.8 s on
        recordings of five sites.
    noise_floor : m, added in quadrature to the measurement noise.
    modes : see above.

    Raises
    ------
    WideberthError : a number that is not positive, or unknown ``modes``.

    References
    ----------
    H. A. P. Blom and Y. Bar-Shalom, "The Interacting Multiple Model Algorithm for Systems
    with Markovian Switching Coefficients", 1988.
    """

    steady: float = 0.015
    manoeuvring: float = 0.06
    standing: float = 0.005
    braking: float = 0.5
    dwell: float = 10.0
    stopping: float = 0.1
    speed: float = 0.8
    noise_floor: float = 0.01
    modes: Literal["merged", "kept"] = "merged"

    reference: ClassVar[str] = "blom1988interacting"
    _name: ClassVar[str] = "imm"
    _scaled: ClassVar[Powers] = {
        "steady": 1.0,
        "manoeuvring": 1.0,
        "standing": 0.5,
        "noise_floor": 0.5,
    }

    def __post_init__(self) -> None:
        numbers = ("steady", "manoeuvring", "standing", "braking", "dwell", "speed", "noise_floor")
        for name in numbers:
            positive(f"imm.{name}", getattr(self, name))
        probability("imm.stopping", self.stopping)
        checked_choice("imm.modes", self.modes, Literal["merged", "kept"])

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        if self.modes == "kept":
            return self._kept(beliefs, tracks, steps)
        return forecast(started(beliefs, tracks, self._motion, TRUSTED), steps, "imm")

    def _moves(self) -> "SwitchingMotion":
        return SwitchingMotion(
            (self.steady, self.manoeuvring),
            (self.standing, self.braking),
            self.dwell,
            self.stopping,
            self.speed,
        )

    def _kept(self, beliefs: Beliefs, tracks: Tracks, steps: int) -> Forecast:
        """One mode per model, without switches ahead."""
        weight, state, covariance, origin = beliefs.values
        each = []
        for mode in range(len(MODES)):
            parts = np.ones_like(weight), state, covariance
            values = tuple(part[..., [mode], :] for part in parts)
            motion = KeptModel(self._motion, mode)
            start = started(replace(beliefs, values=(*values, origin)), tracks, motion, TRUSTED)
            each.append(forecast(start, steps, "imm"))
        return Forecast(
            np.concatenate([one.mean for one in each], axis=1),
            np.concatenate([one.covariance for one in each], axis=1),
            weight.T,
            tracks.dt,
            each[0].fallback,
            partial(_joint_of_each, each),
        )


def _joint_of_each(each: Sequence[Forecast]) -> Array:
    """Joint covariance of each mode, (O, M, N*D, N*D), m^2."""
    return np.concatenate([one.joint for one in each if one.joint is not None], axis=1)


@dataclass(frozen=True)
class SwitchingMotion(Motion):
    """Walking on, manoeuvring and stopping, see `InteractingModels`.

    Parameters
    ----------
    densities : m^2/s^3, of the white acceleration of the first two.
    rest : m/s and s, deviation of the velocity of the third and the time in which it decays.
    dwell : s, in a model on average.
    stopping : of all switches from a model that moves, the share to the one that stops.
    speed : m/s, standard deviation of the first velocity.
    """

    densities: tuple[float, float]
    rest: tuple[float, float]
    dwell: float
    stopping: float
    speed: float

    @property
    def start(self) -> tuple[float, ...]:
        """See `Motion.start`."""
        return (self.speed**2,)

    @property
    def usual(self) -> tuple[float, ...]:
        """See `Motion.usual`: mu' pi = mu'."""
        moves = 0.5 / (1.0 + self.stopping)
        return (moves, moves, 2.0 * self.stopping * moves)

    def step(self, times: Array) -> ModeStep:
        """See `Motion.step`."""
        lower, process = singer(times, *self.rest)
        axes = [white_steps(times, density) for density in self.densities]
        axes.append((lower[1:, 1:], process[1:, 1:]))
        transition, process = (np.stack(part, axis=2) for part in zip(*axes, strict=True))
        moving, stop = 1.0 - self.stopping, self.stopping
        switches = np.array([[-1.0, moving, stop], [moving, -1.0, stop], [0.5, 0.5, -1.0]])
        left = -np.expm1(-times / self.dwell)
        switching = np.eye(len(axes))[:, :, None] + left * switches[:, :, None]
        return ModeStep(transition, process, switching)


@dataclass(frozen=True)
class KeptModel(Motion):
    """One of the models, that stays in force.

    Parameters
    ----------
    motion : of all models. mode : number of the model.
    """

    motion: Motion
    mode: int

    @property
    def start(self) -> tuple[float, ...]:
        """See `Motion.start`."""
        return self.motion.start

    def step(self, times: Array) -> ModeStep:
        """See `Motion.step`."""
        every, own = self.motion.step(times), slice(self.mode, self.mode + 1)
        alone = np.ones((1, 1, len(times)))
        return ModeStep(every.transition[:, :, own], every.process[:, :, own], alone)
