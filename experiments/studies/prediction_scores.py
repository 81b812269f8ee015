"""Scores of forecasts along recordings, and the lines of the table that condense them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np

from ...framework import Adaptive, Forecast, Predictor
from ...framework.values.arrays import Array, BoolArray
from ...metrics.scoring import (
    covered,
    displacement,
    energy_score,
    inside_throughout,
    joint_tail,
    last_known,
    negative_log_likelihood,
    reached_tail,
    reason_kind,
    region_area,
    trajectory_energy_score,
)
from ...metrics.statistics import known_mean
from ...predictors.data.recordings import STOOD, Recording
from ..engine.base import Row
from .prediction_data import PredictionData
from .prediction_windows import ForecastInstant, Protocol, moments
from .region_family import rounded

SPAN = 3.0
"""s of the past, at most, over which a window's speed is measured: noise of 10 cm then makes an
error of 0.05 m/s."""
TAIL = 0.05
"""1 - content of the regions whose area has a column."""
WALKED = 0.5
"""m/s; who is faster at the forecast, and stands at the end of what was predicted, stops in
between."""


class Scores(NamedTuple):
    """Scores of W windows; definitions in `wideberth.metrics.scoring`.

    Attributes
    ----------
    error, nll, energy, tail, area : (W, N), of each step.
    trajectory, joint : (W,), energy score and tail of the whole trajectory; ``joint`` is NaN
        where the forecast has no joint covariance.
    stops : (W,), 1 where the obstacle stops in the window, else 0.
    speed : (W,), m/s, as in `Protocol`.
    fallback : (W,) of reasons, None where the named method was used.
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
    fallback: Any

    def chosen(self, which: BoolArray) -> "Scores":
        """Return some of the windows."""
        return Scores(*(values[which] for values in self))


@final
@dataclass
class Effort:
    """Seconds that a predictor took, and for how many obstacles."""

    predict: float = 0.0
    update: float = 0.0
    calls: int = 0
    obstacles: int = 0

    def row(self) -> Row:
        """Return the columns of the measured times."""
        return {
            "calls": self.calls,
            "obstacles_per_call": self.obstacles / self.calls,
            "predict_us_per_obstacle": 1e6 * self.predict / self.obstacles,
            "predict_s": self.predict,
            "update_s": self.update,
        }


