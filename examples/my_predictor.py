"""A predictor of your own: obstacles that slow down to a halt."""

from dataclasses import dataclass

import numpy as np

from wideberth import Forecast, Predictor, Scene, Tracks, register
from wideberth.framework.testing import check_predictor
from wideberth.predictors.kalman import Kalman


@register("predictors", "braking")
@dataclass(frozen=True)
class Braking(Predictor):
    """Keep the filtered direction while the speed decays with a time constant in s."""

    time_constant: float = 3.0

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Slow down what the Kalman filter predicts."""
        straight = Kalman().predict(tracks, max(steps, 2))
        velocity = (straight.mean[:, 0, 1] - straight.mean[:, 0, 0]) / tracks.dt
        time, tau = tracks.dt * np.arange(1, steps + 1)[:, None], self.time_constant
        short = velocity[:, None] * (time - tau * (1 - np.exp(-time / tau)))
        mean, spread = straight.mean[:, 0, :steps], straight.covariance[:, 0, :steps]
        return Forecast.single(mean - short, spread, tracks.dt, straight.fallback)

if __name__ == "__main__":
    check_predictor(Braking())
    print("Braking keeps the laws of a predictor")
