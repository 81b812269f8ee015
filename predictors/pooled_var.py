"""One vector autoregression for all obstacles, learnt from recorded tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.tracking.windows import windows_of
from ..framework.values.arrays import positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import refuse_adaptive, with_fallback
from .core.history import LONGEST_GAP, Histories, gather
from .core.own_step import ForecastFn, at_own_step
from .core.velocity_forecast import past_velocities, process_gaussians, served, start_covariance
from .core.velocity_process import VelocityProcess, velocity_path
from .kalman import Kalman

FIT_WANTED = 100
"""Fewest rows of the regression."""


@dataclass(frozen=True)
class IsotropicProcess:
    """A velocity process that is the same in every direction.

    v_h = a_1 v_{h-1} + ... + a_p v_{h-p} + u_h,   u_h ~ N(0, s^2 I)

    Attributes
    ----------
    coefficients : the a_j.
    innovation : s^2, (m/s)^2.
    dt : s, the step that both belong to.

    Raises
    ------
    WideberthError : no coefficient, or a number that is not positive.
    """

    coefficients: tuple[float, ...]
    innovation: float
    dt: float

    def __post_init__(self) -> None:
        if not self.coefficients:
            raise WideberthError("process.coefficients is empty; wanted one number for each lag")
        positive("process.innovation", self.innovation)
        positive("process.dt", self.dt)

    @classmethod
    def random_walk(cls, order: int, density: float, dt: float) -> "IsotropicProcess":
        """Velocities that drift under white acceleration: a_1 = 1, s^2 = q dT."""
        return cls((1.0, *(0.0,) * (order - 1)), density * dt, dt)

    @classmethod
    def learnt(cls, dataset: Sequence[Tracks], order: int, who: str) -> "IsotropicProcess":
        """Fit one process to all tracks by least squares over all rows and axes.

        Every p + 2 consecutive samples make a row for each axis; all weigh the same. Should
        the estimate explode, it is held at the radius 1 (`VelocityProcess.settled`).

        Raises
        ------
        WideberthError : too few rows, scenes of different steps or dimensions.
        """
        windows = windows_of(dataset, order + 2, 0, wanted=FIT_WANTED, who=who)
        steps = {round(scene.dt, 6) for scene in dataset}
        if len(steps) > 1:
            raise WideberthError(
                f"{who}.fit: scenes have steps of {', '.join(map(str, sorted(steps)))} s; a "
                "vector autoregression belongs to one: resample them first"
            )
        velocities = [np.diff(part.tracks.positions, axis=1) / part.tracks.dt for part in windows]
        rows = np.concatenate(velocities).transpose(0, 2, 1).reshape(-1, order + 1)
        known, target = rows[:, -2::-1], rows[:, -1]
        found = np.linalg.lstsq(known, target, rcond=None)[0]
        settled = cls(tuple(found.tolist()), 1.0, dataset[0].dt).spread(1, 1).settled()
        coefficients = settled.coefficients[0, :, 0, 0]
        squares = np.sum((target - known @ coefficients) ** 2)
        innovation = float(squares / (len(rows) - order))
        return cls(tuple(coefficients.tolist()), innovation, dataset[0].dt)

    def spread(self, count: int, size: int) -> VelocityProcess:
        """Return it for each of several obstacles, in ``size`` dimensions."""
        eye = np.eye(size)
        lags = np.array(self.coefficients)[:, None, None] * eye
        return VelocityProcess(
            np.tile(lags, (count, 1, 1, 1)),
            np.tile(self.innovation * eye, (count, 1, 1)),
            np.zeros((count, size)),
        )


@final
@dataclass(frozen=True)
class PooledVectorAutoregression(Fittable):
    """VAR(2) on velocities with coefficients shared by all obstacles.

    v_h = a_1 v_{h-1} + a_2 v_{h-2} + u_h,   u_h ~ N(0, s^2 I)

    Scalar coefficients are the only ones that turn with the world; there is no intercept,
    which would be a drift of the place that was recorded. Learnt from thousands of steps
    (`IsotropicProcess.learnt`) the process is stable and its coefficients are known, so that
    the covariance is the exact one (`process_covariances`), started from the measurement
    noise or the tracker's covariance as in `VectorAutoregression`.

    Unfitted it is a random walk of the velocity: a_1 = 1, a_2 = 0, s^2 = q dT.

    Left to ``fallback``, with a reason: obstacles of fewer than p + 1 samples. Tracks whose step
    differs from the recordings' are resampled to it (`at_own_step`), so that p + 1 samples at
    the recordings' step are needed.

    Parameters
    ----------
    order : p.
    acceleration_density : q, m^2/s^3, of the unfitted process.
    noise_floor : m, added in quadrature to the measurement noise.
    fallback : predictor for the obstacles it cannot serve.
    fitted : what `fit` has learnt.

    Raises
    ------
    WideberthError : a number out of range, or ``fitted`` of another order.

    References
    ----------
    H. Luetkepohl, "New Introduction to Multiple Time Series Analysis", 2005, chapter 3.
    """

    order: int = 2
    acceleration_density: float = 0.02
    noise_floor: float = 0.01
    fallback: Predictor = field(default_factory=Kalman)
    fitted: IsotropicProcess | None = None

    reference: ClassVar[str] = "luetkepohl2005new"

    def __post_init__(self) -> None:
        refuse_adaptive("pooled_var.fallback", self.fallback)
        whole("pooled_var.order", self.order)
        positive("pooled_var.acceleration_density", self.acceleration_density)
        positive("pooled_var.noise_floor", self.noise_floor)
        if self.fitted is not None and len(self.fitted.coefficients) != self.order:
            raise WideberthError(
                f"pooled_var.fitted has {len(self.fitted.coefficients)} coefficients; wanted "
                f"{self.order}, one for each lag: fit it again"
            )

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Return a copy with the process of these recordings; see `Fittable.fit`.

        Raises
        ------
        WideberthError : as `IsotropicProcess.learnt`.
        """
        return replace(self, fitted=IsotropicProcess.learnt(dataset, self.order, "pooled_var"))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        own, missing = at_own_step(
            self._says, tracks, steps,
            dt=None if self.fitted is None else self.fitted.dt,
            rows=self.order + 1, noise_floor=self.noise_floor, who="pooled_var",
        )  # fmt: skip
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _says(self, tracks: Tracks, steps: int) -> ForecastFn:
        """Forecast tracks at the step of the process."""
        past = gather(tracks, length=self.order + 1 + LONGEST_GAP)
        missing = unable("pooled_var", past, self.order)
        past = served(past, missing)
        density = self.acceleration_density
        law = self.fitted or IsotropicProcess.random_walk(self.order, density, tracks.dt)
        process = law.spread(len(tracks), tracks.dimension)
        _, recent = past_velocities(past, tracks.dt, self.order)
        path = velocity_path(process, recent, steps + int(past.late.max(initial=0)))
        start = start_covariance(tracks, self.noise_floor, self.order)
        return process_gaussians(process, past, path, start, tracks.dt, steps), missing


def unable(who: str, past: Histories, order: int) -> list[str | None]:
    """Why a process of this order cannot serve each obstacle, or None.

    Parameters
    ----------
    who : name of the predictor.
    past : histories; samples filled in count.
    order : p.
    """
    return [
        None
        if length > order
        else f"{who}: {length} sample{'s' * (length != 1)}, needs {order + 1}"
        for length in past.length.tolist()
    ]
