"""Forecasts of obstacles as Gaussians, and the obstacle of a region."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, BoolArray, altered, checked, checked_covariance, positive, settle
from .errors import WideberthError
from .motion import Truth
from .polygon import Polygon
from .roots import factor


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

    def __init__(self, mean: ArrayLike, covariance: ArrayLike) -> None:
        mean = checked("obstacle.mean", mean, None)
        shape = (*mean.shape, mean.shape[-1])
        covariance = checked_covariance("obstacle.covariance", covariance, shape)
        settle(self, mean=mean, covariance=covariance)


@dataclass(frozen=True, eq=False)
class Scene:
    """Context for a predictor: the robot's state and plan, goals, static obstacles.

    Attributes
    ----------
    ego : (n,) state of the robot itself.
    plan : (N, D), m, positions of its current plan, or None.
    goals : (O, D), m, of the obstacles, or None where unknown.
    truth : the true future, for the oracle alone.
    plan_times : (N,), s, on the clock of the tracks' stamp; without them the plan is on the
        forecast's grid, its first row one step after the newest sample.
    radius : m, of the robot.
    polygons : what stands still, as far as it is known.

    Raises
    ------
    WideberthError : a plan, its times or goals of a wrong shape or not finite; times that do
        not increase.
    """

    ego: Array | None
    plan: Array | None
    goals: Array | None
    truth: Truth | None
    plan_times: Array | None
    radius: float
    polygons: tuple[Polygon, ...]

    def __init__(
        self,
        ego: Array | None = None,
        plan: ArrayLike | None = None,
        goals: ArrayLike | None = None,
        truth: Truth | None = None,
        plan_times: ArrayLike | None = None,
        radius: float = 0.0,
        polygons: tuple[Polygon, ...] = (),
    ) -> None:
        if plan is not None:
            plan = checked("scene.plan", plan, (None, None))
        if goals is not None:
            goals = checked("scene.goals", goals, (None, None))
        if plan_times is not None:
            length = None if plan is None else len(plan)
            plan_times = checked("scene.plan_times", plan_times, (length,))
            if (np.diff(plan_times) <= 0).any():
                raise WideberthError("scene.plan_times must increase from row to row")
        settle(self, ego=ego, plan=plan, goals=goals, truth=truth, plan_times=plan_times)
        settle(self, radius=radius, polygons=polygons)


LIGHT = 0.01
"""Forecast modes of less weight than this are left out of plans, and named there; what judges
forecasts as planners use them leaves them out too."""


def heeded(weight: Array) -> BoolArray:
    """Which modes plans heed, (O, M): those of a weight of `LIGHT` at least, and the heaviest."""
    heaviest = weight.max(axis=1, keepdims=True, initial=0.0)
    return np.asarray((weight >= LIGHT) | (weight == heaviest))


JointSource: TypeAlias = Array | Callable[[], Array] | None
"""A joint covariance, (O, M, N*D, N*D), m^2, or what computes it when it is asked for."""


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
    joint_source : what `joint` is computed from when first asked for: few need it, and for
        a thousand obstacles it costs more than all the rest. A function must be picklable.

    Raises
    ------
    WideberthError : shapes that do not fit, not finite, not PSD, weights not a distribution.
    """

    mean: Array
    covariance: Array
    weight: Array
    dt: float
    fallback: tuple[str | None, ...]
    joint_source: JointSource

    def __init__(
        self,
        mean: ArrayLike,
        covariance: ArrayLike,
        weight: ArrayLike,
        dt: float,
        fallback: Sequence[str | None],
        joint_source: JointSource = None,
    ) -> None:
        mean = checked(
            "forecast.mean",
            mean,
            (None, None, None, None),
            reason=": obstacles, modes, steps, coordinates",
        )
        shape = mean.shape
        covariance = checked_covariance("forecast.covariance", covariance, (*shape, shape[-1]))
        weight = checked("forecast.weight", weight, shape[:2])
        if shape[0] and ((weight < 0).any() or (np.abs(weight.sum(axis=1) - 1) > 1e-9).any()):
            raise WideberthError("forecast.weight must be at least 0 and sum to 1 per obstacle")
        positive("forecast.dt", dt)
        if len(fallback) != shape[0]:
            raise WideberthError(
                f"forecast.fallback has {len(fallback)} entries; wanted {shape[0]}, one "
                "per obstacle (None where the method itself was used)"
            )
        settle(self, mean=mean, covariance=covariance, weight=weight, dt=dt)
        if isinstance(joint_source, np.ndarray):
            joint_source = self._whole(joint_source)
        settle(self, fallback=tuple(fallback), joint_source=joint_source)

    def __repr__(self) -> str:
        """Say how many obstacles, modes and steps there are."""
        obstacles, modes, steps, size = self.mean.shape
        words = f"{obstacles} obstacle{'s' * (obstacles != 1)} in {size} dimensions, "
        words += f"{modes} mode{'s' * (modes != 1)} each, {steps} steps of {self.dt:g} s"
        reasons = sum(reason is not None for reason in self.fallback)
        return f"Forecast({words}{f', {reasons} by another method' * bool(reasons)})"

    def _whole(self, joint: Array) -> Array:
        obstacles, modes, steps, size = self.mean.shape
        flat = steps * size
        return checked_covariance("forecast.joint", joint, (obstacles, modes, flat, flat))

    @cached_property
    def joint(self) -> Array | None:
        """Covariance over the whole horizon, (O, M, N*D, N*D), m^2; None if it is not known."""
        source = self.joint_source
        return self._whole(source()) if callable(source) else source

    @classmethod
    def single(
        cls,
        mean: Array,
        covariance: Array,
        dt: float,
        fallback: tuple[str | None, ...] | None = None,
        joint_source: JointSource = None,
    ) -> "Forecast":
        """Build a forecast of one Gaussian per obstacle from (O, N, D) and (O, N, D, D)."""
        count = len(mean)
        reasons = (None,) * count if fallback is None else fallback
        weight = np.ones((count, 1))
        return cls(mean[:, None], covariance[:, None], weight, dt, reasons, joint_source)

    @property
    def steps(self) -> int:
        """N, the number of steps ahead."""
        return int(self.mean.shape[2])

    def cut(self, steps: int) -> tuple["Forecast", "Forecast"]:
        """Return the first ``steps`` and those behind them; of the latter no joint covariance."""
        mean, covariance = self.mean, self.covariance
        source = None if self.joint_source is None else partial(_leading, self, steps)
        first = altered(
            self, mean=mean[:, :, :steps], covariance=covariance[:, :, :steps], joint_source=source
        )
        rest = mean[:, :, steps:], covariance[:, :, steps:]
        return first, altered(self, mean=rest[0], covariance=rest[1], joint_source=None)

    def likeliest(self) -> "Forecast":
        """Return the same with the heaviest mode of each obstacle alone."""
        rows, best = np.arange(len(self.weight)), self.weight.argmax(axis=1)
        mean, covariance = self.mean[rows, best], self.covariance[rows, best]
        return Forecast.single(mean, covariance, self.dt, self.fallback)

    def sample(self, rng: np.random.Generator, count: int) -> Array:
        """Draw trajectories, (count, O, N, D), m.

        With `joint` the steps of one draw belong together; without it each step is drawn
        from its own Gaussian, independent of the others (the marginals are right, the
        path is not).
        """
        obstacles, _, steps, size = self.mean.shape
        draws = np.empty((count, obstacles, steps, size))
        for o in range(obstacles):
            draws[:, o] = self.sample_of(o, rng, count)
        return draws

    def sample_of(self, obstacle: int, rng: np.random.Generator, count: int) -> Array:
        """Draw trajectories of one obstacle, (count, N, D), m; see `sample`."""
        modes, steps, size = self.mean.shape[1:]
        draws = np.empty((count, steps, size))
        chosen = rng.choice(modes, size=count, p=self.weight[obstacle])
        for m in range(modes):
            rows = np.flatnonzero(chosen == m)
            noise = rng.standard_normal((len(rows), steps * size))
            draws[rows] = self.mean[obstacle, m] + self._spread(obstacle, m, noise)
        return draws

    def _spread(self, obstacle: int, mode: int, noise: Array) -> Array:
        steps, size = self.mean.shape[2:]
        if self.joint is not None:
            whole = noise @ factor(self.joint[obstacle, mode]).T
            return np.asarray(whole.reshape(-1, steps, size))
        root = factor(self.covariance[obstacle, mode])
        return np.asarray(np.einsum("nij,cnj->cni", root, noise.reshape(-1, steps, size)))


def _leading(forecast: Forecast, steps: int) -> Array:
    """Joint covariance of the first steps of a forecast that knows one."""
    joint, size = forecast.joint, steps * forecast.mean.shape[3]
    assert joint is not None  # it has a source
    return joint[..., :size, :size]


def on_grid(forecast: Forecast, times: Array) -> bool:
    """Whether some times, s after the newest sample, are those of a forecast's steps."""
    if len(times) != forecast.steps:
        return False
    place = np.asarray(times) / forecast.dt
    return bool((np.abs(place - np.arange(1, len(times) + 1)) <= 1e-9).all())


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
    if on_grid(forecast, times):
        return forecast
    dt = float(times[1] - times[0]) if len(times) > 1 else forecast.dt
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
