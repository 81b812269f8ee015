"""The front of a tuning sweep: clearance against time, one panel per factor."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..drawing.plotting import COLOURS, PAGE
from ..engine.base import Row
from ..engine.closed_loop import group
from ..engine.showing import shown
from .trade_off_markers import bars_note, mark, say_empty, widen

BEST = "0.75"
"""Grey of what no other setting beats."""


def draw_fronts(lines: Sequence[Row], rows: Sequence[Row]) -> Any:
    """Draw the settings of each factor beside the base.

    A star stands for the base; behind, in every panel, a grey step joins the settings that no
    other one beats in clearance and time among those that always arrived. Bars and hollow markers
    as in `fronts.mark`.
    """
    from matplotlib import pyplot

    played = group(rows, "factor", "value")
    (first, *others) = played
    factors = list(dict.fromkeys(factor for factor, _ in others))
    wide = min(len(factors), 3)
    deep = -(-len(factors) // wide) if factors else 1
    figure, axes = pyplot.subplots(
        deep, max(wide, 1), figsize=(PAGE * (0.4 + 0.2 * wide), 0.6 + 2.2 * deep), squeeze=False,
        sharex=True, sharey=True, layout="constrained",
    )  # fmt: skip
    for panel in axes.flat[len(factors) :]:
        panel.set_visible(False)
    front = _front(lines)
    for i, factor in enumerate(factors):
        panel, colour = axes.flat[i], COLOURS[1 + i % (len(COLOURS) - 1)]
        panel.set_title(factor)
        panel.plot(*front.T, "-", color=BEST, linewidth=2.5, zorder=0.5)
        for key, own in played.items():
            if key[0] == factor:
                _value(panel, own, key, colour)
        place = mark(panel, played[first], "success_time", ("*", COLOURS[0]))
        if place is not None:
            panel.plot(*place, "*", color=COLOURS[0], markersize=9, zorder=4)
        panel.margins(0.12)
        if place is not None:
            widen(panel)
        if i + wide >= len(factors):  # nothing below it
            panel.tick_params(labelbottom=True)
            panel.set_xlabel("time to the goals (s)")
    if not any(row["success"] for row in rows):
        for panel in axes.flat[: len(factors)]:
            say_empty(panel)
    for panel in axes[:, 0]:
        panel.set_ylabel("least clearance (m)")
    _legend(figure, bars_note(map(len, played.values())))
    return figure


def _value(panel: Any, rows: Sequence[Row], key: tuple[Any, ...], colour: str) -> None:
    place = mark(panel, rows, "success_time", ("o", colour))
    if place is not None:
        panel.annotate(shown(key[1]), place, (3, -8), textcoords="offset points", fontsize=6)


def _front(lines: Sequence[Row]) -> Any:
    """Corners of the step that joins the best settings without failures, (K, 2)."""
    from .tuning import pareto

    safe = [line for line in lines if line["success"] == 1.0]
    points = np.array([(line["time_median_s"], line["clearance_median_m"]) for line in safe])
    if not len(points):
        return np.zeros((0, 2))
    best = points[pareto(points * (1.0, -1.0))]
    best = best[np.argsort(best[:, 0])]
    corners = np.stack([np.append(best[1:, 0], best[-1, 0]), best[:, 1]], axis=1)
    return np.stack([best, corners], axis=1).reshape(-1, 2)


def _legend(figure: Any, words: str) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], linestyle="", marker="*", color=COLOURS[0], markersize=9, label="base"),
        Line2D([], [], linestyle="", marker="o", color=COLOURS[1], label="one setting changed"),
        Line2D([], [], color=BEST, linewidth=2.5, label="front of those that always arrive"),
    ]
    figure.legend(
        handles=entries, loc="outside lower center", ncols=3, title=f"medians; {words}",
        title_fontsize=7,
    )  # fmt: skip
