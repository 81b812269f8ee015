"""Extended and unscented Kalman filters of turning bodies, all obstacles at once.

State (x, y, theta, v, omega): place m, heading rad, speed m/s, yaw rate rad/s. The heading is
never measured and never compared, only turned, so that nothing here wraps angles.

The batch axis is the first one of every array, and the last one in memory (`_columns`): sums
over five components then run along memory, where NumPy is fast.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...framework.values.arrays import Array
from .history import Histories

STATES = 5
SPREAD_WEIGHT = 2.0
"""Weight of the central sigma point in covariances (beta; 2 is best for a Gaussian)."""

Step: TypeAlias = "Callable[[Array, Array, TurnModel], tuple[Array, Array, Array]]"
"""From states (B, 5) and covariances (B, 5, 5) to both one step on, and the (B, 5, 5) matrix A
with Cov(s_{k+1}, s_k) = A Cov(s_k)."""


@dataclass(frozen=True, eq=False)
class TurnModel:
    """Steps along arcs whose speed and yaw rate are disturbed by white noise.

    Attributes
    ----------
    dt : s.
    speed_process : (2, 2), covariance of what noise adds to (way along the heading, speed).
    turn_transition : (2, 2), of (heading, yaw rate): [[1, c], [0, e]]. A lasting yaw rate has
        c = dT and e = 1.
    turn_process : (2, 2), covariance of what noise adds to (heading, yaw rate).
    """

    dt: float
    speed_process: Array
    turn_transition: Array
    turn_process: Array

    def moved(self, state: Array) -> Array:
        """States (..., 5) one step on, without noise.

        With u = c omega / 2, half of the turn, the chord of the arc is v dT sin(u) / u long
        and leads along theta + u: the textbook's v / omega (sin(theta + omega dT) - sin(theta))
        without its division by zero on a straight line.
        """
        turn, kept = self.turn_transition[:, 1]
        half = 0.5 * turn * state[..., 4]
        chord = self.dt * state[..., 3] * _sinc(half)
        after = np.array(state)
        after[..., 0] += chord * np.cos(state[..., 2] + half)
        after[..., 1] += chord * np.sin(state[..., 2] + half)
        after[..., 2] += 2.0 * half
        after[..., 4] *= kept
        return after

    def jacobian(self, state: Array) -> Array:
        """Return the derivative of `moved`, (B, 5, 5), for states (B, 5)."""
        turn = self.turn_transition[0, 1]
        half = 0.5 * turn * state[:, 4]
        length, slope = self.dt * _sinc(half), self.dt * _sinc_slope(half)
        speed, angle = state[:, 3], state[:, 2] + half
        along, aside = np.cos(angle), np.sin(angle)
        matrix = _columns(np.tile(np.eye(STATES), (len(state), 1, 1)))
        matrix[:, 0, 2], matrix[:, 1, 2] = -speed * length * aside, speed * length * along
        matrix[:, 0, 3], matrix[:, 1, 3] = length * along, length * aside
        reach = 0.5 * turn * speed
        matrix[:, 0, 4] = reach * (slope * along - length * aside)
        matrix[:, 1, 4] = reach * (slope * aside + length * along)
        matrix[:, 2:5:2, 2:5:2] = self.turn_transition
        return matrix

    def process(self, state: Array) -> Array:
        """Covariance of the noise of one step, (B, 5, 5), at the headings of states (B, 5)."""
        along = np.stack([np.cos(state[:, 2]), np.sin(state[:, 2])])
        (way, both), (_, speed) = self.speed_process
        noise = np.zeros((STATES, STATES, len(state)))
        noise[:2, :2] = way * along[:, None] * along
        noise[:2, 3] = noise[3, :2] = both * along
        noise[3, 3] = speed
        noise[2::2, 2::2] = self.turn_process[..., None]
        return np.moveaxis(noise, 2, 0)


def _columns(array: Array) -> Array:
    """Return the array with its first axis last in memory; free where it already is."""
    return np.moveaxis(np.ascontiguousarray(np.moveaxis(array, 0, -1)), -1, 0)


def _sinc(angle: Array) -> Array:
    """sin(u) / u."""
    return np.asarray(np.sinc(angle / np.pi))


def _sinc_slope(angle: Array) -> Array:
    """Return the derivative of sin(u) / u, by its series where the closed form cancels."""
    small = np.abs(angle) < 1e-2
    safe = np.where(small, 1.0, angle)
    series = -angle / 3 * (1 - angle**2 / 10 * (1 - angle**2 / 28))
    return np.where(small, series, (np.cos(safe) - np.sin(safe) / safe) / safe)


def extended_step(state: Array, covariance: Array, model: TurnModel) -> tuple[Array, Array, Array]:
    """Predict by linearisation, P -> A P A' + Q with A the Jacobian; see `Step`."""
    slope = model.jacobian(state)
    half = np.einsum("bij,bjk->bik", slope, covariance)
    spread = np.einsum("bik,blk->bil", half, slope) + model.process(state)
    return model.moved(state), spread, slope


