"""Obstacles that keep the velocity they had on average over their last steps."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, altered, positive, whole
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.history import LONGEST_GAP, NOISE_FLOOR, Histories, gather, measurement_noise
from .core.kalman_filter import ModeStates, Start, forecast
from .kalman import DriftingVelocity


@final
@dataclass(frozen=True)
class ConstantVelocity(Predictor):
    """Straight on at the mean velocity of the last steps: the baseline to beat.

    v = (p_k - p_{k-w}) / (w dT),   mu_h = p_k + h dT v

    The covariance is exact for independent measurement noise R and a velocity that drifts
    under white acceleration of density q. With T = w dT, the state (p_k, v_k) starts with

        P_0 = [[R, R/T], [R/T, 2R/T^2 + q T/3 I]]

    (q T/3 is the variance between the mean velocity over T and the velocity at its end) and
    then grows by F P F' + Q as in `white_acceleration`. Where a tracker gives its own
    covariance of position and velocity, that takes the place of the terms with R: positions
    that have been filtered do not err independently. Where it gives its velocity as well, v is
    that, and P_0 its covariance.

    Gaps: the sample ``window`` steps back is taken, or the nearest older observed one, or
    the oldest there is; w is the true distance.

    Parameters
    ----------
    window : w. One is the "last step" of the literature; with measurement noise of 1 cm at
        2 Hz the mean error of five steps is half of that of one (0.080 m against 0.164 m
        on recorded robots), so five is the default.
    acceleration_density : q, m^2/s^3. 0.02 suits walking people; slow robots on a smooth
        floor have 1e-4.
    speed : m/s per axis, standard deviation of the velocity where only one sample is known
        (the obstacle is then taken as standing, and the reason says so).

    Raises
    ------
    WideberthError : a window below 1 or a number that is not positive.

    References
    ----------
    Schoeller et al., "What the constant velocity model can teach us about pedestrian
    motion prediction", RA-L 2020.
    """

    window: int = 5
    acceleration_density: float = 0.02
    speed: float = 1.0

    reference: ClassVar[str] = "schoeller2020constant"

    def __post_init__(self) -> None:
        whole("constant_velocity.window", self.window)
        for name in ("acceleration_density", "speed"):
            positive(f"constant_velocity.{name}", getattr(self, name))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=self.window + LONGEST_GAP + 1)
        noise = measurement_noise(tracks, NOISE_FLOOR)
        velocity, covariance = self._start(past, noise, tracks)
        state = np.stack([np.zeros_like(velocity), velocity])
        count, size = velocity.shape
        blocks = covariance.reshape(count, 2, size, 2, size).transpose(1, 2, 3, 4, 0)
        weight = np.ones((1, count))
        modes = ModeStates(weight, state.transpose(0, 2, 1)[:, :, None], blocks[..., None, :])
        motion = DriftingVelocity(self.acceleration_density, self.speed)
        unseen = np.asarray(past.samples == 0)
        start = Start(modes, past.origin.T, past.late, unseen, motion, tracks.dt)
        own = forecast(start, steps, "constant_velocity")
        if tracks.velocity is not None:
            return own
        single = "constant_velocity: 1 sample, needs 2"
        reasons = tuple(
            single if samples == 1 else reason
            for samples, reason in zip(past.samples, own.fallback, strict=True)
        )
        return altered(own, fallback=reasons)

    def _start(self, past: Histories, noise: Array, tracks: Tracks) -> tuple[Array, Array]:
        """Velocity, (O, D), and covariance of (position, velocity), (O, 2D, 2D)."""
        count, rows, size = past.positions.shape
        newest = rows - 1
        older = past.observed & (np.arange(rows) <= newest - self.window)
        first = np.where(older.any(axis=1), newest - np.argmax(older[:, ::-1], axis=1), past.began)
        moved = first < newest
        span = np.where(moved, newest - first, 1)[:, None, None] * tracks.dt
        place = past.positions[np.arange(count), np.minimum(first, newest)]
        velocity = np.where(moved[:, None], -place / span[:, 0], 0.0)
        eye = np.eye(size)
        drift = self.acceleration_density * span / 3 * eye
        known = moved[:, None, None]
        cross = np.where(known, noise / span, 0.0)
        spread = np.where(known, 2 * noise / span**2 + drift, self.speed**2 * eye)
        start = _blocks(noise, cross, spread)
        if tracks.state_covariance is not None and tracks.velocity is not None:
            seen = past.samples > 0
            velocity = np.where(seen[:, None], tracks.velocity, velocity)
            start = np.where(seen[:, None, None], tracks.state_covariance, start)
        elif tracks.state_covariance is not None:
            zero = np.zeros_like(noise)
            tracked = tracks.state_covariance + _blocks(zero, zero, np.where(known, drift, zero))
            start = np.where(known, tracked, start)
        return velocity, start


def _blocks(first: Array, cross: Array, second: Array) -> Array:
    """[[first, cross], [cross', second]] for each obstacle, (O, 2D, 2D)."""
    above = np.concatenate([first, cross], axis=2)
    below = np.concatenate([cross.swapaxes(1, 2), second], axis=2)
    return np.concatenate([above, below], axis=1)
