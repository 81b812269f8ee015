"""From what is seen to a forecast on the plan's grid."""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import final

import numpy as np

from ..predictor import Adaptive, AdaptiveFiltering, Predictor
from ..values.arrays import Array, altered, assembled
from ..values.beliefs import Beliefs
from ..values.errors import WideberthError
from ..values.failures import caught
from ..values.forecast import Forecast, Scene, on_grid, resample
from ..values.motion import Observation
from ..values.number_limits import bounded
from ..values.plan import Plan
from ..values.tracks import Tracks
from .history import History, admitted
from .names import FASTEST
from .noise import NoiseEstimate
from .resampling import PACE

LOG = logging.getLogger("wideberth.perception")
CHANGED = 1.2
"""Factor between an estimated noise and the one logged last from which on it is logged again."""
FORGET = 3.0
"""s after which the planner drops an obstacle that is no longer reported."""
FINE = 0.01
"""Share of a track's step that the clock must resolve."""
LONG = 20.0
"""Pause between two observations over the period from which on it is said, once."""


@final
@dataclass(frozen=True, eq=False)
class Perception:
    """Remembered detections and the predictor that forecasts them: a value that `take` replaces.

    Attributes
    ----------
    predictor : as configured, or its adapted copy.
    dimension : D of the robot; detections of another dimension are dropped.
    history : of the detections.
    forget : s after which an obstacle that is no longer reported is dropped.
    period : s that are meant to lie between observations.
    stamp : s, of the last observation.
    notes : what was refused since `drained`, and why.
    logged : the noise of each sensor that was logged last, m.
    paused : whether a long pause was noted.
    placeless : names of those that the last observation saw without a place, see `sound`.
    filtered : the tracks that the predictor has filtered last, and what came of it.
    """

    predictor: Predictor
    dimension: int
    history: History
    forget: float
    period: float
    stamp: float = -np.inf
    notes: tuple[str, ...] = ()
    logged: Mapping[str, float] = field(default_factory=dict)
    paused: bool = False
    placeless: tuple[str, ...] = ()
    filtered: tuple[Tracks, Beliefs] | None = None

    @classmethod
    def initial(
        cls,
        predictor: Predictor,
        dimension: int,
        dt: float,
        samples: int,
        period: float,
        forget: float,
        fastest: float = FASTEST,
    ) -> "Perception":
        """Return that of a controller that has seen nothing.

        Parameters
        ----------
        predictor, dimension, forget : as above.
        dt : s between the samples of the tracks.
        samples : their number; more where they would not reach back over ``forget``.
        period : s between observations.
        fastest : m/s, speed that no obstacle exceeds.
        """
        samples = max(samples, math.ceil(forget / dt) + 2)
        history = History(dt, samples, forget, 2.5 * max(dt, period), fastest)
        return cls(predictor, dimension, history, forget, period)

    @property
    def noise(self) -> dict[str, NoiseEstimate]:
        """The estimated noise of each sensor that does not state it."""
        return self.history.noise

    def take(self, observation: Observation, here: Array | None = None) -> "Perception":
        """Take note of what is seen from ``here``, (D,), m; see `admitted` for what is refused.

        A clock that goes back starts the history anew: measurements from the future would
        neither be forgotten nor replaced.
        """
        stamp = observation.stamp
        if not math.isfinite(stamp):
            return self
        notes, history = list(self.notes), self.history
        if stamp < self.stamp:
            notes.append(f"clock went back by {self.stamp - stamp:.3g} s")
            history = history.emptied()
        pause, period = stamp - self.stamp, self.period
        paused = math.isfinite(pause) and pause > max(LONG * period, self.forget)
        if paused and not self.paused:
            notes.append(
                f"pause of {pause:.3g} s between observations, at a period of {period:.3g} s: "
                "what was seen before is forgotten; are the stamps in s?"
            )
        if (step := math.ulp(stamp)) > FINE * history.dt:
            notes.append(f"clock counts in steps of {step:.3g} s at {stamp:.3g} s")
        asked = observation, self.dimension, self.forget, here
        sighting = admitted(*asked, partial(history.known, stamp))
        history = history.add(stamp, sighting.detections)
        return replace(
            self, history=history, stamp=stamp, notes=(*notes, *sighting.notes, *history.notes),
            logged=_logged(history.noise, self.logged), paused=self.paused or paused,
            placeless=sighting.placeless,
        )  # fmt: skip

    def drained(self) -> tuple["Perception", tuple[str, ...]]:
        """Return the same without notes, and the notes."""
        return replace(self, notes=()) if self.notes else self, self.notes

    def learnt(self, tracks: Tracks | None, scene: Scene) -> "Perception":
        """Filter what is new, and let a predictor that adapts learn.

        One that raises stays as it was; where its filter does, `forecast` says so.
        """
        predictor, notes = self.predictor, self.notes
        if tracks is None:
            return self
        try:
            beliefs = self._beliefs(tracks)
        except Exception:
            return altered(self, filtered=None)
        try:
            if isinstance(predictor, AdaptiveFiltering):
                predictor = predictor.update(tracks, scene, beliefs)
            elif isinstance(predictor, Adaptive):
                predictor = predictor.update(tracks, scene)
        except Exception as error:
            notes = (*notes, f"not adapted: {caught(error)}")
        return altered(self, predictor=predictor, filtered=(tracks, beliefs), notes=notes)

    def _beliefs(self, tracks: Tracks) -> Beliefs:
        """Filter what is new in the tracks."""
        last, beliefs = self.filtered or (None, None)
        if beliefs is not None and last is tracks:
            return beliefs
        return self.predictor.filtered(tracks, beliefs)

    def forecast(
        self, tracks: Tracks | None, first: float, grid: Array, scene: Scene
    ) -> Forecast | None:
        """Forecast all obstacles, or return None when none is known.

        Parameters
        ----------
        tracks : of the history.
        first : s, time of the plan's first state.
        grid : (N,), s after ``first`` of the plan's steps.
        scene : what else the predictor may look at.

        Raises
        ------
        WideberthError : the predictor returned something else than was asked for.
        """
        if tracks is None:
            return None
        times = first - tracks.stamp + grid
        return _on_times(self._ask(tracks, _steps(times, tracks), scene), tracks, times)

    def _ask(self, tracks: Tracks, steps: int, scene: Scene) -> Forecast:
        """Ask the predictor for all obstacles, or, if it raises, for those it does not raise for.

        The others stay where they were seen (`standing`), with the error as the reason. If it
        raises for each of them, it is the predictor that is broken, and the error is passed on.
        """
        try:
            forecast = self.predictor.ahead(self._beliefs(tracks), tracks, steps, scene)
        except Exception:
            causes = [
                self._cause(tracks.select([row]), steps, scene, row) for row in range(len(tracks))
            ]
            sound = [row for row, cause in enumerate(causes) if cause is None]
            if not 0 < len(sound) < len(tracks):
                raise
            some = self.predictor.predict(tracks.select(sound), steps, narrowed(scene, sound))
            self._check(some, tracks.select(sound), steps)
            return completed(some, sound, tracks, causes)
        self._check(forecast, tracks, steps)
        return forecast

    def _cause(self, track: Tracks, steps: int, scene: Scene, row: int) -> str | None:
        """Return what the predictor raises for one obstacle, if it does."""
        try:
            self.predictor.predict(track, steps, narrowed(scene, [row]))
        except Exception as error:
            return caught(error)
        return None

    def _check(self, forecast: Forecast, tracks: Tracks, steps: int) -> None:
        name = type(self.predictor).__name__
        if not isinstance(forecast, Forecast):
            raise WideberthError(f"{name}.predict returned {type(forecast).__name__}")
        shape = forecast.mean.shape
        if (shape[0], *shape[2:]) != (len(tracks), steps, tracks.dimension):
            raise WideberthError(
                f"{name} forecast {shape[0]} obstacles, {shape[2]} steps, {shape[3]} coordinates; "
                f"asked for {len(tracks)}, {steps}, {tracks.dimension}"
            )
        if abs(forecast.dt - tracks.dt) > 1e-9:
            raise WideberthError(
                f"{name} forecast steps of {forecast.dt} s; asked for {tracks.dt} s"
            )


