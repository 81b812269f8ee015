"""Kalman filters of all obstacles at once, each measurement at its own time.

Notation: O obstacles, M modes (models that may be in force), D coordinates, s components of the
state along one axis (position, velocity, ...), N steps. All axes move alike and apart: a mode
moves the components of an axis by f (s, s) and adds noise of covariance q (s, s). One mode is the
plain Kalman filter, several are interacting multiple models (IMM). Obstacles are the last axis:
sums over few components then run along memory.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np

from ...framework.values.arrays import Array, BoolArray, assembled
from ...framework.values.beliefs import Beliefs
from ...framework.values.forecast import Forecast
from ...framework.values.measurements import IntArray
from ...framework.values.tracks import ON_GRID, Tracks
from .assembly import NEVER_SEEN_SPREAD
from .filter_loop import compiled
from .history import LONGEST_GAP, floored, gather
from .propagation import after, cut_steps

BLOCK = 32
"""Steps by which kept tables differ in length: from call to call more or fewer are asked for."""
MOST_STEPS = 200
"""Steps from the newest measurement of an obstacle to the present; longer ones beyond them."""
PAUSE = LONGEST_GAP + 1 + 1e-6
"""Steps of the tracks; after a longer pause between two measurements a filter begins anew."""


class ModeStep(NamedTuple):
    """How modes move in given times, one for each of L obstacles, or L = 1 for all of them.

    Attributes
    ----------
    transition, process : (s, s, M, L), f and q.
    switching : (M, M, L), pi_ij, the probability that mode j follows mode i.
    """

    transition: Array
    process: Array
    switching: Array


class Motion(ABC):
    """Modes of motion: a frozen value that can be hashed."""

    @property
    @abstractmethod
    def start(self) -> tuple[float, ...]:
        """Variances of velocity, ... along an axis at the first measurement; their mean is 0."""

    @abstractmethod
    def step(self, times: Array) -> ModeStep:
        """Return how the modes move in times (L,), s."""

    @property
    def usual(self) -> tuple[float, ...]:
        """Probability of each mode in the long run, (M,); here of a single mode."""
        return (1.0,)

    @cached_property
    def first(self) -> tuple[Array, Array]:
        """Variances at the first measurement and probabilities of the modes, as arrays."""
        return np.array(self.start), np.array(self.usual)


class ModeStates(NamedTuple):
    """State of each obstacle under each mode, relative to an origin of its own.

    Attributes
    ----------
    weight : (M, O), mode probabilities, mu.
    state : (s, D, M, O).
    covariance : (s, D, s, D, M, O).
    """

    weight: Array
    state: Array
    covariance: Array

    def at(self, rows: IntArray) -> "ModeStates":
        """Return those of some obstacles, in increasing order."""
        if len(rows) == self.weight.shape[-1]:
            return self
        return ModeStates(*(np.take(part, rows, axis=-1) for part in self))

    def replaced(self, rows: IntArray, part: "ModeStates") -> "ModeStates":
        """Return them with those of some obstacles, in increasing order, replaced."""
        if len(rows) == self.weight.shape[-1]:
            return part
        copy = ModeStates(*(whole.copy() for whole in self))
        for whole, own in zip(copy, part, strict=True):
            whole[..., rows] = own
        return copy


def moved(modes: ModeStates, step: ModeStep) -> ModeStates:
    """Return the modes one step on: mixed, then predicted by each mode, f x and f P f' + q."""
    components, size, number, count = modes.state.shape
    copy = ModeStates(*(part.copy() for part in modes))
    lengths = step.transition.shape[-1]
    which = np.arange(count) if lengths > 1 else np.zeros(count, dtype=np.int64)
    noise = np.zeros((count, size, size))
    nothing = np.zeros((count, size)), noise, noise  # W = 0: of no weight
    first = np.zeros(components - 1), np.zeros(number)
    once = np.ones(count, dtype=np.int64)
    _run(copy, np.zeros((size, count)), once.copy(), np.arange(count + 1), nothing, once, which,
         step, first)  # fmt: skip
    return copy


