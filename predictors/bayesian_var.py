"""A vector autoregression that starts from a prior and learns from each obstacle's history."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, positive, whole
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import refuse_adaptive, with_fallback
from .core.history import NOISE_FLOOR, Histories, gather
from .core.least_squares import complete_rows, lagged, regress
from .core.pattern_search import fit_numbers
from .core.velocity_forecast import past_velocities, process_gaussians, served, start_covariance
from .core.velocity_process import VelocityProcess, velocity_path
from .kalman import Kalman
from .pooled_var import IsotropicProcess, unable

SEARCHED = (
    {"acceleration_density": 1.0},
    {"samples": 1.0},
    {"acceleration_density": 1.0, "samples": -1.0},
)
"""Where `fit` looks: along both numbers, and along the ridge where one makes up for the other."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior distribution of an obstacle's process.

    A matrix-normal inverse-Wishart distribution, the same in every direction:

    Sigma_u ~ IW(n_0 s^2 I, n_0 + D + 1),   B | Sigma_u ~ MN(B_0, (tau^2 / s^2) I, Sigma_u)

    so that E Sigma_u = s^2 I and E (b - b_0)^2 = tau^2 for every coefficient b.

    Attributes
    ----------
    process : B_0 and s^2.
    deviation : tau.
    samples : n_0; s^2 weighs as much as that many rows of the regression.
    """

    process: IsotropicProcess
    deviation: float
    samples: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior distribution of each obstacle's process given its history.

    Attributes
    ----------
    process : B_n and E Sigma_u = Psi_n / (n_0 + n).
    root : (O, K, K), W with W W' = L_n^-1; Cov(vec B) = L_n^-1 kron Sigma_u.
    """

    process: VelocityProcess
    root: Array


def posterior(prior: Prior, velocities: Array, past: Histories) -> Posterior:
    """Bayes' rule, all obstacles at once.

    L_n = l I + Z'Z,   B_n = L_n^-1 (l B_0 + Z'Y),   l = s^2 / tau^2
    Psi_n = n_0 s^2 I + (Y - Z B_n)'(Y - Z B_n) + l (B_n - B_0)'(B_n - B_0)

    which is least squares with the rows (sqrt(l) I, sqrt(l) B_0) on top of (Z, Y). For a
    history without a single row it is the prior. Rows with a velocity that was filled in where
    samples are missing are left out: they are smoother than the obstacle is.

    Parameters
    ----------
    prior : see `Prior`.
    velocities : (O, T - 1, D), m/s, of the histories ``past``.
    """
    count, _, size = velocities.shape
    believed = prior.process.spread(1, size)
    order = believed.order
    weight = np.sqrt(believed.innovation[0, 0, 0]) / prior.deviation
    mean = believed.coefficients[0].swapaxes(0, 1).reshape(size, order * size)
    seen = np.asarray(past.observed[:, 1:] & past.observed[:, :-1], dtype=np.bool_)
    regressors, targets = lagged(velocities, past.began, order, seen=seen)
    above = np.repeat(weight * np.eye(order * size)[:, :, None], count, axis=2)
    below = np.repeat(weight * mean[:, :, None], count, axis=2)
    found = regress(
        np.concatenate([above, regressors], axis=1), np.concatenate([below, targets], axis=1)
    )
    rows = complete_rows(seen, order).sum(axis=1)
    scale = np.moveaxis(found.squares, 2, 0) + prior.samples * believed.innovation
    innovation = scale / (prior.samples + rows)[:, None, None]
    solution = np.moveaxis(found.solution, 2, 0)
    lags = solution.reshape(count, order, size, size).swapaxes(2, 3)
    process = VelocityProcess(lags, innovation)
    return Posterior(process, np.ascontiguousarray(np.moveaxis(found.root, 2, 0)))


HISTORY = 20
"""Newest grid samples used. Obstacles change their ways: with 80 samples of recorded robots the
forecasts from the newest 20 were likelier (3.38 against 3.26 nat per step); let it grow where
`VectorAutoregression` is the truth."""


