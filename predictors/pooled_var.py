"""One vector autoregression for all obstacles, learnt from recorded tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import Gaussians, refuse_adaptive, with_fallback
from .core.history import LONGEST_GAP, NOISE_FLOOR, Histories, gather, measurement_noise
from .core.velocity_forecast import past_velocities, process_gaussians, served, start_covariance
from .core.velocity_process import VelocityProcess, velocity_path
from .data.windows import windows_of
from .kalman import Kalman

SAME_STEP = 0.01
"""Share by which the step of tracks may differ from that of the recordings."""
FARTHEST = 10.0
"""Largest factor between the two steps; beyond it forecasts mean little and cost much."""
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
        )


@final
@dataclass(frozen=True)
class PooledVectorAutoregression(Fittable):
    """VAR(2) on velocities with coefficients shared by all obstacles.

    v_h = a_1 v_{h-1} + a_2 v_{h-2} + u_h,   u_h ~ N(0, s^2 I)

    Scalar coefficients are the only ones that turn with the world. Learnt from thousands of steps
    (`IsotropicProcess.learnt`) the process is stable and its coefficients are known, so that
    the covariance is the exact one (`process_covariances`), started from the measurement
    noise or the tracker's covariance as in `VectorAutoregression`.

    Unfitted it is a random walk of the velocity: a_1 = 1, a_2 = 0, s^2 = q dT.

    Left to ``fallback``, with a reason: obstacles of fewer than p + 1 samples. Tracks whose step
    differs from the recordings' are resampled to it, so that p + 1 samples at
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
    noise_floor: float = NOISE_FLOOR
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
        own, missing = self._at_own_step(tracks, steps)
        return with_fallback(own, missing, self.fallback, tracks, scene)

    def _at_own_step(self, tracks: Tracks, steps: int) -> tuple[Gaussians, list[str | None]]:
        """Forecast at the step of the recordings, and resample to the tracks' step.

        Histories are read at the recordings' step back from each obstacle's newest sample, and
        means and covariances at the tracks' steps ahead, on straight lines between two samples or
        steps, as `framework.values.forecast.resample` does. The joint covariance is then not
        known. Where the steps agree within `SAME_STEP` nothing of this happens; where they differ
        more than `FARTHEST`, no obstacle can be served.
        """
        dt = None if self.fitted is None else self.fitted.dt
        if dt is None or abs(tracks.dt / dt - 1) <= SAME_STEP:
            return self._forecast(tracks, steps)
        if not 1 / FARTHEST <= tracks.dt / dt <= FARTHEST:
            own, _ = self._forecast(tracks, steps)
            reason = f"pooled_var: fitted at steps of {dt:g} s, tracks have {tracks.dt:g} s"
            return own, [reason] * len(tracks)
        past = gather(tracks)
        last = past.positions.shape[1] - 1
        count = min(self.order + 1, int(last * tracks.dt / dt + 1e-9) + 1)
        place = last - dt / tracks.dt * np.arange(count - 1.0, -1.0, -1.0)
        known = place >= past.began[:, None] - 1e-9
        read = past.origin[:, None] + _between(past.positions, np.broadcast_to(place, known.shape))
        read = np.where(known[..., None], read, np.nan)
        seen = replace(tracks, positions=read, dt=dt, sightings=None)
        late = past.late
        ahead = ceil((steps + int(late.max(initial=0))) * tracks.dt / dt - 1e-9)
        own, missing = self._forecast(seen, max(ahead, 1))
        times = tracks.dt / dt * (late[:, None] + np.arange(1.0, steps + 1))
        noise = measurement_noise(tracks, self.noise_floor)
        mean = np.concatenate([past.origin[:, None], own.mean], axis=1)
        covariance = np.concatenate([noise[:, None], own.covariance], axis=1)
        resampled = Gaussians(_between(mean, times), _between(covariance, times), own.reasons)
        return resampled, missing

    def _forecast(self, tracks: Tracks, steps: int) -> tuple[Gaussians, list[str | None]]:
        """Gaussians of tracks at the step of the process, and why each cannot be used, or None."""
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


def _between(values: Array, place: Array) -> Array:
    """Interpolate rows of (O, T, ...) linearly at fractional indices (O, N)."""
    below = np.clip(np.floor(place + 1e-9).astype(np.int64), 0, values.shape[1] - 1)
    above = np.minimum(below + 1, values.shape[1] - 1)
    share = np.clip(place - below, 0.0, 1.0).reshape(*place.shape, *(1,) * (values.ndim - 2))
    row = np.arange(len(values))[:, None]
    return np.asarray((1 - share) * values[row, below] + share * values[row, above])
