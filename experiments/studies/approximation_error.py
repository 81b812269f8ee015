"""How far the paper's enlarged ellipse falls short of the exact sum."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import WideberthError
from ...framework.values.arrays import Array, positive, whole
from ...regions import inflation
from ..drawing.plotting import PAGE, style, subplots
from ..engine.closed_loop import group
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, reduced, rounded

MARKERS = ("", *"os^Dv")
"""With the line styles, what distinguishes the lines in grey print."""


@final
@dataclass(frozen=True)
class ApproximationError(GridStudy):
    """Errors over the polar angle, and the largest one over condition number and size.

    The paper's figure shows an error that vanishes on the axes of the ellipse and for round
    covariances. It states neither the norm nor the axes, the margin or the condition numbers,
    so its numbers cannot be reproduced; here the smallest semi-axis s sigma_2 is ``short_axis``
    margins, the condition number is that of the covariance (axis ratio squared) and both errors
    are divided by the margin.

    The second figure leaves the choice of ``short_axis`` behind. With b = s sigma_2, a =
    b sqrt(lambda_1 / lambda_2), A and H the arithmetic and harmonic mean of both, the largest
    clearance error is 1 - sqrt((H + rho) / (A + rho)) of the margin rho: a function of the
    condition number and b / rho alone. It is drawn for condition numbers from 1 to 1e4 and
    b / rho from 0.01 to 100, and at each of them compared with a search along the boundary.

    Attributes
    ----------
    conditions : lambda_1 / lambda_2 of the covariances, each at least 1.
    short_axis : s sigma_2 as a multiple of the margin.
    margin : m, r + r_d.
    angles : number of polar angles from 0 to 90 degrees.
    resolution : condition numbers and sizes of the map.
    """

    conditions: tuple[float, ...] = (1.0, 2.0, 4.0, 10.0, 25.0, 100.0)
    short_axis: float = 1.0
    margin: float = 1.5
    angles: int = 361
    resolution: int = 41

    claim: ClassVar[str] = (
        "The enlargement by r + r_d is exact on the axes and for round covariances; elsewhere it "
        "falls short."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def __post_init__(self) -> None:
        positive("short_axis", self.short_axis)
        positive("margin", self.margin)
        whole("angles", self.angles, least=2)
        whole("resolution", self.resolution, least=2)
        if not self.conditions or min(self.conditions) < 1.0:
            raise WideberthError(
                f"conditions is {self.conditions}; wanted numbers of at least 1, the largest "
                "eigenvalue over the smallest"
            )

    def axes(self) -> Axes:
        """Each condition number of the curves, and each size of the map."""
        curves = [("curve", value) for value in self.conditions]
        sizes = [("map", size) for size in grid(SIZES, self.resolution).tolist()]
        return {("part", "value"): [*curves, *sizes]}

    def measure(self, task: Task) -> TaskOutcome:
        """Both errors at every angle, over the margin, or one line of the map."""
        part, value = task.settings["part"], float(task.settings["value"])
        if part == "map":
            rows = map_rows(value, self.margin, self.resolution)
            return TaskOutcome([{"part": part, **row} for row in rows])
        b = np.asarray(self.short_axis * self.margin)
        a = b * np.sqrt(value)
        degrees = np.linspace(0.0, 90.0, self.angles)
        angle, margin = np.radians(degrees), np.asarray(self.margin)
        radial = inflation.radial_error(a, b, margin, angle) / margin
        clearance = inflation.clearance_error(a, b, margin, angle) / margin
        closed = float(inflation.largest_clearance_error(a, b, margin) / margin)
        return TaskOutcome([
            {
                "part": part,
                "condition": value,
                "polar_angle_deg": float(degrees[i]),
                "radial_error_over_margin": _clean(radial[i]),
                "clearance_error_over_margin": _clean(clearance[i]),
                "largest_clearance_error_closed_form": closed,
            }
            for i in range(self.angles)
        ])  # fmt: skip

    def summary(self, rows: list[Row]) -> list[Row]:
        """Largest errors and where they are, per condition number; then cuts of the map."""
        curves, chart = _part(rows, "curve"), _part(rows, "map")
        condensed: list[Row] = []
        for (condition,), chosen in group(curves, "condition").items():
            line: Row = {"condition": condition, "short_axis_over_margin": self.short_axis}
            for kind in ("radial", "clearance"):
                worst = max(chosen, key=lambda row: float(row[f"{kind}_error_over_margin"]))
                line[f"largest_{kind}_error"] = worst[f"{kind}_error_over_margin"]
                line[f"at_deg_{kind}"] = worst["polar_angle_deg"]
            line["closed_form"] = chosen[0]["largest_clearance_error_closed_form"]
            condensed.append(line)
        sizes = list(dict.fromkeys(row["short_axis_over_margin"] for row in chart))
        return [*condensed, *(map_summary(chart, size) for size in decades(sizes))]

    def pictures(self, result: Result) -> Pictures:
        """Both errors over the polar angle; the map of the largest with cuts through it."""
        figure, panels = subplots(2, 1, figsize=(3.5, 4.2), sharex=True)
        for panel, kind in zip(panels, ("radial", "clearance"), strict=True):
            _panel(panel, _part(result.rows, "curve"), kind)
        panels[0].legend(title=r"$\lambda_1/\lambda_2$", ncols=2)
        panels[1].set_xlabel("polar angle from the major axis (°)")
        panels[0].set_title(
            "enlarged ellipse against exact sum\n"
            rf"smallest semi-axis $s\sigma_2 = {self.short_axis:g}\,\rho$, $\rho = r + r_d$"
        )
        yield "approximation_error", figure
        yield "approximation_error_map", draw_map(_part(result.rows, "map"))

    def quick(self) -> Self:
        """Fewer angles, and a coarse map."""
        return reduced(self, angles=91, resolution=9)


def _clean(value: float) -> float:
    """Round: differences at the 1e-13 of the margin are noise and differ between processors."""
    return round(float(value), 12) + 0.0


def _part(rows: list[Row], name: str) -> list[Row]:
    return [row for row in rows if row["part"] == name]


def _panel(panel: Any, rows: list[Row], kind: str) -> None:
    for i, ((condition,), chosen) in enumerate(group(rows, "condition").items()):
        panel.plot(
            [row["polar_angle_deg"] for row in chosen],
            [row[f"{kind}_error_over_margin"] for row in chosen],
            **style(i, MARKERS), markevery=(10 + 6 * i, max(len(chosen) // 7, 1)),
            markersize=3.0, label=f"{condition:g}",
        )  # fmt: skip
    panel.set(ylabel=rf"{kind} error / $\rho$", xlim=(0.0, 90.0), xticks=range(0, 91, 15))


CONDITIONS = (0.0, 4.0)
"""Decimal logarithms of the least and the largest condition number of the map."""

SIZES = (-2.0, 2.0)
"""The same of the short semi-axis over the margin."""

CONTOURS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""Labelled lines of the map, as shares of the margin."""

