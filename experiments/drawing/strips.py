"""Columns of dots: a quantity of every episode, a column per setting, with the medians."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine.base import Row
from ..engine.closed_loop import column, group
from .plotting import COLOURS, entry, name_columns

if TYPE_CHECKING:
    pass

DOT: dict[str, Any] = {"marker": "o", "color": "0.35"}
NEVER: dict[str, Any] = {"marker": "^", "color": COLOURS[2]}


def strip(panel: Any, rows: Sequence[Row], name: str) -> None:
    """Draw one dot per episode in a column per planner, with the median as a bar.

    Episodes without a finite value (who never arrived has no time) stand as triangles at the
    upper edge and count as longer than all others; where they are the half, there is no median.
    """
    groups = group(rows, "planner")
    for i, some in enumerate(groups.values()):
        values = column(some, name)
        known = np.isfinite(values)
        spread = np.linspace(-0.18, 0.18, len(values)) if len(values) > 1 else np.zeros(1)
        panel.plot(i + spread[known], values[known], linestyle="", markersize=2.5, **DOT)
        if not known.all():
            panel.plot(
                i + spread[~known], np.full((~known).sum(), 0.96), linestyle="", markersize=4,
                transform=panel.get_xaxis_transform(), **NEVER,
            )  # fmt: skip
        middle = float(np.median(np.where(known, values, np.inf)))
        if np.isfinite(middle):
            panel.plot([i - 0.3, i + 0.3], [middle] * 2, "-", color="black", linewidth=1.5)
    name_columns(panel, [planner for (planner,) in groups])
    panel.grid(axis="y", linewidth=0.4, alpha=0.6)


def strip_legend(figure: Any, lines: str = "") -> None:
    """Name what `strip` draws, and grey lines where there are any.

    Parameters
    ----------
    figure : with its panels drawn.
    lines : what thin grey lines are; empty for none.
    """
    entries = [
        entry("episode", markersize=3, **DOT),
        entry("median", color="black", linestyle="-", linewidth=1.5),
    ]
    drawn = [line for panel in figure.axes for line in panel.lines]
    if any(line.get_marker() == NEVER["marker"] for line in drawn):
        entries.append(entry("never arrived", markersize=4, **NEVER))
    if lines:
        entries.append(entry(lines, color="0.5", linestyle="-", linewidth=0.6))
    figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))
