"""Constant turn rate and velocity (CTRV): robots and vehicles that drive along arcs."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Literal, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_acceleration import singer
from .core.assembly import Gaussians, with_fallback
from .core.history import Histories, IntArray, gather, measurement_noise
from .core.propagation import after, cut_steps, white_acceleration
from .core.turn_filter import STATES, Step, TurnModel, extended_step, filter_turns, unscented_step
from .kalman import Kalman

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

    ``filter`` "ukf" predicts by sigma points, "ekf" by linearisation, while filtering and over
    the horizon alike (`unscented_step`, `extended_step`). The joint covariance over the
    horizon is that of the chain of linear steps that each of them makes.

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
    noise_floor : m, added in quadrature to the measurement noise.
    history : grid samples to filter.
    filter : see above.
    fallback : predictor for the others.

    Raises
    ------
    WideberthError : a number that is not positive, or an unknown filter.

    References
    ----------
    R. Schubert, E. Richter and G. Wanielik, "Comparison and Evaluation of Advanced Motion
    Models for Vehicle Tracking", 2008; R. van der Merwe, "Sigma-Point Kalman Filters", 2004.
    """

    acceleration_density: float = 0.02
    yaw_rate: float = 0.3
    turn_time: float = 0.5
    speed: float = 1.0
    noise_floor: float = 0.03
    history: int = 40
    filter: Literal["ukf", "ekf"] = "ukf"
    fallback: Predictor = field(default_factory=Kalman)

    reference: ClassVar[str] = "schubert2008comparison"

    def __post_init__(self) -> None:
        for name in ("acceleration_density", "yaw_rate", "turn_time", "speed", "noise_floor"):
            positive(f"coordinated_turn.{name}", getattr(self, name))
        whole("coordinated_turn.history", self.history)
        if self.filter not in ("ukf", "ekf"):
            raise WideberthError(
                f"coordinated_turn.filter is {self.filter!r}; wanted one of ukf, ekf"
            )

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        count, size = len(tracks), tracks.dimension
        mean, covariance = np.zeros((count, steps, size)), np.zeros((count, steps, size, size))
        reasons: tuple[str | None, ...] = (None,) * count
        if size != 2:
            flat = [f"coordinated_turn: {size} coordinates, needs 2"] * count
            own = Gaussians(mean, covariance, reasons)
            return with_fallback(own, flat, self.fallback, tracks, scene)
        past = gather(tracks, length=self.history)
        frame = _frames(past)
        model = self._model(tracks.dt)
        step = unscented_step if self.filter == "ukf" else extended_step
        state, start, fit = self._filter(past, frame, tracks, model, step)
        ahead = steps + int(past.late.max(initial=0))
        moved, spread = _roll_out(state, start, model, step, ahead)
        moved = np.einsum("oab,onb->ona", frame, moved)
        spread = np.einsum("oab,onbc->onac", frame, spread)
        spread = np.einsum("onac,odc->onad", spread, frame)
        mean = past.origin[:, None] + after(moved, steps, past.late)
        joint = partial(_joint, state, start, frame, model, step, steps, past.late)
        own = Gaussians(mean, after(spread, steps, past.late), reasons, joint)
        missing = self._missing(past, start, fit)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _model(self, dt: float) -> TurnModel:
        """Return one step of the motion."""
        _, speed_process = white_acceleration(dt, self.acceleration_density, 1)
        transition, process = singer(dt, self.yaw_rate, self.turn_time)
        return TurnModel(dt, speed_process, transition[1:, 1:], process[1:, 1:])

    def _filter(
        self, past: Histories, frame: Array, tracks: Tracks, model: TurnModel, step: Step
    ) -> tuple[Array, Array, Array]:
        """Filter in the frames; see `filter_turns`."""
        noise = measurement_noise(tracks, self.noise_floor)
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
        return filter_turns(past, noise, (state, covariance), model, step)

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
    state: Array, covariance: Array, model: TurnModel, step: Step, steps: int
) -> tuple[Array, Array]:
    """Means (O, N, 2) and covariances (O, N, 2, 2) of the place at each step ahead."""
    moved, spread = np.zeros((len(state), steps, 2)), np.zeros((len(state), steps, 2, 2))
    for h in range(steps):
        state, covariance, _ = step(state, covariance, model)
        moved[:, h], spread[:, h] = state[:, :2], covariance[:, :2, :2]
    return moved, spread


def _joint(
    state: Array,
    covariance: Array,
    frame: Array,
    model: TurnModel,
    step: Step,
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
        state, covariance, slope = step(state, covariance, model)
        known = slope @ known
        cross = known[:, :2].reshape(count, 2, h, 2)
        joint[:, h, :, :h] = cross
        joint[:, :h, :, h] = cross.transpose(0, 2, 3, 1)
        joint[:, h, :, h] = covariance[:, :2, :2]
        known = np.concatenate([known, covariance[:, :, :2]], axis=2)
    whole = np.einsum("oab,ohbkd,ocd->ohakc", frame, joint, frame, optimize=True)
    return cut_steps(whole.reshape(count, ahead * 2, ahead * 2), steps, 2, late)
