"""Markers of a front: how much clearance a setting keeps, and what time it takes for it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...metrics.statistics import quartiles
from ..engine.base import Row
from ..engine.closed_loop import column
from .plotting import COLOURS, ENOUGH, entry, few, title

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
    without an end count as none; fewer than `ENOUGH` episodes have no bars. The marker is hollow
    if there are episodes with a contact or without arrival, with their number beside it; None
    where no episode has an arrival.
    """
    marker, colour = look
    low, middle, high = quartiles(column(rows, time))
    if not np.isfinite(middle):
        return None
    clearance = column(rows, "clearance")
    typical, least = float(np.median(clearance)), float(clearance.min())
    failed = sum(not row["success"] for row in rows)
    if len(rows) >= ENOUGH:
        panel.plot([low, high], [typical, typical], "-", color=colour, linewidth=0.8)
        panel.plot([middle, middle], [least, typical], "-", color=colour, linewidth=0.8)
    face = "white" if failed else colour
    panel.plot(middle, typical, marker, color=colour, markersize=5, markerfacecolor=face)
    if failed:
        panel.annotate(f"{failed}", (middle, typical), (3, 3), textcoords="offset points",
                       fontsize=6, color=colour)  # fmt: skip
    return middle, typical


def nest(panel: Any) -> None:
    """Enlarge markers below others at the same place, so that each of them is seen."""
    markers = [line for line in panel.lines if line.get_marker() != "None"]
    for i, marker in enumerate(markers):
        place = np.ravel(marker.get_data())
        above = sum(np.allclose(place, np.ravel(one.get_data())) for one in markers[i + 1 :])
        marker.set_markersize(5.0 + 4.0 * above)


def say_empty(panel: Any) -> None:
    """Say in a panel without markers why it has none, instead of ticks that mean nothing."""
    panel.set(xticks=[], yticks=[])
    panel.text(0.5, 0.6, "no arrivals", transform=panel.transAxes, ha="center", color="0.3")


LEAST_TIME, LEAST_CLEARANCE = 2.0, 0.2
"""s and m; what a panel shows at least, so that a tick never stands for a hundredth."""


def widen(panel: Any) -> None:
    """Let a panel show at least 2 s and 0.2 m, around what is drawn."""
    widen_time(panel)
    low, high = panel.get_ylim()
    more = max(0.5 * (LEAST_CLEARANCE - (high - low)), 0.0)
    panel.set_ylim(low - more, high + more)


def widen_time(panel: Any) -> None:
    """Let a panel show at least 2 s along x, around what is drawn."""
    low, high = panel.get_xlim()
    more = max(0.5 * (LEAST_TIME - (high - low)), 0.0)
    panel.set_xlim(low - more, high + more)


def bars_note(counts: Iterable[int]) -> str:
    """Say what the bars of the markers are, or why there are none."""
    return few(counts) or "bars: quartiles of the time, down to the least clearance"


def front_legend(figure: Any, looks: Mapping[str, Look], counts: Iterable[int]) -> None:
    """Name the markers below the figure, and say what bars and hollow ones are.

    Parameters
    ----------
    looks : of the names that have a marker.
    counts : episodes behind each marker.
    """
    entries = [
        entry(title(name), marker=marker, color=colour, markersize=5)
        for name, (marker, colour) in looks.items()
    ]
    words = f"medians; {bars_note(counts)}\nhollow: so many touched or did not arrive"
    for columns in range(min(max(len(entries), 1), 4), 0, -1):
        legend = figure.legend(
            handles=entries, loc="outside lower center", ncols=columns,
            title=words, title_fontsize=7,
        )  # fmt: skip
        if columns == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()  # long names: fewer of them side by side
