"""Interacting multiple models: walking on, manoeuvring and stopping, each as likely as it fits."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal, Self, final

import numpy as np

from ..framework.predictor import Fittable
from ..framework.values.arrays import Array, positive, probability, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_acceleration import singer
from .core.assembly import Gaussians, finish, with_fallback
from .core.history import Histories, IntArray, gather, measurement_noise
from .core.kalman_filter import on_all_axes
from .core.mode_bank import Beliefs, ModeBank, filter_modes, merged_joint, merged_path
from .core.pattern_search import fit_numbers
from .core.propagation import after, readings, step_covariances, step_joint, white_acceleration
from .kalman import Kalman

MODES = ("steady", "manoeuvring", "stopping")

SCALED = ({"steady": 1.0, "manoeuvring": 1.0, "standing": 0.5, "noise_floor": 0.5},)
"""What `fit` multiplies by powers of one number. The ratios stay: with them free, scenes left
out of the fit were forecast worse, as noise against motion is a matter of each recording."""


@final
@dataclass(frozen=True)
class InteractingModels(Fittable):
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
    (`mixed`, `updated`). All start equally likely, as `kalman` does. Missing samples are
    predicted over.

    The forecast, by ``modes``:

    - "merged": one Gaussian per step, with the exact mean, covariance and joint covariance
      of the chain's own future, switches ahead included, given the newest beliefs.
    - "kept": three modes with the newest model probabilities as weights, in the order above;
      each keeps its model over the whole horizon. A planner then keeps clear of each.

    A tracker's ``state_covariance`` is not used: it belongs to no one model.

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
    speed : m/s per axis, standard deviation of the first velocity.
    noise_floor : m, added in quadrature to the measurement noise.
    history : grid samples to filter.
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
    speed: float = 1.0
    noise_floor: float = 0.01
    history: int = 40
    modes: Literal["merged", "kept"] = "merged"

    reference: ClassVar[str] = "blom1988interacting"

    def __post_init__(self) -> None:
        numbers = ("steady", "manoeuvring", "standing", "braking", "dwell", "speed", "noise_floor")
        for name in numbers:
            positive(f"imm.{name}", getattr(self, name))
        probability("imm.stopping", self.stopping)
        whole("imm.history", self.history)
        if self.modes not in ("merged", "kept"):
            raise WideberthError(f"imm.modes is {self.modes!r}; wanted one of merged, kept")

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy fitted by `fit_numbers`; see `Fittable.fit`."""
        return fit_numbers(self, SCALED, dataset)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=self.history)
        bank = self.bank(tracks.dt, tracks.dimension)
        beliefs = self._filtered(past, tracks, bank)
        if self.modes == "kept":
            return self._kept(beliefs, bank, past, tracks, steps)
        ahead = steps + int(past.late.max(initial=0))
        moved, spread = merged_path(beliefs, bank, tracks.dimension, ahead)
        mean = past.origin[:, None] + after(moved, steps, past.late)
        joint = partial(merged_joint, beliefs, bank, tracks.dimension, steps, past.late)
        own = Gaussians(mean, after(spread, steps, past.late), (None,) * len(tracks), joint)
        return finish(own, past, tracks, "imm")

    def filter(self, past: Histories, tracks: Tracks) -> Beliefs:
        """Return the beliefs after the newest observed samples, in the order of `MODES`."""
        return self._filtered(past, tracks, self.bank(tracks.dt, tracks.dimension))

    def _filtered(self, past: Histories, tracks: Tracks, bank: ModeBank) -> Beliefs:
        return filter_modes(past, measurement_noise(tracks, self.noise_floor), bank, self.speed)

    def bank(self, dt: float, size: int) -> ModeBank:
        """Return the three models and their chain."""
        lower, process = singer(dt, self.standing, self.braking)
        axes = [
            white_acceleration(dt, self.steady, 1),
            white_acceleration(dt, self.manoeuvring, 1),
            (lower[1:, 1:], process[1:, 1:]),
        ]
        leave = -np.expm1(-dt / self.dwell)
        moving, stop = 1.0 - self.stopping, self.stopping
        switches = np.array([[-1.0, moving, stop], [moving, -1.0, stop], [0.5, 0.5, -1.0]])
        return ModeBank(
            np.stack([on_all_axes(transition, size) for transition, _ in axes]),
            np.stack([on_all_axes(process, size) for _, process in axes]),
            np.eye(len(axes)) + leave * switches,
        )

    def _kept(
        self, beliefs: Beliefs, bank: ModeBank, past: Histories, tracks: Tracks, steps: int
    ) -> Forecast:
        """One mode per model, without switches ahead."""
        size = tracks.dimension
        ahead = steps + int(past.late.max(initial=0))
        means, spreads = [], []
        for mode, (transition, process) in enumerate(bank.models):
            reads = readings(transition, size, ahead)
            moved = np.einsum("nds,so->ond", reads, beliefs.state[:, mode])
            start = beliefs.covariance[:, :, mode].transpose(2, 0, 1)
            spread = step_covariances(transition, process, start, size, ahead)
            means.append(past.origin[:, None] + after(moved, steps, past.late))
            spreads.append(after(spread, steps, past.late))
        own = Forecast(
            np.stack(means, axis=1),
            np.stack(spreads, axis=1),
            beliefs.weight.T,
            tracks.dt,
            (None,) * len(tracks),
            partial(_kept_joint, beliefs, bank, size, steps, past.late),
        )
        missing = ["imm: never observed" if count == 0 else None for count in past.samples]
        return with_fallback(own, missing, Kalman(), tracks, None)


def _kept_joint(beliefs: Beliefs, bank: ModeBank, size: int, steps: int, late: IntArray) -> Array:
    """Joint covariance of each mode, (O, M, N*D, N*D), m^2."""
    start = beliefs.covariance.transpose(2, 3, 0, 1)
    each = [
        step_joint(*model, start[mode], size, steps, late)
        for mode, model in enumerate(bank.models)
    ]
    return np.stack(each, axis=1)