@final
@dataclass(frozen=True)
class BayesianVectorAutoregression(Fittable):
    """VAR(2) on velocities, shrunk towards a prior: usable from three samples.

        v_h = A_1 v_{h-1} + A_2 v_{h-2} + u_h,   u_h ~ N(0, Sigma_u)

    B = [A_1 A_2]' and Sigma_u have the conjugate prior `Prior`, whose mean is constant
    velocity (A_1 = I, A_2 = 0), and each obstacle's own history the `posterior`. With few samples
    the forecast is the prior's, with many that of the `VectorAutoregression` fitted by least
    squares. A short history already determines Sigma_u, how much this obstacle's velocity
    changes; its coefficients need a far longer one.

    Mean and covariance are those of the process (B_n, E Sigma_u), with the posterior
    covariance of B carried to the positions by the delta method (`process_covariances`); at
    the first step that is exactly the covariance of the predictive t distribution, whose heavier
    tails a Gaussian cannot have. The start covariance is as in `VectorAutoregression`.

    Stability: where the companion radius r of B_n is above 1, A_j / r^j takes the place of A_j,
    so that no forecast explodes.

    It works unfitted. `fit` replaces ``acceleration_density`` and ``samples`` by the two numbers
    with which forecasts of windows (8 samples seen, 12 predicted) give what then happened the
    highest mean log likelihood.

    Left to ``fallback``, with a reason: obstacles of fewer than p + 1 samples.

    Parameters
    ----------
    order : p.
    deviation : tau, the prior standard deviation of a coefficient. Z'Z must reach s^2 / tau^2,
        in (m/s)^2, before a history moves the coefficients half of the way. It is a setting:
        learnt on some places it did worse on others than this one (final error of recorded
        people 4.8 s ahead 0.98 m against 0.97 m).
    acceleration_density : q, m^2/s^3; the prior has s^2 = q dT.
    samples : n_0, by how many rows of its own an obstacle's Sigma_u is half its own.
    fallback : predictor for the obstacles it cannot serve.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    K. R. Kadiyala and S. Karlsson, "Numerical methods for estimation and inference in Bayesian
    VAR-models", Journal of Applied Econometrics 12, 1997 (the normal-Wishart prior).
    """

    order: int = 2
    deviation: float = 0.005
    acceleration_density: float = 0.02
    samples: float = 6.0
    fallback: Predictor = field(default_factory=Kalman)

    reference: ClassVar[str] = "kadiyala1997bayesian"

    def __post_init__(self) -> None:
        refuse_adaptive("bayesian_var.fallback", self.fallback)
        whole("bayesian_var.order", self.order)
        for name in ("deviation", "acceleration_density", "samples"):
            positive(f"bayesian_var.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy with the prior under which these recordings are likeliest.

        The likelihood is that of the whole futures (`fit_numbers`), not of the next velocity
        alone: how people turn and stop over seconds does not show in one step.

        Raises
        ------
        WideberthError : too few windows, scenes of different steps or dimensions.
        """
        process = IsotropicProcess.learnt(dataset, self.order, "bayesian_var")
        begin = replace(self, acceleration_density=process.innovation / process.dt)
        return fit_numbers(begin, SEARCHED, dataset)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        past = gather(tracks, length=HISTORY)
        missing = unable("bayesian_var", past, self.order)
        past = served(past, missing)
        velocities, recent = past_velocities(past, tracks.dt, self.order)
        drift = IsotropicProcess.random_walk(self.order, self.acceleration_density, tracks.dt)
        prior = Prior(drift, self.deviation, self.samples)
        believed = posterior(prior, velocities, past)
        process = believed.process.settled()
        path = velocity_path(process, recent, steps + int(past.late.max(initial=0)))
        start = start_covariance(tracks, NOISE_FLOOR, self.order)
        own = process_gaussians(process, past, path, start, tracks.dt, steps, root=believed.root)
        return with_fallback(own, missing, self.fallback, tracks, scene)
