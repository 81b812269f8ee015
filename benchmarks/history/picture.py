"""Draw the history of speed: ``python benchmarks/history/picture.py`` writes the page's figure.

A panel for each ratio of ``releases.csv``, on an axis that begins at 0, so that heights compare as
the numbers do; a point for each release with the interval of its median. Where no other work is
named, the ratio is to the unit (`work.py`).
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from compare import RATIOS, ROOT, read_rows  # noqa: E402

from wideberth.experiments.drawing.plotting import (  # noqa: E402
    COLOURS,
    PAGE,
    paper_style,
    subplots,
)

FIGURE = ROOT / "docs" / "figures" / "speed-history.png"
COLUMNS = 3
LABELLED = 8
"""Most releases that are all named on the axis; of more, every so many."""


def draw(rows: Sequence[Mapping[str, str]]) -> Any:
    """Return the figure of some rows, one at least."""
    lines = -(-len(RATIOS) // COLUMNS)
    figure, panels = subplots(lines, COLUMNS, figsize=(PAGE, 1.75 * lines), sharex=True)
    releases = [row["release"] for row in rows]
    step = -(-len(rows) // LABELLED)
    for panel, (name, (_, _, words)) in zip(panels.flat, RATIOS.items(), strict=True):
        places = [place for place, row in enumerate(rows) if row[name]]
        middle, low, high = (
            np.array([float(rows[place][f"{name}{end}"]) for place in places])
            for end in ("", "_low", "_high")
        )
        look = {"color": COLOURS[1], "marker": "o", "markersize": 3.5, "capsize": 2.5}
        panel.errorbar(places, middle, (middle - low, high - middle), linewidth=0.9, **look)
        panel.set_title(words, fontsize="small", loc="left")
        panel.set_ylim(0.0, 1.1 * high.max(initial=1e-9))
        panel.set_xlim(-0.6, len(rows) - 0.4)
        panel.set_xticks(range(0, len(rows), step), releases[::step], rotation=30, ha="right")
    return figure


def main(file: Path = FIGURE) -> None:
    """Write the figure of the page."""
    with paper_style():
        draw(read_rows()).savefig(file, metadata={"Software": None})


if __name__ == "__main__":
    main()
