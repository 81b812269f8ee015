"""Markers of a front: how much clearance a setting keeps, and what time it takes for it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from wideberth.experiments.base import Row
from wideberth.experiments.closed_loop import column
from wideberth.experiments.plotting import COLOURS
from wideberth.experiments.prices import quartiles

Look = tuple[str, str]
"""Marker and colour."""


def front_looks(names: Iterable[str]) -> dict[str, Look]:
    """Give each name a marker and a colour."""
    return {
        name: ("osD^vPX*<>dp"[i % 12], COLOURS[i % len(COLOURS)]) for i, name in enumerate(names)
    }


def mark(panel: Any, rows: Sequence[Row], time: str, look: Look) -> tuple[float, float] | None:
    """Draw one marker at the median time and clearance of the episodes; return its place.

    Bars reach down to the least clearance and over the quartiles of the time, of which episodes
    without an end count as none. The marker is hollow where somebody touched or did not arrive,
    with how many beside it; None where nobody arrived.
    """
    marker, colour = look
    low, middle, high = quartiles(column(rows, time))
    if not np.isfinite(middle):
        return None
    clearance = column(rows, "clearance")
    typical, least = float(np.median(clearance)), float(clearance.min())
    failed = sum(not row["success"] for row in rows)
    panel.plot([low, high], [typical, typical], "-", color=colour, linewidth=0.8)
    panel.plot([middle, middle], [least, typical], "-", color=colour, linewidth=0.8)
    face = "white" if failed else colour
    panel.plot(middle, typical, marker, color=colour, markersize=5, markerfacecolor=face)
    if failed:
        panel.annotate(f"{failed}", (middle, typical), (3, 3), textcoords="offset points",
                       fontsize=6, color=colour)  # fmt: skip
    return middle, typical


def say_empty(panel: Any) -> None:
    """Say in a panel without markers why it has none, instead of ticks that mean nothing."""
    panel.set(xticks=[], yticks=[])
    panel.text(0.5, 0.6, "nobody arrived", transform=panel.transAxes, ha="center", color="0.3")


def front_legend(figure: Any, looks: Mapping[str, Look]) -> None:
    """Name the markers below the figure."""
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], linestyle="", marker=marker, color=colour, markersize=5,
               label=name.replace("_", " "))
        for name, (marker, colour) in looks.items()
    ]  # fmt: skip
    figure.legend(handles=entries, loc="outside lower center", ncols=min(len(entries), 4))
