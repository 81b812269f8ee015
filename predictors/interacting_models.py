"""Interacting multiple models: walking on, manoeuvring and stopping, each as likely as it fits.

Notation: M models, S components of the state (position, velocity, ...), O obstacles, pi_ij the
probability that model j follows model i after one step.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar, Literal, Self, final

import numpy as np

from ..framework.predictor import Fittable
from ..framework.values.arrays import Array, BoolArray, checked_choice, positive, probability
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_acceleration import singer
from .core.assembly import Gaussians, finish, with_fallback
from .core.history import FILTERED, Histories, IntArray, gather, measurement_noise
from .core.kalman_filter import measured_update, on_all_axes
from .core.pattern_search import fit_numbers
from .core.propagation import (
    after,
    cut_steps,
    readings,
    step_covariances,
    step_joint,
    white_acceleration,
)
from .kalman import Kalman

FAINTEST = -690.0
"""Least logarithm of a model's probability over that of the likeliest one: 1e-300."""


@dataclass(frozen=True, eq=False)
class ModeBank:
    """Linear models and the chain that switches between them.

    Attributes
    ----------
    transition : (M, S, S), F_j.
    process : (M, S, S), Q_j.
    switching : (M, M), pi_ij; rows sum to 1.
    """

    transition: Array
    process: Array
    switching: Array

    @property
    def models(self) -> Iterator[tuple[Array, Array]]:
        """F_j and Q_j of each model."""
        return zip(self.transition, self.process, strict=True)

    @cached_property
    def squared(self) -> Array:
        """F_j kron F_j, (M, S^2, S^2)."""
        return np.stack([np.kron(transition, transition) for transition in self.transition])

    @cached_property
    def usual(self) -> Array:
        """Probability of each model in the long run, (M,): mu = switching' mu, sum 1."""
        count = len(self.switching)
        balance = np.concatenate([self.switching.T - np.eye(count), np.ones((1, count))])
        share, *_ = np.linalg.lstsq(balance, np.eye(count + 1)[count], rcond=None)
        return np.asarray(np.maximum(share, np.exp(FAINTEST)))


@dataclass(frozen=True, eq=False)
class ModelBeliefs:
    """State estimate of each obstacle under each model.

    Obstacles are the last axis: sums over few models and components then run along memory.

    Attributes
    ----------
    weight : (M, O), model probabilities, mu.
    state : (S, M, O).
    covariance : (S, S, M, O).
    """

    weight: Array
    state: Array
    covariance: Array

    def where(self, chosen: BoolArray, other: "ModelBeliefs") -> "ModelBeliefs":
        """Take these beliefs where ``chosen`` (O,) is True, the other ones elsewhere."""
        if chosen.all():
            return self
        return ModelBeliefs(
            np.where(chosen, self.weight, other.weight),
            np.where(chosen, self.state, other.state),
            np.where(chosen, self.covariance, other.covariance),
        )


def mixed(beliefs: ModelBeliefs, switching: Array) -> ModelBeliefs:
    """Beliefs just before the next step, by the model that will be in force.

    c_j = sum_i pi_ij mu_i,   omega_ij = pi_ij mu_i / c_j,
    x_0j = sum_i omega_ij x_i,   P_0j = sum_i omega_ij (P_i + (x_i - x_0j)(x_i - x_0j)')
    """
    weight = switching.T @ beliefs.weight
    share = switching[:, :, None] * beliefs.weight[:, None] / weight
    state = np.einsum("ijo,sio->sjo", share, beliefs.state)
    gap = beliefs.state[:, :, None] - state[:, None]
    covariance = np.einsum("ijo,abio->abjo", share, beliefs.covariance)
    covariance += np.einsum("aijo,bijo->abjo", share * gap, gap)
    return ModelBeliefs(weight, state, covariance)


def stepped(beliefs: ModelBeliefs, bank: ModeBank) -> ModelBeliefs:
    """Beliefs one step on: mixed, then predicted by each model."""
    before = mixed(beliefs, bank.switching)
    states, modes, count = before.state.shape
    state = bank.transition @ before.state.swapaxes(0, 1)
    # F P F' of all at once: a product of F kron F and the entries of P.
    entries = before.covariance.reshape(states**2, modes, count).swapaxes(0, 1)
    spread = (bank.squared @ entries).reshape(modes, states, states, count)
    spread += bank.process[..., None]
    return ModelBeliefs(before.weight, state.swapaxes(0, 1), np.moveaxis(spread, 0, 2))


