"""Scores of forecasts along recordings, and the table and summary that condense them."""

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
from ...predictors.data.recordings import STOOD, Recording, doubts
from ..engine.base import Row
from ..engine.closed_loop import column, group
from .fitting import AS_GIVEN, FITTED, UNFITTED
from .grid import rounded
from .prediction_data import ForecastInstant, PredictionData, Protocol, moments

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


MEANS = {
    "ade_m": "error_m",
    "fde_m": "final_m",
    **{name: name for name in ("nll", "energy_m", "cover_50", "cover_90", "cover_95")},
    **{name: name for name in ("all_95", "joint_95", "fell_back")},
}
"""Columns of the summary that are means over the scenes -> columns of the table."""
AREAS = ("area_m2", "area_90_m2", "area_mean_m2")
"""Columns of the table whose mean over the scenes, at the last step, is in the summary."""


def summarised(rows: list[Row]) -> list[Row]:
    """Means over the primary scenes by predictor, then every predictor scene by scene.

    The means are left out where there is but one primary scene. ``cover_95_steps`` are the
    extremes over the steps: of the mean over the scenes in the first lines, of the scene in
    the others. ``cover_95_NAME`` is the coverage of a class of speed, over all steps and the
    scenes that have it. The areas are those of the last step. ``fitted`` is "yes", "no", in
    how many of the scenes, "as given", or empty where there is nothing to fit. What holds for
    several lines stands in the notes once: the protocol where it changes, how fast those who
    move are and how many recordings were fitted to once per scene. In the table it stands in
    every line.
    """
    primary, classes = primary_rows(rows), speed_classes(rows)
    count = len(group(primary, "scene"))
    together = group(primary, "predictor").values() if count > 1 else ()
    lines = [_line(some, f"mean of {count}", classes) for some in together]
    apart = group(rows, "predictor", "scene").items()
    lines += [_line(some, str(scene), classes) for (_, scene), some in apart]
    protocol = ""
    for some in group(lines, "scene").values():
        said = {protocol}
        for line in some:
            protocol = line.pop("protocol")
            stated = [protocol, *line.pop("stated")]
            notes = [text for text in stated if text not in said]
            line["notes"] = "; ".join([*notes, *line.pop("remarks")]) or None
            said.update(stated)
    return lines


def primary_rows(rows: list[Row]) -> list[Row]:
    """Lines of the primary scenes; of all where there is none."""
    return [row for row in rows if row["role"] == "primary"] or rows


def stepwise(rows: list[Row], name: str = "all") -> list[Row]:
    """Lines of single steps of a slice."""
    return [row for row in rows if row["step"] != "all" and row["slice"] == name]


def speed_classes(rows: list[Row]) -> dict[str, str]:
    """Return the names of the classes of speed, slowest first, and their bounds in words."""
    bounds = {
        str(row["slice"]): (float(row["from_mps"]), row["below_mps"])
        for row in rows
        if row.get("from_mps") is not None
    }
    slowest_first = sorted(bounds, key=lambda name: bounds[name][0])
    return {name: _bounds(*bounds[name]) for name in slowest_first}


def _bounds(least: float, below: float | None) -> str:
    if below is None:
        return f"from {least:g} m/s on"
    return f"{least:g} to {below:g} m/s" if least else f"below {below:g} m/s"


def _line(rows: list[Row], scene: str, classes: Mapping[str, str]) -> Row:
    """Condense the lines of one predictor, in one or several scenes."""
    whole = [row for row in rows if row["step"] == "all" and row["slice"] == "all"]
    steps = list(group(stepwise(rows), "step").values())
    cover = [known_mean(column(some, "cover_95")) for some in steps]
    bounds = ", ".join(f"{name} {text}" for name, text in classes.items())
    return {
        "predictor": whole[0]["predictor"],
        "scene": scene,
        "windows": int(column(whole, "windows").sum()),
        **{name: rounded(known_mean(column(whole, of))) for name, of in MEANS.items()},
        "cover_95_steps": f"{np.min(cover):.3f} to {np.max(cover):.3f}",
        **{f"cover_95_{name}": _covered(rows, name) for name in classes},
        **{name: rounded(known_mean(column(steps[-1], name))) for name in AREAS},
        "fitted": _fitted(whole),
        "protocol": "; ".join([*_texts(whole, "protocol"), *([bounds] if bounds else [])]),
        "stated": [*_speed_notes(whole), *_of_one(whole, "noise"), *_fits(whole, FITTED)],
        "remarks": [*_fits(whole, UNFITTED), *_of_one(whole, "reasons")],
    }


def _covered(rows: list[Row], name: str) -> float | None:
    """Coverage of a class over all steps, mean of the scenes that have it; None without any."""
    some = [row for row in rows if row["step"] == "all" and row["slice"] == name]
    return rounded(known_mean(column(some, "cover_95"))) if some else None


def _speed_notes(rows: list[Row]) -> list[str]:
    """Say how fast those who move are; of several scenes, where dt is likely to be wrong."""
    notes = []
    for row in rows:
        speed = float(row["speed_mps"])
        asked = doubts(speed)
        notes += [f"{row['scene']}: {text}" for text in asked]
        if not asked and len(rows) == 1 and np.isfinite(speed):
            notes.append(f"median speed {speed:.3g} m/s of those who move")
    return notes


def _of_one(rows: list[Row], name: str) -> list[str]:
    """Return what a column says of a single scene, if anything."""
    return [str(rows[0][name])] if len(rows) == 1 and rows[0][name] else []


def _fitted(rows: list[Row]) -> str | None:
    """Say in a word whether the predictor was fitted."""
    if not any(str(row["fitted"]).startswith((FITTED, UNFITTED)) for row in rows):
        return AS_GIVEN if rows[0]["fitted"] == AS_GIVEN else None
    count = sum(str(row["fitted"]).startswith(FITTED) for row in rows)
    return {0: "no", len(rows): "yes"}.get(count, f"{count} of {len(rows)}")


def _fits(rows: list[Row], begin: str) -> list[str]:
    return [text for text in _texts(rows, "fitted") if text.startswith(begin)]


def _texts(rows: list[Row], name: str) -> list[str]:
    """Return a column's texts, each once, sorted."""
    return sorted({str(row[name]) for row in rows})
