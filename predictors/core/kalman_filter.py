"""Kalman filters of all obstacles at once, each measurement at its own time.

Notation: O obstacles, M modes (models that may be in force), D coordinates, s components of the
state along one axis (position, velocity, ...), N steps. All axes move alike and apart: a mode
moves the components of an axis by f (s, s) and adds noise of covariance q (s, s). One mode is the
plain Kalman filter, several are interacting multiple models (IMM). Obstacles are the last axis:
sums over few components then run along memory.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import NamedTuple

import numpy as np

from ...framework.values.arrays import Array, BoolArray, assembled
from ...framework.values.beliefs import Beliefs
from ...framework.values.forecast import Forecast
from ...framework.values.measurements import IntArray, Measurements
from ...framework.values.tracks import ON_GRID, Tracks
from .assembly import NEVER_SEEN_SPREAD
from .history import LONGEST_GAP, floored, gather
from .propagation import after, cut_steps

FAINTEST = -690.0
"""Least logarithm of a mode's probability over that of the likeliest one: 1e-300."""
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


def mixed(modes: ModeStates, switching: Array) -> ModeStates:
    """Return the modes just before the next step, by the mode that will be in force.

    c_j = sum_i pi_ij mu_i,   omega_ij = pi_ij mu_i / c_j,
    x_0j = sum_i omega_ij x_i,   P_0j = sum_i omega_ij (P_i + (x_i - x_0j)(x_i - x_0j)')
    """
    if len(modes.weight) == 1:
        return modes
    share = switching * modes.weight[:, None]
    weight = share.sum(axis=0)
    share /= weight
    state = np.einsum("ijo,sdio->sdjo", share, modes.state)
    gap = modes.state[:, :, :, None] - state[:, :, None]
    covariance = np.einsum("ijo,sdteio->sdtejo", share, modes.covariance)
    covariance += np.einsum("sdijo,teijo->sdtejo", share * gap, gap)
    return ModeStates(weight, state, covariance)


def moved(modes: ModeStates, step: ModeStep) -> ModeStates:
    """Return the modes one step on: mixed, then predicted by each mode, f x and f P f' + q."""
    weight, state, covariance = mixed(modes, step.switching)
    half = _applied(step.transition, covariance).transpose(2, 3, 0, 1, 4, 5)
    spread = _applied(step.transition, half)  # f (f P)' = f P f'
    for axis in range(state.shape[1]):
        spread[:, axis, :, axis] += step.process
    return ModeStates(weight, _applied(step.transition, state), spread)


def _applied(matrix: Array, values: Array) -> Array:
    """Multiply the first axis of values (s, ..., M, O) by a matrix of each mode, (s, s, M, L)."""
    if matrix.shape[-1] > 1:
        return np.asarray(np.einsum("abmo,b...mo->a...mo", matrix, values))
    modes_first = values.transpose(-2, *range(values.ndim - 2), -1)
    flat = modes_first.reshape(*modes_first.shape[:2], -1)
    product = (matrix[..., 0].transpose(2, 0, 1) @ flat).reshape(modes_first.shape)
    return product.transpose(*range(1, values.ndim - 1), 0, -1)


def updated(modes: ModeStates, place: Array, whitening: Array) -> ModeStates:
    """Return the modes after one measured position, mu_j = c_j Lambda_j / sum of them.

    With W' W = R^-1 the D numbers W z have independent errors of variance 1, and are taken one
    after the other, h = a row of W:

    K = P h / S,  S = h' P h + 1,  P+ = (I - K h') P (I - K h')' + K K'

    (Joseph's form: it stays positive semi-definite but for rounding; after jumps of 1e9 m that
    is larger than 1, so that h' P h is cut at 0.)

    Parameters
    ----------
    place : (D, O), m, relative to the origins.
    whitening : (D, D, O), W, lower triangular, 1/m.
    """
    state, covariance = modes.state, modes.covariance
    alone, evidence = len(modes.weight) == 1, np.zeros(modes.weight.shape)
    for h, measured in zip(whitening, np.einsum("abo,bo->ao", whitening, place), strict=True):
        column = np.einsum("semdo,do->semo", covariance[:, :, 0].transpose(0, 1, 3, 2, 4), h)
        total = np.maximum(np.einsum("dmo,do->mo", column[0], h), 0.0) + 1.0
        gain = column / total
        gap = measured - np.einsum("dmo,do->mo", state[0], h)
        state = state + gain * gap
        kept = covariance - gain[:, :, None, None] * column
        rest = np.einsum("semdo,do->semo", kept[:, :, 0].transpose(0, 1, 3, 2, 4), h) - gain
        covariance = kept - rest[:, :, None, None] * gain
        if not alone:
            evidence -= 0.5 * (np.log(total) + gap**2 / total)
    if alone:
        return ModeStates(modes.weight, state, covariance)
    # No mode becomes impossible: one that weighs nothing at all could never come back, and
    # after steps much longer than the dwell time nothing would lead to the others.
    logarithm = np.log(modes.weight) + evidence
    weight = np.exp(np.maximum(logarithm - logarithm.max(axis=0), FAINTEST))
    return ModeStates(weight / weight.sum(axis=0), state, covariance)


def whitened(noise: Array) -> Array:
    """Return W, lower triangular, with W' W = R^-1, (D, D, O), for positive definite R."""
    size = len(noise)
    root, inverse = np.zeros_like(noise), np.zeros_like(noise)
    for j in range(size):
        rest = noise[j:, j] - (root[j:, :j] * root[j, :j]).sum(axis=1)
        root[j:, j] = rest / np.sqrt(rest[0])
    for j in range(size):
        inverse[j, j] = 1.0 / root[j, j]
        for i in range(j + 1, size):
            inverse[i, j] = -(root[i, j:i] * inverse[j:i, j]).sum(axis=0) / root[i, i]
    return inverse


