"""People who drift."""

from dataclasses import dataclass
from typing import final

from wideberth import Forecast, Predictor, Scene, Tracks
from wideberth.predictors import Kalman


@final
@dataclass(frozen=True)
class Drift(Predictor):
    """Enlarge the covariance of the Kalman filter, for people who drift.

    Parameters
    ----------
    factor : of the covariance.
    """

    factor: float = 2.0

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Return the forecast of the Kalman filter with a larger covariance."""
        forecast = Kalman().predict(tracks, steps, scene)
        mean, covariance = forecast.mean[:, 0], self.factor * forecast.covariance[:, 0]
        return Forecast.single(mean, covariance, tracks.dt, forecast.fallback)