def _steps(times: Array, tracks: Tracks) -> int:
    """How many steps of the tracks reach the last of some times, s after the newest sample."""
    return max(int(np.ceil(times[-1] / tracks.dt - 1e-9)), 1)


def _on_times(forecast: Forecast, tracks: Tracks, times: Array) -> Forecast:
    """Carry a forecast of the tracks to times, s after the newest sample."""
    if on_grid(forecast, times):
        return forecast
    newest = tracks.positions[:, -1]
    newest = np.where(np.isnan(newest), forecast.mean[:, 0, 0], newest)
    return resample(forecast, newest, tracks.noise, times)


def _logged(
    noise: Mapping[str, NoiseEstimate], before: Mapping[str, float]
) -> Mapping[str, float]:
    """Log what the noise of a sensor is estimated as, at first and when it has changed."""
    if not noise:
        return before
    logged = dict(before)
    for sensor, estimate in noise.items():
        known = logged.get(sensor)
        ratio = estimate.deviation / known if known else np.inf
        if estimate.samples and not 1 / CHANGED < ratio < CHANGED:
            LOG.info("%s%s", f"sensor {sensor}: " if sensor else "", estimate.text)
            logged[sensor] = estimate.deviation
    return logged


def scene_of(observation: Observation, plan: Plan | None, radius: float) -> Scene:
    """Return the scene of a predictor: the robot's state, radius and last plan, walls, truth."""
    positions, times = None, None
    if plan is not None:
        positions = plan.positions
        times = plan.stamp + plan.dt * np.arange(len(positions), dtype=np.float64)
        if not (times[1:] > times[:-1]).all():  # a clock too large to tell the steps apart
            positions, times = None, None
    return assembled(  # of values that were checked
        Scene,
        ego=observation.state,
        goals=None,
        plan=positions,
        truth=observation.truth,
        plan_times=times,
        radius=radius,
        polygons=observation.polygons,
    )


