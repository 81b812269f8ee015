"""Forecast: where each obstacle will be, as Gaussians; and what a region keeps clear of."""

from dataclasses import dataclass

import numpy as np

from .arrays import Array, checked, checked_covariance, positive
from .errors import WideberthError
from .motion import Truth


@dataclass(frozen=True, eq=False)
class GaussianObstacle:
    """A disc whose centre is Gaussian. Leading axes are a batch.

    Attributes
    ----------
    mean : (..., D), m.
    covariance : (..., D, D), m^2.
    """

    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        mean = checked("obstacle.mean", self.mean, None)
        shape = (*mean.shape, mean.shape[-1])
        covariance = checked_covariance("obstacle.covariance", self.covariance, shape)
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)


@dataclass(frozen=True, eq=False)
class Scene:
    """What else a predictor may look at.

    Attributes
    ----------
    ego : (n,) state of the robot itself.
    plan : (N, D), m, positions of its current plan, or None.
    goals : (O, D), m, of the obstacles, or None where unknown.
    truth : the true future, for the oracle alone.
    """

    ego: Array | None = None
    plan: Array | None = None
    goals: Array | None = None
    truth: Truth | None = None


@dataclass(frozen=True, eq=False)
class Forecast:
    """Gaussian mixtures over the future positions of all obstacles.

    Step i (counted from 1) is i * dt seconds after the newest sample of the tracks.

    Attributes
    ----------
    mean : (O, M, N, D), m.
    covariance : (O, M, N, D, D), m^2.
    weight : (O, M), sums to 1 for each obstacle.
    dt : s.
    fallback : per obstacle None, or why the named method was not used.
    joint : (O, M, N*D, N*D), m^2, covariance over the whole horizon, or None.

    Raises
    ------
    WideberthError : shapes that do not fit, not finite, not PSD, weights not a distribution.
    """

    mean: Array
    covariance: Array
    weight: Array
    dt: float
    fallback: tuple[str | None, ...]
    joint: Array | None = None

    def __post_init__(self) -> None:
        mean = checked("forecast.mean", self.mean, (None, None, None, None))
        shape = mean.shape
        covariance = checked_covariance(
            "forecast.covariance", self.covariance, (*shape, shape[-1])
        )
        weight = checked("forecast.weight", self.weight, shape[:2])
        if shape[0] and ((weight < 0).any() or (np.abs(weight.sum(axis=1) - 1) > 1e-9).any()):
            raise WideberthError("forecast.weight must be at least 0 and sum to 1 per obstacle")
        positive("forecast.dt", self.dt)
        if len(self.fallback) != shape[0]:
            raise WideberthError(
                f"forecast.fallback has {len(self.fallback)} entries; wanted {shape[0]}, one "
                "per obstacle (None where the method itself was used)"
            )
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "weight", weight)
        if self.joint is not None:
            flat = shape[2] * shape[3]
            joint = checked_covariance("forecast.joint", self.joint, (*shape[:2], flat, flat))
            object.__setattr__(self, "joint", joint)

    @classmethod
    def single(
        cls,
        mean: Array,
        covariance: Array,
        dt: float,
        fallback: tuple[str | None, ...] | None = None,
    ) -> "Forecast":
        """Build a forecast of one Gaussian per obstacle from (O, N, D) and (O, N, D, D)."""
        count = len(mean)
        reasons = (None,) * count if fallback is None else fallback
        return cls(mean[:, None], covariance[:, None], np.ones((count, 1)), dt, reasons)

    @property
    def steps(self) -> int:
        """N, the number of steps ahead."""
        return int(self.mean.shape[2])

    def sample(self, rng: np.random.Generator, count: int) -> Array:
        """Draw trajectories, (count, O, N, D), m.

        With `joint` the steps of one draw belong together; without it each step is drawn
        from its own Gaussian, independent of the others (the marginals are right, the
        path is not).
        """
        obstacles, modes, steps, size = self.mean.shape
        draws = np.empty((count, obstacles, steps, size))
        for o in range(obstacles):
            chosen = rng.choice(modes, size=count, p=self.weight[o])
            for m in range(modes):
                rows = np.flatnonzero(chosen == m)
                noise = rng.standard_normal((len(rows), steps * size))
                draws[rows, o] = self.mean[o, m] + self._spread(o, m, noise)
        return draws

    def _spread(self, obstacle: int, mode: int, noise: Array) -> Array:
        steps, size = self.mean.shape[2:]
        if self.joint is not None:
            whole = noise @ _root(self.joint[obstacle, mode]).T
            return np.asarray(whole.reshape(-1, steps, size))
        root = _root(self.covariance[obstacle, mode])
        return np.asarray(np.einsum("nij,cnj->cni", root, noise.reshape(-1, steps, size)))


def _root(covariance: Array) -> Array:
    """Return a matrix whose product with its transpose is the covariance; works when singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None))[..., None, :])


def resample(forecast: Forecast, origin: Array, spread: Array, times: Array) -> Forecast:
    """Carry a forecast onto another time grid.

    Between two steps mean and covariance are interpolated linearly (a convex combination
    of PSD matrices is PSD); before the first step they start at the newest position and
    its measurement covariance.

    Parameters
    ----------
    forecast : with its own dt.
    origin : (O, D), m, position at time 0 (the newest sample).
    spread : (O, D, D), m^2, covariance of that position.
    times : (T,), s after the newest sample, within [0, N * dt].

    Returns
    -------
    Forecast with T steps. Its ``dt`` is the spacing of ``times``.
    """
    obstacles, modes, steps, size = forecast.mean.shape
    place = np.asarray(times) / forecast.dt
    if place.size and (place.min() < -1e-9 or place.max() > steps + 1e-9):
        raise WideberthError(
            f"times span {times.min():g} to {times.max():g} s; the forecast reaches from 0 to "
            f"{steps * forecast.dt:g} s: predict more steps"
        )
    dt = float(times[1] - times[0]) if len(times) > 1 else forecast.dt
    if len(times) == steps and np.allclose(place, np.arange(1, steps + 1), rtol=0, atol=1e-9):
        return forecast
    first = np.broadcast_to(origin[:, None, None], (obstacles, modes, 1, size))
    wide = np.broadcast_to(spread[:, None, None], (obstacles, modes, 1, size, size))
    mean = np.concatenate([first, forecast.mean], axis=2)
    covariance = np.concatenate([wide, forecast.covariance], axis=2)
    below = np.clip(np.floor(place).astype(int), 0, steps - 1)
    share = np.clip(place - below, 0.0, 1.0)
    a, b = share[:, None], share[:, None, None]
    return Forecast(
        (1 - a) * mean[:, :, below] + a * mean[:, :, below + 1],
        (1 - b) * covariance[:, :, below] + b * covariance[:, :, below + 1],
        forecast.weight,
        dt,
        forecast.fallback,
    )
