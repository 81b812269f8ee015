"""The largest clearance error over condition number and size: its map and its curves."""

from typing import Any

import numpy as np

from ...framework.values.arrays import Array
from ...regions import inflation
from ..drawing.plotting import COLOURS, LINES, PAGE
from ..engine.base import Row
from .region_family import rounded

CONDITIONS = (0.0, 4.0)
"""Decimal logarithms of the least and the largest condition number of the map."""

SIZES = (-2.0, 2.0)
"""The same of the short semi-axis over the margin."""

CONTOURS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""Labelled lines of the map, as shares of the margin."""

MARKERS = ("o", "s", "^", "D", "v", "")


def grid(ends: tuple[float, float], count: int) -> Array:
    """Numbers at equal steps of their logarithm, (count,); nine digits, alike everywhere."""
    return np.array([rounded(10.0**exponent) for exponent in np.linspace(*ends, count)])


def map_rows(size: float, margin: float, count: int) -> list[Row]:
    """One line of the map: all condition numbers for one short semi-axis.

    Both numbers are shares of the margin: the closed form of the Hausdorff distance, and the
    largest clearance error that is found along the boundary itself.

    Parameters
    ----------
    size : short semi-axis of the content ellipse over the margin.
    margin : m.
    count : condition numbers.
    """
    conditions = grid(CONDITIONS, count)
    b, room = np.full(count, size * margin), np.full(count, margin)
    a = b * np.sqrt(conditions)
    closed = inflation.largest_clearance_error(a, b, room) / margin
    found = _found(a, b, room) / margin
    return [
        {
            "condition": float(conditions[i]),
            "short_axis_over_margin": size,
            "largest_clearance_error_closed_form": rounded(float(closed[i]), True),
            "largest_clearance_error_found": rounded(float(found[i]), True),
        }
        for i in range(count)
    ]


def _found(a: Array, b: Array, margin: Array) -> Array:
    """Largest clearance errors, (C,) m, by a search over the boundary that narrows three times.

    The angles searched are those of the normal: in polar angle the peak of a thin ellipse is
    too narrow for any grid.
    """
    low, high = np.zeros(len(a)), np.full(len(a), 0.5 * np.pi)
    best = np.zeros(len(a))
    a, b, margin = a[:, None], b[:, None], margin[:, None]
    for _ in range(3):
        normal = np.linspace(low, high, 61, axis=1)
        upper, lower = (b + margin) ** 2 * np.sin(normal), (a + margin) ** 2 * np.cos(normal)
        error = inflation.clearance_error(a, b, margin, np.arctan2(upper, lower))
        best = np.maximum(best, error.max(axis=1))
        at = np.clip(error.argmax(axis=1), 1, normal.shape[1] - 2)[:, None]
        low, high = (np.take_along_axis(normal, at + step, axis=1)[:, 0] for step in (-1, 1))
    return best


def map_summary(rows: list[Row], size: float) -> Row:
    """Condense one line of the map: its error at the largest condition number, and the check.

    ``largest_disagreement`` is that of the closed form and the search along the boundary,
    over all condition numbers, as a share of the margin.
    """
    own = [row for row in rows if row["short_axis_over_margin"] == size]
    last = max(own, key=lambda row: float(row["condition"]))
    names = ("largest_clearance_error_found", "largest_clearance_error_closed_form")
    gaps = [abs(float(row[names[0]]) - float(row[names[1]])) for row in own]
    return {
        "condition": last["condition"],
        "short_axis_over_margin": size,
        "largest_clearance_error": last[names[0]],
        "closed_form": last[names[1]],
        "largest_disagreement": max(gaps),
    }


def decades(sizes: list[float]) -> list[float]:
    """Sizes of the curves: the whole powers of ten of the grid, its ends where there is none."""
    whole = [size for size in sizes if np.isclose(np.log10(size) % 1.0, (0.0, 1.0)).any()]
    return whole or [sizes[0], sizes[-1]]


def draw_map(rows: list[Row]) -> Any:
    """Heat map with labelled contours, and curves over the condition number beside it."""
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(PAGE, 3.0), width_ratios=(1.25, 1.0))
    conditions = sorted({float(row["condition"]) for row in rows})
    sizes = sorted({float(row["short_axis_over_margin"]) for row in rows})
    table = {
        (row["condition"], row["short_axis_over_margin"]): float(
            row["largest_clearance_error_closed_form"]
        )
        for row in rows
    }
    error = np.array([[table[condition, size] for condition in conditions] for size in sizes])
    _heat(figure, left, conditions, sizes, error)
    _curves(right, conditions, sizes, error)
    return figure


def _heat(
    figure: Any, panel: Any, conditions: list[float], sizes: list[float], error: Array
) -> None:
    mesh = panel.pcolormesh(
        conditions, sizes, error, cmap="viridis", vmin=0.0, vmax=0.85, shading="gouraud",
        rasterized=True,
    )  # fmt: skip
    panel.grid(False)
    panel.set_xscale("log")
    panel.set_yscale("log")
    levels = [level for level in CONTOURS if error.min() < level < error.max()]
    if levels:
        shades = ["white" if level < 0.45 else "black" for level in levels]
        lines = panel.contour(conditions, sizes, error, levels, colors=shades, linewidths=0.7)
        panel.clabel(lines, fmt=lambda value: f"{100 * value:g} %", fontsize=6)
    bar = figure.colorbar(mesh, ax=panel, pad=0.02)
    bar.set_label(r"largest clearance error / $\rho$")
    panel.set_xlabel(r"condition number $\lambda_1/\lambda_2$")
    panel.set_ylabel(r"short semi-axis $s\sigma_2 / \rho$")
    panel.set_title(r"clearance lost to the exact sum, $\rho = r + r_d$")


def _curves(panel: Any, conditions: list[float], sizes: list[float], error: Array) -> None:
    for i, size in enumerate(decades(sizes)):
        panel.plot(
            conditions,
            error[sizes.index(size)],
            color=COLOURS[i % len(COLOURS)],
            linestyle=LINES[i % len(LINES)],
            marker=MARKERS[i % len(MARKERS)],
            markevery=(2 * i % 5, max(len(conditions) // 6, 1)),
            markersize=3.0,
            label=f"{size:g}",
        )
    panel.set_xscale("log")
    panel.set_xlim(conditions[0], conditions[-1])
    panel.set_ylim(0.0, None)
    panel.legend(title=r"$s\sigma_2 / \rho$")
    panel.set_xlabel(r"condition number $\lambda_1/\lambda_2$")
    panel.set_ylabel(r"largest clearance error / $\rho$")
    panel.set_title("cuts through the map")