def updated(beliefs: ModelBeliefs, measured: Array, variance: Array) -> ModelBeliefs:
    """Beliefs after one measured position, mu_j = c_j Lambda_j / sum of them.

    Parameters
    ----------
    measured, variance : (D, O), m and m^2, along axes on which the errors are independent.
    """
    state, covariance, density = measured_update(
        beliefs.state, beliefs.covariance, measured, variance
    )
    logarithm = np.log(beliefs.weight) + density
    # No model becomes impossible: one that weighs nothing at all could never come back, and
    # after steps much longer than the dwell time nothing would lead to the others.
    weight = np.exp(np.maximum(logarithm - logarithm.max(axis=0), FAINTEST))
    return ModelBeliefs(weight / weight.sum(axis=0), state, covariance)


def filter_modes(past: Histories, noise: Array, bank: ModeBank, speed: float) -> ModelBeliefs:
    """Filter all histories from their first sample on; missing ones are predicted over.

    Each model starts as likely as it is in the long run (`ModeBank.usual`), with the first sample
    as position, covariance R, and the velocity 0 with ``speed``^2 I (m/s).

    Parameters
    ----------
    past : histories; what was filled in is not used.
    noise : (O, D, D), m^2, positive definite, R.
    """
    count, rows, size = past.positions.shape
    modes, states = bank.transition.shape[:2]
    variance, vectors = np.linalg.eigh(noise)
    local = (past.positions @ vectors).transpose(1, 2, 0).copy()
    spread = np.concatenate([variance.T, np.full((states - size, count), speed**2)])
    first = np.eye(states)[:, :, None, None] * np.repeat(spread[:, None], modes, axis=1)
    beliefs = start = ModelBeliefs(
        np.repeat(bank.usual[:, None], count, axis=1), np.zeros((states, modes, count)), first
    )
    for column in range(rows):
        ahead = stepped(beliefs, bank)
        measured = updated(ahead, local[column], variance.T)
        beliefs = measured.where(past.observed[:, column], ahead)
        if column <= past.began.max(initial=0):
            place = start.state.copy()
            place[:size] = local[column][:, None]
            fresh = ModelBeliefs(start.weight, place, start.covariance)
            beliefs = fresh.where(np.asarray(column <= past.began), beliefs)
    return _turned(beliefs, vectors)


def _begun(beliefs: ModelBeliefs, past: Histories, tracks: Tracks) -> ModelBeliefs:
    """Take velocity and covariance of the tracker for obstacles of which it has one sample."""
    new = np.asarray(past.samples == 1)
    if tracks.velocity is None or tracks.state_covariance is None or not new.any():
        return beliefs
    size = tracks.dimension
    state, covariance = beliefs.state.copy(), beliefs.covariance.copy()
    state[size:, :, new] = tracks.velocity[new].T[:, None]
    covariance[..., new] = tracks.state_covariance[new].transpose(1, 2, 0)[:, :, None]
    return ModelBeliefs(beliefs.weight, state, covariance)


def _turned(beliefs: ModelBeliefs, vectors: Array) -> ModelBeliefs:
    """Turn states and covariances by the rotations with columns ``vectors``, (O, D, D)."""
    states, modes, count = beliefs.state.shape
    size = vectors.shape[1]
    order = states // size
    state = beliefs.state.reshape(order, size, modes, count)
    blocks = beliefs.covariance.reshape(order, size, order, size, modes, count)
    turn = np.ascontiguousarray(vectors.transpose(1, 2, 0))
    state = np.einsum("abo,kbmo->kamo", turn, state)
    blocks = np.einsum("abo,kblcmo->kalcmo", turn, blocks)
    blocks = np.einsum("dco,kalcmo->kaldmo", turn, blocks)
    return ModelBeliefs(
        beliefs.weight,
        state.reshape(beliefs.state.shape),
        blocks.reshape(beliefs.covariance.shape),
    )


def merged(beliefs: ModelBeliefs, size: int) -> tuple[Array, Array]:
    """Mean (S, O) of the mixture of all models, and covariance (D, D, O) of the position."""
    mean = (beliefs.weight * beliefs.state).sum(axis=1)
    gap = beliefs.state[:size] - mean[:size, None]
    spread = beliefs.covariance[:size, :size] + gap[:, None] * gap
    return mean, np.asarray((beliefs.weight * spread).sum(axis=2))


def merged_path(
    beliefs: ModelBeliefs, bank: ModeBank, size: int, steps: int
) -> tuple[Array, Array]:
    """Mean (O, N, D) and covariance (O, N, D, D) of the position at each step ahead, m, m^2.

    Exact moments of the switching system: mixing keeps the first two moments of every model.
    """
    count = beliefs.weight.shape[1]
    mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
    for h in range(steps):
        beliefs = stepped(beliefs, bank)
        state, spread = merged(beliefs, size)
        mean[:, h], covariance[:, h] = state[:size].T, spread.transpose(2, 0, 1)
    return mean, covariance


