"""Motion along arcs of varying speed and yaw rate, by an unscented Kalman filter.

State (x, y, theta, v, omega): place m, heading rad, speed m/s, yaw rate rad/s. The heading is
never measured and never compared, only turned, so that nothing here wraps angles.

The batch axis is the first one of every array, and the last one in memory (`_columns`): sums
over five components then run along memory, where NumPy is fast.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_acceleration import singer
from .core.assembly import Gaussians, with_fallback
from .core.history import FILTERED, Histories, IntArray, gather, measurement_noise
from .core.propagation import after, cut_steps, white_acceleration
from .kalman import Kalman

STATES = 5
SPREAD_WEIGHT = 2.0
"""Weight of the central sigma point in covariances (beta; 2 is best for a Gaussian)."""


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


def unscented_step(
    state: Array, covariance: Array, model: TurnModel
) -> tuple[Array, Array, Array]:
    """Predict by sigma points, from states (B, 5) and covariances (B, 5, 5) to both one step on.

    Also returned is the (B, 5, 5) matrix A with Cov(s_{k+1}, s_k) = A Cov(s_k).

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

    The measurement is linear in the state. Also returned is the
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
    past: Histories, noise: Array, start: tuple[Array, Array], model: TurnModel
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
        ahead, spread, _ = unscented_step(state, covariance, model)
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


NEEDED = 3
"""Samples: two give a heading, the third says whether it turns."""
CHORD = 3
"""Steps between the two samples that give the first heading."""
FIRST_HEADING = 0.5
"""rad, standard deviation of the first heading beyond what the measurement noise explains."""
UNKNOWN = np.pi**2 / 3
"""rad^2, variance of a heading of which nothing is known."""
VAGUE = 0.3
"""rad; a heading known less well than that is not known."""
MISFIT = 20.0
"""Squared innovations this many times larger than the model has them on average: it is no
turning body, and the filter, not being linear, answers wildly."""
TINY = 1e-12
"""m, keeps divisions by the way of an obstacle that stands finite."""
NOISE_FLOOR = 0.03
"""m, added in quadrature to the measurement noise."""


@final
@dataclass(frozen=True)
class CoordinatedTurn(Predictor):
    """A Kalman filter on place, heading, speed and yaw rate, rolled out along the arc.

    x' = x + v dT sin(u)/u cos(theta + u),  u = omega dT / 2,   y' likewise with the sine,
    theta' = theta + omega dT,   v' = v + white noise,
    d omega = -omega / turn_time dt + white noise,   E[omega^2] = yaw_rate^2 in the long run

    so that a turn seen now ends after ``turn_time`` (then omega dT stands for the integral of
    the decaying rate). One much longer than the horizon is the constant turn rate of the
    textbook, whose error on recorded people is a third larger: they turn for a step or two.

    It predicts by sigma points (`unscented_step`), while filtering and over the horizon alike.
    The joint covariance over the horizon is that of the chain of linear steps that they make.

    It works in a frame of its own for each obstacle, along the chord of its first samples,
    so that the forecast turns with the world; that chord is also the first heading and
    speed. A tracker's ``state_covariance`` is not used: it knows neither heading nor yaw rate.

    Left to ``fallback``, with the reason: three-dimensional tracks (the model is one of the
    plane), fewer than 3 samples, an obstacle whose heading is not known to 0.3 rad at the
    end, as of one that stands, and one whose squared innovations are 20 times too large.

    It is not fitted: by likelihood, the best numbers are those with which no heading is ever
    known and all is left to the fallback.

    Parameters
    ----------
    acceleration_density : m^2/s^3, of the white acceleration along the heading.
    yaw_rate : rad/s, standard deviation of the yaw rate, whose mean is 0.
    turn_time : s.
    speed : m/s, standard deviation of the first speed.
    fallback : predictor for the others.

    Raises
    ------
    WideberthError : a number that is not positive.

    References
    ----------
    R. Schubert, E. Richter and G. Wanielik, "Comparison and Evaluation of Advanced Motion
    Models for Vehicle Tracking", 2008; R. van der Merwe, "Sigma-Point Kalman Filters", 2004.
    """

    acceleration_density: float = 0.02
    yaw_rate: float = 0.3
    turn_time: float = 0.5
    speed: float = 1.0
    fallback: Predictor = field(default_factory=Kalman)

    reference: ClassVar[str] = "schubert2008comparison"

    def __post_init__(self) -> None:
        for name in ("acceleration_density", "yaw_rate", "turn_time", "speed"):
            positive(f"coordinated_turn.{name}", getattr(self, name))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        count, size = len(tracks), tracks.dimension
        mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
        reasons: tuple[str | None, ...] = (None,) * count
        if size != 2:
            flat = [f"coordinated_turn: {size} coordinates, needs 2"] * count
            own = Gaussians(mean, covariance, reasons)
            return with_fallback(own, flat, self.fallback, tracks, scene)
        past = gather(tracks, length=FILTERED)
        frame = _frames(past)
        model = self._model(tracks.dt)
        state, start, fit = self._filter(past, frame, tracks, model)
        ahead = steps + int(past.late.max(initial=0))
        moved, spread = _roll_out(state, start, model, ahead)
        moved = np.einsum("oab,onb->ona", frame, moved)
        spread = np.einsum("oab,onbc->onac", frame, spread)
        spread = np.einsum("onac,odc->onad", spread, frame)
        mean = past.origin[:, None] + after(moved, steps, past.late)
        joint = partial(_joint, state, start, frame, model, steps, past.late)
        own = Gaussians(mean, after(spread, steps, past.late), reasons, joint)
        missing = self._missing(past, start, fit)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _model(self, dt: float) -> TurnModel:
        """Return one step of the motion."""
        _, speed_process = white_acceleration(dt, self.acceleration_density, 1)
        transition, process = singer(dt, self.yaw_rate, self.turn_time)
        return TurnModel(dt, speed_process, transition[1:, 1:], process[1:, 1:])

    def _filter(
        self, past: Histories, frame: Array, tracks: Tracks, model: TurnModel
    ) -> tuple[Array, Array, Array]:
        """Filter in the frames; see `filter_turns`."""
        noise = measurement_noise(tracks, NOISE_FLOOR)
        noise = frame.swapaxes(1, 2) @ noise @ frame
        past = replace(past, positions=past.positions @ frame)
        chord, span = _chords(past)
        length = np.linalg.norm(chord, axis=1)
        count, rows = past.observed.shape
        state = np.zeros((count, STATES))
        if rows:
            state[:, :2] = past.positions[np.arange(count), np.minimum(past.began, rows - 1)]
        state[:, 3] = length / (span * tracks.dt)
        covariance = np.zeros((count, STATES, STATES))
        covariance[:, :2, :2] = noise
        doubt = np.trace(noise, axis1=1, axis2=2) / np.maximum(length, TINY) ** 2
        covariance[:, 2, 2] = FIRST_HEADING**2 + np.minimum(doubt, UNKNOWN)
        covariance[:, 3, 3], covariance[:, 4, 4] = self.speed**2, self.yaw_rate**2
        return filter_turns(past, noise, (state, covariance), model)

    def _missing(self, past: Histories, covariance: Array, fit: Array) -> list[str | None]:
        """Why the filter cannot be used, or None, per obstacle."""
        deviation = np.sqrt(covariance[:, 2, 2])
        reasons: list[str | None] = []
        for count, doubt, error in zip(past.samples, deviation, fit, strict=True):
            reason = None
            if count < NEEDED:
                plural = "" if count == 1 else "s"
                reason = f"coordinated_turn: {count} sample{plural}, needs {NEEDED}"
            elif doubt > VAGUE:
                reason = f"coordinated_turn: heading known to {doubt:.2g} rad, needs {VAGUE:g}"
            elif error > MISFIT:
                reason = f"coordinated_turn: innovations {error:.2g} times those of the model"
            reasons.append(reason)
        return reasons


