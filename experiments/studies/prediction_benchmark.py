"""Every predictor on every scene: errors, likelihoods, coverage, areas, fallbacks and times."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from math import ceil
from pathlib import Path
from textwrap import fill
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self, final

import numpy as np

from ...framework.plugins.config import build
from ...framework.plugins.registry import names, unknown
from ...framework.predictor import Adaptive, Fittable, Predictor
from ...framework.tracking.recordings import Recording
from ...framework.tracking.windows import IntArray, cut_windows
from ...framework.values.arrays import Array, BoolArray, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast
from ...framework.values.tracks import Tracks
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
from ...simulation.drawing.artists import outlines
from ..drawing.plotting import COLOURS, LINES, PAGE, save, subplots
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import column, group
from .prediction_data import FAST, STOOD, PredictionData, SceneFiles, longest_stretch, usual_speed
from .region_family import rounded, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHORTEST = 2
"""Predicted steps of the shortest window in Schoeller's protocol."""
SPAN = 3.0
"""s of the past, at most, over which a window's speed is measured: noise of 10 cm then makes an
error of 0.05 m/s."""
SLICES = ("all", "stops")
"""Names of the table's slices that no class of speed may have."""
WAY = 1.0
"""m from the forecast to the end of what was predicted; who goes less far is hardly drawn."""


@final
@dataclass(frozen=True)
class Protocol:
    """Which windows are scored, and how.

    A window is an obstacle with ``observed`` consecutive rows, the newest of which is the
    moment of the forecast. "full": and ``predicted`` consecutive rows after it. "schoeller",
    as in the published baseline of constant velocity: 2 rows after it suffice and at most
    ``predicted`` are scored, so that every start within a track gives one window of 10 to 20
    rows (with 8 + 12); the last row that there is counts as the final one.

    Windows overlap and follow one another by ``stride`` rows.

    A window's speed is the distance from the position 3 s before the forecast (from the first
    observed one where fewer were observed) to the newest, over the time between.

    Parameters
    ----------
    observed : rows that a predictor is given, with everybody who is seen at the newest one.
    predicted : rows ahead.
    windows : "full" or "schoeller".
    stride : every so many rows a forecast is scored. Predictors that adapt see every row.
    floor : m, standard deviation added in quadrature in the likelihoods (and in the joint
        coverage), but not in coverage and area: those are of the forecast as it stands.
    draws : of each forecast, for the energy scores and the joint regions of mixtures.
    seed : of the draws, which are the same for every predictor.
    speeds : m/s, least speed of each class of windows that is also scored by itself; the first
        is 0.

    Raises
    ------
    WideberthError : a number out of range.
    """

    observed: int = 8
    predicted: int = 12
    windows: Literal["full", "schoeller"] = "full"
    stride: int = 1
    floor: float = 0.01
    draws: int = 99
    seed: int = 0
    speeds: dict[str, float] = field(
        default_factory=lambda: {"standing": 0.0, "slow": 0.1, "walking": 0.5, "fast": 1.5}
    )

    def __post_init__(self) -> None:
        whole("protocol.observed", self.observed, least=2)
        whole("protocol.predicted", self.predicted, least=SHORTEST)
        whole("protocol.stride", self.stride)
        whole("protocol.draws", self.draws, least=2)
        whole("protocol.seed", self.seed, least=0)
        positive("protocol.floor", self.floor)
        self._check_speeds()

    def _check_speeds(self) -> None:
        for name in SLICES:
            if name in self.speeds:
                raise WideberthError(
                    f"protocol.speeds has a class {name!r}, which is another part of the table; "
                    "name it otherwise"
                )
        least = list(self.speeds.values())
        increase = all(first < second for first, second in pairwise(least))
        if least and not (least[0] == 0.0 and increase and np.isfinite(least[-1])):
            raise WideberthError(
                f"protocol.speeds is {self.speeds}; wanted the least speed of each class, m/s: "
                "0 for the first, and more from each to the next"
            )

    @property
    def least(self) -> int:
        """Rows that must follow the newest observed one."""
        return self.predicted if self.windows == "full" else SHORTEST

    def text(self, dt: float) -> str:
        """Say in one line which windows are scored and how; ``fitted`` says who learnt."""
        kind = "full windows" if self.windows == "full" else f"windows from {SHORTEST} on"
        apart = "" if self.stride == 1 else f", every {self.stride} rows"
        return (
            f"{self.observed} + {self.predicted} rows of {dt:g} s, {kind}{apart}, "
            f"floor {self.floor:g} m"
        )


