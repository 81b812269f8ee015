"""Motion along arcs of varying speed and yaw rate, by an unscented Kalman filter.

State (x, y, theta, v, omega): place m, heading rad, speed m/s, yaw rate rad/s. The heading is
never measured and never compared, only turned, so that nothing here wraps angles.

The batch axis is the first one of every array, and the last one in memory (`_columns`): sums
over five components then run along memory, where NumPy is fast.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Filtering, Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.beliefs import Beliefs
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.measurements import NO_LOG, IntArray
from ..framework.values.tracks import ON_GRID, Tracks
from .constant_acceleration import singer
from .core.assembly import Gaussians, with_fallback
from .core.history import floored
from .core.kalman_filter import PAUSE
from .core.measurement_rounds import in_steps, rounds
from .core.propagation import white_steps
from .kalman import Kalman

STATES = 5
SPREAD_WEIGHT = 2.0
"""Weight of the central sigma point in covariances (beta; 2 is best for a Gaussian)."""


@dataclass(frozen=True, eq=False)
class TurnModel:
    """Steps along arcs whose speed and yaw rate are disturbed by white noise.

    Attributes
    ----------
    times : (L,), s, of the steps: one for each of L bodies, or L = 1 for all of them.
    speed_process : (2, 2, L), covariance of what noise adds to (way along the heading, speed).
    turn_transition : (2, 2, L), of (heading, yaw rate): [[1, c], [0, e]]. A lasting yaw rate has
        c = dT and e = 1.
    turn_process : (2, 2, L), covariance of what noise adds to (heading, yaw rate).
    """

    times: Array
    speed_process: Array
    turn_transition: Array
    turn_process: Array

    def moved(self, state: Array) -> Array:
        """States (..., B, 5) one step on, without noise.

        With u = c omega / 2, half of the turn, the chord of the arc is v dT sin(u) / u long
        and leads along theta + u: the textbook's v / omega (sin(theta + omega dT) - sin(theta))
        without its division by zero on a straight line.
        """
        turn, kept = self.turn_transition[:, 1]
        half = 0.5 * turn * state[..., 4]
        chord = self.times * state[..., 3] * _sinc(half)
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
        noise[2::2, 2::2] = self.turn_process
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
    offsets = np.sqrt(STATES) * root.transpose(2, 0, 1)
    points = model.moved(state + np.stack([offsets, -offsets]))
    mean = points.sum(axis=(0, 1)) / (2 * STATES)
    centre = model.moved(state) - mean
    gaps = points - mean
    spread = np.einsum("ckbi,ckbj->bij", gaps, gaps) / (2 * STATES)
    spread += SPREAD_WEIGHT * centre[:, :, None] * centre[:, None, :]
    # Cov(before, after) = L G with G the halved differences, so that A' = (L L')^-1 L G.
    slope = ((points[0] - points[1]) * (0.5 / np.sqrt(STATES))).swapaxes(0, 1)
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


NEEDED = 3
"""Measurements: two give a heading, the third says whether it turns."""
CHORD = 3
"""Steps between the two measurements that give the first heading."""
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
class CoordinatedTurn(Filtering):
    """A Kalman filter on place, heading, speed and yaw rate, rolled out along the arc.

    x' = x + v dT sin(u)/u cos(theta + u),  u = omega dT / 2,   y' likewise with the sine,
    theta' = theta + omega dT,   v' = v + white noise,
    d omega = -omega / turn_time dt + white noise,   E[omega^2] = yaw_rate^2 in the long run

    so that a turn seen now ends after ``turn_time`` (then omega dT stands for the integral of
    the decaying rate). One much longer than the horizon is the constant turn rate of the
    textbook, whose error on recorded people is a third larger: they turn for a step or two.

    It predicts by sigma points (`unscented_step`), while filtering and over the horizon alike.
    The joint covariance over the horizon is that of the chain of linear steps that they make.

    It takes each measurement at its own time, and works in a frame of its own for each obstacle,
    along the chord from its first measurement to one 3 steps of the tracks later, so that the
    forecast turns with the world; that chord is also the first heading and speed. After a pause
    of more than 6 steps it begins anew. A tracker's ``state_covariance`` is not used: it knows
    neither heading nor yaw rate.

    Left to ``fallback``, with the reason: three-dimensional tracks (the model is one of the
    plane), fewer than 3 measurements, an obstacle whose heading is not known to 0.3 rad at the
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

    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return place, heading, speed and yaw rate of all obstacles; see `Filtering.filtered`.

        An obstacle whose chord is not known in full yet is filtered again the next time.
        """
        if tracks.dimension != 2:
            return Beliefs.none()
        sightings = tracks.measured
        earlier = before or Beliefs.none()
        first, newest, count, values = earlier.resumed(sightings, SHAPES)
        if values is earlier.values:
            return earlier
        state, covariance, frame, origin, fit = values
        log = list(sightings.log)
        starts = _starts(tracks, first, newest, log)
        for each in rounds(sightings, first, newest, np.inf):
            fresh = np.isinf(each.lag)
            noise = floored(each.noise, NOISE_FLOOR)
            new = each.rows[fresh], each.place[fresh], noise[fresh]
            for row, place, spread in zip(*new, strict=True):
                begun = self._begun(starts[row], spread)
                state[:, row], covariance[..., row], frame[..., row] = begun
                origin[:, row], fit[:, row], count[row] = place, 0.0, 0
            rows = each.rows[~fresh]
            if rows.size:
                axes = frame[..., rows].transpose(2, 0, 1)
                place = np.einsum("oba,ob->oa", axes, (each.place[~fresh].T - origin[:, rows]).T)
                turned = axes.swapaxes(1, 2) @ noise[~fresh] @ axes
                ahead = self._carried(
                    _first(state, rows), _first(covariance, rows), each.lag[~fresh], tracks.dt
                )
                after, spread, surprise = position_update(*ahead, place, turned)
                state[:, rows], covariance[..., rows] = after.T, spread.transpose(1, 2, 0)
                fit[0, rows] += surprise
                fit[1, rows] += 1.0
            newest[each.rows] = each.time
            count[each.rows] += 1
        return Beliefs(tuple(log), newest, count, values)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        count, size = len(tracks), tracks.dimension
        reasons: tuple[str | None, ...] = (None,) * count
        if size != 2:
            mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
            flat = [f"coordinated_turn: {size} coordinates, needs 2"] * count
            own = Gaussians(mean, covariance, reasons)
            return with_fallback(own, flat, self.fallback, tracks, scene)
        state, covariance, frame, origin, fit = (
            np.moveaxis(part, -1, 0) for part in beliefs.values
        )
        missing = self._missing(
            beliefs.count, covariance, fit[:, 0] / np.maximum(2.0 * fit[:, 1], 1.0)
        )
        late = np.flatnonzero(tracks.lag)
        if late.size:
            state, covariance = state.copy(), covariance.copy()
            state[late], covariance[late] = self._carried(
                state[late], covariance[late], tracks.lag[late], tracks.dt
            )
        model = self._model(np.array([tracks.dt]))
        start = _columns(state), _columns(covariance)
        moved, spread = _roll_out(*start, model, steps)
        moved = np.einsum("oab,onb->ona", frame, moved)
        spread = np.einsum("oab,onbc->onac", frame, spread)
        spread = np.einsum("onac,odc->onad", spread, frame)
        joint = partial(_joint, *start, frame, model, steps)
        own = Gaussians(origin[:, None] + moved, spread, reasons, joint)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _carried(
        self, state: Array, covariance: Array, lag: Array, dt: float
    ) -> tuple[Array, Array]:
        """States (B, 5) and covariances after times (B,), s, in steps of nearly ``dt``."""
        for rows, times in in_steps(lag, dt):
            moved, spread, _ = unscented_step(
                _columns(state[rows]), _columns(covariance[rows]), self._model(times)
            )
            state, covariance = state.copy(), covariance.copy()
            state[rows], covariance[rows] = moved, spread
        return state, covariance

    def _model(self, times: Array) -> TurnModel:
        """Return one step of the motion for each of some times, (L,), s."""
        _, speed_process = white_steps(times, self.acceleration_density)
        transition, process = singer(times, self.yaw_rate, self.turn_time)
        return TurnModel(times, speed_process, transition[1:, 1:], process[1:, 1:])

    def _begun(self, start: tuple[Array, float], noise: Array) -> tuple[Array, Array, Array]:
        """State (5,), covariance (5, 5) and frame (2, 2) at a first measurement.

        Parameters
        ----------
        start : chord, (2,), m, and its time, s. noise : (2, 2), m^2.
        """
        chord, span = start
        length = float(np.hypot(*chord))
        along = chord / max(length, TINY) if length > 0 else np.array([1.0, 0.0])
        frame = np.array([[along[0], -along[1]], [along[1], along[0]]])
        covariance = np.zeros((STATES, STATES))
        covariance[:2, :2] = frame.T @ noise @ frame
        doubt = np.trace(noise) / max(length, TINY) ** 2
        covariance[2, 2] = FIRST_HEADING**2 + min(doubt, UNKNOWN)
        covariance[3, 3], covariance[4, 4] = self.speed**2, self.yaw_rate**2
        return np.array([0.0, 0.0, 0.0, length / span, 0.0]), covariance, frame

    def _missing(self, counts: IntArray, covariance: Array, fit: Array) -> list[str | None]:
        """Why the filter cannot be used, or None, per obstacle."""
        deviation = np.sqrt(covariance[:, 2, 2])
        reasons: list[str | None] = []
        for count, doubt, error in zip(counts, deviation, fit, strict=True):
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


SHAPES = ((STATES,), (STATES, STATES), (2, 2), (2,), (2,))
"""Of an obstacle's beliefs: state and covariance in its frame, the frame's axes as columns and
its origin, m, and the sum and number of its squared innovations."""


def _starts(
    tracks: Tracks, first: IntArray, newest: Array, log: list[int]
) -> dict[int, tuple[Array, float]]:
    """Find who begins, and where; return the first chord of each, (2,), m, and its time, s.

    ``first`` and ``newest`` are moved to the beginning, after the last pause. ``log`` becomes
    `NO_LOG` of those whose chord a later measurement will change.
    """
    sightings, starts = tracks.measured, {}
    for row, times in enumerate(sightings.times):
        new = times[max(first[row] - 1, 0) :]
        pauses = np.flatnonzero(np.diff(new) > PAUSE * tracks.dt)
        if pauses.size:
            first[row] = len(times) - len(new) + int(pauses[-1]) + 1
            newest[row] = -np.inf
        if np.isfinite(newest[row]) or first[row] == len(times):
            continue
        begin = first[row]
        end = int(times.searchsorted(times[begin] + (CHORD - ON_GRID) * tracks.dt))
        if end == len(times):
            log[row], end = NO_LOG, len(times) - 1
        values = sightings.values[row]
        chord = values[end, :2] - values[begin, :2]
        span = float(times[end] - times[begin])
        starts[row] = chord, span if span > 0 else tracks.dt
    return starts


def _first(values: Array, rows: IntArray) -> Array:
    """Return those of some obstacles, with the obstacles on the first axis."""
    return np.moveaxis(values[..., rows], -1, 0)


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
) -> Array:
    """Joint covariance of the places at all steps, (O, N*2, N*2), m^2.

    Cov(s_{h+1}, s_i) = A_h Cov(s_h, s_i) with the A_h of the filter's own steps.
    """
    count = len(state)
    joint = np.zeros((count, steps, 2, steps, 2))
    known = np.zeros((count, STATES, 0))
    for h in range(steps):
        state, covariance, slope = unscented_step(state, covariance, model)
        known = slope @ known
        cross = known[:, :2].reshape(count, 2, h, 2)
        joint[:, h, :, :h] = cross
        joint[:, :h, :, h] = cross.transpose(0, 2, 3, 1)
        joint[:, h, :, h] = covariance[:, :2, :2]
        known = np.concatenate([known, covariance[:, :, :2]], axis=2)
    whole = np.einsum("oab,ohbkd,ocd->ohakc", frame, joint, frame, optimize=True)
    return np.asarray(whole.reshape(count, steps * 2, steps * 2))
