"""Figures of comparisons: outcomes, fronts, pairs and trends."""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np

from ..drawing.plotting import ENOUGH, PAGE, entry, few, legend_below, number, subplots, title
from ..drawing.trade_off_markers import (
    front_legend,
    front_looks,
    mark,
    nest,
    say_empty,
    widen,
    widen_time,
)
from ..engine.closed_loop import column, group
from .episode_statistics import against, by_controller, means, paired, promised, shares
from .grid import Pictures, Row, labelled

PLACES = ("scenario", "robot", "settings")
"""Where controllers are compared; a panel each."""
PARTS = {
    "success": {"color": "0.88"},
    "timeout": {"color": "white", "hatch": "//////"},
    "deadlock": {"color": "white", "hatch": "xxxxxx"},
    "collision": {"color": "0.25"},
}
"""Outcome -> how its part of a bar looks."""
TRENDS = {
    "success": "share that arrives\nwithout touching",
    "time_median_s": "time to the goals (s),\nmedian",
    "clearance_median_m": "least clearance (m),\nmedian",
}
"""Column of the summary -> label of its panel of trends."""


def summary_pictures(lines: Sequence[Row], rows: Sequence[Row], baseline: str) -> Pictures:
    """Yield all figures of the table, and the table condensed: all means, and promises kept.

    Parameters
    ----------
    lines : of the summary.
    rows : of the table.
    baseline : controller that the others are paired with.
    """
    names = list(dict.fromkeys(str(row["controller"]) for row in rows))
    yield "outcomes", _outcomes(rows)
    yield "clearance_against_time", draw_front(rows, names)
    if len(names) > 1:
        yield "paired_times", _pairs(rows, names, baseline)
    if len(_panels(rows)) > 2:
        yield "trends", _trends(rows, lines, names)
    groups = labelled(rows, *PLACES, "controller")
    yield "means.csv", [{**labels, **means(own)} for labels, own in groups]
    yield "promises.csv", [{**labels, **promised(own)} for labels, own in groups]