@final
@dataclass(frozen=True, eq=False)
class ForecastInstant:
    """One row of a recording at which forecasts are scored.

    Attributes
    ----------
    row : in the recording.
    tracks : everybody seen at this row, and the ``observed`` rows up to it.
    scored : indices into the tracks of those who are scored.
    truth : (K, predicted, D), m, what the scored ones then did; NaN after the first sample
        missing.
    """

    row: int
    tracks: Tracks
    scored: IntArray
    truth: Array


def window_places(data: PredictionData, recording: Recording, how: Protocol) -> IntArray:
    """Track and newest observed row of every window, (W, 2), by row and then by track."""
    found = cut_windows(data.whole(recording), how.observed, how.least)
    places = np.stack([found.obstacle, found.row], axis=1)
    kept = places[places[:, 1] % how.stride == 0]
    return np.asarray(kept[np.lexsort((kept[:, 0], kept[:, 1]))])


def moments(
    data: PredictionData, recording: Recording, how: Protocol
) -> Iterator[ForecastInstant]:
    """Yield every row of a recording, from the first; ``scored`` is empty without windows."""
    places = window_places(data, recording, how)
    length = len(recording.times)
    for row in range(length):
        tracks = recording.tracks(row, how.observed, radius=data.radius, noise=data.noise)
        who = places[places[:, 1] == row, 0]
        where = {ident: index for index, ident in enumerate(tracks.ids)}
        scored = np.array([where[recording.ids[i]] for i in who], dtype=np.int64)
        truth = np.full((len(who), how.predicted, tracks.dimension), np.nan)
        ahead = recording.positions[who, row + 1 : row + 1 + how.predicted]
        seen = np.isfinite(ahead).all(axis=2)
        unbroken = np.logical_and.accumulate(seen, axis=1)
        truth[:, : ahead.shape[1]] = np.where(unbroken[..., None], ahead, np.nan)
        yield ForecastInstant(row, tracks, scored, truth)


def shown_windows(
    data: PredictionData, recording: Recording, how: Protocol, quantiles: Sequence[float]
) -> list[tuple[int, str]]:
    """Choose windows to draw: row and identity of some that are more or less of a surprise.

    Of all windows known in full of those who get somewhere (of all if none does) they are
    those whose distance of the last position from that of a person who walks straight on has
    these quantiles.
    """
    surprises: list[tuple[float, int, str]] = []
    ways: list[float] = []
    for moment in moments(data, recording, how):
        past = moment.tracks.positions[moment.scored]
        straight = past[:, -1] + how.predicted * (past[:, -1] - past[:, -2])
        gaps = np.linalg.norm(moment.truth[:, -1] - straight, axis=1)
        went = np.linalg.norm(moment.truth[:, -1] - past[:, -1], axis=1)
        for gap, way, index in zip(gaps, went, moment.scored, strict=True):
            if np.isfinite(gap):
                surprises.append((float(gap), moment.row, moment.tracks.ids[index]))
                ways.append(float(way))
    moving = [one for one, way in zip(surprises, ways, strict=True) if way >= WAY]
    chosen = sorted(moving or surprises)
    at = [round(share * (len(chosen) - 1)) for share in quantiles]
    return [chosen[i][1:] for i in at] if chosen else []


TAIL = 0.05
"""1 - content of the regions whose area has a column."""
WALKED = 0.5
"""m/s; who is faster at the forecast, and stands at the end of what was predicted, stops in
between."""


@final
@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of W windows; definitions in `wideberth.metrics.scoring`.

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
        forecast.fallback,
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


def _together(parts: Sequence[Scores]) -> Scores:
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in _arrays()
    }
    return Scores(**arrays, fallback=tuple(one for part in parts for one in part.fallback))


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
    if len(stops):
        rows.append(_whole(stops, {"slice": "stops"}))
    bounds = pairwise([*speeds.values(), np.inf])
    for name, (least, beyond) in zip(speeds, bounds, strict=True):
        some = scores.chosen((scores.speed >= least) & (scores.speed < beyond))
        if len(some):
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
    count = len(scores)
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


SHOWN = (0.5, 0.95)
"""Quantiles of the surprise of the two forecasts that are drawn."""


