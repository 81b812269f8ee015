"""Any predictor's mean, with the spread its errors had on recorded tracks."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import ClassVar, Self, TypeAlias, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, BoolArray, checked, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .constant_velocity import ConstantVelocity
from .core.assembly import refuse_adaptive
from .core.calibration import replayed, same_step
from .core.history import Histories, IntArray, gather
from .data.windows import Windows, windows_of

Row: TypeAlias = tuple[float, ...]
Pair: TypeAlias = tuple[float, float]

STILL = 1e-6
"""m/s; no edge lies below, so that rounding (a turned world) changes no obstacle's class."""
SHRINKAGE = 50.0
"""Windows: each class counts that many of the average of all beside its own."""
FLOOR = 1e-3
"""m, added in quadrature to every standard deviation: the digits that recordings have."""


@dataclass(frozen=True, eq=False)
class MotionClass:
    """Features of each obstacle's history that select its class.

    Attributes
    ----------
    speed : (O,), m/s, |v_k| with v_k = (p_k - p_{k-1}) / dT, the newest step.
    heading : (O, D), v_k / |v_k|; zero where the speed is below `STILL`.
    jitter : (O,), m/s, root mean square of |v_j - v_{j-1}| over the steps of the history:
        measurement noise and manoeuvres together. 0 where there are not three samples.
    """

    speed: Array
    heading: Array
    jitter: Array

    @classmethod
    def of(cls, past: Histories, dt: float) -> "MotionClass":
        """Read it from histories; steps across a filled gap count as the line they are."""
        velocity = np.diff(past.positions, axis=1) / dt
        if not velocity.shape[1]:
            zero = np.zeros(len(past.origin))
            return cls(zero, np.zeros_like(past.origin), zero)
        speed = np.linalg.norm(velocity[:, -1], axis=1)
        moves = speed >= STILL
        heading = velocity[:, -1] / np.where(moves, speed, 1.0)[:, None] * moves[:, None]
        change = np.sum(np.diff(velocity, axis=1) ** 2, axis=2)
        change = np.where(past.present[:, :-2], change, 0.0)
        count = np.maximum(past.length - 2, 1)
        return cls(speed, heading, np.sqrt(change.sum(axis=1) / count))


