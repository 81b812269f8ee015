"""Kalman filters over all obstacles at once: arrays in, arrays out.

The models here treat all axes alike and apart: F = f kron I and Q = q kron I, with f and q
the (s, s) matrices of one axis and the state ordered (position, velocity, ...), each of D
components. Then, in the principal axes of its measurement noise, an obstacle is D filters
with one scalar measurement each. Covariances do not depend on what is measured but only on
when and how well, so that they are computed once for all axes with the same noise and the
same missing samples, and kept for the next call: as long as nothing is missed, the samples
counted from an obstacle's first one are the same for all obstacles and at all calls.
"""

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from ...framework.values.forecast import Forecast
from ...framework.values.tracks import Tracks
from .assembly import Gaussians, finish
from .history import Histories, IntArray
from .propagation import Growth, after, step_joint


@dataclass(frozen=True, eq=False)
class AxisModel:
    """How one axis moves: s_{k+1} = f s_k + w, w ~ N(0, q), the position first.

    Attributes
    ----------
    transition : (s, s), f.
    process : (s, s), q.
    start : (s - 1,), variances of velocity, ... at the first sample, where their mean is 0.
    """

    transition: Array
    process: Array
    start: Array


@dataclass(frozen=True, eq=False)
class Filtered:
    """Filtered state of each obstacle at its newest observed sample.

    Attributes
    ----------
    state : (O, s*D): position relative to the origin of the history, velocity, ...
    covariance : (O, s*D, s*D).
    """

    state: Array
    covariance: Array


def filter_axes(past: Histories, noise: Array, model: AxisModel) -> Filtered:
    """Filter all histories from the first sample on; missing samples are only predicted.

    The first sample starts the filter: position z_0 with covariance R, the rest 0 with the
    variances of the model.

    Parameters
    ----------
    past : histories; what was filled in is not used.
    noise : (O, D, D), m^2, positive definite, R.
    model : of one axis.
    """
    count, rows, size = past.positions.shape
    order = len(model.transition)
    if rows == 0 or count == 0:
        return Filtered(np.zeros((count, order * size)), started(noise, model))
    variance, vectors = _axes(noise)
    local = (past.positions @ vectors).transpose(1, 0, 2).reshape(rows, count * size)
    began = np.repeat(past.began, size)
    spread, seen = variance.ravel(), _from_the_first(past)
    if seen.all():  # the usual case: axes differ by their noise alone
        spread, which = _different(spread)
        seen = np.ones((len(spread), rows), dtype=np.bool_)
    else:
        seen = np.repeat(seen, size, axis=0)
        first, which = _distinct(spread, seen)
        spread, seen = spread[first], seen[first]
    tables = _tables(spread.tobytes(), seen.tobytes(), rows, model)
    state = _filter_means(local, began, tables, which, model.transition)
    covariance = tables.covariance[np.maximum(rows - 1 - began, 0), which]
    covariance = covariance.reshape(count, size, order, order)
    back = vectors[:, None] * covariance.transpose(0, 2, 3, 1).reshape(count, -1, 1, size)
    whole = (back @ vectors.swapaxes(1, 2)[:, None]).reshape(count, order, order, size, size)
    return Filtered(
        np.einsum("oij,ojs->osi", vectors, state.reshape(count, size, order)).reshape(count, -1),
        whole.transpose(0, 1, 3, 2, 4).reshape(count, order * size, order * size),
    )


def _different(spread: Array) -> tuple[Array, IntArray]:
    """Return the different numbers among some, and which of them each is."""
    if (spread == spread[0]).all():
        return spread[:1], np.zeros(len(spread), dtype=np.int64)
    found, which = np.unique(spread, return_inverse=True)
    return found, which.astype(np.int64)


def _axes(noise: Array) -> tuple[Array, Array]:
    """Eigenvalues and eigenvectors of each; once where all are the same, as of one sensor."""
    if not (noise == noise[0]).all():
        return np.linalg.eigh(noise)
    variances, axes = np.empty(noise.shape[:2]), np.empty(noise.shape)
    variances[...], axes[...] = _axes_of_one(noise[0].tobytes(), noise.shape[1])
    return variances, axes


@lru_cache(maxsize=16)
def _axes_of_one(noise: bytes, size: int) -> tuple[Array, Array]:
    """Return those of one covariance (D, D), kept for the next call."""
    values, vectors = np.linalg.eigh(np.frombuffer(noise).reshape(size, size))
    return values, vectors


