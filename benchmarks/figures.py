"""Figures of a run: time, growth, what is solved of the hard instances, stages of a decision."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from measuring import Row, labels, repeats
from set_ups import CAP, PAPER, PERIOD

from wideberth.experiments.drawing.plotting import (
    COLOURS,
    LINES,
    PAGE,
    paper_style,
    save,
    subplots,
)

HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "++++", "----")
MARKERS = ("o", "s", "^", "v", "D", "x")
FILES = ("bench_times", "bench_growth", "bench_hard", "bench_stages")


def draw(tables: Mapping[str, Sequence[Row]], folder: Path) -> list[Path]:
    """Draw what the tables hold the numbers of; PNG and PDF each."""
    makers = {"solves": _times, "scaling": _growth, "hard": _hard, "stages": _stages}
    made = []
    for (name, maker), file in zip(makers.items(), FILES, strict=True):
        if tables.get(name):
            with paper_style():
                made += save(maker(tables[name]), folder, file)
    return made


def _times(solves: Sequence[Row]) -> Any:
    """Share of instances solved within a time, by their best repeat."""
    figure, panel = subplots(figsize=(PAGE, 2.8))
    shown = [label for label in labels(solves) if label != f"{PAPER}, 450 ms"]
    for i, label in enumerate(shown):
        own = [row for row in solves if row["set-up"] == label]
        solved = {row["instance"] for row in own if row["solved"] and row["violation"] <= 1e-4}
        best = repeats(own, label)
        taken = np.sort([min(times) for index, times in best.items() if index in solved])
        share = np.arange(1, len(taken) + 1) / len(best)
        panel.step(taken, 100 * share, where="post", label=label, **_line(i))
    _mark(panel, 1e3 * PERIOD, "50 ms")
    _mark(panel, 1e3 * CAP, "paper's cap")
    panel.set(xscale="log", xlabel="time of one solve, ms", ylabel="instances solved, %")
    panel.set_ylim(0, 103)
    figure.legend(loc="outside right center")
    return figure


def _mark(panel: Any, place: float, name: str) -> None:
    panel.axvline(place, color="0.4", linestyle="-", linewidth=0.6)
    panel.annotate(name, (place, 3), rotation=90, ha="right", va="bottom", fontsize=6)


def _growth(rows: Sequence[Row]) -> Any:
    """Time against the number of obstacles and against the horizon, on log axes."""
    axes = list(dict.fromkeys(row["axis"] for row in rows))
    figure, panels = subplots(1, len(axes), figsize=(PAGE, 2.4), sharey=True, squeeze=False)
    for axis, panel in zip(axes, panels[0], strict=True):
        size = "obstacles" if axis.startswith("K") else "steps"
        for i, label in enumerate(labels(rows)):
            own = [row for row in rows if (row["axis"], row["set-up"]) == (axis, label)]
            sizes, times = ([row[name] for row in own] for name in (size, "best_median_ms"))
            panel.plot(sizes, times, marker=MARKERS[i % len(MARKERS)], markersize=3, label=label,
                       **_line(i))  # fmt: skip
        ticks = sorted({row[size] for row in rows if row["axis"] == axis})
        panel.set(xscale="log", yscale="log", title=axis.partition(", ")[2])
        panel.set_xlabel("obstacles K" if size == "obstacles" else "horizon N, steps")
        panel.set_xticks(ticks, [str(tick) for tick in ticks])
        panel.minorticks_off()
    panels[0, 0].set_ylabel("median time of one solve, ms")
    panels[0, 0].legend()
    return figure


def _hard(rows: Sequence[Row]) -> Any:
    """Share solved of hard instances with a known feasible point, by kind."""
    figure, panel = subplots(figsize=(PAGE, 2.6))
    shown = [row for row in rows if row["known"]]
    kinds, names = list(dict.fromkeys(row["kind"] for row in shown)), labels(shown)
    width = 0.85 / max(len(names), 1)
    for i, label in enumerate(names):
        heights = [_share(shown, kind, label) for kind in kinds]
        places = np.arange(len(kinds)) + (i - 0.5 * (len(names) - 1)) * width
        panel.bar(places, heights, width, label=label, color=COLOURS[i % len(COLOURS)],
                  hatch=HATCHES[i % len(HATCHES)], edgecolor="white", linewidth=0.3)  # fmt: skip
    panel.set_xticks(range(len(kinds)), [kind.replace("_", "\n") for kind in kinds])
    panel.grid(axis="x", visible=False)
    panel.set(ylabel="solved, %", ylim=(0, 103))
    figure.legend(loc="outside right center")
    return figure


def _stages(rows: Sequence[Row]) -> Any:
    """Mean time of each stage of a whole decision, by how many obstacles are seen."""
    predictors, stages, seen = (
        [*dict.fromkeys(row[key] for row in rows)] for key in ("predictor", "stage", "seen")
    )
    figure, panels = subplots(1, len(predictors), figsize=(PAGE, 4.4), sharex=True, sharey=True)
    width = 0.85 / max(len(seen), 1)
    for panel, predictor in zip(np.ravel(panels), predictors, strict=True):
        for i, count in enumerate(seen):
            case = (predictor, count)
            times = [row["ms"] for row in rows if (row["predictor"], row["seen"]) == case]
            places = np.arange(len(stages)) + (i - 0.5 * (len(seen) - 1)) * width
            panel.barh(places, times, width, label=f"{count} seen, {sum(times):.2g} ms",
                       color=COLOURS[i % len(COLOURS)], hatch=HATCHES[i % len(HATCHES)],
                       edgecolor="white", linewidth=0.3)  # fmt: skip
        panel.set_yticks(range(len(stages)), stages)
        panel.grid(axis="y", visible=False)
        panel.set(title=predictor, xlabel="processor time in one decision, ms")
        panel.legend()
    panel.invert_yaxis()
    return figure


def _share(rows: Sequence[Row], kind: str, label: str) -> float:
    found = [row for row in rows if (row["kind"], row["set-up"]) == (kind, label)]
    return 100.0 * found[0]["solved_1e-4"] if found else 0.0


def _line(i: int) -> dict[str, Any]:
    """Tell lines apart by colour and style; beyond six by width too."""
    wide = 1.2 if i < len(LINES) else 2.0
    return {
        "color": COLOURS[i % len(COLOURS)],
        "linestyle": LINES[i % len(LINES)],
        "linewidth": wide,
    }