def _run(
    modes: ModeStates,
    origin: Array,
    count: IntArray,
    begins: IntArray,
    measured: tuple[Array, Array, Array],
    number: IntArray,
    which: IntArray,
    step: ModeStep,
    first: tuple[Array, Array],
) -> None:
    """Filter in place, see `filter_each`."""
    components, size, modes_, obstacles = modes.state.shape
    state = modes.state.reshape(components * size, modes_, obstacles)
    covariance = modes.covariance.reshape(*[components * size] * 2, modes_, obstacles)
    flat = modes.weight, state, covariance
    compiled()[0](begins, measured, number, which, tuple(step), first, flat, origin, count)


def whitened(noise: Array) -> Array:
    """Return W, lower triangular, with W' W = R^-1, (K, D, D); NaN where R is not definite."""
    whitening = np.empty(noise.shape)
    compiled()[1](np.ascontiguousarray(noise), whitening)
    return whitening


def _step(motion: Motion, times: Array) -> ModeStep:
    """Return the step of each time, from a table; one for all where they are the same."""
    if (times == times[0]).all():
        times = times[:1]
    return _tabled(motion, times.tobytes())


@lru_cache(maxsize=64)
def _tabled(motion: Motion, times: bytes) -> ModeStep:
    step = motion.step(np.frombuffer(times))
    return ModeStep(*(np.ascontiguousarray(part) for part in step))


def filtered(tracks: Tracks, before: Beliefs | None, motion: Motion, floor: float) -> Beliefs:
    """Filter all measurements of all obstacles; see `Filtering.filtered`.

    Each mode starts as likely as it is in the long run, with the first measurement as position,
    covariance R, and velocity, ... 0 with the variances of the motion.

    Parameters
    ----------
    tracks, before : as there.
    motion : of the modes.
    floor : m, see `floored`.
    """
    sightings, size = tracks.measured, tracks.dimension
    components, modes_ = len(motion.start) + 1, len(motion.usual)
    body = components, size
    shapes = (modes_,), (*body, modes_), (*body, *body, modes_), (size,)
    first, newest, count, values = (before or Beliefs.none()).resumed(sightings, shapes)
    if before is not None and values is before.values:
        return before
    values[0][:, count == 0] = motion.first[1][:, None]
    number = sightings.count - first
    rows = np.flatnonzero(number)
    if not rows.size:
        return Beliefs(sightings.log, newest, count, values)
    begins = np.concatenate([[0], np.cumsum(number)])
    unused = [(row, first[row]) for row in rows.tolist()]
    times = np.concatenate([sightings.times[row][begin:] for row, begin in unused])
    measured = np.concatenate([sightings.values[row][begin:] for row, begin in unused])
    lag, heads = times.copy(), begins[rows]
    lag[1:] -= times[:-1]
    lag[heads] = times[heads] - newest[rows]
    newest[rows] = times[begins[rows + 1] - 1]
    steps, which, length = _in_steps(lag, PAUSE * tracks.dt, tracks.dt)
    noise = floored(measured[:, size:].reshape(-1, size, size), floor)
    places = np.ascontiguousarray(measured[:, :size])
    _run(ModeStates(*values[:3]), values[3], count, begins, (places, noise, whitened(noise)),
         steps, which, _step(motion, length), motion.first)  # fmt: skip
    return Beliefs(sightings.log, newest, count, values)


def _in_steps(lag: Array, pause: float, dt: float) -> tuple[IntArray, IntArray, Array]:
    """Divide times (K,), s, into steps of nearly ``dt`` s, at most `MOST_STEPS`.

    Returns
    -------
    number : (K,), of the steps; 0 for a time above ``pause`` s, after which a filter begins anew.
    which : (K,), index of their length.
    length : (L,), s, different ones.
    """
    number = np.minimum(np.maximum(np.rint(lag / dt), 1.0), MOST_STEPS)
    paused = lag > pause
    each = np.where(paused, dt, lag) / np.where(paused, 1.0, number)
    number[paused] = 0.0
    if (each == each[0]).all():
        return number.astype(np.int64), np.zeros(len(lag), dtype=np.int64), each[:1]
    length, which = np.unique(each, return_inverse=True)
    return number.astype(np.int64), which, length