def on_all_axes(matrix: Array, size: int) -> Array:
    """Matrix of the whole state from that of one axis, m kron I, (s*D, s*D)."""
    return np.asarray(np.kron(matrix, np.eye(size)), dtype=np.float64)


def started(noise: Array, model: AxisModel) -> Array:
    """Covariance at the first sample, blkdiag(R, start kron I), (O, s*D, s*D)."""
    count, size = noise.shape[:2]
    total = len(model.transition) * size
    covariance = np.zeros((count, total, total))
    covariance[:, :size, :size] = noise
    covariance[:, size:, size:] = on_all_axes(np.diag(model.start), size)
    return covariance


def _from_the_first(past: Histories) -> BoolArray:
    """Whether each sample counted from an obstacle's first one was observed, (O, T).

    What lies beyond the newest one counts as observed: it is not reached.
    """
    rows = past.observed.shape[1]
    if not past.began.any():
        return past.observed
    column = past.began[:, None] + np.arange(rows)
    known = past.observed[np.arange(len(column))[:, None], np.minimum(column, rows - 1)]
    return np.asarray(known | (column >= rows), dtype=np.bool_)


def _distinct(variance: Array, seen: BoolArray) -> tuple[IntArray, IntArray]:
    """First index of each distinct pair (variance, row of ``seen``), and which one each is."""
    bits = np.packbits(seen, axis=1)
    keys = np.concatenate([variance[:, None].view(np.uint8), bits], axis=1)
    packed = np.ascontiguousarray(keys).view(np.dtype((np.void, keys.shape[1])))[:, 0]
    _, first, which = np.unique(packed, return_index=True, return_inverse=True)
    return first.astype(np.int64), which.astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Tables:
    """Gains and covariances, which do not depend on measured values, for U kinds of axes.

    Rows are samples counted from the first one of a history.

    gain : (T, s, U), 0 where nothing is measured, and at the first sample.
    covariance : (T, U, s, s), after each sample.
    """

    gain: Array
    covariance: Array


@lru_cache(maxsize=4)
def _tables(variance: bytes, seen: bytes, rows: int, model: AxisModel) -> _Tables:
    """Run the covariance recursion for noise variances (U,) and samples (U, T).

    Kept by what it depends on, the model by identity.
    """
    noise = np.frombuffer(variance)
    used = np.frombuffer(seen, dtype=np.bool_).reshape(len(noise), rows)
    covariance = started(noise[:, None, None], model).transpose(1, 2, 0)
    gain = np.zeros((rows, len(covariance), len(noise)))
    found = [covariance]
    for k in range(1, rows):
        covariance = advanced(covariance, model.transition, model.process)
        step, _, measured = scalar_update(covariance, 0, noise)
        covariance = np.where(used[:, k], measured, covariance)
        gain[k] = np.where(used[:, k], step, 0.0)
        found.append(covariance)
    return _Tables(gain, np.stack(found).transpose(0, 3, 1, 2))


def _filter_means(
    measured: Array, began: IntArray, tables: _Tables, which: IntArray, transition: Array
) -> Array:
    """States (B, s) after all samples (T, B).

    The gain is 0 up to the first sample, so that a filter stays there until it begins.
    """
    rows, count = measured.shape
    if tables.gain.shape[2] == 1 and not began.any():  # the usual case needs no look-up
        gain = tables.gain
    else:
        since = np.maximum(np.arange(rows)[:, None] - began, 0)
        kinds = tables.gain.shape[2]
        flat = tables.gain.transpose(0, 2, 1).reshape(rows * kinds, -1)
        gain = flat.take(since * kinds + which, axis=0).transpose(0, 2, 1)
    state, moved = np.zeros((2, len(transition), count))
    gap, change, ahead = np.empty(count), np.empty_like(state), moved[0]
    product, subtract, multiply, add = transition.dot, np.subtract, np.multiply, np.add
    state[0] = measured[np.minimum(began, rows - 1), np.arange(count)]
    for share, place in zip(gain[1:], measured[1:], strict=True):
        product(state, moved)
        subtract(place, ahead, gap)
        multiply(share, gap, change)
        add(moved, change, state)
    return state.T


