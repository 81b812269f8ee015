"""Online conformal calibration: scales that follow how often the truth was missed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ..framework.predictor import Adaptive, Fittable, Predictor
from ..framework.tracking.windows import Windows, windows_of
from ..framework.values.arrays import Array, checked, positive, probability, whole
from ..framework.values.coverage import Coverage, Event
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from ..metrics.episode import content_bound
from ..metrics.scoring import reached_tail
from .core.calibration import replayed, same_step, scaled, squared_distances
from .core.history import FILTERED, Histories, IntArray, gather
from .corrected import Corrected, thinned
from .interacting_models import InteractingModels

ON_GRID = 1e-6
"""Steps by which a time may miss another and still count as the same."""
EARLY = 0.9
"""Steps after which the next forecast is stated: stamps that jitter must not skip every other."""
FEWEST, CLASS = 100, 100
"""Windows that a fit needs in all, and a class for scales of its own."""
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
    kind : class of each.
    mean, covariance, weight : as in `Forecast`, covariances as stated, scale and all.
    """

    stamp: float
    ids: tuple[str, ...]
    kind: tuple[int, ...]
    mean: Any
    covariance: Any
    weight: Any

    def __post_init__(self) -> None:
        for name in ("mean", "covariance", "weight"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=np.float64))


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


@final
@dataclass(frozen=True)
class AdaptiveConformal(Adaptive, Fittable):
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

    `update` makes the forecasts that it will judge: those of all obstacles seen at the newest
    sample (for ``observed`` samples in a row), so that the rate is one of all that a planner is
    given. Truth is looked up by identity at the time it falls due (linear between two samples
    where updates come off the grid) and lost if the obstacle is not there. A clock that goes back
    or another dt starts anew. On another time grid scales are interpolated.

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
                mean, covariance, weight = replayed(base, scene, some, FILTERED)
                scores.append(squared_distances(mean, covariance, weight, some.future))
                past = gather(_with_past(scene, some))
                kinds.append(self._kinds(mean, weight, past, scene.dt))
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

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        return self._stated(tracks, steps, scene)[0]

    def _stated(
        self, tracks: Tracks, steps: int, scene: Scene | None
    ) -> tuple[Forecast, IntArray]:
        """Return the scaled forecast and the class of each obstacle."""
        forecast = self.base.predict(tracks, steps, scene)
        kinds = self._kinds(forecast.mean, forecast.weight, gather(tracks), tracks.dt)
        if self.state is not None:
            known, dt = self.state.log_scale, self.state.dt
        elif self.start is not None and self.start_dt is not None:
            known, dt = self.start, self.start_dt
        else:
            return forecast, kinds
        table = np.exp(known).reshape(self.classes, self.steps)
        return scaled(forecast, table[kinds], dt, tracks), kinds

    def _kinds(self, mean: Array, weight: Array, past: Histories, dt: float) -> IntArray:
        """Class of each obstacle, (O,), from its forecast and its history."""
        centre = np.einsum("om,omnd->ond", weight, mean[:, :, :2])
        if centre.shape[1] == 1:
            centre = np.stack([past.origin, centre[:, 0]], axis=1)
        speed = np.linalg.norm(centre[:, -1] - centre[:, 0], axis=1) / dt
        kinds = np.searchsorted(np.array(self.speeds), speed, side="right")
        appeared = past.samples == 1
        return np.where(appeared, len(self.speeds) + 1, kinds).astype(np.int64)

    def update(self, tracks: Tracks, scene: Scene | None = None) -> Self:
        """Learn from forecasts that have fallen due, then forecast; see `Adaptive.update`."""
        base = self.base
        if isinstance(base, Adaptive):
            base = base.update(tracks, scene)
        state = self._learnt(tracks)
        learnt = replace(self, base=base, state=state)
        last = state.pending[-1].stamp if state.pending else -np.inf
        if tracks.stamp - last < EARLY * tracks.dt - _slack(tracks):
            return learnt
        most = math.ceil(self.steps / EARLY)
        pending = (*state.pending, learnt._made(tracks, scene))[-most:]
        return replace(learnt, state=replace(state, pending=pending))

    def _made(self, tracks: Tracks, scene: Scene | None) -> Pending:
        """State a forecast of the obstacles that count."""
        recent = tracks.positions[:, -self.observed :]
        seen = np.isfinite(recent).all(axis=(1, 2)) & (recent.shape[1] == self.observed)
        index = [int(i) for i in np.flatnonzero(seen)]
        forecast, kinds = self._stated(tracks, self.steps, scene)
        return Pending(
            tracks.stamp,
            tuple(tracks.ids[i] for i in index),
            tuple(kinds[index].tolist()),
            forecast.mean[index],
            forecast.covariance[index],
            forecast.weight[index],
        )

    def _learnt(self, tracks: Tracks) -> Online:
        """Return the state after the truth that has come since the last update."""
        state = self.state
        slack = _slack(tracks)
        if (
            state is None
            or abs(state.dt - tracks.dt) > slack
            or tracks.stamp < state.stamp - slack
            or len(state.log_scale) != self.classes * self.steps
        ):
            return Online(tracks.stamp, tracks.dt, self.first(tracks.dt))
        balance = np.zeros((self.classes, self.steps))
        count = np.zeros_like(balance)
        place = {ident: index for index, ident in enumerate(tracks.ids)}
        for one in state.pending:
            first = self._due(state.stamp - one.stamp + slack, state.dt)
            last = self._due(tracks.stamp - one.stamp + slack, state.dt)
            for step in range(first, last):
                kinds, missed = self._missed(one, step, tracks, place)
                np.add.at(balance[:, step], kinds, missed - self.tail)
                np.add.at(count[:, step], kinds, 1.0)
        change = self.rate * balance / np.sqrt(np.maximum(count, 1.0))
        log_scale = state.log_scale + change.ravel()
        bounded = np.clip(log_scale, -LIMIT, LIMIT).tolist()
        horizon = tracks.stamp - self.steps * state.dt + slack
        waiting = tuple(one for one in state.pending if one.stamp > horizon)
        return Online(tracks.stamp, state.dt, tuple(bounded), waiting)

    def _due(self, elapsed: float, dt: float) -> int:
        """Return how many steps of a forecast have fallen due, whatever the clock has done."""
        return int(min(max(elapsed / dt, 0.0), self.steps))

    def first(self, dt: float) -> tuple[float, ...]:
        """Log scales before anything was seen to happen."""
        if self.start is None or self.start_dt is None:
            return (0.0,) * (self.classes * self.steps)
        learnt = np.reshape(self.start, (self.classes, self.steps))
        grid = np.arange(1.0, self.steps + 1)
        rows = [np.interp(dt * grid, self.start_dt * grid, row) for row in learnt]
        return tuple(np.concatenate(rows).tolist())

    def _missed(
        self, one: Pending, step: int, tracks: Tracks, place: dict[str, int]
    ) -> tuple[IntArray, Array]:
        """Class of each obstacle known at the due time, and 1 where it lay outside, else 0."""
        mine = [i for i, ident in enumerate(one.ids) if ident in place]
        theirs = [place[one.ids[i]] for i in mine]
        truth = _position(tracks, one.stamp + (step + 1) * tracks.dt)[theirs]
        known = np.isfinite(truth).all(axis=1)
        rows = np.array(mine, dtype=np.int64)[known]
        with np.errstate(all="ignore"):  # a distance beyond all numbers is a miss
            tails = reached_tail(
                one.mean[rows, :, step : step + 1],
                one.covariance[rows, :, step : step + 1],
                one.weight[rows],
                truth[known, None],
            )
        kinds = np.array(one.kind, dtype=np.int64)[rows]
        return kinds, np.asarray(tails[:, 0] < self.tail, dtype=np.float64)