class ModeReadings(NamedTuple):
    """Moments of the position at steps ahead, from the state and the mode now.

    A position along an axis is a' s + noise, with a that depends on the modes to come.

    Attributes
    ----------
    mean : (N, M, s), r = E[a].
    spread : (N, M, s, s), C = E[a a'] - r r'.
    noise : (N, M), m^2, variance of the noise.
    """

    mean: Array
    spread: Array
    noise: Array


@lru_cache(maxsize=32)
def readings(motion: Motion, dt: float, steps: int) -> ModeReadings:
    """Return them for the steps dt, 2 dt, ..., by going back from the last one.

    r_h(i) = sum_j pi_ij f_j' r_{h-1}(j),   d_ij = f_j' r_{h-1}(j) - r_h(i)
    C_h(i) = sum_j pi_ij (f_j' C_{h-1}(j) f_j + d_ij d_ij')
    n_h(i) = sum_j pi_ij (n_{h-1}(j) + tr(q_j (C_{h-1}(j) + r_{h-1}(j) r_{h-1}(j)')))

    All are sums of squares, so that no digits are lost however fast an obstacle is.
    """
    f, q, chain = (part[..., 0] for part in motion.step(np.array([dt])))
    components, modes = f.shape[0], f.shape[2]
    mean, noise = np.zeros((modes, components)), np.zeros(modes)
    mean[:, 0], spread = 1.0, np.zeros((modes, components, components))
    made = []
    for _ in range(steps):
        square = spread + mean[:, :, None] * mean[:, None]
        noise = chain @ (noise + np.einsum("jab,abj->j", square, q))
        ahead = np.einsum("abj,ja->jb", f, mean)
        mean = chain @ ahead
        apart = ahead - mean[:, None]
        spread = np.einsum("ij,acj,jab,bdj->icd", chain, f, spread, f)
        spread += np.einsum("ij,ija,ijb->iab", chain, apart, apart)
        made.append((mean, spread, noise))
    if not made:
        empty = np.empty((0, modes, components))
        return ModeReadings(empty, empty[..., None] * np.zeros(components), empty[..., 0])
    return ModeReadings(*(np.stack(part) for part in zip(*made, strict=True)))


def moments_ahead(modes: ModeStates, reads: ModeReadings) -> tuple[Array, Array]:
    """Mean (N, D, O), m, and covariance (N, D, D, O), m^2, of the position at each step.

    With m_j the mean under mode j and m the mean of all,

    Cov = sum_j mu_j ((C_j + r_j r_j') : P_j + C_j : x_j x_j' + n_j I + (m_j - m)(m_j - m)')
    """
    weight, state = modes.weight, modes.state
    steps, number = reads.noise.shape
    components, size, _, count = state.shape
    pairs = (weight * modes.covariance).transpose(4, 0, 2, 1, 3, 5)
    square = reads.spread + reads.mean[..., :, None] * reads.mean[..., None, :]
    covariance = square.reshape(steps, -1) @ pairs.reshape(number * components**2, -1)
    covariance = covariance.reshape(steps, size, size, count)
    flat = state.transpose(2, 0, 1, 3).reshape(number, components, -1)
    each = (reads.mean.transpose(1, 0, 2) @ flat).reshape(number, steps, size, count)
    mean = each[0]
    if number > 1:
        mean = np.einsum("mo,mndo->ndo", weight, each)
        gap = each - mean
        covariance += np.einsum("mndo,mneo->ndeo", weight[:, None, None] * gap, gap)
        pairs = np.einsum("admo,bemo->mabdeo", weight * state, state)
        moving = reads.spread.reshape(steps, -1) @ pairs.reshape(number * components**2, -1)
        covariance += moving.reshape(covariance.shape)
    noise = reads.noise @ weight
    for axis in range(size):
        covariance[:, axis, axis] += noise
    return mean, covariance


