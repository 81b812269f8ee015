"""Every predictor on every scene: errors, likelihoods, coverage, areas, fallbacks and times."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from textwrap import fill
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from ...framework import Fittable, Forecast, Predictor, WideberthError, build, names
from ...framework.plugins.registry import unknown
from ...framework.values.arrays import Array
from ...metrics.statistics import known_mean
from ...predictors.data.recordings import usual_speed
from ...simulation.drawing.artists import outlines
from ..drawing.plotting import COLOURS, LINES, PAGE, legend_below, style, subplots, title
from ..engine.closed_loop import column, group
from .fitting import AS_GIVEN, NOTHING, check_fit, fitted
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, rounded
from .prediction_data import (
    PredictionData,
    Protocol,
    SceneFiles,
    longest_stretch,
    shown_windows,
    window_places,
)
from .prediction_scores import (
    CONTENTS,
    LEVELS,
    TAIL,
    calibration,
    primary_rows,
    run_along,
    speed_classes,
    stepwise,
    summarised,
    table_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = (0.5, 0.95)
"""Quantiles of the surprise of the two forecasts that are drawn."""


@final
@dataclass(frozen=True)
class PredictionBenchmark(GridStudy):
    """Forecasts held against recordings of people or robots; one task per predictor and scene.

    At each row of a recording a predictor is given all who are seen, as far back as
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
    printed: ClassVar[tuple[str, ...]] = (
        *("windows", "ade_m", "fde_m", "nll"),
        *("cover_95", "area_m2", "fell_back", "notes"),
    )

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
                    message = f"{field_name}: {unknown('predictor', name, known)}"
                    key = name.rpartition(":")[2].lower()
                    path = f"; name it first, as in --set 'predictors.{key}={{type: \"{name}\"}}'"
                    raise WideberthError(message + path * (":" in name))
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
                hint = f" ({name!r} is a predictor: 'chosen' names predictors, 'only' scenes)"
                known = name in {*self.predictors, *names("predictors")}
                raise WideberthError(
                    f"only: {unknown('scene', name, scenes)}{hint if known else ''}"
                )
        return {name: scenes[name] for name in (self.only or scenes)}

    def axes(self) -> Axes:
        """Each scene with each predictor; recordings are read and predictors built first.

        Raises
        ------
        WideberthError : a file that cannot be used, a scene without a single window, or a
            predictor whose fit needs a library that is not installed.
        """
        for name in self.family():
            self._check_fit(name)
        scored, short = self.scored(), {}
        for name, scene in self.data.found(self.only).items():
            recordings = self.data.read(scene)
            if name in scored and not any(
                len(window_places(self.data, one, self.protocol)) for one in recordings
            ):
                short[name] = max(map(longest_stretch, recordings))
        if short:
            raise WideberthError(self._no_window(scored, short))
        pairs = [(predictor, scene) for scene in scored for predictor in self.family()]
        return {("predictor", "scene"): pairs}

    def _check_fit(self, name: str) -> None:
        """Refuse a predictor that cannot be built, or lacks a library for its fit."""
        predictor = self.member(name)
        if self._learns(name, predictor):
            check_fit(predictor, f"or score it unfitted: --set 'as_given=[{name}]'")

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

    def inputs(self) -> list[Path]:
        """Return the recordings."""
        scenes = self.data.found(self.only).values()
        return [path for scene in scenes for path in self.data.paths(scene)]

    def measure(self, task: Task) -> TaskOutcome:
        """Fit the predictor to the other scenes, run it along this one, and score it."""
        name, place = str(task.settings["predictor"]), str(task.settings["scene"])
        scene = self.data.found(self.only)[place]
        recordings = self.data.read(scene)
        begin = perf_counter()
        predictor, learnt_from = self._fitted(name, place)
        seconds = perf_counter() - begin
        shown = shown_windows(self.data, recordings[0], self.protocol, SHOWN)
        scores, effort, samples = run_along(predictor, recordings, self.data, self.protocol, shown)
        dt = self.data.step(scene)
        head: Row = {"predictor": name, "scene": place, "role": scene.role}
        how: Row = {
            "protocol": self.protocol.text(dt),
            "speed_mps": rounded(usual_speed(recordings)),
            "fitted": learnt_from,
            "noise": self.data.noise_text(recordings),
        }
        rows = [head | how | row for row in table_rows(scores, dt, self.protocol.speeds)]
        kept = {"levels": LEVELS, "coverage": calibration(scores), "samples": samples}
        files = {f"{place}/{name}.json": json.dumps(kept).encode()}
        return TaskOutcome(rows, [{**head, "fit_s": seconds, **effort.row()}], files)

    def _learns(self, name: str, predictor: Predictor) -> bool:
        return isinstance(predictor, Fittable) and self.fit and name not in self.as_given

    def _fitted(self, name: str, scene: str) -> tuple[Predictor, str]:
        """Return the predictor as it is scored, and what it was fitted to."""
        predictor = self.member(name)
        if not isinstance(predictor, Fittable):
            return predictor, NOTHING
        if not self._learns(name, predictor):
            return predictor, AS_GIVEN
        missing = ", ".join(self.data.missing() or ())
        lacking = f" ({missing} not there)" if missing else ""
        return fitted(predictor, self.data.training(scene, self.only), lacking)

    def summary(self, rows: list[Row]) -> list[Row]:
        """Means over the scenes, then every scene; see `summarised`."""
        return summarised(rows)

    def pictures(self, result: Result) -> Pictures:
        """Draw calibration, coverage and error per step, and two forecasts of each predictor."""
        rows = primary_rows(result.rows)
        files = {
            (str(predictor), str(scene)): json.loads(result.read(f"{scene}/{predictor}.json"))
            for predictor, scene in group(rows, "predictor", "scene")
        }
        yield from prediction_pictures(rows, files)

    def quick(self) -> Self:
        """Few rows of the smallest scene, and the chosen or the first three predictors."""
        scenes = self.scored()
        small = min(scenes, key=lambda name: self.data.size(scenes[name]))
        chosen = self.chosen or tuple(self.family()[:3])
        protocol = replace(self.protocol, stride=max(self.protocol.stride, 5))
        return replace(self, chosen=chosen, only=(small,), protocol=protocol)


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


