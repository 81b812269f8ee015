"""Tables in colour: predictors down, regions across."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ..drawing.plotting import PAGE
from ..engine.base import Row

SHOWN = (
    ("success", "success", ".2f"),
    ("time_mean_s", "time to the goals (s)", ".1f"),
    ("intrusion_share", "share of time near somebody", ".2f"),
)
"""Column of the summary, title and format of each table."""


def draw_tables(lines: Sequence[Row]) -> Any:
    """Draw a table for each measure; dark is better, and the number stands in its cell."""
    from matplotlib import pyplot

    predictors = list(dict.fromkeys(str(line["predictor"]) for line in lines))
    regions = list(dict.fromkeys(str(line["region"]) for line in lines))
    size = PAGE, 0.5 + len(SHOWN) * (0.35 + 0.17 * len(predictors)) + 0.9
    figure, axes = pyplot.subplots(len(SHOWN), 1, figsize=size, sharex=True, squeeze=False)
    for panel, (name, title, form) in zip(axes[:, 0], SHOWN, strict=True):
        found = {(line["predictor"], line["region"]): line[name] for line in lines}
        table = np.array([[_number(found[one, other]) for other in regions] for one in predictors])
        _table(panel, table, form, better_high=name == "success")
        panel.set_title(title)
        panel.set_yticks(range(len(predictors)), [one.replace("_", " ") for one in predictors])
    names = [other.replace("_", " ") for other in regions]
    axes[-1, 0].set_xticks(range(len(regions)), names, rotation=40, ha="right")
    return figure


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _table(panel: Any, table: Array, form: str, *, better_high: bool) -> None:
    """Shade a table from its worst to its best number; what is not known is left white."""
    known = table[np.isfinite(table)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    span = high - low if high > low else 1.0
    good = (table - low) / span if better_high else (high - table) / span
    good = np.where(high > low, good, 1.0)
    panel.imshow(
        np.where(np.isfinite(table), good, np.nan), cmap="cividis_r", vmin=-0.05, vmax=1.05,
        aspect="auto",
    )  # fmt: skip
    panel.grid(False)
    panel.tick_params(length=0)
    for (i, j), value in np.ndenumerate(table):
        text = format(value, form) if np.isfinite(value) else "none"
        dark = np.isfinite(value) and good[i, j] > 0.5
        panel.text(
            j, i, text, ha="center", va="center", fontsize=6, color="white" if dark else "black"
        )