@dataclass(frozen=True, eq=False)
class Start:
    """Where forecasts begin: a whole number of steps before the newest row of the tracks.

    Attributes
    ----------
    modes : of each obstacle.
    origin : (D, O), m, that states are relative to.
    late : (O,), that number; a forecast must drop its first ``late`` steps.
    unseen : (O,), those without a measurement.
    motion : of the modes.
    dt : s, of a step.
    """

    modes: ModeStates
    origin: Array
    late: IntArray
    unseen: BoolArray
    motion: Motion
    dt: float

    def moments(self, steps: int) -> tuple[Array, Array]:
        """Return mean (O, N, D), m, and covariance (O, N, D, D), m^2, of the first steps.

        They are computed for a multiple of `BLOCK` steps and kept for the next call.
        """
        length = BLOCK * -(-steps // BLOCK)
        if length not in self._known:
            middle, spread = moments_ahead(self.modes, readings(self.motion, self.dt, length))
            mean = (middle + self.origin).transpose(2, 0, 1)
            covariance = (0.5 * (spread + spread.swapaxes(1, 2))).transpose(3, 0, 1, 2)
            if self.unseen.any():
                mean[self.unseen] = 0.0
                covariance[self.unseen] = NEVER_SEEN_SPREAD**2 * np.eye(mean.shape[2])
            self._known[length] = mean, covariance
        mean, covariance = self._known[length]
        return mean[:, :steps], covariance[:, :steps]

    @cached_property
    def _known(self) -> dict[int, tuple[Array, Array]]:
        return {}


@lru_cache(maxsize=8)
def started(beliefs: Beliefs, tracks: Tracks, motion: Motion, trusted: float = np.inf) -> Start:
    """Carry beliefs over the part of a step by which measurements miss the grid.

    The last ones are kept: a decision asks twice.

    Parameters
    ----------
    beliefs : of the obstacles of the tracks, in any order of modes.
    tracks : of the obstacles.
    motion : of the modes.
    trusted : number of measurements up to which position, velocity and covariances are those of
        the tracker, where there is one, at the newest observed row. One that states no velocity
        has its numbers used from the second measurement on.
    """
    *parts, origin = beliefs.values
    modes, lag = ModeStates(*parts), tracks.lag
    least = 2 if tracks.velocity is None else 1
    tracked = (least <= beliefs.count) & (beliefs.count <= trusted)
    if tracks.state_covariance is not None and tracked.any():
        rows = np.flatnonzero(tracked)
        newest = gather(tracks, length=1)
        lag = np.where(tracked, tracks.dt * newest.late, lag)
        modes = modes.replaced(rows, _tracked(modes.at(rows), tracks, rows))
        origin = np.where(tracked, newest.origin.T, origin)
    late = np.minimum(np.floor(lag / tracks.dt + ON_GRID), MOST_STEPS).astype(np.int64)
    rest = np.asarray(lag - tracks.dt * late, dtype=np.float64)
    off = np.flatnonzero(rest > ON_GRID * tracks.dt)
    if off.size:
        modes = modes.replaced(off, moved(modes.at(off), _step(motion, rest[off])))
    return Start(modes, origin, late, np.asarray(beliefs.count == 0), motion, tracks.dt)


def _tracked(modes: ModeStates, tracks: Tracks, rows: IntArray) -> ModeStates:
    """Return modes with the tracker's numbers for some obstacles, about their newest position."""
    joint, velocity = tracks.state_covariance, tracks.velocity
    assert joint is not None
    count, size = len(rows), tracks.dimension
    state, covariance = modes.state.copy(), modes.covariance.copy()
    state[0] = 0.0
    if velocity is not None:
        state[1] = velocity[rows].T[:, None]
    covariance[:2, :, 2:], covariance[2:, :, :2] = 0.0, 0.0
    blocks = joint[rows].reshape(count, 2, size, 2, size).transpose(1, 2, 3, 4, 0)
    covariance[:2, :, :2] = blocks[..., None, :]
    return ModeStates(modes.weight, state, covariance)


def forecast(start: Start, steps: int, name: str) -> Forecast:
    """Forecast one Gaussian per obstacle, with the exact moments of the motion's own future.

    Nothing is known of an obstacle never observed, so its mean is the world's origin (the one
    place where a forecast cannot turn and shift with the world) and its standard deviation
    `NEVER_SEEN_SPREAD`, the same unknown place at all steps.
    """
    mean, covariance = start.moments(steps + int(start.late.max(initial=0)))
    reasons: tuple[str | None, ...] = (None,) * len(mean)
    if start.unseen.any():
        reasons = tuple(f"{name}: never observed" if new else None for new in start.unseen)
    return assembled(  # finite and PSD for tracks within the limits
        Forecast,
        mean=after(mean, steps, start.late)[:, None],
        covariance=after(covariance, steps, start.late)[:, None],
        weight=np.ones((len(mean), 1)),
        dt=start.dt,
        fallback=reasons,
        joint_source=partial(_joint, start, steps),
    )


def _joint(start: Start, steps: int) -> Array:
    """Joint covariance of the positions at all steps, (O, 1, N*D, N*D), m^2.

    With d_h = s_h - E[s_h], 1_j(h) that mode j is in force at step h and
    C_j(h) = E[1_j(h) (d_h; 1) d_i'] for an earlier step i,

    C_j(h+1) = [[F_j, F_j E[s_h] - E[s_{h+1}]], [0, 1]] sum_i pi_ij C_i(h)

    and Cov(s_h, s_i) is the sum of the upper parts of all C_j(h).
    """
    modes, step = start.modes, _step(start.motion, np.array([start.dt]))
    f, chain = step.transition[..., 0], step.switching[..., 0]
    size, count = modes.state.shape[1], modes.state.shape[3]
    further = steps + int(start.late.max(initial=0))
    joint = np.zeros((count, further, size, further, size))
    upper = np.zeros((*modes.state.shape[:3], 0, size, count))
    lower = np.zeros((modes.state.shape[2], 0, size, count))
    middle = (modes.weight * modes.state).sum(axis=2)
    for h in range(further):
        modes, before = moved(modes, step), middle
        middle = (modes.weight * modes.state).sum(axis=2)
        shift = np.einsum("abm,bdo->admo", f, before) - middle[:, :, None]
        upper = np.einsum("mj,bdmkeo->bdjkeo", chain, upper)
        lower = np.einsum("mj,mkeo->jkeo", chain, lower)
        upper = np.einsum("abm,bdmkeo->admkeo", f, upper)
        upper += shift[:, :, :, None, None] * lower
        cross = upper[0].sum(axis=1)
        joint[:, h, :, :h] = cross.transpose(3, 0, 1, 2)
        joint[:, :h, :, h] = cross.transpose(3, 1, 2, 0)
        gap = modes.state - middle[:, :, None]
        here, weight = gap[0].swapaxes(0, 1), modes.weight[:, None]
        square = modes.covariance[:, :, 0].swapaxes(2, 3) + gap[..., None, :] * here
        own = weight * square
        joint[:, h, :, h] = own[0].sum(axis=1).transpose(2, 0, 1)
        upper = np.concatenate([upper, own[:, :, :, None]], axis=3)
        lower = np.concatenate([lower, (weight * here)[:, None]], axis=1)
    whole = joint.reshape(count, further * size, further * size)
    whole = cut_steps(whole, steps, size, start.late)[:, None]
    whole[start.unseen] = NEVER_SEEN_SPREAD**2 * np.tile(np.eye(size), (steps, steps))
    return whole
