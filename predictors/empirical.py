"""Any predictor's mean, with the spread its errors had on recorded tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.tracking.windows import Windows, windows_of
from ..framework.values.arrays import Array, BoolArray, whole
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_velocity import ConstantVelocity
from .core.assembly import refuse_adaptive
from .core.calibration import replayed, same_step
from .core.error_table import ErrorTable, Motion, joined, learn_table
from .core.history import gather

FEWEST = 3
"""Samples: jitter is a difference of two velocities."""


@final
@dataclass(frozen=True)
class Empirical(Fittable):
    """Replaces the covariance of a base predictor by that of its recorded errors.

    mu_h as the base says,   Sigma_h = Sigma_h(speed bin, jitter bin), turned to the heading

    Somebody who stands, strolls or zigzags is not equally hard to forecast, and one process
    noise does not say so: on recorded pedestrians of other recordings, 24 classes bring
    0.17 nat per step over one for all. What a table holds, and how it is carried to other
    time grids, stands in `ErrorTable`. Errors are those against later measurements, so that
    the covariance is that of what will be measured.

    Missing samples are filled in before jitter is read, so that people look steadier than they
    are: of a simulated crowd of mixed agility with 30 % of the samples missing the nominal 95 %
    held 90 to 91 % (`AdaptiveConformal` mends the rate in the long run).

    Unfitted, and for an obstacle for which the base gives a reason or whose history has
    fewer than three samples, the base's own covariance stands (with a reason). Of a base
    with several modes each mode gets the table's covariance, learnt from the mode that was
    nearest to the truth.

    Parameters
    ----------
    base : gives the mean; where it can be fitted it is, on the same tracks. The default's
        mean of two steps halves what rounding and noise of one step do to the mean.
    observed : samples of history that jitter is read from, and that windows have in `fit`.
    steps : ahead, learnt in `fit`.
    speeds, jitters : number of bins, of equal shares of the windows. The slowest bin (with
        one bin, all) is without direction.
    fitted : what `fit` has learnt.

    Raises
    ------
    WideberthError : fewer than 3 samples observed, a number below 1, or a base that adapts.

    References
    ----------
    Schoeller et al., "What the constant velocity model can teach us about pedestrian
    motion prediction", RA-L 2020, for the mean of the default base.
    """

    base: Predictor = field(default_factory=lambda: ConstantVelocity(window=2))
    observed: int = 8
    steps: int = 12
    speeds: int = 4
    jitters: int = 6
    fitted: ErrorTable | None = None

    reference: ClassVar[str] = "schoeller2020constant"

    def __post_init__(self) -> None:
        refuse_adaptive("empirical.base", self.base)
        whole("empirical.observed", self.observed, least=FEWEST)
        for name in ("steps", "speeds", "jitters"):
            whole(f"empirical.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Learn the table from every window of ``observed`` + ``steps`` samples.

        Raises
        ------
        WideberthError : fewer than 10 windows per class, or scenes that differ in dt or
            dimension.
        """
        windows = windows_of(
            dataset,
            self.observed,
            self.steps,
            wanted=10 * self.speeds * self.jitters,
            who="empirical",
        )
        same_step(dataset, "empirical")
        base = self.base.fit(dataset) if isinstance(self.base, Fittable) else self.base
        filled = [
            (scene, found) for scene, found in zip(dataset, windows, strict=True) if len(found)
        ]
        error = np.concatenate([_nearest_error(base, scene, found) for scene, found in filled])
        motions = [Motion.of(gather(found.tracks), scene.dt) for scene, found in filled]
        table = learn_table(joined(motions), error, dataset[0].dt, self.speeds, self.jitters)
        return replace(self, base=base, fitted=table)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        forecast = self.base.predict(tracks, steps, scene)
        if self.fitted is None:
            return forecast
        past = gather(tracks, length=self.observed)
        motion = Motion.of(past, tracks.dt)
        own = np.array([reason is None for reason in forecast.fallback], dtype=np.bool_)
        short = own & (past.length < FEWEST)
        own &= ~short
        times = tracks.dt * (past.late[:, None] + np.arange(1.0, steps + 1))
        spread = self.fitted.spreads(motion, times)
        learnt = _turned(spread, motion.heading)[:, None]
        reasons = tuple(
            f"empirical: {count} samples, needs {FEWEST}" if few else reason
            for count, few, reason in zip(past.length, short, forecast.fallback, strict=True)
        )
        known = own.all() or forecast.joint_source is not None
        joint = partial(_joint, forecast, own, self.fitted, motion.heading, spread, times)
        return Forecast(
            forecast.mean,
            np.where(own[:, None, None, None, None], learnt, forecast.covariance),
            forecast.weight,
            forecast.dt,
            reasons,
            joint if known else None,
        )


def _nearest_error(base: Predictor, scene: Tracks, windows: Windows) -> Array:
    """Truth minus the mode that came nearest to it over the horizon, (W, N, D)."""
    mean, _, weight = replayed(base, scene, windows)
    error = windows.future[:, None] - mean
    distance = np.sum(error**2, axis=(2, 3))
    nearest = np.argmin(np.where(weight > 0, distance, np.inf), axis=1)
    return np.asarray(error[np.arange(len(error)), nearest])


def _turned(spread: Array, heading: Array) -> Array:
    """Return c I + (a - c) u u' from deviations (O, N, 2) and u (O, D): (O, N, D, D)."""
    along, across = np.moveaxis(spread**2, 2, 0)
    outer = heading[:, None, :, None] * heading[:, None, None, :]
    eye = np.eye(heading.shape[1])
    return np.asarray(across[..., None, None] * eye + (along - across)[..., None, None] * outer)


def _joint(
    forecast: Forecast,
    own: BoolArray,
    table: ErrorTable,
    heading: Array,
    spread: Array,
    times: Array,
) -> Array:
    """Joint covariance over the horizon: what was learnt, else the base's."""
    count, modes, steps, size = forecast.mean.shape
    forward, side = table.correlations(times)
    along = forward * spread[:, :, None, 0] * spread[:, None, :, 0]
    across = side * spread[:, :, None, 1] * spread[:, None, :, 1]
    outer = heading[:, :, None] * heading[:, None, :]
    whole_joint = np.einsum("onm,de->onmde", across, np.eye(size)) + np.einsum(
        "onm,ode->onmde", along - across, outer
    )
    flat = whole_joint.swapaxes(2, 3).reshape(count, 1, steps * size, steps * size)
    joint = np.repeat(flat, modes, axis=1)
    if not own.all():
        assert forecast.joint is not None
        joint[~own] = forecast.joint[~own]
    return joint
