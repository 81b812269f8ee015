"""The figure of `closed_loop_risk`: shares at every step beside what is nominal."""

from pathlib import Path
from typing import Any

import numpy as np

from ..drawing.plotting import COLOURS, ENOUGH, LINES, PAGE, few, paper_style, save
from ..engine.base import Row
from ..engine.closed_loop import column, group

MARKS = "osD^vP"
LEAST = 1e-3
"""Lower end of the logarithmic axis; shares of zero show as the upper half of their bar."""


def draw(lines: list[Row], folder: Path) -> list[Path]:
    """Draw one column per crowd and level: who left the region, and who was touched."""
    from matplotlib import pyplot

    columns = group(lines, "crowd", "level")
    looks = {name: k for k, (name,) in enumerate(group(lines, "predictor"))}
    with paper_style():
        figure, panels = pyplot.subplots(
            2, len(columns), figsize=(PAGE, 4.2), squeeze=False, sharex=True, sharey="row"
        )
        for i, ((crowd, level), own) in enumerate(columns.items()):
            upper, lower = panels[0, i], panels[1, i]
            for (name,), some in group(own, "predictor").items():
                _outside(upper, some, looks[name], name)
                _touched(lower, some, looks[name])
            _nominal(upper, own, "outside_nominal")
            _nominal(lower, own, "touched_nominal")
            upper.set_title(f"{crowd}\n{str(level).replace('_', ', tail ')} %")
            lower.set_xlabel("step")
        marks = _legend(panels[0])
        words = few(int(line["episodes"]) for line in lines) or "bars: intervals of 95 %"
        figure.legend(
            marks.values(), marks.keys(), loc="outside lower center", ncols=6,
            title=f"{words}; dotted: nominal", title_fontsize=7,
        )  # fmt: skip
        panels[0, 0].set_ylabel("walker outside its region")
        panels[0, 0].set_ylim(0.0, 1.0)
        panels[1, 0].set_ylabel("touched, of near pairs\n(line: computed)")
        panels[1, 0].set_yscale("log")
        panels[1, 0].set_ylim(LEAST, 1.0)
        return save(figure, folder, "closed_loop_risk")


def _legend(panels: Any) -> dict[str, Any]:
    """Name of each series in some panels -> its mark."""
    found: dict[str, Any] = {}
    for panel in panels:
        handles, labels = panel.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    return found


def _outside(panel: Any, some: list[Row], k: int, name: str) -> None:
    steps, share = column(some, "step"), column(some, "outside")
    panel.errorbar(
        steps, share, _bars(some, "outside"), fmt=MARKS[k], color=COLOURS[k],
        linestyle="none", markersize=3, linewidth=0.8, label=name,
    )  # fmt: skip


def _touched(panel: Any, some: list[Row], k: int) -> None:
    steps, share = column(some, "step"), column(some, "near_touched")
    shift = 0.12 * (k - 2)
    panel.errorbar(
        steps + shift, share, _bars(some, "near_touched"), fmt=MARKS[k], color=COLOURS[k],
        linestyle="none", markersize=3, linewidth=0.8,
    )  # fmt: skip
    panel.plot(
        steps + shift,
        column(some, "near_expected"),
        linestyle=LINES[k],
        color=COLOURS[k],
        linewidth=0.8,
    )


def _nominal(panel: Any, own: list[Row], name: str) -> None:
    panel.axhline(own[0][name], color="black", linestyle=":", linewidth=0.9)


def _bars(some: list[Row], name: str) -> Any:
    """Lengths of bars below and above a share, (2, K); None of fewer than `ENOUGH` episodes."""
    if min(column(some, "episodes")) < ENOUGH:
        return None
    share = column(some, name)
    bars = [share - column(some, f"{name}_low"), column(some, f"{name}_high") - share]
    return np.maximum(bars, 0.0)