def advanced(covariance: Array, transition: Array, process: Array) -> Array:
    """Covariances one step on, F P F' + Q, for P of (S, S, B) that share F and Q."""
    shape = covariance.shape
    half = (transition @ covariance.reshape(shape[0], -1)).reshape(shape)
    turned = transition @ half.swapaxes(0, 1).reshape(shape[0], -1)
    return np.asarray(turned.reshape(shape) + process[:, :, None])


def scalar_update(
    covariance: Array, component: int, variance: Array
) -> tuple[Array, Array, Array]:
    """Gain (S, ...), innovation variance (...) and covariance after measuring one component.

    K = P h / S,  S = h' P h + r,  P+ = (I - K h') P (I - K h')' + r K K'

    (Joseph's form: it stays positive semi-definite but for rounding; after jumps of 1e9 m that
    is larger than r, so that h' P h is cut at 0.)

    Parameters
    ----------
    covariance : (S, S, ...), P.
    component : of the state that is measured; h is its unit vector.
    variance : (...), r.
    """
    column = covariance[:, component]
    total = np.maximum(column[component], 0.0) + variance
    gain = column / total
    kept = covariance - gain[:, None] * column
    joseph = kept - (kept[:, component] - variance * gain)[:, None] * gain
    return gain, total, joseph


def measured_update(
    state: Array, covariance: Array, measured: Array, variance: Array
) -> tuple[Array, Array, Array]:
    """Update with one position with independent errors on its axes, one axis after the other.

    Parameters
    ----------
    state, covariance : (S, ...) and (S, S, ...) before it; the position comes first.
    measured, variance : D arrays that fit (...), m and m^2.

    Returns
    -------
    State and covariance after it, and the log density of the measurement, (...).
    """
    density = np.zeros(state.shape[1:])
    for axis, (place, spread) in enumerate(zip(measured, variance, strict=True)):
        gain, total, covariance = scalar_update(covariance, axis, spread)
        gap = place - state[axis]
        state = state + gain * gap
        density = density - 0.5 * (np.log(2 * np.pi * total) + gap**2 / total)
    return state, covariance, density


def _tracked(
    filtered: Filtered, tracker: Array, velocity: Array | None, samples: IntArray
) -> tuple[Array, Array]:
    """States and covariances, with the tracker's own where the velocity is known."""
    state, start = filtered.state.copy(), filtered.covariance.copy()
    both = tracker.shape[1]
    known = samples > (1 if velocity is None else 0)
    state[known, : both // 2] = 0.0
    if velocity is not None:
        state[known, both // 2 : both] = velocity[known]
    start[known, :both, both:] = 0.0
    start[known, both:, :both] = 0.0
    start[known, :both, :both] = tracker[known]
    return state, start


def roll_out(
    filtered: Filtered, model: AxisModel, past: Histories, tracks: Tracks, steps: int, name: str
) -> Forecast:
    """Forecast from filtered states; exact for the model, Cov(s_j, s_h) = F^(j-h) P_h.

    Where the tracks carry a tracker's ``state_covariance``, their positions are estimates
    that hold all earlier measurements, with errors that are not independent as R takes them
    to be. The newest one is then the position, and the tracker's covariance takes the place
    of the filter's own for position and velocity. The mean of the velocity is the tracker's
    where the tracks carry it, else the filter's, as components beyond it always are.
    """
    state, start = filtered.state, filtered.covariance
    size = tracks.dimension
    if tracks.state_covariance is not None:
        tracker = tracks.state_covariance
        state, start = _tracked(filtered, tracker, tracks.velocity, past.samples)
    growth = _growth(model, size, steps + int(past.late.max(initial=0)))
    moved = np.einsum("nds,os->ond", growth.reads, state)
    spread = growth.covariances(start)
    mean = past.origin[:, None] + after(moved, steps, past.late)
    whole = growth.transition, growth.process
    joint = partial(step_joint, *whole, start, size, steps, past.late)
    own = Gaussians(mean, after(spread, steps, past.late), (None,) * len(tracks), joint)
    return finish(own, past, tracks, name)


@lru_cache(maxsize=16)
def _growth(model: AxisModel, size: int, steps: int) -> Growth:
    """Return how all axes together grow, kept for the next call; the model by identity."""
    whole = on_all_axes(model.transition, size), on_all_axes(model.process, size)
    return Growth.of(*whole, size, steps)
