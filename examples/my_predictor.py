"""A predictor of your own: obstacles that slow down to a halt.

The script checks the laws of a predictor and draws the forecast of one walker beside that of the
Kalman filter into ``my_predictor.png``. A config names the predictor by its path,
``predictor: my_predictor:Braking``, if this file lies in the folder where the command is given.
"""

from dataclasses import dataclass
from typing import final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from wideberth import Forecast, Predictor, Scene, Tracks, register
from wideberth.framework import check_predictor
from wideberth.predictors import Kalman

DT = 0.4  # s, between two samples of the track
SEEN = 9  # samples
STEPS = 12  # steps that are forecast


@register("predictors", "braking")
@final
@dataclass(frozen=True)
class Braking(Predictor):
    """Keep the direction of motion while the speed decays exponentially.

    With the filtered velocity v and the time constant tau, the mean is::

        p(t) = p(0) + v tau (1 - exp(-t / tau))

    The covariance is the one of the Kalman filter.

    Parameters
    ----------
    time_constant : s, after which 1/e of the speed is left.
    """

    time_constant: float = 3.0

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Shorten the straight motion that the Kalman filter forecasts."""
        straight = Kalman().predict(tracks, max(steps, 2))
        mean = straight.mean[:, 0]  # (obstacles, steps, D), m
        covariance = straight.covariance[:, 0]  # (obstacles, steps, D, D), m^2
        velocity = (mean[:, 1] - mean[:, 0]) / tracks.dt  # (obstacles, D), m/s

        time = tracks.dt * np.arange(1, steps + 1)  # s
        tau = self.time_constant
        travelled = tau * (1.0 - np.exp(-time / tau))  # s at full speed
        missing = velocity[:, None, :] * (time - travelled)[None, :, None]  # m

        return Forecast.single(
            mean[:, :steps] - missing, covariance[:, :steps], tracks.dt, straight.fallback
        )


def braking_walker() -> Tracks:
    """Return the track of one walker, who has begun to slow down."""
    time = DT * np.arange(1 - SEEN, 1)  # s, the newest sample is at 0
    x = 1.4 * time - 0.1 * time**2  # m
    y = 0.3 * time  # m
    return Tracks(
        positions=np.stack([x, y], axis=-1)[None],
        dt=DT,
        ids=("walker",),
        radius=(0.3,),
        noise=1e-4 * np.eye(2)[None],  # m^2, of one measured position
    )


def draw(tracks: Tracks, file: str) -> None:
    """Draw the track, and the forecasts with circles of one standard deviation."""
    figure, axes = plt.subplots(figsize=(7, 3))
    axes.plot(*tracks.positions[0].T, "ks-", markersize=4, label="observed")
    for predictor, colour, marker in ((Kalman(), "0.6", "x"), (Braking(), "C0", "o")):
        forecast = predictor.predict(tracks, STEPS)
        mean = forecast.mean[0, 0]
        name = type(predictor).__name__
        axes.plot(*mean.T, color=colour, marker=marker, markersize=4, label=name)
        for centre, covariance in zip(mean, forecast.covariance[0, 0], strict=True):
            deviation = np.sqrt(covariance[0, 0])
            axes.add_patch(Circle(centre, deviation, color=colour, fill=False, alpha=0.4))
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.legend()
    figure.savefig(file, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    check_predictor(Braking())
    print("Braking keeps the laws of a predictor")
    draw(braking_walker(), "my_predictor.png")