def narrowed(scene: Scene, rows: list[int]) -> Scene:
    """Return the scene for some of the obstacles."""
    return scene if scene.goals is None else replace(scene, goals=scene.goals[rows])


def completed(
    some: Forecast, rows: list[int], tracks: Tracks, causes: Sequence[str | None]
) -> Forecast:
    """Add the obstacles without a forecast, standing where they were seen last.

    mu_h = p,   Sigma_h = R + (v t_h)^2 I,   v = `PACE`, t_h the time since they were seen

    Parameters
    ----------
    some : forecast of the obstacles in these ``rows``.
    tracks : of all obstacles.
    causes : (O,), why there is no forecast, or None.
    """
    known = bounded(tracks, None)
    tracks = tracks if known is None else known.tracks
    count, modes, size = len(tracks), some.mean.shape[1], tracks.dimension
    seen = np.asarray(np.isfinite(tracks.positions).all(axis=2), dtype=np.bool_)
    late = np.argmax(seen[:, ::-1], axis=1)
    place = np.nan_to_num(tracks.positions[np.arange(count), -1 - late])
    times = tracks.dt * (late[:, None] + np.arange(1.0, some.steps + 1))
    wide = tracks.noise[:, None] + (PACE * times)[..., None, None] ** 2 * np.eye(size)
    mean = np.repeat(np.repeat(place[:, None, None], modes, 1), some.steps, 2)
    covariance = np.repeat(wide[:, None], modes, 1)
    weight = np.eye(modes)[np.zeros(count, dtype=np.int64)]
    mean[rows], covariance[rows], weight[rows] = some.mean, some.covariance, some.weight
    reasons = list(causes)
    for row, reason in zip(rows, some.fallback, strict=True):
        reasons[row] = reason
    return Forecast(mean, covariance, weight, some.dt, tuple(reasons))