def joined(motions: Sequence[MotionClass]) -> MotionClass:
    """Put the obstacles of several motions after one another."""
    parts = [(each.speed, each.heading, each.jitter) for each in motions]
    return MotionClass(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@dataclass(frozen=True)
class ErrorTable:
    """Variances of the error along and across the heading, per class and step.

    A class is a bin of speed and a bin of jitter. Its variances (a_h, c_h) stand for

    Sigma_h = g (c_h I + (a_h - c_h) u u') + FLOOR^2 I,   g = max(1, jitter / highest edge)^2

    with u the heading: noise in the velocities makes errors that grow with it, and g carries
    that on beyond the jitters that were recorded often. In the slowest bin, where a heading
    says nothing, a_h = c_h. Errors of one obstacle at two steps are correlated as on average
    over all classes.

    Another time grid: standard deviations are linear in the time ahead between the learnt
    steps and 0 at the newest sample; beyond the last step they go on growing as over the
    last step; correlations are those of the interpolated errors, constant beyond the ends.
    Jitter is compared as it is, though at another dT noise and manoeuvres show otherwise in it.

    Attributes
    ----------
    dt : s, between the steps learnt.
    speeds, jitters : m/s, edges between the bins, not decreasing.
    variances : m^2, [class][step] of (along, across); the class is
        speed bin * (number of jitter bins) + jitter bin.
    along, across : (N, N), correlation of the errors at two steps.
    windows : how many the table was learnt from.

    Raises
    ------
    WideberthError : shapes that do not fit, or numbers that are not positive or not finite.
    """

    dt: float
    speeds: Row
    jitters: Row
    variances: tuple[tuple[Pair, ...], ...]
    along: tuple[Row, ...]
    across: tuple[Row, ...]
    windows: int

    def __post_init__(self) -> None:
        positive("table.dt", self.dt)
        classes = (len(self.speeds) + 1) * (len(self.jitters) + 1)
        variances = checked("table.variances", self.variances, (classes, None, 2))
        steps = variances.shape[1]
        for name in ("along", "across"):
            checked(f"table.{name}", getattr(self, name), (steps, steps))
        for name in ("speeds", "jitters"):
            edges = checked(f"table.{name}", getattr(self, name), (len(getattr(self, name)),))
            if (np.diff(edges) < 0).any():
                raise WideberthError(f"table.{name} is {edges.tolist()}; edges must not decrease")
        if not steps or (variances < 0).any():
            raise WideberthError("table.variances must hold one step at least and none below 0")

    def bins(self, motion: MotionClass) -> IntArray:
        """Class of each obstacle, (O,)."""
        return classes(motion, np.array(self.speeds), np.array(self.jitters))

    def growth(self, motion: MotionClass) -> Array:
        """Return g, (O,)."""
        return growth(motion.jitter, np.array(self.jitters))

    def spreads(self, motion: MotionClass, times: Array) -> Array:
        """Return standard deviations along and across, (O, N, 2), m, at times ahead (O, N), s."""
        place = times / self.dt
        below = np.clip(np.floor(place + 1e-9), 0, len(self.along) - 1).astype(np.int64)
        share = (place - below)[..., None]
        row = self.bins(motion)[:, None]
        first = self._deviations[row, below]
        step = self._deviations[row, below + 1] - first
        # Beyond the table, errors that shrank over the last step do not shrink further.
        beyond = np.maximum(share - 1.0, 0.0) * np.maximum(step, 0.0)
        spread = first + np.minimum(share, 1.0) * step + beyond
        wide = spread * np.sqrt(self.growth(motion))[:, None, None]
        return np.asarray(np.sqrt(wide**2 + FLOOR**2))

    def correlations(self, times: Array) -> tuple[Array, Array]:
        """Return correlations along and across, 2 x (O, N, N), at times ahead (O, N), s."""
        steps = len(self.along)
        place = np.clip(times / self.dt - 1.0, 0.0, steps - 1.0)
        weight = np.maximum(1.0 - np.abs(place[..., None] - np.arange(steps)), 0.0)
        return _carried(np.array(self.along), weight), _carried(np.array(self.across), weight)

    @cached_property
    def _deviations(self) -> Array:
        """Standard deviations with those at time 0 in front, (classes, N + 1, 2), m."""
        return np.pad(np.sqrt(np.array(self.variances)), ((0, 0), (1, 0), (0, 0)))


def _carried(correlation: Array, weight: Array) -> Array:
    """Correlation of weighted sums of errors; PSD for any weights."""
    covariance = weight @ correlation @ weight.swapaxes(1, 2)
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return np.asarray(covariance / (scale[:, :, None] * scale[:, None, :]))


def classes(motion: MotionClass, speeds: Array, jitters: Array) -> IntArray:
    """Class of each obstacle from the edges of the bins, (O,)."""
    slow = np.searchsorted(speeds, motion.speed)
    calm = np.searchsorted(jitters, motion.jitter)
    return np.asarray(slow * (len(jitters) + 1) + calm, dtype=np.int64)


def growth(jitter: Array, edges: Array) -> Array:
    """Return g = max(1, jitter / highest edge)^2, (O,); 1 where there is no edge."""
    top = edges[-1] if edges.size else np.inf
    return np.asarray(np.maximum(jitter / top, 1.0) ** 2)


def learn_table(
    motion: MotionClass, error: Array, dt: float, speed_bins: int, jitter_bins: int
) -> ErrorTable:
    """Learn a table from past errors.

    Edges are quantiles, so that the bins hold equal shares of the windows. Variances are
    means of e^2 / g, each class with `SHRINKAGE` windows of the average of all beside its own.

    Parameters
    ----------
    motion : of W obstacles.
    error : (W, N, D), m, truth minus forecast.
    dt : s, between the steps.
    speed_bins, jitter_bins : how many.
    """
    speeds = np.maximum(np.quantile(motion.speed, _shares(speed_bins)), STILL)
    jitters = np.maximum(np.quantile(motion.jitter, _shares(jitter_bins)), STILL)
    forward = np.einsum("wnd,wd->wn", error, motion.heading)
    side = error - forward[..., None] * motion.heading[:, None]
    # Of an obstacle without a heading, forward is 0 and side is all of the error.
    sides = error.shape[2] - (motion.speed >= STILL)
    squares = np.stack([forward**2, np.sum(side**2, axis=2) / sides[:, None]], axis=2)
    wide = growth(motion.jitter, jitters)[:, None, None]
    place = classes(motion, speeds, jitters)
    table = _shrunk_means(squares / wide, place, speed_bins * jitter_bins)
    table[:jitter_bins] = _mean_over_axes(table[:jitter_bins], error.shape[2])
    scale = np.maximum(np.sqrt(table[place] * wide), STILL)
    return ErrorTable(
        float(dt),
        tuple(speeds.tolist()),
        tuple(jitters.tolist()),
        tuple(tuple((float(a), float(c)) for a, c in rows) for rows in table),
        _correlation((forward / scale[..., 0])[..., None]),
        _correlation(side / scale[..., 1:]),
        len(error),
    )


def _shrunk_means(squares: Array, place: IntArray, count: int) -> Array:
    """Mean of each class, (count, N, 2), drawn to that of all."""
    total = np.zeros((count, *squares.shape[1:]))
    np.add.at(total, place, squares)
    number = np.bincount(place, minlength=count)[:, None, None]
    return np.asarray((total + SHRINKAGE * squares.mean(axis=0)) / (number + SHRINKAGE))


def _shares(bins: int) -> Array:
    return np.arange(1, bins) / bins


def _mean_over_axes(table: Array, size: int) -> Array:
    """Variance per axis of errors whose direction is not looked at, in both columns."""
    mean = (table[..., :1] + (size - 1) * table[..., 1:]) / size
    return np.repeat(mean, 2, axis=2)


def _correlation(errors: Array) -> tuple[Row, ...]:
    """Correlation about zero of (W, N, C) errors at two steps, as nested tuples."""
    moment = np.einsum("wic,wjc->ij", errors, errors) + STILL * np.eye(errors.shape[1])
    scale = np.sqrt(np.diag(moment))
    return tuple(tuple(row) for row in (moment / np.outer(scale, scale)).tolist())


FEWEST = 3
"""Samples: jitter is a difference of two velocities."""


@final
@dataclass(frozen=True)
class Empirical(Fittable):
    """Replaces the covariance of a base predictor by that of its recorded errors.

    mu_h as the base says,   Sigma_h = Sigma_h(speed bin, jitter bin), turned to the heading

    People who stand, stroll or zigzag are not equally hard to forecast, and one process
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
        motions = [MotionClass.of(gather(found.tracks), scene.dt) for scene, found in filled]
        table = learn_table(joined(motions), error, dataset[0].dt, self.speeds, self.jitters)
        return replace(self, base=base, fitted=table)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        forecast = self.base.predict(tracks, steps, scene)
        if self.fitted is None:
            return forecast
        past = gather(tracks, length=self.observed)
        motion = MotionClass.of(past, tracks.dt)
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