def run_along(
    predictor: Predictor,
    recordings: Sequence[Recording],
    data: PredictionData,
    how: Protocol,
    shown: Sequence[tuple[int, str]] = (),
) -> tuple[Scores, Effort, list[dict[str, Any]]]:
    """Let a predictor forecast every window of some recordings.

    It is given all people seen at a row, so that it may look at neighbours, and nothing of
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
            rng = np.random.default_rng([0, number, moment.row])
            parts.append(_score(forecast, moment, how, rng))
            wanted = [one for row, one in shown if row == moment.row and number == 0]
            samples += [_sample(forecast, moment, ident) for ident in wanted]
    return Scores(*map(np.concatenate, zip(*parts, strict=True))), effort, samples


def _of(forecast: Forecast, moment: ForecastInstant) -> Forecast:
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


def _score(
    forecast: Forecast, moment: ForecastInstant, how: Protocol, rng: np.random.Generator
) -> Scores:
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
        _window_speeds(moment),
        np.array(forecast.fallback, dtype=object),
    )


def _stops(moment: ForecastInstant) -> Array:
    """Tell who walks at the forecast and stands in the end; 0 where the end is unknown."""
    positions, dt = moment.tracks.positions[moment.scored], moment.tracks.dt
    before = np.linalg.norm(positions[:, -1] - positions[:, -2], axis=1) / dt
    after = np.linalg.norm(moment.truth[:, -1] - moment.truth[:, -2], axis=1) / dt
    return np.asarray((before > WALKED) & (after < STOOD), dtype=np.float64)


def _window_speeds(moment: ForecastInstant) -> Array:
    """Speed of each scored obstacle before the forecast, (K,), m/s; see `Protocol`."""
    positions, dt = moment.tracks.positions[moment.scored], moment.tracks.dt
    back = min(max(int(SPAN / dt + 1e-9), 1), positions.shape[1] - 1)
    way = positions[:, -1] - positions[:, -1 - back]
    return np.asarray(np.linalg.norm(way, axis=1) / (back * dt))


def _sample(forecast: Forecast, moment: ForecastInstant, ident: str) -> dict[str, Any]:
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


CONTENTS = (0.5, 0.9, 0.95)
"""Of the regions whose coverage has a column."""
LEVELS = (*(round(0.05 * i, 2) for i in range(1, 20)), 0.99)
"""Contents of the calibration curves."""


def table_rows(scores: Scores, dt: float, speeds: Mapping[str, float]) -> list[Row]:
    """Return the lines of all windows, of those with a stop, and of every class of speed.

    All windows and every class have a line per step and one for all steps together; a class
    without a window has none.

    Parameters
    ----------
    dt : s, between the steps.
    speeds : m/s, least speed of each class, as in `Protocol`.
    """
    rows = _slice(scores, dt, {"slice": "all"})
    stops = scores.chosen(scores.stops > 0)
    if len(stops.error):
        rows.append(_whole(stops, {"slice": "stops"}))
    bounds = pairwise([*speeds.values(), np.inf])
    for name, (least, beyond) in zip(speeds, bounds, strict=True):
        some = scores.chosen((scores.speed >= least) & (scores.speed < beyond))
        if len(some.error):
            below = None if beyond == np.inf else beyond
            rows += _slice(some, dt, {"slice": name, "from_mps": least, "below_mps": below})
    return rows


def _slice(scores: Scores, dt: float, head: Row) -> list[Row]:
    """Return one line per step and one for all steps."""
    rows: list[Row] = []
    for step in range(scores.error.shape[1]):
        known = np.isfinite(scores.error[:, step])
        rows.append({
            **head, "step": step + 1, "time_s": rounded((step + 1) * dt),
            "windows": int(known.sum()), **_columns(scores, slice(step, step + 1)),
        })  # fmt: skip
    return [*rows, _whole(scores, head)]


def _columns(scores: Scores, steps: slice) -> Row:
    """Means over windows of the means over some steps, quantiles of the error and the area."""

    def mean(values: Array) -> float:
        return rounded(known_mean(_row_means(values[:, steps])))

    areas = scores.area[:, steps]
    return {
        "error_m": mean(scores.error),
        "median_m": _quantile(_row_means(scores.error[:, steps]), 0.5),
        "nll": mean(scores.nll),
        "energy_m": mean(scores.energy),
        **{
            f"cover_{round(100 * content)}": mean(covered(scores.tail, 1.0 - content))
            for content in CONTENTS
        },
        "area_m2": _quantile(areas, 0.5),
        "area_90_m2": _quantile(areas, 0.9),
        "area_mean_m2": rounded(known_mean(areas)),
    }


def _row_means(values: Array) -> Array:
    """Mean of what is known in each row; NaN where nothing is."""
    known = np.isfinite(values)
    number = known.sum(axis=1)
    share = np.where(known, values, 0.0).sum(axis=1) / np.maximum(number, 1)
    return np.where(number > 0, share, np.nan)


def _quantile(values: Array, share: float) -> float:
    """Quantile of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return rounded(float(np.quantile(known, share))) if known.size else float("nan")


def _whole(scores: Scores, head: Row) -> Row:
    """Return the line of all steps together."""
    throughout = inside_throughout(scores.tail, TAIL)
    reasons = Counter(reason_kind(one) for one in scores.fallback if one is not None)
    count = len(scores.fallback)
    return {
        **head,
        "step": "all",
        "windows": count,
        **_columns(scores, slice(None)),
        "final_m": rounded(known_mean(last_known(scores.error))),
        "trajectory_energy_m": rounded(known_mean(scores.trajectory)),
        "all_95": rounded(known_mean(throughout)),
        "joint_95": rounded(known_mean(covered(scores.joint, TAIL))),
        "fell_back": rounded(sum(reasons.values()) / count),
        "reasons": "; ".join(
            f"{number / count:.1%}: {reason}" for reason, number in reasons.most_common()
        ),
    }


def calibration(scores: Scores) -> list[list[float]]:
    """Coverage at every content of `LEVELS`, one list per step."""
    steps = scores.tail.shape[1]
    at = [covered(scores.tail, 1.0 - content) for content in LEVELS]
    return [[rounded(known_mean(held[:, step])) for held in at] for step in range(steps)]
