"""Online conformal calibration: scales that follow how often the truth was missed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self, final

import numpy as np

from ..framework.predictor import Adaptive, AdaptiveFiltering, Fittable, Predictor
from ..framework.values.arrays import (
    Array,
    BoolArray,
    altered,
    assembled,
    checked,
    positive,
    probability,
    whole,
)
from ..framework.values.beliefs import Beliefs
from ..framework.values.coverage import Coverage, Event
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks, resolution
from ..metrics.episode import SMALLEST, content_bound
from ..metrics.scoring import reached_tail
from .core.assembly import more_modes
from .core.calibration import followed, same_step, scaled, squared_distances
from .core.history import LONGEST_GAP, IntArray, gather
from .core.kalman_filter import whitened
from .core.wrapping import Wrapping
from .corrected import Corrected, thinned
from .data.windows import Windows, windows_of
from .interacting_models import InteractingModels

EARLY = 0.9
"""Steps after which the next forecast is stated: stamps that jitter must not skip every other."""
FEWEST, CLASS = 100, 100
"""Windows that a fit needs in all, and a class for scales of its own."""
BRIDGE = 2.5
"""Steps, longest pause between two measurements between which the truth is on a straight line."""
LIMIT = 12.0
"""Largest |log scale|: a factor of 400 in lengths. It stops the drift to 0 where a forecast
never misses (all people stand still), from which the scale would need long to come back."""


@dataclass(frozen=True, eq=False)
class Stated:
    """What forecasts said of one obstacle at one step, R times, until it is compared with truth.

    Attributes
    ----------
    row : (R,), of the obstacle in `Online.ids`.
    time : (R,), s, that the step is about.
    kind, step : (R,), class and step, from 0.
    mean, covariance, weight : (R, M, D), (R, M, D, D), (R, M), covariances as stated, scale and
        all.
    """

    row: Any
    time: Any
    kind: Any
    step: Any
    mean: Any
    covariance: Any
    weight: Any

    def __post_init__(self) -> None:
        for name in ("row", "kind", "step"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.int64))
        for name in ("time", "mean", "covariance", "weight"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))

    @classmethod
    def of(cls, forecast: Forecast, stamp: float, rows: IntArray, kinds: IntArray) -> "Stated":
        """Return all steps of a forecast that was made at a time, s, for some rows."""
        steps, modes, size = forecast.steps, *forecast.mean.shape[1::2]
        step = np.tile(np.arange(steps), len(rows))
        return assembled(
            cls,
            row=np.repeat(rows, steps),
            time=stamp + forecast.dt * (step + 1.0),
            kind=np.repeat(kinds[rows], steps),
            step=step,
            mean=forecast.mean[rows].swapaxes(1, 2).reshape(-1, modes, size),
            covariance=forecast.covariance[rows].swapaxes(1, 2).reshape(-1, modes, size, size),
            weight=np.repeat(forecast.weight[rows], steps, axis=0),
        )

    def at(self, index: IntArray) -> "Stated":
        """Return some of them."""
        return assembled(Stated, **{name: part[index] for name, part in vars(self).items()})

    def joined(self, other: "Stated") -> "Stated":
        """Return both; where one has fewer modes, they are filled up with modes of weight 0."""
        if not len(self.row):
            return other
        modes = max(self.weight.shape[1], other.weight.shape[1])
        mine, more = vars(self._with_modes(modes)), vars(other._with_modes(modes))
        parts = {name: np.concatenate([mine[name], more[name]]) for name in mine}
        return assembled(Stated, **parts)

    def _with_modes(self, modes: int) -> "Stated":
        if self.weight.shape[1] == modes:
            return self
        return altered(
            self,
            mean=more_modes(self.mean, modes),
            covariance=more_modes(self.covariance, modes),
            weight=more_modes(self.weight, modes, True),
        )


NOTHING = Stated(*[()] * 7)
"""No forecast waits."""


@dataclass(frozen=True, eq=False)
class Online:
    """State of the online calibration: scales learnt and forecasts that wait for the truth.

    Attributes
    ----------
    stamp : s, of the newest sample used.
    dt : s, between the steps.
    log_scale : (C * N,), of the covariance of each step, the slowest class first, and last that
        of those who have just appeared.
    stated : s, stamp of the newest sample of the last forecast that was stated; -inf without any.
    ids : of the obstacles that ``waiting`` is about.
    waiting : of forecasts that were stated 0.9 steps apart or more.
    """

    stamp: float
    dt: float
    log_scale: tuple[float, ...]
    stated: float = -math.inf
    ids: tuple[str, ...] = ()
    waiting: Stated = NOTHING

    @cached_property
    def scale(self) -> Array:
        """Of the covariance of each step, (C * N,)."""
        return np.exp(self.log_scale)

    def about(self, ids: tuple[str, ...]) -> "Online":
        """Return the same with these obstacles first, and behind them others that it waits for."""
        if ids == self.ids:
            return self
        place = {name: row for row, name in enumerate(ids)}
        for row in np.unique(self.waiting.row).tolist():
            place.setdefault(self.ids[row], len(place))
        rows = np.array([place.get(name, -1) for name in self.ids], dtype=np.int64)
        waiting = self.waiting
        if len(waiting.row):
            waiting = altered(waiting, row=rows[waiting.row])
        return altered(self, ids=tuple(place), waiting=waiting)


@final
@dataclass(frozen=True)
class AdaptiveConformal(Wrapping, AdaptiveFiltering, Fittable):
    """Scales the covariances of a base predictor online, from the errors observed so far.

    Sigma_h -> exp(l_ch) Sigma_h,   l_ch <- l_ch + rate * sum_i (miss_i - tail) / sqrt(n)

    Each class c of speed has its scales: forecasts of people who stand err less than those of
    people who walk, and a rate that holds for both together holds for neither. The speed is that
    of the base's forecast over its first steps, in which measurement noise is filtered. Who has
    just appeared, with a single sample, shows no speed, and is of the last class. Whenever
    truth arrives for step h of earlier forecasts of n obstacles of a class, miss_i is 1 where it
    lies outside of the region of content 1 - tail that was stated, scale included, else 0. Of
    several modes that is the region of highest density, as everywhere that forecasts are scored;
    the union of the modes' ellipses, which a planner keeps clear of, is larger and holds more.
    Too many misses widen the step, too few narrow it. The n people of one moment are n looks at
    the same scale; the sum of their misses varies by sqrt(n), so that a step's scale moves alike
    in a crowd and alone.

    Nothing is assumed of the base or of the world but that |l_ch| stays below 12: as the sum
    telescopes, over T updates the misses of one obstacle average to within (max l - min l
    + rate) / (rate T) of the tail, on any site and however it changes. (Of several, their sums
    over sqrt(n) do: a moment with four people weighs twice as much as one with one.) That is a
    long-run rate per class and step; it says nothing of a single moment, of all steps
    together, or of an episode.

    `update` makes the forecasts that it will judge: those of all obstacles measured within the
    newest step (and for ``observed`` samples in a row), so that the rate is one of all that a
    planner is given. Each obstacle is judged once a measurement of its own reaches the time at
    which a step falls due, there or on the line between two measurements, and not where they are
    more than 2.5 steps apart. A clock that goes back or another dt starts anew. On another time
    grid scales are interpolated.

    Without a fit it starts from l = 0. `fit` fits the base and starts from where the recordings
    would have l: the logarithm of the (1 - tail) quantile of the squared Mahalanobis distances
    of a class and step (of several modes from the nearest), over that of the chi-square
    distribution. Every recording counts alike; a class with fewer than 100 windows starts where
    all classes together do.

    Parameters
    ----------
    base : predictor to calibrate.
    tail : of the region that is to hold.
    rate : of adaptation. One miss of a lone obstacle widens the variance by the factor
        exp(rate (1 - tail)), one hit narrows it by exp(-rate tail). Small follows slowly, large
        makes scales restless and their regions larger on average.
    observed : samples in a row that an obstacle must have been seen for its forecast to count;
        by default all count who are seen.
    steps : ahead, each with a scale of its own; later ones share the last.
    speeds : m/s, bounds between the classes, increasing; none for one class.
    start, start_dt : what `fit` has learnt, in the order of `Online.log_scale`, and its dt, s.
    state : what `update` has learnt; None before.

    Raises
    ------
    WideberthError : a tail outside (0, 1), a rate not above 0, or a number below 1.

    References
    ----------
    Gibbs, Candes, "Adaptive Conformal Inference Under Distribution Shift", NeurIPS 2021, who
    adapt the level; here the logarithm of the size is, which cannot run out of quantiles
    (Angelopoulos, Candes, Tibshirani, "Conformal PID Control", NeurIPS 2023).
    """

    base: Predictor = field(default_factory=lambda: Corrected(InteractingModels()))
    tail: float = 0.05
    rate: float = 0.1
    observed: int = 1
    steps: int = 12
    speeds: tuple[float, ...] = (0.1, 0.5, 1.5)
    start: tuple[float, ...] | None = None
    start_dt: float | None = None
    state: Online | None = None

    reference: ClassVar[str] = "gibbs2021adaptive"
    coverage: ClassVar[Coverage | None] = Coverage(
        Event.LONG_RUN,
        "1 - tail in the limit, for each class of speed and step",
        "the logarithm of no scale reaches its limit",
        reference,
    )

    def __post_init__(self) -> None:
        probability("adaptive_conformal.tail", self.tail)
        positive("adaptive_conformal.rate", self.rate)
        for name in ("observed", "steps"):
            whole(f"adaptive_conformal.{name}", getattr(self, name))
        bounds = (0.0, *self.speeds)
        if not np.isfinite(bounds).all() or (np.diff(bounds) <= 0).any():
            raise WideberthError(
                f"adaptive_conformal.speeds is {self.speeds}; wanted increasing numbers above 0"
            )
        if (self.start is None) != (self.start_dt is None):
            raise WideberthError("adaptive_conformal.start and start_dt belong together")
        if self.start is not None:
            checked("adaptive_conformal.start", self.start, (self.classes * self.steps,))
            positive("adaptive_conformal.start_dt", self.start_dt or 0.0)

    @property
    def classes(self) -> int:
        """C: those of speed, and that of who has just appeared."""
        return len(self.speeds) + 2

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Fit the base, where it can be fitted, and learn where the scales start.

        Raises
        ------
        WideberthError : as the base's fit, scenes that differ in dt, or too few windows.
        """
        same_step(dataset, "adaptive_conformal")
        found = windows_of(
            dataset, self.observed, self.steps, wanted=FEWEST, who="adaptive_conformal"
        )
        base = self.base.fit(dataset) if isinstance(self.base, Fittable) else self.base
        scores, kinds, weights = [], [], []
        for scene, windows in zip(dataset, found, strict=True):
            some = thinned(windows)
            if len(some):
                mean, covariance, weight = followed(base, scene, some)
                scores.append(squared_distances(mean, covariance, weight, some.future))
                newest, new = some.tracks.positions[:, -1], _appeared(scene, some)
                kinds.append(self._kinds(mean, weight, newest, new, scene.dt))
                weights.append(np.full(len(some), 1.0 / len(some)))
        limit = content_bound(dataset[0].dimension, self.tail)
        start = _starts(
            np.concatenate(scores) / limit,
            np.concatenate(kinds),
            np.concatenate(weights),
            self.classes,
            1.0 - self.tail,
        )
        return replace(self, base=base, state=None, start=start, start_dt=dataset[0].dt)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        return self._stated(beliefs, tracks, steps, scene)[0]

    def _stated(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None
    ) -> tuple[Forecast, IntArray]:
        """Return the scaled forecast and the class of each obstacle."""
        forecast = self.base.ahead(beliefs, tracks, steps, scene)
        count = beliefs.count if len(beliefs) else gather(tracks).samples
        newest = gather(tracks, length=1).origin if steps == 1 else forecast.mean[:, 0, 0]
        kinds = self._kinds(forecast.mean, forecast.weight, newest, count == 1, tracks.dt)
        if self.state is not None:
            scale, dt = self.state.scale, self.state.dt
        elif self.start is not None and self.start_dt is not None:
            scale, dt = np.exp(self.start), self.start_dt
        else:
            return forecast, kinds
        return scaled(forecast, scale.reshape(self.classes, -1)[kinds], dt, tracks), kinds

    def _kinds(
        self, mean: Array, weight: Array, newest: Array, appeared: BoolArray, dt: float
    ) -> IntArray:
        """Class of each obstacle, (O,), from its forecast.

        Parameters
        ----------
        mean, weight : of the forecast.
        newest : (O, D), m, newest position; used where a forecast has one step.
        appeared : (O,), who has a single sample.
        dt : s.
        """
        centre = np.einsum("om,omnd->ond", weight, mean[:, :, :2])
        moved = centre[:, -1] - (newest if centre.shape[1] == 1 else centre[:, 0])
        speed = np.sqrt((moved**2).sum(axis=1)) / dt
        kinds = np.searchsorted(np.array(self.speeds), speed, side="right")
        return np.where(appeared, len(self.speeds) + 1, kinds).astype(np.int64)

    def update(
        self, tracks: Tracks, scene: Scene | None = None, beliefs: Beliefs | None = None
    ) -> Self:
        """Learn from forecasts that have fallen due, then forecast; see `Adaptive.update`."""
        beliefs = self.filtered(tracks) if beliefs is None else beliefs
        base = self.base
        if isinstance(base, AdaptiveFiltering):
            base = base.update(tracks, scene, beliefs)
        elif isinstance(base, Adaptive):
            base = base.update(tracks, scene)
        state = self._learnt(tracks)
        learnt = altered(self, base=base, state=state)
        slack = resolution(tracks.dt, tracks.stamp)
        if tracks.stamp - state.stated < EARLY * tracks.dt - slack:
            return learnt
        seen = tracks.lag < tracks.dt - slack
        if self.observed > 1:
            seen &= _in_a_row(tracks, self.observed)
        rows = np.flatnonzero(seen & (tracks.measured.count > 0))
        forecast, kinds = learnt._stated(beliefs, tracks, self.steps, scene)
        waiting = state.waiting.joined(Stated.of(forecast, tracks.stamp, rows, kinds))
        return altered(learnt, state=altered(state, stated=tracks.stamp, waiting=waiting))

    def _learnt(self, tracks: Tracks) -> Online:
        """Return the state after the truth that has come since the last update."""
        state = self.state
        slack = resolution(tracks.dt, tracks.stamp)
        if (
            state is None
            or abs(state.dt - tracks.dt) > slack
            or tracks.stamp < state.stamp - slack
            or len(state.log_scale) != self.classes * self.steps
        ):
            return Online(tracks.stamp, tracks.dt, self.first(tracks.dt), ids=tracks.ids)
        state = state.about(tracks.ids)
        due, rest = self._due(state, tracks)
        log_scale = state.log_scale
        if len(due.row):
            log_scale = self._weighed(log_scale, due, _truth(tracks, due))
        return altered(state, stamp=tracks.stamp, log_scale=log_scale, waiting=rest)

    def _due(self, state: Online, tracks: Tracks) -> tuple[Stated, Stated]:
        """Return the forecasts that are judged now, and those that wait on.

        Judged are those about a time that measurements of their obstacle have reached.
        """
        waiting = state.waiting
        newest = np.full(len(state.ids), -np.inf)
        newest[: len(tracks)] = tracks.measured.newest + (tracks.stamp - tracks.clock)
        slack = resolution(tracks.dt, tracks.stamp)
        if not len(waiting.row):
            return NOTHING, NOTHING
        known = waiting.time <= newest[waiting.row] + slack
        begin = waiting.time - state.dt * (waiting.step + 1.0)
        lately = begin > tracks.stamp - (self.steps + BRIDGE) * state.dt + slack
        return waiting.at(np.flatnonzero(known)), waiting.at(np.flatnonzero(lately & ~known))

    def _weighed(
        self, log_scale: tuple[float, ...], looks: Stated, truth: Array
    ) -> tuple[float, ...]:
        """Return the scales after forecasts met the truth, (R, D), NaN where it is unknown."""
        known = np.isfinite(truth).all(axis=1)
        with np.errstate(all="ignore"):  # a distance beyond all numbers is a miss
            missed = _missed(looks, truth, self.tail)[known]
        cell = (looks.kind * self.steps + looks.step)[known]
        size = self.classes * self.steps
        balance = np.bincount(cell, missed - self.tail, size)
        count = np.bincount(cell, minlength=size)
        change = self.rate * balance / np.sqrt(np.maximum(count, 1.0))
        return tuple(np.clip(log_scale + change, -LIMIT, LIMIT).tolist())

    def first(self, dt: float) -> tuple[float, ...]:
        """Log scales before anything was seen to happen."""
        if self.start is None or self.start_dt is None:
            return (0.0,) * (self.classes * self.steps)
        learnt = np.reshape(self.start, (self.classes, self.steps))
        grid = np.arange(1.0, self.steps + 1)
        rows = [np.interp(dt * grid, self.start_dt * grid, row) for row in learnt]
        return tuple(np.concatenate(rows).tolist())


