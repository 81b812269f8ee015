"""One predictor run along recordings, and the scores of every window."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from time import perf_counter
from typing import Any, final

import numpy as np

from ...framework.metrics.scoring import (
    displacement,
    energy_score,
    joint_tail,
    negative_log_likelihood,
    reached_tail,
    region_area,
    trajectory_energy_score,
)
from ...framework.predictor import Adaptive, Predictor
from ...framework.tracking.recordings import Recording
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.forecast import Forecast
from .prediction_data import STOOD, PredictionData
from .prediction_windows import SPAN, Moment, Protocol, moments
from .region_family import rounded

TAIL = 0.05
"""1 - content of the regions whose area has a column."""
WALKED = 0.5
"""m/s; who is faster at the forecast, and stands at the end of what was predicted, stops in
between."""


@final
@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of W windows; definitions in `wideberth.framework.metrics.scoring`.

    Attributes
    ----------
    error, nll, energy, tail, area : (W, N), of each step.
    trajectory, joint : (W,), energy score and tail of the whole trajectory; ``joint`` is NaN
        where the forecast has no joint covariance.
    stops : (W,), 1 where the obstacle stops in the window, else 0.
    speed : (W,), m/s, as in `Protocol`.
    fallback : reasons, None where the named method was used.
    """

    error: Array
    nll: Array
    energy: Array
    tail: Array
    area: Array
    trajectory: Array
    joint: Array
    stops: Array
    speed: Array
    fallback: tuple[str | None, ...]

    def __len__(self) -> int:
        """Count the windows."""
        return len(self.error)

    def chosen(self, which: BoolArray) -> "Scores":
        """Return some of the windows."""
        arrays: dict[str, Any] = {name: getattr(self, name)[which] for name in _arrays()}
        reasons = tuple(self.fallback[i] for i in np.flatnonzero(which))
        return Scores(**arrays, fallback=reasons)


def _arrays() -> list[str]:
    return [field.name for field in fields(Scores) if field.name != "fallback"]


@final
@dataclass
class Effort:
    """Seconds that a predictor took, and for how many obstacles."""

    predict: float = 0.0
    update: float = 0.0
    calls: int = 0
    obstacles: int = 0


def run_along(
    predictor: Predictor,
    recordings: Sequence[Recording],
    data: PredictionData,
    how: Protocol,
    shown: Sequence[tuple[int, str]] = (),
) -> tuple[Scores, Effort, list[dict[str, Any]]]:
    """Let a predictor forecast every window of some recordings.

    It is given everybody seen at a row, so that it may look at neighbours, and nothing of
    the robot or the future. One that adapts starts anew with each recording, and is shown
    every row before it forecasts there.

    Parameters
    ----------
    shown : (row, identity) of forecasts in the first recording to be returned themselves.
    """
    effort, parts = Effort(), []
    samples: list[dict[str, Any]] = []
    for number, recording in enumerate(recordings):
        current = predictor
        for moment in moments(data, recording, how):
            if isinstance(current, Adaptive):
                begin = perf_counter()
                current = current.update(moment.tracks)
                effort.update += perf_counter() - begin
            if not len(moment.scored):
                continue
            begin = perf_counter()
            forecast = current.predict(moment.tracks, how.predicted)
            effort.predict += perf_counter() - begin
            effort.calls += 1
            effort.obstacles += len(moment.tracks)
            forecast = _of(forecast, moment)
            rng = np.random.default_rng([how.seed, number, moment.row])
            parts.append(_score(forecast, moment, how, rng))
            wanted = [one for row, one in shown if row == moment.row and number == 0]
            samples += [_sample(forecast, moment, ident) for ident in wanted]
    return _together(parts), effort, samples


def _of(forecast: Forecast, moment: Moment) -> Forecast:
    """Return the forecast of the scored obstacles alone."""
    index, joint = moment.scored, forecast.joint
    return Forecast(
        forecast.mean[index],
        forecast.covariance[index],
        forecast.weight[index],
        forecast.dt,
        tuple(forecast.fallback[i] for i in index),
        None if joint is None else joint[index],
    )


def _score(forecast: Forecast, moment: Moment, how: Protocol, rng: np.random.Generator) -> Scores:
    """Score one row's forecasts."""
    mean, spread, weight = forecast.mean, forecast.covariance, forecast.weight
    truth, floor, joint = moment.truth, how.floor, forecast.joint
    draws = forecast.sample(rng, how.draws)
    whole = np.full(len(truth), np.nan)
    if joint is not None:
        blurred = draws + floor * rng.standard_normal(draws.shape)
        whole = joint_tail(mean, joint, weight, truth, blurred, floor)
    area = region_area(mean, spread, weight, TAIL)
    return Scores(
        displacement(mean, weight, truth),
        negative_log_likelihood(mean, spread, weight, truth, floor),
        energy_score(draws, truth),
        reached_tail(mean, spread, weight, truth),
        np.where(np.isfinite(truth).all(axis=-1), area, np.nan),
        trajectory_energy_score(draws, truth),
        whole,
        _stops(moment),
        _speeds(moment),
        forecast.fallback,
    )


def _stops(moment: Moment) -> Array:
    """Tell who walks at the forecast and stands in the end; 0 where the end is unknown."""
    positions, dt = moment.tracks.positions[moment.scored], moment.tracks.dt
    before = np.linalg.norm(positions[:, -1] - positions[:, -2], axis=1) / dt
    after = np.linalg.norm(moment.truth[:, -1] - moment.truth[:, -2], axis=1) / dt
    return np.asarray((before > WALKED) & (after < STOOD), dtype=np.float64)


def _speeds(moment: Moment) -> Array:
    """Speed of each scored obstacle before the forecast, (K,), m/s; see `Protocol`."""
    positions, dt = moment.tracks.positions[moment.scored], moment.tracks.dt
    back = min(max(int(SPAN / dt + 1e-9), 1), positions.shape[1] - 1)
    way = positions[:, -1] - positions[:, -1 - back]
    return np.asarray(np.linalg.norm(way, axis=1) / (back * dt))


def _together(parts: Sequence[Scores]) -> Scores:
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in _arrays()
    }
    return Scores(**arrays, fallback=tuple(one for part in parts for one in part.fallback))


def _sample(forecast: Forecast, moment: Moment, ident: str) -> dict[str, Any]:
    """Keep one forecast for the figure."""
    ids = [moment.tracks.ids[i] for i in moment.scored]
    at = ids.index(ident)
    kept: dict[str, Array] = {
        "past": moment.tracks.positions[moment.scored[at]],
        "truth": moment.truth[at],
        "mean": forecast.mean[at],
        "covariance": forecast.covariance[at],
        "weight": forecast.weight[at],
    }
    numbers = {name: np.round(array, 12).tolist() for name, array in kept.items()}
    return {"id": ident, "time_s": rounded(moment.row * moment.tracks.dt), **numbers}