def _whitening(noise: Array, floor: float) -> Array:
    """Return W, (D, D, O), of floored covariances (O, D, D); one where all are the same."""
    if (noise == noise[0]).all():
        return _same_whitening(noise[0].tobytes(), noise.shape[1], floor)
    return whitened(floored(noise, floor).transpose(1, 2, 0))


@lru_cache(maxsize=64)
def _same_whitening(noise: bytes, size: int, floor: float) -> Array:
    return whitened(floored(np.frombuffer(noise).reshape(size, size), floor)[..., None])


class Round(NamedTuple):
    """The next measurement of each obstacle that has one.

    Attributes
    ----------
    rows : (R,), of the obstacles, increasing.
    time : (R,), s, of the measurements.
    lag : (R,), s, since the last one of the same obstacle; inf where the filter begins with it.
    place : (R, D), m. noise : (R, D, D), m^2.
    """

    rows: IntArray
    time: Array
    lag: Array
    place: Array
    noise: Array

    def where(self, chosen: BoolArray) -> "Round":
        """Return the measurements where a mask (R,) is True."""
        if chosen.all():
            return self
        numbers = self.time, self.lag, self.place, self.noise
        return Round(self.rows[chosen], *(part[chosen] for part in numbers))


def rounds(
    sightings: Measurements, first: IntArray, newest: Array, pause: float
) -> Iterator[Round]:
    """Deal out the measurements that were not used yet, the oldest of each obstacle first.

    Parameters
    ----------
    sightings : of all obstacles.
    first : (O,), index of the first one of each that was not used.
    newest : (O,), s, time of the newest one that was; -inf without any.
    pause : s; after a longer one a filter begins anew.
    """
    number = sightings.count - first
    rows = np.flatnonzero(number)
    if not rows.size:
        return
    begins = list(zip(rows.tolist(), first[rows].tolist(), strict=True))
    times = np.concatenate([sightings.times[row][begin:] for row, begin in begins])
    values = np.concatenate([sightings.values[row][begin:] for row, begin in begins])
    size = sightings.size
    places, noise = values[:, :size], values[:, size:].reshape(-1, size, size)
    number, last = number[rows], newest[rows]
    index = np.cumsum(number) - number
    for _ in range(int(number.max())):
        time = times[index]
        lag = time - last
        lag[lag > pause] = np.inf
        yield Round(rows, time, lag, places[index], noise[index])
        more = number > 1
        rows, index, number, last = rows[more], index[more] + 1, number[more] - 1, time[more]


def in_steps(lag: Array, dt: float) -> Iterator[tuple[IntArray, Array]]:
    """Divide times (O,) > 0 into steps of nearly ``dt`` s; whose next step it is, and how long.

    Longer times than `MOST_STEPS` of them are divided into that many.
    """
    number = np.minimum(np.maximum(np.rint(lag / dt), 1.0), MOST_STEPS)
    times = lag / number
    for done in range(int(number.max(initial=0.0))):
        rows = np.flatnonzero(number > done)
        yield rows, times[rows]


def carried(modes: ModeStates, motion: Motion, lag: Array, dt: float) -> ModeStates:
    """Return the modes after times (O,) > 0, s, in steps of nearly ``dt`` s."""
    for rows, times in in_steps(lag, dt):
        modes = modes.replaced(rows, moved(modes.at(rows), _step(motion, times)))
    return modes


def _step(motion: Motion, times: Array) -> ModeStep:
    """Return the step of each time; one for all where they are the same."""
    if (times == times[0]).all():
        return _same_step(motion, float(times[0]))
    return motion.step(times)


@lru_cache(maxsize=64)
def _same_step(motion: Motion, time: float) -> ModeStep:
    return motion.step(np.array([time]))


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
    modes, origin = ModeStates(*values[:3]), values[3]
    modes.weight[:, count == 0] = np.array(motion.usual)[:, None]
    for each in rounds(sightings, first, newest, PAUSE * tracks.dt):
        fresh = np.isinf(each.lag)
        if fresh.any():
            new = each.where(fresh)
            origin[:, new.rows], count[new.rows] = new.place.T, 0
            modes = modes.replaced(new.rows, _begun(new, motion, floor))
        if not fresh.all():
            old = each.where(~fresh)
            ahead = carried(modes.at(old.rows), motion, old.lag, tracks.dt)
            place = old.place.T - origin[:, old.rows]
            now = updated(ahead, place, _whitening(old.noise, floor))
            modes = modes.replaced(old.rows, now)
        newest[each.rows] = each.time
        count[each.rows] += 1
    return Beliefs(sightings.log, newest, count, (*modes, origin))


def _begun(new: Round, motion: Motion, floor: float) -> ModeStates:
    """Return the modes after the first measurement of obstacles."""
    noise, start, number = floored(new.noise, floor), motion.start, len(motion.usual)
    count, size = new.place.shape
    body = len(start) + 1, size
    covariance = np.zeros((*body, *body, number, count))
    covariance[0, :, 0] = noise.transpose(1, 2, 0)[:, :, None]
    for component, variance in enumerate(start, 1):
        covariance[component, range(size), component, range(size)] = variance
    weight = np.repeat(np.array(motion.usual)[:, None], count, axis=1)
    return ModeStates(weight, np.zeros((*body, number, count)), covariance)


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
    modes, step = start.modes, _same_step(start.motion, start.dt)
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