def _missed(looks: Stated, truth: Array, tail: float) -> Array:
    """Return 1 where the truth, (R, D), lay outside of the region that was stated, else 0."""
    if looks.mean.shape[1] > 1:
        mean, covariance = looks.mean[:, :, None], looks.covariance[:, :, None]
        inside = reached_tail(mean, covariance, looks.weight, truth[:, None])[:, 0] >= tail
    else:
        size = truth.shape[1]
        spread = looks.covariance[:, 0] + SMALLEST * np.eye(size)
        gap = np.einsum("rab,rb->ra", whitened(spread), truth - looks.mean[:, 0])
        inside = (gap**2).sum(axis=1) <= content_bound(size, tail)
    return np.where(inside, 0.0, 1.0)


def _truth(tracks: Tracks, looks: Stated) -> Array:
    """Where obstacles were when forecasts of them were due, (R, D), m; NaN where unknown."""
    measured, slack = tracks.measured, resolution(tracks.dt, tracks.stamp)
    time = looks.time + (tracks.clock - tracks.stamp)
    truth = np.full((len(time), tracks.dimension), np.nan)
    now = np.abs(tracks.clock - time) <= slack
    truth[now] = tracks.positions[looks.row[now], -1]
    rest = np.flatnonzero(~now)
    for row in np.unique(looks.row[rest]):
        mine = rest[looks.row[rest] == row]
        times, places = measured.times[row], measured.values[row][:, : measured.size]
        after = np.minimum(times.searchsorted(time[mine] - slack), len(times) - 1)
        before = np.maximum(after - 1, 0)
        width = times[after] - times[before]
        share = np.where(width > 0, (times[after] - time[mine]) / np.maximum(width, slack), 0.0)
        share = np.where(np.abs(share) * width <= slack, 0.0, share)
        exact = np.abs(times[after] - time[mine]) <= slack
        known = exact | ((width > 0) & (share <= 1.0) & (width <= BRIDGE * tracks.dt))
        line = places[after] - share[:, None] * (places[after] - places[before])
        truth[mine] = np.where(known[:, None], line, np.nan)
    return truth