def _chords(past: Histories) -> tuple[Array, Array]:
    """Way from the first sample to one about `CHORD` steps on, (O, 2), m, and the steps, (O,)."""
    count, rows = past.observed.shape
    if rows == 0:
        return np.zeros((count, 2)), np.ones(count)
    row, columns = np.arange(count), np.arange(rows)
    first = np.minimum(past.began, rows - 1)
    later = past.observed & (columns >= first[:, None] + CHORD)
    second = np.where(later.any(axis=1), np.argmax(later, axis=1), rows - 1)
    chord = past.positions[row, second] - past.positions[row, first]
    return chord, np.maximum(second - first, 1).astype(np.float64)


def _frames(past: Histories) -> Array:
    """Rotations from the frame along the first chord to the world, (O, 2, 2)."""
    chord, _ = _chords(past)
    length = np.linalg.norm(chord, axis=1, keepdims=True)
    along = np.where(length > 0, chord / np.maximum(length, TINY), [1.0, 0.0])
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([along, aside], axis=2)


def _roll_out(
    state: Array, covariance: Array, model: TurnModel, steps: int
) -> tuple[Array, Array]:
    """Means (O, N, 2) and covariances (O, N, 2, 2) of the place at each step ahead."""
    moved, spread = np.zeros((len(state), steps, 2)), np.zeros((len(state), steps, 2, 2))
    for h in range(steps):
        state, covariance, _ = unscented_step(state, covariance, model)
        moved[:, h], spread[:, h] = state[:, :2], covariance[:, :2, :2]
    return moved, spread


def _joint(
    state: Array,
    covariance: Array,
    frame: Array,
    model: TurnModel,
    steps: int,
    late: IntArray,
) -> Array:
    """Joint covariance of the places from step late + 1 to late + N, (O, N*2, N*2), m^2.

    Cov(s_{h+1}, s_i) = A_h Cov(s_h, s_i) with the A_h of the filter's own steps.
    """
    count = len(state)
    ahead = steps + int(late.max(initial=0))
    joint = np.zeros((count, ahead, 2, ahead, 2))
    known = np.zeros((count, STATES, 0))
    for h in range(ahead):
        state, covariance, slope = unscented_step(state, covariance, model)
        known = slope @ known
        cross = known[:, :2].reshape(count, 2, h, 2)
        joint[:, h, :, :h] = cross
        joint[:, :h, :, h] = cross.transpose(0, 2, 3, 1)
        joint[:, h, :, h] = covariance[:, :2, :2]
        known = np.concatenate([known, covariance[:, :, :2]], axis=2)
    whole = np.einsum("oab,ohbkd,ocd->ohakc", frame, joint, frame, optimize=True)
    return cut_steps(whole.reshape(count, ahead * 2, ahead * 2), steps, 2, late)
