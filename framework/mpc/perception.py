"""From what is seen to a forecast on the plan's grid."""

import logging

import numpy as np

from ..arrays import Array
from ..errors import WideberthError
from ..forecast import Forecast, Scene, resample
from ..history import History
from ..motion import Observation, sound
from ..noise import NoiseEstimate
from ..predictor import Adaptive, Predictor
from ..tracks import Tracks

LOG = logging.getLogger("wideberth.perception")
CHANGED = 1.2
"""Factor between an estimated noise and the one logged last from which on it is logged again."""


class Perception:
    """Remembers detections and asks the predictor; `drain` tells what it had to drop.

    Parameters
    ----------
    predictor : as configured; the adapted copy is kept inside.
    dimension : D of the robot; detections of another dimension are dropped.
    dt : s between the samples of the tracks.
    samples : their number.
    period : s between observations.
    forget : s after which an obstacle that is no longer reported is dropped.
    """

    def __init__(
        self,
        predictor: Predictor,
        dimension: int,
        dt: float,
        samples: int,
        period: float,
        forget: float,
    ) -> None:
        self._predictor = predictor
        self._dimension, self._dt = dimension, dt
        gap = 2.5 * max(dt, period)
        self._sizes = (dt, samples, forget, gap)
        self._history = History(*self._sizes)
        self._stamp = -np.inf
        self._notes: list[str] = []
        self._logged: dict[str, float] = {}

    @property
    def noise(self) -> dict[str, NoiseEstimate]:
        """The estimated noise of each sensor that does not state it."""
        return self._history.noise

    def take(self, observation: Observation) -> None:
        """Take note of what is seen.

        A clock that goes back starts the history anew: measurements from the future would
        neither be forgotten nor replaced.
        """
        if not np.isfinite(observation.stamp):
            return
        if observation.stamp < self._stamp:
            self._notes.append(f"clock went back by {self._stamp - observation.stamp:.3g} s")
            self._history = History(*self._sizes)
        self._stamp = observation.stamp
        detections, refused = sound(observation, self._dimension)
        self._notes += refused
        self._history.add(observation.stamp, detections)
        self._log_noise()

    def _log_noise(self) -> None:
        """Log what the noise of a sensor is estimated as, at first and when it has changed."""
        for sensor, estimate in self._history.noise.items():
            before = self._logged.get(sensor)
            ratio = estimate.deviation / before if before else np.inf
            if estimate.samples and not 1 / CHANGED < ratio < CHANGED:
                LOG.info("%s%s", f"sensor {sensor}: " if sensor else "", estimate.text)
                self._logged[sensor] = estimate.deviation

    def drain(self) -> list[str]:
        """Return what had to be dropped since the last call."""
        notes, self._notes = self._notes, []
        return notes

    def forecast(self, first: float, grid: Array, scene: Scene) -> tuple[Tracks, Forecast] | None:
        """Forecast all obstacles, or return None when none is known.

        Parameters
        ----------
        first : s, time of the plan's first state.
        grid : (N,), s after ``first`` of the plan's steps.
        scene : what else the predictor may look at.

        Raises
        ------
        WideberthError : the predictor returned something else than was asked for.
        """
        tracks = self._history.tracks()
        if tracks is None:
            return None
        if isinstance(self._predictor, Adaptive):
            self._predictor = self._predictor.update(tracks, scene)
        times = first - tracks.stamp + grid
        steps = max(int(np.ceil(times[-1] / self._dt - 1e-9)), 1)
        forecast = self._predictor.predict(tracks, steps, scene)
        self._check(forecast, tracks, steps)
        newest = tracks.positions[:, -1]
        newest = np.where(np.isnan(newest), forecast.mean[:, 0, 0], newest)
        return tracks, resample(forecast, newest, tracks.noise, times)

    def _check(self, forecast: Forecast, tracks: Tracks, steps: int) -> None:
        name = type(self._predictor).__name__
        if not isinstance(forecast, Forecast):
            raise WideberthError(f"{name}.predict returned {type(forecast).__name__}")
        shape = forecast.mean.shape
        if (shape[0], *shape[2:]) != (len(tracks), steps, tracks.dimension):
            raise WideberthError(
                f"{name} forecast {shape[0]} obstacles, {shape[2]} steps, {shape[3]} coordinates; "
                f"asked for {len(tracks)}, {steps}, {tracks.dimension}"
            )
        if abs(forecast.dt - tracks.dt) > 1e-9:
            raise WideberthError(
                f"{name} forecast steps of {forecast.dt} s; asked for {tracks.dt} s"
            )