def _with_past(scene: Tracks, windows: Windows) -> Tracks:
    """Tracks of windows with what was seen before them, as far back as filters look."""
    rows = windows.row[:, None] + np.arange(1 - FILTERED, 1)
    before = scene.positions[windows.obstacle[:, None], np.maximum(rows, 0)]
    return replace(windows.tracks, positions=np.where((rows >= 0)[..., None], before, np.nan))


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


def _slack(tracks: Tracks) -> float:
    """Seconds by which a time may miss another: a clock that counts since 1970 is coarse."""
    return max(ON_GRID * tracks.dt, 4.0 * float(np.spacing(abs(tracks.stamp))))


def _position(tracks: Tracks, time: float) -> Array:
    """Where each obstacle was at a time up to the newest sample, (O, D); NaN if not known."""
    rows = tracks.positions.shape[1]
    place = min(rows - 1 - (tracks.stamp - time) / tracks.dt, rows - 1.0)
    if not place > -1.0:  # also where a clock has made the difference infinite
        return np.full((len(tracks), tracks.dimension), np.nan)
    nearest = round(place)
    if abs(place - nearest) * tracks.dt <= _slack(tracks):
        place = float(nearest)
    below = int(np.floor(place))
    if below < 0:
        return np.full((len(tracks), tracks.dimension), np.nan)
    share = place - below
    if share == 0.0:
        return np.asarray(tracks.positions[:, below])
    return np.asarray(
        (1 - share) * tracks.positions[:, below] + share * tracks.positions[:, below + 1]
    )