def _in_a_row(tracks: Tracks, number: int) -> BoolArray:
    """Whether each obstacle has so many samples in a row, (O,), up to one of the last two rows."""
    seen = np.isfinite(tracks.positions).all(axis=2)
    late = np.zeros((len(tracks), number), dtype=np.bool_)
    seen = np.concatenate([late, seen], axis=1)
    now, before = seen[:, -number:], seen[:, -number - 1 : -1]
    return np.asarray(np.where(now[:, -1], now.all(axis=1), before.all(axis=1)), dtype=np.bool_)


def _appeared(scene: Tracks, windows: Windows) -> BoolArray:
    """Whose newest sample in a window is the first since a long gap, (W,)."""
    rows = windows.row[:, None] + np.arange(-LONGEST_GAP - 1, 0)
    before = scene.positions[windows.obstacle[:, None], np.maximum(rows, 0)]
    seen = np.isfinite(before).all(axis=2) & (rows >= 0)
    return np.asarray(~seen.any(axis=1), dtype=np.bool_)


def _starts(
    ratio: Array, kinds: IntArray, weights: Array, count: int, content: float
) -> tuple[float, ...]:
    """Log of the weighted quantile of (W, N) ratios by class, `Online.log_scale`'s order."""
    rows = []
    for kind in range(count):
        own = kinds == kind
        some = own if own.sum() >= CLASS else np.ones_like(own)
        rows.append([_quantile(column, weights[some], content) for column in ratio[some].T])
    return tuple(np.clip(np.log(np.maximum(rows, 1e-12)), -LIMIT, LIMIT).ravel().tolist())


def _quantile(values: Array, weights: Array, share: float) -> float:
    """Return the least value that this share of the weight does not exceed."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][min(np.searchsorted(total, share * total[-1]), len(order) - 1)])
