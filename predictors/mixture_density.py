"""Mixture density network: several futures per obstacle, each with its probability."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.plugins.extras import check_extra
from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_velocity import ConstantVelocity
from .core.assembly import Gaussians, refuse_adaptive, with_fallback
from .core.calibration import same_step
from .core.density_network import (
    DensityNetwork,
    Modes,
    forecast_of,
    frames,
    resampled,
    rows_that_span,
)
from .core.history import NOISE_FLOOR, Histories, gather, too_short
from .data.windows import windows_of

WANTED = 100
"""Fewest windows to fit to."""
MANOEUVRES = ((0.8, 0.0, 0.0), (0.1, 0.0, 0.35), (0.1, 0.0, -0.35))
"""Unfitted: weight, and what is added to the straight path at the horizon, ahead and aside, in
units of speed x horizon: walk on, bear left, bear right."""
HORIZON = 4.8
"""s, unfitted: how long a manoeuvre takes."""
STANDING_SPEED = 0.05
"""m/s, unfitted: speed at which half of the heading is believed."""
SPREAD = (0.0, 0.1, 0.02)
"""Unfitted spread of each mode: diffusion of the position (m^2/s), deviation of the velocity
(m/s per axis), density of white acceleration (m^2/s^3)."""
_NEEDS = ("optax", "learning", "to fit mixture_density needs JAX and Optax")


@final
@dataclass(frozen=True)
class MixtureDensity(Fittable):
    """A small network says, for each obstacle, which futures there are and how likely.

    p(x_1, ..., x_N) = sum_k w_k N(mu_k, Sigma_k);  w, mu, Sigma = network(newest velocities)

    The network (two tanh layers) sees the last ``observed`` positions as velocities in the
    obstacle's own frame. It says of each mode its weight (softmax); its path, the straight line
    at the weighted mean of those velocities plus a cubic in time; and its covariance, which
    grows from 0 by a random walk, an unknown velocity and white acceleration (see `Modes`), so
    that it is PSD and the joint covariance over the horizon is known. The measurement noise is
    added. `fit` trains it with JAX; a forecast needs NumPy alone.

    The idea is that of Zhang et al.; the network is not theirs. It is blind to the site, and a
    mode is a whole trajectory, so that an MPC keeps clear of each mode by a region of its own.

    Unfitted, three stated manoeuvres take the network's place: walk on (80 %), bear left or
    right (10 % each) by 35 % of the way straight ahead, with spreads that suit walking people
    and are far too wide for slow robots.

    On recorded people (8 + 12 samples of 0.4 s, each of five scenes forecast by a network that
    never saw it; means of the scenes): mean error of the mixture's mean 0.435 m, at the end
    0.927 m, negative log likelihood -0.72 per step with a floor of 1 cm, and regions of highest
    density of 50, 90 and 95 % hold 62, 90 and 95 % (93 to 96 % by scene). The likelihood gains
    most from people who stand or whose recorded path was interpolated. Unfitted: 0.435 m,
    0.911 m, 0.65; 72, 91 and 93 %.

    Time: the network knows seconds. Histories of another dt are resampled to that of the
    training by straight lines between samples; a horizon beyond the training's holds each
    mode's last velocity while its covariance grows on.

    Parameters
    ----------
    observed : samples that the network sees; shorter histories go to ``fallback``, and so do
        those of which more than half was filled in, and everything in three dimensions.
    predicted : steps that it is trained to look ahead.
    modes : K, of the network.
    rounds : of training, of 50 updates, about 0.2 s each on one core, whatever the data.
    seed : of the training.
    fallback : predictor for the obstacles that it cannot serve.
    fitted : the trained network, as `fit` leaves it.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    Z. Zhang, E. Dean, Y. Karayiannidis, K. Akesson, "Motion Prediction Based on Multiple
    Futures for Dynamic Obstacle Avoidance of Mobile Robots", CASE 2021.
    C. M. Bishop, "Mixture Density Networks", Aston University, 1994.
    """

    observed: int = 8
    predicted: int = 12
    modes: int = 3
    rounds: int = 60
    seed: int = 0
    fallback: Predictor = field(default_factory=ConstantVelocity)
    fitted: DensityNetwork | None = None

    reference: ClassVar[str] = "zhang2021motion"
    fit_needs: ClassVar[tuple[str, str, str] | None] = _NEEDS

    def __post_init__(self) -> None:
        refuse_adaptive("mixture_density.fallback", self.fallback)
        whole("mixture_density.observed", self.observed, least=3)
        for name in ("predicted", "modes", "rounds"):
            whole(f"mixture_density.{name}", getattr(self, name))
        whole("mixture_density.seed", self.seed, least=0)

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Train the network on recordings; see `Fittable.fit`.

        Raises
        ------
        WideberthError : fewer than 100 windows of ``observed + predicted`` samples, other
            than two coordinates, or recordings of different dt.
        """
        check_extra(*_NEEDS)
        from .core.density_training import train

        windows = windows_of(
            dataset, self.observed, self.predicted, wanted=WANTED, who="mixture_density"
        )
        same_step(dataset, "mixture_density")
        if dataset[0].dimension != 2:
            raise WideberthError(
                f"mixture_density.fit: scenes have {dataset[0].dimension} coordinates; wanted 2"
            )
        network = train(windows, modes=self.modes, rounds=self.rounds, seed=self.seed)
        return replace(self, fitted=network)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=self._rows(tracks.dt))
        missing = self._missing(past, tracks)
        if tracks.dimension != 2:
            shape = (len(tracks), steps, tracks.dimension)
            spread = np.zeros((*shape, tracks.dimension))
            empty = Gaussians(np.zeros(shape), spread, (None,) * len(tracks))
            return with_fallback(empty, missing, self.fallback, tracks, scene)
        own = forecast_of(self._foresee(past, tracks.dt), past, tracks, steps, NOISE_FLOOR)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _rows(self, dt: float) -> int:
        """Count the samples of the tracks that span what the network sees."""
        if self.fitted is None:
            return self.observed
        return rows_that_span(self.fitted.observed, self.fitted.dt, dt)

    def _missing(self, past: Histories, tracks: Tracks) -> list[str | None]:
        """Say why an obstacle cannot be served, or None."""
        if tracks.dimension != 2:
            return [f"mixture_density: {tracks.dimension} coordinates, needs 2"] * len(tracks)
        needed = 2 if self.fitted is None else self._rows(tracks.dt)
        return too_short(past, needed, "mixture_density")

    def _foresee(self, past: Histories, dt: float) -> Modes:
        if self.fitted is None:
            return _manoeuvres(past, dt)
        return self.fitted.foresee(
            resampled(past.positions, dt, self.fitted.dt, self.fitted.observed)
        )


def _manoeuvres(past: Histories, dt: float) -> Modes:
    """Return the stated modes of an unfitted predictor."""
    velocities = np.diff(past.positions, axis=1) / dt
    own = frames(velocities, past.present[:, :-1], dt, STANDING_SPEED)
    count, table = len(velocities), np.array(MANOEUVRES)
    path = np.zeros((count, len(table), 3, 2))
    turned = np.einsum("kj,oji->oki", table[:, 1:], own.turn)
    reach = HORIZON * np.sqrt(own.certain) * np.linalg.norm(own.velocity, axis=1)
    path[:, :, 1] = turned * reach[:, None, None]
    diffusion, drift, density = SPREAD
    amounts = (diffusion * HORIZON, (drift * HORIZON) ** 2, density * HORIZON**3 / 3)
    growth = np.multiply.outer(np.array(amounts), np.eye(2))
    whole_growth = np.broadcast_to(growth, (count, len(table), *growth.shape))
    weight = np.broadcast_to(table[:, 0], (count, len(table)))
    return Modes(np.array(weight), own.velocity, path, np.array(whole_growth), HORIZON)
