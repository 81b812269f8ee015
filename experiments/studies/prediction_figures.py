"""Figures of the prediction benchmark: a panel per predictor."""

from collections.abc import Mapping, Sequence
from math import ceil
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ...framework import Forecast
from ...framework.values.arrays import Array
from ...metrics.statistics import known_mean
from ...simulation.drawing.artists import outlines
from ..drawing.plotting import COLOURS, LINES, PAGE, legend_below, style, subplots, title
from ..engine.closed_loop import column, group
from .grid import Pictures, Row
from .prediction_scores import CONTENTS, TAIL
from .prediction_tables import speed_classes, stepwise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