def unscented_step(
    state: Array, covariance: Array, model: TurnModel
) -> tuple[Array, Array, Array]:
    """Predict by sigma points; see `Step`.

    The 2 * 5 points s +- sqrt(5) L_i, L L' = P (Cholesky), weigh 1/10 each and the centre 0 in
    the mean and `SPREAD_WEIGHT` in the covariance (Merwe's scaled points with alpha 1, kappa 0):
    no weight is negative, so that covariances stay positive semi-definite. A is the
    regression of the points after the step on those before it.
    """
    root = floored_root(covariance)
    offsets = np.sqrt(STATES) * root.swapaxes(1, 2)
    points = model.moved(state[:, None] + np.stack([offsets, -offsets]))
    mean = points.sum(axis=(0, 2)) / (2 * STATES)
    centre = model.moved(state) - mean
    gaps = points - mean[:, None]
    spread = np.einsum("cbki,cbkj->bij", gaps, gaps) / (2 * STATES)
    spread += SPREAD_WEIGHT * centre[:, :, None] * centre[:, None, :]
    # Cov(before, after) = L G with G the halved differences, so that A' = (L L')^-1 L G.
    slope = (points[0] - points[1]) * (0.5 / np.sqrt(STATES))
    for k in reversed(range(STATES)):
        slope[:, k] -= np.einsum("bj,bji->bi", root[:, k + 1 :, k], slope[:, k + 1 :])
        slope[:, k] /= root[:, k, k, None]
    return mean, spread + model.process(state), slope.swapaxes(1, 2)


def floored_root(covariance: Array) -> Array:
    """Lower triangular L with L L' = P, (B, S, S), whatever rounding has done to P.

    Cholesky's recursion, with pivots of at least 1e-14 of the diagonal entry: one covariance
    that is singular must not stop all others, as it would in `numpy.linalg.cholesky`. Below a
    pivot, entries obey L_ij^2 <= P_ii as those of every root do; divided by a pivot that rounding
    has made too small they would grow from step to step.
    """
    states = covariance.shape[-1]
    covariance = _columns(covariance)
    root = np.zeros_like(covariance)
    most = np.sqrt(np.maximum(np.einsum("bii->bi", covariance), np.finfo(np.float64).tiny))
    for j in range(states):
        rest = covariance[:, j:, j] - np.einsum("bik,bk->bi", root[:, j:, :j], root[:, j, :j])
        floor = np.maximum(1e-14 * covariance[:, j, j], np.finfo(np.float64).tiny)
        pivot = np.sqrt(np.maximum(rest[:, 0], floor))
        root[:, j:, j] = np.clip(rest / pivot[:, None], -most[:, j:], most[:, j:])
        root[:, j, j] = pivot
    return root


def position_update(
    state: Array, covariance: Array, measured: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """State (B, 5) and covariance after a position (B, 2) with noise (B, 2, 2); Joseph's form.

    The measurement is linear in the state: the same for both filters. Also returned is the
    innovation squared in units of its covariance S, y' S^-1 y, (B,); 2 is to be expected.
    """
    precision = _inverse(covariance[:, :2, :2] + noise)
    gain = np.einsum("bsd,bde->bse", covariance[:, :, :2], precision)
    kept = covariance - np.einsum("bsd,bdt->bst", gain, covariance[:, :2])
    rest = kept[:, :, :2] - np.einsum("bsd,bde->bse", gain, noise)
    after = kept - np.einsum("bsd,btd->bst", rest, gain)
    gap = measured - state[:, :2]
    moved = np.einsum("bsd,bd->bs", gain, gap)
    surprise = np.einsum("bi,bij,bj->b", gap, precision, gap)
    return state + moved, 0.5 * (after + after.swapaxes(1, 2)), surprise


def _inverse(matrix: Array) -> Array:
    """Inverse of positive definite matrices (B, 2, 2), even where rounding made them singular.

    As in `floored_root`, the determinant is at least 1e-14 of the product of the diagonal.
    """
    first, cross, second = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    adjugate = np.stack([np.stack([second, -cross]), np.stack([-cross, first])])
    product = first * second
    return np.moveaxis(adjugate / np.maximum(product - cross**2, 1e-14 * product), 2, 0)


def filter_turns(
    past: Histories, noise: Array, start: tuple[Array, Array], model: TurnModel, step: Step
) -> tuple[Array, Array, Array]:
    """States (O, 5) and covariances (O, 5, 5) at the newest observed samples, and the fit.

    The fit is the mean of y' S^-1 y / 2 over all samples after the first one, (O,): 1 where
    the model is true.

    Parameters
    ----------
    past : histories in the plane; missing samples are predicted over.
    noise : (O, 2, 2), m^2, of one measurement.
    start : states and covariances at the first samples.
    """
    first, wide = _columns(start[0]), _columns(start[1])
    noise, places = _columns(noise), _columns(past.positions)
    state, covariance = first, wide
    total, used = np.zeros(len(state)), np.zeros(len(state))
    for column in range(past.positions.shape[1]):
        ahead, spread, _ = step(state, covariance, model)
        state, covariance, surprise = position_update(ahead, spread, places[:, column], noise)
        seen, fresh = past.observed[:, column], column <= past.began
        total += np.where(seen & ~fresh, surprise, 0.0)
        used += seen & ~fresh
        if not seen.all():
            state = np.where(seen[:, None], state, ahead)
            covariance = np.where(seen[:, None, None], covariance, spread)
        if fresh.any():
            state = np.where(fresh[:, None], first, state)
            covariance = np.where(fresh[:, None, None], wide, covariance)
    return state, covariance, total / np.maximum(2.0 * used, 1.0)