def prediction_pictures(
    rows: list[Row], files: Mapping[tuple[str, str], dict[str, Any]]
) -> Pictures:
    """Yield every figure.

    Parameters
    ----------
    rows : of the table, of the scenes to show.
    files : what each task left, by predictor and scene.
    """
    steps, classes = stepwise(rows), speed_classes(rows)
    names = list(dict.fromkeys(str(row["predictor"]) for row in rows))
    yield "calibration", _calibration(names, files)
    yield "coverage", _coverage(names, steps)
    yield "error", _error(names, steps)
    yield "area", _area(names, steps)
    if classes:
        yield "coverage_by_speed", _speeds(names, rows, classes)
    scene = next(key[1] for key in files)
    samples = {name: files[name, scene]["samples"] for name in names}
    for number, kind in enumerate(("usual", "surprising")):
        if all(number < len(some) for some in samples.values()):
            chosen = {name: some[number] for name, some in samples.items()}
            yield f"forecasts_{kind}", _samples(chosen, scene)


def _panels(names: Sequence[str], labels: tuple[str, str]) -> "tuple[Figure, list[Any]]":
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
        for step, label, colour, line in (
            (0, "first step", COLOURS[1], "--"),
            (-1, "last step", COLOURS[2], "-."),
        ):
            panel.plot(levels, middle[step], line, color=colour, linewidth=1.0, label=label)
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
        for content, colour, line in STYLES:
            times, middle = _mean(rows, name, f"cover_{round(100 * content)}")
            label = f"{content:g}, mean of scenes" if len(scenes) > 1 else f"{content:g}"
            panel.plot(times, _seen(middle), line, color=colour, label=label)
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
                look = {**style(number, ("",)), "label": f"{which}, {text}"}
                panel.plot(times, _seen(middle), **look)
        _logit(panel, (0.1, 0.5, 0.8, 0.9, 0.95, 0.99))
    return _finished(figure, panels)


def _logit(panel: Any, ticks: Sequence[float]) -> None:
    """Show coverages on a logit scale."""
    from matplotlib.ticker import FixedLocator, NullLocator

    panel.set(yscale="logit", ylim=BEYOND)
    panel.yaxis.set_major_locator(FixedLocator(list(ticks)))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_locator(NullLocator())


def _area(names: list[str], rows: list[Row]) -> "Figure":
    """Draw the area of the region of content 0.95 against the time ahead, on a log scale."""
    figure, panels = _panels(names, ("time ahead (s)", "area (m²)"))
    several = ", mean of scenes" if len(group(rows, "scene")) > 1 else ""
    for name, panel in zip(names, panels, strict=True):
        for (quantity, label), colour, line in zip(AREA_LABELS, COLOURS, LINES, strict=False):
            times, values = _mean(rows, name, quantity)
            shown = np.maximum(values, SMALL)
            panel.plot(times, shown, linestyle=line, color=colour, label=f"{label}{several}")
        panel.set_yscale("log")
    return _finished(figure, panels)


def _error(names: list[str], rows: list[Row]) -> "Figure":
    """Draw the mean error against the time ahead, over those of all others in grey."""
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
    """Draw the forecast of each predictor in one window."""
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
    low, high = middle - half, middle + half
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


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
    legend_below(figure, panels, ncols=5, fontsize=6.5)
    return figure
