"""Obstacles that keep the velocity they had on average over their last steps."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.arrays import Array, positive, whole
from ..framework.forecast import Forecast, Scene
from ..framework.predictor import Predictor
from ..framework.tracks import Tracks
from .assembly import Gaussian, assemble, never_observed
from .history import History, histories, measurement_noise
from .propagation import joint_covariance, white_acceleration


@final
@dataclass(frozen=True)
class ConstantVelocity(Predictor):
    """Straight on at the mean velocity of the last steps: the baseline to beat.

    v = (p_k - p_{k-w}) / (w dT),   mu_h = p_k + h dT v

    The covariance is exact for independent measurement noise R and a velocity that drifts
    under white acceleration of density q. With T = w dT, the state (p_k, v_k) starts with

    P_0 = [[R, R/T], [R/T, 2R/T^2 + q T/3 I]]

    (q T/3 is the variance between the mean velocity over T and the velocity at its end) and
    then grows by F P F' + Q as in `white_acceleration`.

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
    noise_floor : m, added in quadrature to the measurement noise.

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
    noise_floor: float = 0.01

    reference: ClassVar[str] = "schoeller2020constant"

    def __post_init__(self) -> None:
        whole("constant_velocity.window", self.window)
        for name in ("acceleration_density", "speed", "noise_floor"):
            positive(f"constant_velocity.{name}", getattr(self, name))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        noise = measurement_noise(tracks, self.noise_floor)
        parts = [
            self._one(past, noise[index], tracks.dt, steps)
            for index, past in enumerate(histories(tracks))
        ]
        return assemble(parts, tracks, steps)

    def _one(self, past: History, noise: Array, dt: float, steps: int) -> Gaussian:
        size = len(noise)
        if not past.samples:
            return never_observed("constant_velocity", steps, size)
        velocity, start, reason = self._start(past, noise, dt)
        ahead = steps + past.late
        transition, process = white_acceleration(dt, self.acceleration_density, size)
        joint = joint_covariance(transition, process, start, size, ahead)
        mean = past.origin + dt * np.arange(1, ahead + 1)[:, None] * velocity
        return Gaussian.from_joint(mean, joint, reason, skip=past.late)

    def _start(self, past: History, noise: Array, dt: float) -> tuple[Array, Array, str | None]:
        """Velocity, covariance of (position, velocity), and why it is only a guess."""
        zero, eye = np.zeros_like(noise), np.eye(len(noise))
        if past.samples < 2:
            start = np.block([[noise, zero], [zero, self.speed**2 * eye]])
            return zero[0], start, "constant_velocity: 1 sample, needs 2"
        newest = len(past.positions) - 1
        seen = np.flatnonzero(past.observed)
        older = seen[seen <= newest - self.window]
        first = int(older[-1] if older.size else seen[0])
        span = (newest - first) * dt
        drift = self.acceleration_density * span / 3 * eye
        cross = noise / span
        start = np.block([[noise, cross], [cross, 2 * noise / span**2 + drift]])
        return -past.positions[first] / span, start, None