CONDITION = r"condition number $\lambda_1/\lambda_2$"
MAP_MARKERS = (*"os^Dv", "")


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
    figure, (left, right) = subplots(1, 2, figsize=(PAGE, 3.0), width_ratios=(1.25, 1.0))
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
    panel.set(xscale="log", yscale="log")
    levels = [level for level in CONTOURS if error.min() < level < error.max()]
    if levels:
        shades = ["white" if level < 0.45 else "black" for level in levels]
        lines = panel.contour(conditions, sizes, error, levels, colors=shades, linewidths=0.7)
        panel.clabel(lines, fmt=lambda value: f"{100 * value:g} %", fontsize=6)
    figure.colorbar(mesh, ax=panel, pad=0.02, label=r"largest clearance error / $\rho$")
    panel.set(xlabel=CONDITION, ylabel=r"short semi-axis $s\sigma_2 / \rho$")
    panel.set_title(r"clearance lost to the exact sum, $\rho = r + r_d$")


def _curves(panel: Any, conditions: list[float], sizes: list[float], error: Array) -> None:
    for i, size in enumerate(decades(sizes)):
        panel.plot(
            conditions, error[sizes.index(size)], **style(i, MAP_MARKERS),
            markevery=(2 * i % 5, max(len(conditions) // 6, 1)), markersize=3.0, label=f"{size:g}",
        )  # fmt: skip
    panel.set(xscale="log", xlim=(conditions[0], conditions[-1]), ylim=(0.0, None))
    panel.legend(title=r"$s\sigma_2 / \rho$")
    panel.set(xlabel=CONDITION, ylabel=r"largest clearance error / $\rho$")
    panel.set_title("cuts through the map")