def _panels(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of each place by its title, which names what differs between the places."""
    varying = [name for name in PLACES if len({row[name] for row in rows}) > 1]
    return {title(", ".join(map(str, key))): some for key, some in group(rows, *varying).items()}


def _grid(count: int, height: float, **options: Any) -> tuple[Any, list[Any]]:
    """Return a figure with so many panels, at most three in a row, and the panels."""
    wide = min(count, 3)
    deep = -(-count // wide)
    figure, axes = subplots(
        deep, wide, figsize=(PAGE * (0.4 + 0.2 * wide), 0.7 + height * deep), squeeze=False,
        layout="constrained", **options,
    )  # fmt: skip
    for panel in axes.flat[count:]:
        panel.set_visible(False)
    return figure, list(axes.flat[:count])


def _outcomes(rows: Sequence[Row]) -> Any:
    """Draw a bar per controller, a panel per place; of one controller a bar per place."""
    panels = _panels(rows)
    bars = {place: by_controller(some) for place, some in panels.items()}
    if len({row["controller"] for row in rows}) == 1:
        bars = {str(rows[0]["controller"]): panels}
    most = max(map(len, bars.values()))
    figure, axes = _grid(len(bars), 0.5 + 0.24 * most, sharey=True)
    for panel, (place, found) in zip(axes, bars.items(), strict=True):
        for i, some in enumerate(found.values()):
            _bar(panel, -i, some)
        panel.set_yticks(-np.arange(len(found)), map(title, found))
        panel.set(title=place, xlim=(0.0, 1.0))
        panel.grid(visible=False)
    for panel in axes[-3:]:
        panel.set_xlabel("share of episodes")
    played = [len(some) for found in bars.values() for some in found.values()]
    words = few(played) or "whiskers: intervals of 95 %, above of success, below of collision"
    legend_below(figure, axes[:1], ncols=4, title=words, title_fontsize=7)
    return figure


def _bar(panel: Any, place: float, rows: Sequence[Row]) -> None:
    """Draw outcomes from left to right; above and below the intervals of first and last.

    Fewer than `ENOUGH` episodes have no intervals.
    """
    found = shares(rows)
    left = 0.0
    for name, look in PARTS.items():
        panel.barh(
            place, found[name], 0.4, left, edgecolor="black", linewidth=0.5, label=name, **look
        )
        left += found[name]
    if len(rows) < ENOUGH:
        return
    for name, aside in (("success", 0.31), ("collision", -0.31)):  # beside the bar's hatching
        ends = np.array([found[f"{name}_low"], found[f"{name}_high"]])
        ends = ends if name == "success" else 1.0 - ends
        panel.plot(ends, [place + aside] * 2, "|-", color="black", linewidth=1.0, markersize=4)


def draw_front(
    rows: Sequence[Row], names: Sequence[str], time: str = "success_time",
    label: str = "time to the goals (s)",
) -> Any:  # fmt: skip
    """Draw median clearance against median time, a panel per place.

    ``time`` is the column of the times, ``label`` what stands below them.
    """
    looks, drawn = front_looks(names), set()
    panels = _panels(rows)
    figure, axes = _grid(len(panels), 2.2)
    for panel, (where, some) in zip(axes, panels.items(), strict=True):
        panel.set_title(where)
        places = {
            name: mark(panel, own, time, looks[name]) for name, own in by_controller(some).items()
        }
        nest(panel)
        never = [title(name) for name, place in places.items() if place is None]
        missing = [fill(f"(no success: {', '.join(never)})", 36)] if never else []
        if len(never) == len(places):
            missing = []
            say_empty(panel)
        else:
            panel.axhline(0.0, color="black", linewidth=0.8)
            panel.margins(y=0.14)
            widen(panel)
        drawn |= {name for name, place in places.items() if place is not None}
        panel.set_xlabel("\n".join([label, *missing]))
    for panel in axes[:: min(len(axes), 3)]:
        panel.set_ylabel("least clearance (m)")
    known = {name: look for name, look in looks.items() if name in drawn}
    front_legend(figure, known, [len(own) for own in group(rows, *PLACES, "controller").values()])
    return figure


def _pairs(rows: Sequence[Row], names: Sequence[str], baseline: str) -> Any:
    """Draw a dot per seed at which both arrived, the mean and its interval.

    Fewer than `ENOUGH` such seeds have no interval; where there is none, the figure says so.
    """
    others = [name for name in names if name != baseline]
    panels = _panels(rows)
    figure, axes = _grid(len(panels), 0.7 + 0.3 * len(others), sharey=True)
    counts: list[int] = []
    for panel, (where, some) in zip(axes, panels.items(), strict=True):
        panel.set_title(where)
        played = by_controller(some)
        for i, name in enumerate(others):
            counts.append(_difference(panel, -i, played[name], played[baseline]))
        if any(counts[-len(others) :]):
            panel.axvline(0.0, color="black", linewidth=0.8)
            widen_time(panel)
        else:
            panel.set_xticks([])
            panel.grid(visible=False)
        panel.set_yticks(-np.arange(len(others)), map(title, others))
        panel.set_ylim(0.5 - len(others), 0.55)
        panel.set_xlabel(f"time beyond that of {title(baseline)} (s)")
    _pairs_legend(figure, [count for count in counts if count])
    return figure


def _pairs_legend(figure: Any, counts: Sequence[int]) -> None:
    """Say what is drawn, if there is anything."""
    entries = [
        entry("one seed", marker=".", color="0.6", markersize=4),
        entry("mean", marker="D", color="black", markersize=3),
    ]
    if any(count >= ENOUGH for count in counts):
        line = {"color": "black", "linewidth": 1.2, "linestyle": "-"}
        entries.append(entry("its interval of 95 %", **line))
    words = "seeds at which both arrived"
    if not counts:
        entries, words = [], "there is no seed at which both arrived: no times to compare"
    elif min(counts) < ENOUGH:
        words += f" (no interval of fewer than {ENOUGH})"
    if counts:
        words += "\np of equal times by Wilcoxon's test, of equal success by McNemar's"
    figure.legend(
        handles=entries, loc="outside lower center", ncols=3, title=words, title_fontsize=7
    )


def _difference(panel: Any, place: float, own: Sequence[Row], base: Sequence[Row]) -> int:
    """Draw one controller against the baseline; return at how many seeds both arrived."""
    gap = paired(own, base, "success_time") - paired(base, own, "success_time")
    known = gap[np.isfinite(gap)]
    found = against(own, base)
    spread = np.linspace(-0.14, 0.14, len(known)) if len(known) > 1 else np.zeros(len(known))
    ends = [found["time_difference_low_s"], found["time_difference_high_s"]]
    if len(known) >= ENOUGH:
        panel.plot(ends, [place] * 2, "-", color="black", linewidth=1.2)
    if len(known):
        panel.plot(known, place - 0.25 + 0.7 * spread, ".", color="0.6", markersize=2.5)
        panel.plot(found["time_difference_s"], place, "D", color="black", markersize=3)
    count = f"{found['only_this']} to {found['only_baseline']}"
    chance = number(found["p_success"], ".2g")
    times = f"p = {number(found['p_time'], '.2g')}; " if len(known) else ""
    alone = f"both arrived: {len(known)}; {times}one alone: {count}, p = {chance}"
    panel.annotate(
        alone, (1.0, place), xycoords=("axes fraction", "data"), xytext=(-2, 3),
        textcoords="offset points", ha="right", va="bottom", fontsize=5.5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
    )  # fmt: skip
    return len(known)


def _trends(rows: Sequence[Row], lines: Sequence[Row], names: Sequence[str]) -> Any:
    """Draw a line per controller over the places."""
    places = list(_panels(rows))
    found = {name: [line for line in lines if line["controller"] == name] for name in names}
    figure, axes = subplots(1, 3, figsize=(PAGE, 2.7), layout="constrained")
    for panel, (quantity, text) in zip(axes, TRENDS.items(), strict=True):
        for i, (name, some) in enumerate(found.items()):
            at = np.arange(len(places)) + 0.06 * (i - 0.5 * (len(names) - 1))
            values = column(some, quantity)
            (drawn,) = panel.plot(at, values, marker=".", label=title(name))
            if quantity == "success" and min(column(some, "episodes")) >= ENOUGH:
                low, high = column(some, "success_low"), column(some, "success_high")
                panel.vlines(at, low, high, color=drawn.get_color(), linewidth=0.7)
        panel.set_xticks(range(len(places)), places, rotation=90)
        panel.grid(axis="x", visible=False)
        panel.set_ylabel(text)
    axes[0].set_ylim(-0.03, 1.03)
    words = few(int(line["episodes"]) for line in lines) or "bars: intervals of 95 % of the share"
    legend_below(figure, axes[:1], ncols=4, title=words, title_fontsize=7)
    return figure