def merged_joint(
    beliefs: ModelBeliefs, bank: ModeBank, size: int, steps: int, late: IntArray
) -> Array:
    """Joint covariance of the positions from step late + 1 to late + N, (O, N*D, N*D), m^2.

    With d_h = s_h - E[s_h], 1_j(h) that model j is in force at step h and
    C_j(h) = E[1_j(h) (d_h; 1) d_i'] for an earlier step i,

    C_j(h+1) = [[F_j, F_j E[s_h] - E[s_{h+1}]], [0, 1]] sum_i pi_ij C_i(h)

    and Cov(s_h, s_i) is the sum of the upper parts of all C_j(h).
    """
    states, modes, count = beliefs.state.shape
    ahead = steps + int(late.max(initial=0))
    joint = np.zeros((count, ahead, size, ahead, size))
    known = np.zeros((states + 1, modes, 0, count))
    centre, _ = merged(beliefs, size)
    for h in range(ahead):
        before, beliefs = centre, stepped(beliefs, bank)
        centre, spread = merged(beliefs, size)
        shift = np.einsum("jst,to->sjo", bank.transition, before) - centre[:, None]
        past = np.einsum("ij,sido->sjdo", bank.switching, known)
        upper = np.einsum("jst,tjdo->sjdo", bank.transition, past[:states])
        upper += shift[:, :, None] * past[states:]
        cross = upper[:size].sum(axis=1).reshape(size, h, size, count)
        joint[:, h, :, :h] = cross.transpose(3, 0, 1, 2)
        joint[:, :h, :, h] = cross.transpose(3, 1, 2, 0)
        joint[:, h, :, h] = spread.transpose(2, 0, 1)
        known = np.concatenate([upper, past[states:]])
        known = np.concatenate([known, _own(beliefs, centre, size)], axis=2)
    flat = joint.reshape(count, ahead * size, ahead * size)
    return cut_steps(flat, steps, size, late)


def _own(beliefs: ModelBeliefs, centre: Array, size: int) -> Array:
    """E[1_j (d; 1) d_p'] of one step, (S + 1, M, D, O), with d_p the position in d."""
    gap = beliefs.state - centre[:, None]
    square = beliefs.covariance[:, :size].swapaxes(1, 2)
    square = square + gap[:, :, None] * gap[:size].swapaxes(0, 1)
    both = np.concatenate([square, gap[:size].swapaxes(0, 1)[None]])
    return np.asarray(beliefs.weight[:, None] * both)


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
    (`mixed`, `updated`). They start as likely as they are in the long run: who has only just
    appeared is not one in three to stop. Missing samples are predicted over.

    The forecast, by ``modes``:

    - "merged": one Gaussian per step, with the exact mean, covariance and joint covariance
      of the chain's own future, switches ahead included, given the newest beliefs.
    - "kept": three modes with the newest model probabilities as weights, in the order above;
      each keeps its model over the whole horizon. A planner then keeps clear of each.

    An obstacle of a single sample starts with the velocity that its tracker states, and with the
    tracker's covariance of position and velocity, under all models: who has only just been seen
    would otherwise be forecast to go anywhere at 1 m/s. From two samples on the tracker's
    numbers are not used, as they belong to no one model.

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

    def __post_init__(self) -> None:
        numbers = ("steady", "manoeuvring", "standing", "braking", "dwell", "speed", "noise_floor")
        for name in numbers:
            positive(f"imm.{name}", getattr(self, name))
        probability("imm.stopping", self.stopping)
        checked_choice("imm.modes", self.modes, Literal["merged", "kept"])

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy fitted by `fit_numbers`; see `Fittable.fit`."""
        return fit_numbers(self, SCALED, dataset)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=FILTERED)
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

    def filter(self, past: Histories, tracks: Tracks) -> ModelBeliefs:
        """Return the beliefs after the newest observed samples, in the order of `MODES`."""
        return self._filtered(past, tracks, self.bank(tracks.dt, tracks.dimension))

    def _filtered(self, past: Histories, tracks: Tracks, bank: ModeBank) -> ModelBeliefs:
        noise = measurement_noise(tracks, self.noise_floor)
        return _begun(filter_modes(past, noise, bank, self.speed), past, tracks)

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
        self, beliefs: ModelBeliefs, bank: ModeBank, past: Histories, tracks: Tracks, steps: int
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


def _kept_joint(
    beliefs: ModelBeliefs, bank: ModeBank, size: int, steps: int, late: IntArray
) -> Array:
    """Joint covariance of each mode, (O, M, N*D, N*D), m^2."""
    start = beliefs.covariance.transpose(2, 3, 0, 1)
    each = [
        step_joint(*model, start[mode], size, steps, late)
        for mode, model in enumerate(bank.models)
    ]
    return np.stack(each, axis=1)
