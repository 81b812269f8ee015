"""Online conformal calibration: scales that follow how often the truth was missed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self, final

import numpy as np

from ..framework.predictor import Adaptive, AdaptiveFiltering, Fittable, Predictor
from ..framework.tracking.windows import Windows, windows_of
from ..framework.values.arrays import (
    Array,
    BoolArray,
    altered,
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
class Pending:
    """A forecast as it was stated, waiting for the truth.

    Attributes
    ----------
    stamp : s, of the newest sample that it was made from.
    ids : of the obstacles.
    kind : (O,), class of each.
    judged : (O,), steps of each that were compared with the truth, or for which there was none.
    mean, covariance, weight : as in `Forecast`, covariances as stated, scale and all.
    """

    stamp: float
    ids: tuple[str, ...]
    kind: Any
    judged: Any
    mean: Any
    covariance: Any
    weight: Any

    def __post_init__(self) -> None:
        for name in ("mean", "covariance", "weight"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))
        for name in ("kind", "judged"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.int64))


@dataclass(frozen=True, eq=False)
class Online:
    """State of the online calibration: scales learnt and forecasts pending.

    Attributes
    ----------
    stamp : s, of the newest sample used.
    dt : s, between the steps.
    log_scale : (C * N,), of the covariance of each step, the slowest class first, and last that
        of those who have just appeared.
    pending : oldest first; at most one per 0.9 steps of the horizon.
    """

    stamp: float
    dt: float
    log_scale: tuple[float, ...]
    pending: tuple[Pending, ...] = ()

    @cached_property
    def scale(self) -> Array:
        """Of the covariance of each step, (C * N,)."""
        return np.exp(self.log_scale)


class _Looks(NamedTuple):
    """Forecasts of one obstacle at one step that have fallen due, R of them.

    Attributes
    ----------
    row : (R,), of the obstacle in the tracks. time : (R,), s, when they were due.
    kind, step : (R,). mean, covariance, weight : as in `Forecast`, without the steps.
    """

    row: IntArray
    time: Array
    kind: IntArray
    step: IntArray
    mean: Array
    covariance: Array
    weight: Array

    @classmethod
    def of(
        cls, looks: Sequence[tuple[Pending, IntArray, IntArray, IntArray]], dt: float
    ) -> "_Looks":
        """Put them together: forecasts, rows in the tracks, rows in the forecast, and steps."""
        row = np.concatenate([rows for _, rows, _, _ in looks])
        step = np.concatenate([at for *_, at in looks])
        stamps = np.array([one.stamp for one, *_ in looks], dtype=np.float64)
        begin = np.repeat(stamps, [len(rows) for _, rows, *_ in looks])
        kind = np.concatenate([one.kind[index] for one, _, index, _ in looks])
        parts = [
            (one.mean[index, :, at], one.covariance[index, :, at], one.weight[index])
            for one, _, index, at in looks
        ]
        modes = max(part[2].shape[1] for part in parts)
        if modes > 1:
            parts = [
                (
                    more_modes(mean, modes),
                    more_modes(spread, modes),
                    more_modes(share, modes, True),
                )
                for mean, spread, share in parts
            ]
        mean, covariance, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
        time = np.asarray(begin + dt * (step + 1), dtype=np.float64)
        return cls(row, time, kind, step, mean, covariance, weight)


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
        last = state.pending[-1].stamp if state.pending else -np.inf
        if tracks.stamp - last < EARLY * tracks.dt - resolution(tracks.dt, tracks.stamp):
            return learnt
        most = math.ceil((self.steps + BRIDGE) / EARLY)
        pending = (*state.pending, learnt._made(beliefs, tracks, scene))[-most:]
        return altered(learnt, state=altered(state, pending=pending))

    def _made(self, beliefs: Beliefs, tracks: Tracks, scene: Scene | None) -> Pending:
        """State a forecast of the obstacles that count."""
        seen = tracks.lag < tracks.dt - resolution(tracks.dt, tracks.stamp)
        if self.observed > 1:
            seen &= _in_a_row(tracks, self.observed)
        index = np.flatnonzero(seen & (tracks.measured.count > 0))
        forecast, kinds = self._stated(beliefs, tracks, self.steps, scene)
        return Pending(
            tracks.stamp,
            tracks.ids if len(index) == len(tracks) else tuple(tracks.ids[i] for i in index),
            kinds[index],
            np.zeros(len(index)),
            forecast.mean[index],
            forecast.covariance[index],
            forecast.weight[index],
        )

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
            return Online(tracks.stamp, tracks.dt, self.first(tracks.dt))
        pending, looks = self._due(state, tracks)
        horizon = tracks.stamp - (self.steps + BRIDGE) * state.dt + slack
        waiting = tuple(
            one for one in pending if one.stamp > horizon and (one.judged < self.steps).any()
        )
        log_scale = state.log_scale
        if looks is not None:
            log_scale = self._weighed(log_scale, looks, _truth(tracks, looks))
        return Online(tracks.stamp, state.dt, log_scale, waiting)

    def _due(self, state: Online, tracks: Tracks) -> tuple[list[Pending], _Looks | None]:
        """Return the pending forecasts with what is judged now, and what that is."""
        newest = tracks.measured.newest + (tracks.stamp - tracks.clock)
        stamps = np.array([one.stamp for one in state.pending])
        with np.errstate(over="ignore"):  # after leaps of the clock
            elapsed = (newest - stamps[:, None] + resolution(tracks.dt, tracks.stamp)) / state.dt
        known = np.minimum(np.maximum(elapsed, 0.0), self.steps).astype(np.int64)
        place, every = None, np.arange(len(tracks))
        pending: list[Pending] = []
        looks: list[tuple[Pending, IntArray, IntArray, IntArray]] = []
        for one, due in zip(state.pending, known, strict=True):
            rows = every
            if one.ids != tracks.ids:
                place = place or {ident: row for row, ident in enumerate(tracks.ids)}
                rows = np.array([place.get(ident, -1) for ident in one.ids], dtype=np.int64)
                due = np.append(due, 0)[rows]
            judged, index = one.judged, np.flatnonzero(due > one.judged)
            while index.size:
                looks.append((one, rows[index], index, judged[index]))
                judged = np.minimum(judged + 1, np.maximum(due, one.judged))
                index = np.flatnonzero(due > judged)
            pending.append(one if judged is one.judged else altered(one, judged=judged))
        return pending, _Looks.of(looks, state.dt) if looks else None

    def _weighed(
        self, log_scale: tuple[float, ...], looks: _Looks, truth: Array
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


def _missed(looks: _Looks, truth: Array, tail: float) -> Array:
    """Return 1 where the truth, (R, D), lay outside of the region that was stated, else 0."""
    if looks.mean.shape[1] > 1:
        mean, covariance = looks.mean[:, :, None], looks.covariance[:, :, None]
        inside = reached_tail(mean, covariance, looks.weight, truth[:, None])[:, 0] >= tail
    else:
        size = truth.shape[1]
        spread = looks.covariance[:, 0] + SMALLEST * np.eye(size)
        gap = np.einsum(
            "abr,rb->ar", whitened(spread.transpose(1, 2, 0)), truth - looks.mean[:, 0]
        )
        inside = (gap**2).sum(axis=0) <= content_bound(size, tail)
    return np.where(inside, 0.0, 1.0)


def _truth(tracks: Tracks, looks: _Looks) -> Array:
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
