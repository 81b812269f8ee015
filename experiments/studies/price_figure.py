"""The figure of what regions cost: one line per region, one panel per price."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..drawing.plotting import COLOURS, PAGE, few, note
from ..engine.base import Row
from ..engine.closed_loop import column, group
from .prices import ELLIPSE, excess, quartiles
from .region_family import title

MARKERS = "osD^v"
"""One per forecast; the first is filled, the others are hollow."""


def draw_prices(rows: list[Row], summary: list[Row], times: list[Row]) -> Any:
    """Clearance, extra time, extra way and solve-time ratio of each region, by its area.

    Dots are medians over the seeds. Bars reach from the least to the median clearance, and
    between the quartiles of all else, where there are at least `ENOUGH` seeds; left of zero
    clearance the discs overlap.
    """
    from matplotlib import pyplot

    names = _by_area(summary)
    words = few(len(some) for some in group(rows, "region", "forecast").values())
    forecasts = list(dict.fromkeys(str(line["forecast"]) for line in summary))
    figure, panels = pyplot.subplots(
        1, 5, figsize=(PAGE, 1.2 + 0.2 * len(names)), sharey=True,
        width_ratios=(0.75, 1.0, 1.0, 1.0, 1.0),
    )  # fmt: skip
    for i, forecast in enumerate(forecasts):
        offset = (i - 0.5 * (len(forecasts) - 1)) * 0.6 / max(len(forecasts), 2)
        for place, name in enumerate(names):
            values = _values(rows, summary, times, forecast, name)
            for panel, three in zip(panels, values, strict=True):
                _mark(panel, three, place + offset, i, bars=not words)
    _dress(panels, names)
    _legend(figure, forecasts, words)
    return figure


def _values(
    rows: list[Row], summary: list[Row], times: list[Row], forecast: str, name: str
) -> list[Sequence[float]]:
    """Lower end, dot and upper end in each panel; empty where there is nothing to show."""

    def chosen(table: list[Row], region: str) -> list[Row]:
        found = [row for row in table if row["region"] == region]
        return [row for row in found if row["forecast"] == forecast]

    (line,), own, base = chosen(summary, name), chosen(rows, name), chosen(rows, ELLIPSE)
    if not line.get("episodes"):
        return [()] * 5
    timed = [(line["ratio_q25"], line["ratio"], line["ratio_q75"]) for line in chosen(times, name)]
    clearance = column(own, "clearance")
    return [
        (line["area_ratio"],) * 3,
        (clearance.min(), float(np.median(clearance)), float(np.median(clearance))),
        quartiles(100.0 * excess(own, base, "time_ratio_worst")),
        quartiles(100.0 * excess(own, base, "length_ratio_worst")),
        timed[0] if timed else (),
    ]


def _by_area(summary: list[Row]) -> list[str]:
    """Regions from the smallest to the largest, by their mean area over the forecasts."""
    sizes = {}
    for (name,), some in group(summary, "region").items():
        known = [float(line["area_ratio"]) for line in some if line.get("episodes")]
        sizes[name] = float(np.nan_to_num(np.mean(known or [np.inf]), nan=np.inf))
    return sorted(sizes, key=lambda name: sizes[name])


def _mark(panel: Any, three: Sequence[float], place: float, i: int, *, bars: bool) -> None:
    if not np.isfinite(three).all() or not len(three):
        return
    low, middle, high = three
    colour = COLOURS[(1 + i) % len(COLOURS)]
    if bars:
        panel.plot([low, high], [place, place], "-", color=colour, linewidth=1.0)
    panel.plot(
        middle, place, MARKERS[i % len(MARKERS)], color=colour, markersize=3.4,
        markerfacecolor="white" if i else colour, markeredgewidth=0.8,
    )  # fmt: skip


def _dress(panels: Any, names: list[str]) -> None:
    """Axes, units and the line at the paper's ellipse, or at touching discs."""
    labels = (
        "area over\nexact sum", "least clearance\n(m)", "extra time\nover ellipse (%)",
        "extra path\nover ellipse (%)", "solve time\nover ellipse",
    )  # fmt: skip
    for panel, text, line in zip(panels, labels, (1.0, 0.0, 0.0, 0.0, 1.0), strict=True):
        panel.axvline(line, color="black", linestyle=":", linewidth=0.9)
        panel.set_xlabel(text)
        panel.margins(x=0.12)
    left, right = panels[1].get_xlim()
    if left < 0.0:
        panels[1].axvspan(left, 0.0, color="0.88", linewidth=0.0, zorder=0)
        panels[1].set_xlim(left, right)
    _octaves(panels[-1])
    panels[0].set_yticks(range(len(names)), [title(name) for name in names])
    panels[0].set_ylim(len(names) - 0.4, -0.6)


def _octaves(panel: Any) -> None:
    """Logarithmic axis with ticks at powers of two: the ratios span little more than ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    panel.set_xscale("log", base=2)
    panel.xaxis.set_major_locator(LogLocator(base=2, numticks=12))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_locator(NullLocator())


def _legend(figure: Any, forecasts: list[str], words: str) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D(
            [],
            [],
            marker=MARKERS[i % len(MARKERS)],
            color=COLOURS[(1 + i) % len(COLOURS)],
            markerfacecolor="white" if i else COLOURS[1],
            linestyle="-",
            linewidth=1.0,
            markersize=3.4,
            label=f"{forecast} forecasts",
        )
        for i, forecast in enumerate(forecasts)
    ]
    bars = words or "bars: quartiles\n(clearance: from the least; grey: collision)"
    entries.append(note(f"dots: medians over the seeds; {bars}"))
    figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))
