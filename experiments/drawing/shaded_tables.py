"""Tables of numbers, shaded from worst to best."""

from typing import Any

import numpy as np

from ...framework.values.arrays import Array


def shaded(panel: Any, table: Array, form: str, *, better_high: bool) -> None:
    """Shade a table from its worst to its best number; what is not known is left white.

    Numbers that are printed alike have one colour; where all are, none is shaded.
    """
    table = np.vectorize(lambda value: float(format(value, form)), otypes=[float])(table)
    known = table[np.isfinite(table)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    span = high - low if high > low else 1.0
    good = (table - low) / span if better_high else (high - table) / span
    good = np.where(high > low, good, 0.0)
    panel.imshow(
        np.where(np.isfinite(table), good, np.nan), cmap="Blues", vmin=-0.05, vmax=1.05,
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