@final
@dataclass(frozen=True)
class PredictionBenchmark(Experiment):
    """Forecasts held against recordings of people or robots; one task per predictor and scene.

    At each row of a recording a predictor is given everybody who is seen, as far back as
    ``protocol.observed`` rows, and the windows that are complete there are scored (see
    `Protocol`, and `wideberth.metrics.scoring` for the definitions). What can be fitted
    is
    fitted to the recordings of all other scenes (leave one scene out); if these are too few,
    or there are none, the predictor is scored with its defaults and ``fitted`` says why. A
    predictor that was fitted before, as one given by ``{saved: FILE}``, is fitted anew unless
    ``as_given`` names it; whether it had seen the scene that it is scored on is not checked.
    What adapts starts anew with every recording.

    The table has a line per predictor, scene and step; lines of step "all" average over the
    steps (``error_m`` is then the ADE, ``final_m`` the FDE) and tell how often the predictor
    fell back, and why, without numbers in the reasons. ``median_m`` is the median of the
    windows' errors, where ``error_m`` is their mean. ``all_95`` is the share of windows that
    stay in the regions of content 0.95 at all steps, ``joint_95`` that of trajectories in the
    region of content 0.95 of the joint covariance, where the forecast has one. Areas are those
    of the regions of content 0.95: their median, their 90th percentile and their mean. Lines
    of slice "stops" are of those who walk at the forecast and stand at its end; the other
    slices are classes of speed (see `Protocol`), with a line per step.

    Parameters
    ----------
    predictors : by name, beside the registered ones; one named like a registered one stands
        for it.
    registered : score every registered predictor with its defaults too.
    left_out : registered ones that are not scored. An oracle without the future is its
        fallback; a predictor that solves a game at every row would need days.
    data : the recordings.
    protocol : which windows are scored.
    chosen : names of the predictors to score, given or registered; if empty, all the given
        ones, and the registered ones but for those left out.
    fit : whether what can be fitted is.
    as_given : names of predictors that are scored as they are all the same.
    only : scenes to score; all if empty. Files of the others may then be missing.
    """

    claim: ClassVar[str] = (
        "Forecasts cover what then happens: how far off is each predictor, and how honest?"
    )
    reference: ClassVar[str] = "gneiting2007strictly, schoeller2020constant"
    captions: ClassVar[Mapping[str, str]] = {
        "calibration": (
            "Share of true positions inside regions of each content: on the diagonal a forecast "
            "is honest, below it too sure."
        ),
        "error": "Mean distance between forecast and truth over the time ahead.",
        "coverage": (
            "Share of true positions inside regions of three contents over the time ahead: each "
            "line belongs on its grey level."
        ),
        "coverage_by_speed": (
            "The same for slow and fast obstacles: a forecast that is honest on average may not "
            "be so for either."
        ),
        "area": "Area of the 95 % regions over the time ahead: large regions block a planner.",
        "forecasts_*": (
            "Every predictor's forecast of a usual or a surprising window, with its 95 % regions."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("ade_m", "cover_95", "area_m2")

    predictors: dict[str, Predictor] = field(default_factory=dict)
    registered: bool = True
    left_out: tuple[str, ...] = ("oracle",)
    data: PredictionData = field(default_factory=PredictionData)
    protocol: Protocol = field(default_factory=Protocol)
    chosen: tuple[str, ...] = ()
    fit: bool = True
    as_given: tuple[str, ...] = ()
    only: tuple[str, ...] = ()

    def family(self) -> list[str]:
        """Names of the predictors: the chosen ones, or the given and then the registered ones.

        Raises
        ------
        WideberthError : unknown names in ``chosen`` or ``as_given``.
        """
        known = {*self.predictors, *names("predictors")}
        for field_name in ("chosen", "as_given"):
            for name in getattr(self, field_name):
                if name not in known:
                    raise WideberthError(f"{field_name}: {unknown('predictor', name, known)}")
        others = names("predictors") if self.registered else []
        taken = {*self.predictors, *self.left_out}
        usual = [*self.predictors, *(name for name in others if name not in taken)]
        return list(self.chosen) or usual

    def member(self, name: str) -> Predictor:
        """Return the given predictor of this name, or the registered one with its defaults."""
        given = self.predictors.get(name)
        found: Predictor = build("predictors", name) if given is None else given
        return found

    def scored(self) -> dict[str, SceneFiles]:
        """Return the scenes to score.

        Raises
        ------
        WideberthError : as `PredictionData.found`, and unknown names in ``only``.
        """
        found = self.data.found(self.only)
        scenes = {name: scene for name, scene in found.items() if scene.role != "training"}
        for name in self.only:
            if name not in scenes:
                hint = (
                    ""
                    if name not in {*self.predictors, *names("predictors")}
                    else (f" ({name!r} is a predictor: 'chosen' names predictors, 'only' scenes)")
                )
                raise WideberthError(f"only: {unknown('scene', name, scenes)}{hint}")
        return {name: scenes[name] for name in (self.only or scenes)}

    def tasks(self) -> Sequence[Task]:
        """One per predictor and scene; every recording is read and every predictor built first.

        Raises
        ------
        WideberthError : a file that cannot be used, or a scene without a single window.
        """
        for name in self.family():
            self.member(name)
        scored, short = self.scored(), {}
        for name, scene in self.data.found(self.only).items():
            recordings = self.data.read(scene)
            if name in scored and not any(
                len(window_places(self.data, one, self.protocol)) for one in recordings
            ):
                short[name] = max(map(longest_stretch, recordings))
        if short:
            raise WideberthError(self._no_window(scored, short))
        return [
            Task(f"{predictor} {scene}", settings={"predictor": predictor, "scene": scene})
            for scene in scored
            for predictor in self.family()
        ]

    def _no_window(self, scored: dict[str, SceneFiles], short: dict[str, int]) -> str:
        """Say which scenes are too short, by how much, and how to go on."""
        how, others = self.protocol, [name for name in scored if name not in short]
        (name, rows), *more = short.items()
        return (
            f"scene {name} ({', '.join(scored[name].files)}) has no window of {how.observed} + "
            f"{how.least} consecutive rows of {self.data.step(scored[name]):g} s: its longest "
            f"track has {rows}"
            + (f"; nor have {', '.join(one for one, _ in more)}" if more else "")
            + "; state fewer under protocol, or (for logs of a robot) a smaller dt"
            + (f", or score the others: --set 'only=[{', '.join(others)}]'" if others else "")
        )

    def inputs(self) -> Sequence[Path]:
        """Return the recordings."""
        found = self.data.found(self.only)
        return [path for scene in found.values() for path in self.data.paths(scene)]

    def measure(self, task: Task) -> TaskOutcome:
        """Fit the predictor to the other scenes, run it along this one, and score it."""
        name, place = str(task.settings["predictor"]), str(task.settings["scene"])
        scene = self.data.found(self.only)[place]
        recordings = self.data.read(scene)
        begin = perf_counter()
        predictor, fitted = self._fitted(name, place)
        seconds = perf_counter() - begin
        shown = shown_windows(self.data, recordings[0], self.protocol, SHOWN)
        scores, effort, samples = run_along(predictor, recordings, self.data, self.protocol, shown)
        dt = self.data.step(scene)
        head: Row = {"predictor": name, "scene": place, "role": scene.role}
        how: Row = {
            "protocol": self.protocol.text(dt),
            "speed_mps": rounded(usual_speed(recordings)),
            "fitted": fitted,
            "noise": self.data.noise_text(recordings),
        }
        rows = [head | how | row for row in table_rows(scores, dt, self.protocol.speeds)]
        kept = {"levels": LEVELS, "coverage": calibration(scores), "samples": samples}
        files = {f"{place}/{name}.json": json.dumps(kept).encode()}
        return TaskOutcome(rows, [{**head, "fit_s": seconds, **_times(effort)}], files)

    def _fitted(self, name: str, scene: str) -> tuple[Predictor, str]:
        """Return the predictor as it is scored, and what it was fitted to."""
        predictor = self.member(name)
        if not isinstance(predictor, Fittable):
            return predictor, NOTHING
        if not self.fit or name in self.as_given:
            return predictor, AS_GIVEN
        training = self.data.training(scene, self.only)
        missing = ", ".join(self.data.missing() or ())
        lacking = f" ({missing} not there)" if missing else ""
        if not training:
            return predictor, f"{UNFITTED}: no other scene{lacking}"
        try:
            plural = "s" if len(training) > 1 else ""
            text = f"{FITTED} {len(training)} recording{plural}{lacking}"
            after = predictor.fit(training)
            return after, NOTHING if after == predictor else text
        except WideberthError as error:
            return predictor, f"{UNFITTED}: {error}{lacking}"

    def summary(self, rows: list[Row]) -> list[Row]:
        """Condense; see `wideberth.experiments.studies.prediction_benchmark`."""
        return summary(rows)

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw calibration, coverage and error per step, and two forecasts of everybody."""
        from ..drawing.plotting import paper_style

        rows = primary_rows(result.rows)
        files = {
            (str(predictor), str(scene)): json.loads(result.read(f"{scene}/{predictor}.json"))
            for predictor, scene in group(rows, "predictor", "scene")
        }
        with paper_style():
            return draw_all(rows, files, folder)

    def quick(self) -> Self:
        """Few rows of the smallest scene, and the chosen or the first three predictors."""
        sizes = {
            name: sum(path.stat().st_size for path in self.data.paths(scene))
            for name, scene in self.scored().items()
        }
        small = min(sizes, key=lambda name: sizes[name])
        chosen = self.chosen or tuple(self.family()[:3])
        protocol = replace(self.protocol, stride=max(self.protocol.stride, 5))
        return replace(self, chosen=chosen, only=(small,), protocol=protocol)


def _times(effort: Effort) -> Row:
    """Measured times of one task."""
    return {
        "calls": effort.calls,
        "obstacles_per_call": effort.obstacles / effort.calls,
        "predict_us_per_obstacle": 1e6 * effort.predict / effort.obstacles,
        "predict_s": effort.predict,
        "update_s": effort.update,
    }


MEANS = {
    "ade_m": "error_m",
    "fde_m": "final_m",
    "nll": "nll",
    "energy_m": "energy_m",
    "cover_50": "cover_50",
    "cover_90": "cover_90",
    "cover_95": "cover_95",
    "all_95": "all_95",
    "joint_95": "joint_95",
    "fell_back": "fell_back",
}
"""Columns of the summary that are means over the scenes -> columns of the table."""
AREAS = ("area_m2", "area_90_m2", "area_mean_m2")
"""Columns of the table whose mean over the scenes, at the last step, is in the summary."""
AS_GIVEN, NOTHING, FITTED, UNFITTED = "as given", "nothing to fit", "fitted to", "not fitted"
"""Texts of the table's column ``fitted``, or how they begin."""


def summary(rows: list[Row]) -> list[Row]:
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
    return {
        "predictor": whole[0]["predictor"],
        "scene": scene,
        "windows": int(column(whole, "windows").sum()),
        **{name: rounded(known_mean(column(whole, of))) for name, of in MEANS.items()},
        "cover_95_steps": f"{np.min(cover):.3f} to {np.max(cover):.3f}",
        **{f"cover_95_{name}": _covered(rows, name) for name in classes},
        **{name: rounded(known_mean(column(steps[-1], name))) for name in AREAS},
        "fitted": _fitted(whole),
        "protocol": "; ".join([*_texts(whole, "protocol"), *_classes(classes)]),
        "stated": [*_speed_notes(whole), *_noises(whole), *_fits(whole, FITTED)],
        "remarks": _remarks(whole),
    }


def _covered(rows: list[Row], name: str) -> float | None:
    """Coverage of a class over all steps, mean of the scenes that have it; None without any."""
    some = [row for row in rows if row["step"] == "all" and row["slice"] == name]
    return rounded(known_mean(column(some, "cover_95"))) if some else None


def _classes(classes: Mapping[str, str]) -> list[str]:
    """Say what the classes of speed are."""
    return [", ".join(f"{name} {text}" for name, text in classes.items())] if classes else []


def _speed_notes(rows: list[Row]) -> list[str]:
    """Say how fast those who move are; of several scenes, where dt is likely to be wrong."""
    notes = []
    for row in rows:
        speed = float(row["speed_mps"])
        text = f"median speed {speed:.3g} m/s of those who move"
        if speed > FAST:
            notes.append(f"{row['scene']}: {text}: is dt right?")
        elif len(rows) == 1 and np.isfinite(speed):
            notes.append(text)
    return notes


def _noises(rows: list[Row]) -> list[str]:
    """Say how noisy the recorded positions of one scene are."""
    return [str(rows[0]["noise"])] if len(rows) == 1 else []


def _remarks(rows: list[Row]) -> list[str]:
    """Say what could not be fitted, and why one scene's forecasts fell back."""
    reasons = [str(rows[0]["reasons"])] if len(rows) == 1 and rows[0]["reasons"] else []
    return [*_fits(rows, UNFITTED), *reasons]


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


ACROSS = 5
"""Most panels in a row."""
SEEN, BEYOND = (0.05, 0.995), (0.035, 0.9975)
"""Range of the coverages, and of their axis; what lies beyond the first is drawn at its edge."""
LEAST = 0.005
"""m; errors below it are none to be seen."""
MOST = 0.75
"""Share of the predictors whose regions are shown whole, if the frame gets not too wide."""
EVERY = 3
"""Steps between two drawn ellipses."""
NEAR, SIGHT, FAR = 2.0, 0.65, 1.5
"""Half of the width shown: at least (m), at least and at most (in widths of the true way)."""
AREA_LABELS = (("area_m2", "median"), ("area_90_m2", "90th percentile"), ("area_mean_m2", "mean"))
"""Column and name of the areas."""
SMALL = 1e-4
"""m²; smaller areas are drawn as this, so that a certain forecast has a line on the log scale."""
STYLES = ((0.5, COLOURS[1], "--"), (0.9, COLOURS[2], "-."), (0.95, COLOURS[0], "-"))
"""Content, colour and line of the coverages."""


def draw_all(
    rows: list[Row], files: Mapping[tuple[str, str], dict[str, Any]], folder: Path
) -> list[Path]:
    """Draw every figure.

    Parameters
    ----------
    rows : of the table, of the scenes to show.
    files : what each task left, by predictor and scene.
    """
    steps, classes = stepwise(rows), speed_classes(rows)
    names = list(dict.fromkeys(str(row["predictor"]) for row in rows))
    scene = next(key[1] for key in files)
    written = save(_calibration(names, files), folder, "calibration")
    written += save(_coverage(names, steps), folder, "coverage")
    written += save(_error(names, steps), folder, "error")
    written += save(_area(names, steps), folder, "area")
    if classes:
        written += save(_speeds(names, rows, classes), folder, "coverage_by_speed")
    samples = {name: files[name, scene]["samples"] for name in names}
    for number, kind in enumerate(("usual", "surprising")):
        if all(number < len(some) for some in samples.values()):
            chosen = {name: some[number] for name, some in samples.items()}
            written += save(_samples(chosen, scene), folder, f"forecasts_{kind}")
    return written


def _panels(names: list[str], labels: tuple[str, str]) -> "tuple[Figure, list[Any]]":
    """Return a figure with one titled panel per name, on common axes."""
    across = min(ACROSS, max(len(names), 3))
    down = ceil(len(names) / across)
    size = (PAGE, 0.6 + down * (0.4 + 0.8 * PAGE / across))
    figure, grid = subplots(down, across, figsize=size, sharex=True, sharey=True, squeeze=False)
    panels = list(grid.ravel())
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    for number, (panel, name) in enumerate(zip(panels, names, strict=False)):
        panel.set_title(fill(title(name), 22), fontsize=6.5)
        panel.tick_params(labelsize=6)
        if number + across >= len(names):  # the lowest of its column
            panel.xaxis.set_tick_params(labelbottom=True)
        if number >= across * (down - 1):
            panel.set_xlabel(labels[0], fontsize=7)
        if number % across == 0:
            panel.set_ylabel(labels[1], fontsize=7)
    return figure, panels[: len(names)]


def _calibration(names: list[str], files: Mapping[tuple[str, str], dict[str, Any]]) -> "Figure":
    """Draw the share of truths inside against the content promised."""
    figure, panels = _panels(names, ("content promised", "truths inside"))
    for name, panel in zip(names, panels, strict=True):
        own = [one for (predictor, _), one in files.items() if predictor == name]
        levels = own[0]["levels"]
        held = [np.array(one["coverage"], dtype=np.float64) for one in own]
        panel.plot([0, 1], [0, 1], ":", color="0.4", linewidth=0.8, label="promised")
        for number, each in enumerate(held if len(held) > 1 else ()):
            label = "one scene, mean of the steps" if number == 0 else None
            panel.plot(levels, each.mean(axis=0), "-", color="0.75", linewidth=0.7, label=label)
        middle = np.mean(held, axis=0)
        for step, colour, style in ((0, COLOURS[1], "--"), (-1, COLOURS[2], "-.")):
            label = "first step" if step == 0 else "last step"
            panel.plot(levels, middle[step], style, color=colour, linewidth=1.0, label=label)
        label = "mean of steps and scenes" if len(held) > 1 else "mean of steps"
        panel.plot(levels, middle.mean(axis=0), "-", color=COLOURS[0], label=label)
        room = (-0.03, 1.03)  # so that a line at 1 is seen beside the frame
        panel.set(xlim=room, ylim=room, xticks=(0, 0.5, 1), yticks=(0, 0.5, 1))
    return _finished(figure, panels)


def _coverage(names: list[str], rows: list[Row]) -> "Figure":
    """Draw the coverage of three contents against the time ahead, on a logit scale."""
    figure, panels = _panels(names, ("time ahead (s)", "truths inside"))
    for name, panel in zip(names, panels, strict=True):
        for content in CONTENTS:
            panel.axhline(content, color="0.4", linestyle=":", linewidth=0.8)
        scenes = group([row for row in rows if row["predictor"] == name], "scene")
        for number, own in enumerate(scenes.values() if len(scenes) > 1 else ()):
            label = "0.95, one scene" if number == 0 else None
            panel.plot(
                column(own, "time_s"), _seen(column(own, "cover_95")), "-", color="0.75",
                linewidth=0.7, label=label,
            )  # fmt: skip
        for content, colour, style in STYLES:
            times, middle = _mean(rows, name, f"cover_{round(100 * content)}")
            label = f"{content:g}, mean of scenes" if len(scenes) > 1 else f"{content:g}"
            panel.plot(times, _seen(middle), style, color=colour, label=label)
        _logit(panel, (0.1, *CONTENTS, 0.99))
    return _finished(figure, panels)


def _speeds(names: list[str], rows: list[Row], classes: Mapping[str, str]) -> "Figure":
    """Draw the coverage of the content 0.95 against the time ahead, a line per class of speed."""
    figure, panels = _panels(names, ("time ahead (s)", "truths inside"))
    for name, panel in zip(names, panels, strict=True):
        panel.axhline(1 - TAIL, color="0.4", linestyle=":", linewidth=0.8, label="promised")
        for number, (which, text) in enumerate(classes.items()):
            some = stepwise(rows, which)
            if any(row["predictor"] == name for row in some):
                times, middle = _mean(some, name, "cover_95")
                panel.plot(
                    times, _seen(middle), linestyle=LINES[number % len(LINES)],
                    color=COLOURS[number % len(COLOURS)], label=f"{which}, {text}",
                )  # fmt: skip
        _logit(panel, (0.1, 0.5, 0.8, 0.9, 0.95, 0.99))
    return _finished(figure, panels)


def _logit(panel: Any, ticks: Sequence[float]) -> None:
    """Show coverages on a logit scale."""
    from matplotlib.ticker import FixedLocator, NullLocator

    panel.set_yscale("logit")
    panel.set_ylim(*BEYOND)
    panel.yaxis.set_major_locator(FixedLocator(list(ticks)))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_locator(NullLocator())


def _area(names: list[str], rows: list[Row]) -> "Figure":
    """Draw the area of the region of content 0.95 against the time ahead, on a log scale."""
    figure, panels = _panels(names, ("time ahead (s)", "area (m²)"))
    several = ", mean of scenes" if len(group(rows, "scene")) > 1 else ""
    for name, panel in zip(names, panels, strict=True):
        for (quantity, label), colour, style in zip(AREA_LABELS, COLOURS, LINES, strict=False):
            times, values = _mean(rows, name, quantity)
            shown = np.maximum(values, SMALL)
            panel.plot(times, shown, linestyle=style, color=colour, label=f"{label}{several}")
        panel.set_yscale("log")
    return _finished(figure, panels)


def _error(names: list[str], rows: list[Row]) -> "Figure":
    """Draw the mean error against the time ahead, over everybody else's in grey."""
    figure, panels = _panels(names, ("time ahead (s)", "mean error (m)"))
    curves = {name: _mean(rows, name, "error_m") for name in names}
    several = "mean of scenes" if len(group(rows, "scene")) > 1 else "this predictor"
    usual = float(np.median([values[-1] for _, values in curves.values()]))
    highest = 2.0 * max(usual, LEAST)
    for name, panel in zip(names, panels, strict=True):
        for other, (times, values) in curves.items():
            if other != name:
                panel.plot(times, values, "-", color="0.85", linewidth=0.6)
        times, values = curves[name]
        panel.plot(times, values, "-", color=COLOURS[0], label=several)
        panel.set_ylim(0, highest)
        last = values[-1]
        text = f"last: {last:.3g} m" if last < 1000 else f"last: {last:.0f} m"
        panel.text(
            0.06, 0.93, text, transform=panel.transAxes, fontsize=6, va="top",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
        )  # fmt: skip
    if len(names) > 1:
        panels[0].plot([], [], "-", color="0.75", linewidth=0.6, label="other predictors")
    return _finished(figure, panels)


def _samples(samples: Mapping[str, dict[str, Any]], scene: str) -> "Figure":
    """Draw everybody's forecast of one window."""
    from matplotlib.collections import PolyCollection

    figure, panels = _panels(list(samples), ("x (m)", "y (m)"))
    regions = [outlines(_forecast(one), TAIL, every=EVERY) for one in samples.values()]
    for one, region, panel in zip(samples.values(), regions, panels, strict=True):
        past, truth = (np.array(one[key], dtype=np.float64) for key in ("past", "truth"))
        forecast = _forecast(one)
        panel.add_collection(
            PolyCollection(
                list(region), facecolor=(0, 0.45, 0.7, 0.08), edgecolor=COLOURS[1],
                linewidth=0.6, label=f"content {1 - TAIL:g}",
            ),
            autolim=False,
        )  # fmt: skip
        panel.plot(*past.T[:2], "-", color=COLOURS[0], label="seen")
        panel.plot(*past[-1, :2], "o", color=COLOURS[0], markersize=2.5)
        panel.plot(
            *truth.T[:2], "-o", color=COLOURS[2], linewidth=0.8, markersize=1.6, label="truth"
        )
        for mode, weight in zip(forecast.mean[0], forecast.weight[0], strict=True):
            if weight > 0:
                way = np.concatenate([past[-1:], mode])
                panel.plot(*way.T[:2], "--", color=COLOURS[1], linewidth=0.9, label="forecast")
        _frame(panel, np.concatenate([past, truth])[:, :2], regions)
    figure.set_figheight(figure.get_figheight() + 0.3)  # for the title
    who = next(iter(samples.values()))
    track = "" if who["id"] == scene else f", track {who['id']}"
    figure.suptitle(f"{scene}{track}, {who['time_s']:.4g} s after the first row", fontsize=8)
    return _finished(figure, panels)


def _forecast(sample: Mapping[str, Any]) -> Forecast:
    """Return the forecast of one obstacle that a task kept."""
    mean, covariance, weight = (
        np.array(sample[key], dtype=np.float64)[None] for key in ("mean", "covariance", "weight")
    )
    return Forecast(mean, covariance, weight, 1.0, (None,))


def _frame(panel: Any, points: Array, regions: Sequence[Array]) -> None:
    """Show the same part of the world, at equal scale, in every panel.

    As much of it as most predictors' regions take, but not so much that the way gets lost.
    """
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    width = float(np.ptp(points, axis=0).max())
    reach = np.quantile([np.abs(region - middle).max(initial=0.0) for region in regions], MOST)
    half = max(NEAR, SIGHT * width, min(1.05 * float(reach), FAR * width))
    panel.set_xlim(middle[0] - half, middle[0] + half)
    panel.set_ylim(middle[1] - half, middle[1] + half)
    panel.set_aspect("equal")


def _seen(coverage: Array) -> Array:
    return np.clip(coverage, *SEEN)


def _mean(rows: list[Row], name: str, quantity: str) -> tuple[Array, Array]:
    """Time ahead and mean over the scenes of one quantity, per step."""
    own = group([row for row in rows if row["predictor"] == name], "step")
    steps = [some for some in own.values() if np.isfinite(column(some, quantity)).any()]
    times = np.array([column(some, "time_s").mean() for some in steps], dtype=np.float64)
    means = [known_mean(column(some, quantity)) for some in steps]
    return times, np.array(means, dtype=np.float64)


def _finished(figure: "Figure", panels: list[Any]) -> "Figure":
    """Put one legend below all panels."""
    entries: dict[str, Any] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        entries.update(zip(labels, handles, strict=True))
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=5, fontsize=6.5
    )
    return figure
