"""Kalman filters over all obstacles at once: arrays in, arrays out.

The models here treat all axes alike and apart: F = f kron I and Q = q kron I, with f and q
the (s, s) matrices of one axis and the state ordered (position, velocity, ...), each of D
components. Then, in the principal axes of its measurement noise, an obstacle is D filters
with one scalar measurement each. Covariances do not depend on what is measured but only on
when and how well, so that they are computed once for all axes with the same noise and the
same missing samples.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from ...framework.values.forecast import Forecast
from ...framework.values.tracks import Tracks
from .assembly import Gaussians, finish
from .history import Histories, IntArray
from .propagation import after, readings, step_covariances, step_joint


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
    log_likelihood : (O,), of all samples after the first one, log densities in 1/m.
    """

    state: Array
    covariance: Array
    log_likelihood: Array


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
        zero = np.zeros((count, order * size))
        return Filtered(zero, started(noise, model), np.zeros(count))
    variance, vectors = np.linalg.eigh(noise)
    local = (past.positions @ vectors).transpose(1, 0, 2).reshape(rows, count * size)
    seen = np.repeat(past.observed, size, axis=0)
    first, which = _distinct(variance.ravel(), seen)
    tables = _Tables.computed(variance.ravel()[first], seen[first], model)
    began = np.repeat(past.began, size)
    state, surprise = _filter_means(local, began, tables, which, model.transition)
    each = surprise + tables.constant[which]
    covariance = tables.covariance[which].reshape(count, size, order, order)
    back = vectors[:, None] * covariance.transpose(0, 2, 3, 1).reshape(count, -1, 1, size)
    whole = (back @ vectors.swapaxes(1, 2)[:, None]).reshape(count, order, order, size, size)
    return Filtered(
        np.einsum("oij,ojs->osi", vectors, state.reshape(count, size, order)).reshape(count, -1),
        whole.transpose(0, 1, 3, 2, 4).reshape(count, order * size, order * size),
        -0.5 * each.reshape(count, size).sum(axis=1),
    )


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

    gain : (T, s, U), 0 where nothing is measured.
    precision : (T, U), 1/m^2, inverse variance of the innovation, 0 as above.
    constant : (U,), sum of log(2 pi S) over the measured samples.
    covariance : (U, s, s) at the last sample.
    """

    gain: Array
    precision: Array
    constant: Array
    covariance: Array

    @classmethod
    def computed(cls, variance: Array, seen: BoolArray, model: AxisModel) -> "_Tables":
        """Run the covariance recursion for noise variances (U,) and samples (U, T)."""
        kinds, rows = seen.shape
        start = started(variance[:, None, None], model).transpose(1, 2, 0)
        began = np.where(seen.any(axis=1), np.argmax(seen, axis=1), rows)
        gain, precision = np.zeros((rows, len(start), kinds)), np.zeros((rows, kinds))
        constant, covariance = np.zeros(kinds), start
        for k in range(rows):
            covariance = advanced(covariance, model.transition, model.process)
            step, total, measured = scalar_update(covariance, 0, variance)
            used = seen[:, k] & (k > began)
            covariance = np.where(used, measured, covariance)
            covariance = np.where(k > began, covariance, start)
            gain[k] = np.where(used, step, 0.0)
            precision[k] = np.where(used, 1.0 / total, 0.0)
            constant += np.where(used, np.log(2 * np.pi * total), 0.0)
        return cls(gain, precision, constant, covariance.transpose(2, 0, 1))


def _filter_means(
    measured: Array, began: IntArray, tables: _Tables, which: IntArray, transition: Array
) -> tuple[Array, Array]:
    """States (B, s) after all samples (T, B), and the sum of squared innovations over S."""
    rows, count = measured.shape
    kind = which if tables.gain.shape[2] > 1 else slice(None)  # one kind needs no look-up
    state = np.zeros((len(transition), count))
    surprise = np.zeros(count)
    latest = int(began.max())
    for k in range(rows):
        state = transition @ state
        gap = measured[k] - state[0]
        surprise += gap**2 * tables.precision[k][kind]
        state += tables.gain[k][:, kind] * gap
        if k <= latest:
            fresh = k <= began
            state[:, fresh] = 0.0
            state[0, fresh] = measured[k, fresh]
            surprise[fresh] = 0.0
    return state.T, surprise


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


def _tracked(filtered: Filtered, tracker: Array, known: BoolArray) -> tuple[Array, Array]:
    """States and covariances, with the tracker's position and covariance where known."""
    state, start = filtered.state.copy(), filtered.covariance.copy()
    both = tracker.shape[1]
    state[known, : both // 2] = 0.0
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
    of the filter's own for position and velocity; only the mean of the velocity (the tracks
    do not carry it) and components beyond it come from the filter.
    """
    state, start = filtered.state, filtered.covariance
    size = tracks.dimension
    if tracks.state_covariance is not None:
        state, start = _tracked(filtered, tracks.state_covariance, past.samples > 1)
    whole = on_all_axes(model.transition, size), on_all_axes(model.process, size)
    ahead = steps + int(past.late.max(initial=0))
    moved = np.einsum("nds,os->ond", readings(whole[0], size, ahead), state)
    spread = step_covariances(*whole, start, size, ahead)
    mean = past.origin[:, None] + after(moved, steps, past.late)
    joint = partial(step_joint, *whole, start, size, steps, past.late)
    own = Gaussians(mean, after(spread, steps, past.late), (None,) * len(tracks), joint)
    return finish(own, past, tracks, name)
