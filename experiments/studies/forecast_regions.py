"""The content ellipse against Lütkepohl's rectangle, for several correlations and contents."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import GaussianObstacle, WideberthError
from ...framework.region import Convex
from ...framework.values.arrays import Array, positive, probability, whole
from ...regions.box import box_content
from ...regions.luetkepohl_rectangle import LuetkepohlRectangle
from ...regions.mahalanobis_ellipse import MahalanobisEllipse
from ...regions.minkowski_sum import MinkowskiSum
from ..drawing.plotting import COLOURS, PAGE, legend_below, number, style, subplots
from ..engine.closed_loop import group, pick
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, reduced

REGIONS: Mapping[str, Convex] = {
    "ellipse": MahalanobisEllipse(),
    "sum": MinkowskiSum(),
    "rectangle": LuetkepohlRectangle(),
}
"""Enlarged: the paper's ellipse with longer axes, the exact sum of ellipse and disc, and the exact
sum of rectangle and disc. Without margin the first two are the same ellipse."""
BARE = ("ellipse", "rectangle")
"""Regions that differ before the enlargement."""

MARKERS = "os^Dv"
SUMMARY = (
    *("correlation", "content", "area_ratio", "enlarged_ratio", "sum_ratio"),
    *("rectangle_content", "rectangle_frequency", "ellipse_frequency"),
)


@final
@dataclass(frozen=True)
class ForecastRegions(GridStudy):
    """Area and content of ellipse and rectangle, before and after the enlargement by the margin.

    The paper compares them at p = 0.90 for one covariance that it does not give, and concludes
    that the ellipse is less conservative. The content ellipse is the smallest set of its
    content, so that holds before the enlargement. After it the rectangle is still larger than the
    paper's ellipse with longer axes (`LuetkepohlRectangle` has the proof), but it can be smaller
    than the exact sum of ellipse and disc: ``enlarged_ratio`` is the rectangle's area over the
    former, ``sum_ratio`` over the latter.

    Attributes
    ----------
    content : p, which both regions promise in the first figure; one of ``contents``.
    contents : several p for the table and the second figure.
    correlations : of the two coordinates, each within (-1, 1).
    deviations : m, of the two coordinates.
    margin : m, r + r_d, for the columns after the enlargement.
    draws : random positions per correlation, a check of the contents.
    """

    content: float = 0.9
    contents: tuple[float, ...] = (0.5, 0.8, 0.9, 0.95, 0.99)
    correlations: tuple[float, ...] = (0.0, 0.5, 0.8, 0.95)
    deviations: tuple[float, float] = (1.0, 1.0)
    margin: float = 1.5
    draws: int = 200_000

    claim: ClassVar[str] = (
        "The ellipse covers a smaller area than the rectangle and is less conservative."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory, luetkepohl2005new"

    def __post_init__(self) -> None:
        for content in self.contents:
            probability("contents", content)
        if self.content not in self.contents:
            raise WideberthError(
                f"content is {self.content:g}; wanted one of contents, {self.contents}"
            )
        positive("margin", self.margin, zero=True)
        whole("draws", self.draws)
        for deviation in self.deviations:
            positive("deviations", deviation)
        if not self.correlations or max(abs(rho) for rho in self.correlations) > 0.99:
            raise WideberthError(
                f"correlations is {self.correlations}; wanted numbers within [-0.99, 0.99]"
            )

    def axes(self) -> Axes:
        """Each correlation, with random draws of its own."""
        numbered = [(rho, seed) for seed, rho in enumerate(self.correlations)]
        return {("correlation", "seed"): numbered}

    def measure(self, task: Task) -> TaskOutcome:
        """Areas, exact contents and their frequencies among random draws, per content."""
        rho = float(task.settings["correlation"])
        covariance = self._covariance(rho)
        rng = np.random.default_rng(task.seed)
        draws = rng.standard_normal((self.draws, 2)) @ np.linalg.cholesky(covariance).T
        rows = [self._row(rho, content, covariance, draws) for content in self.contents]
        obstacle = GaussianObstacle(np.zeros(2), covariance)
        curves: dict[str, Any] = {"draws": draws[:150].round(6).tolist()}
        for name in BARE:
            region = REGIONS[name]
            bare = region.parameters(obstacle, np.asarray(0.0))
            edge = region.boundary(bare, region.level(1.0 - self.content), 360)
            curves[name] = edge.round(9).tolist()
        return TaskOutcome(rows, files={f"correlation_{rho:g}.json": json.dumps(curves).encode()})

    def _row(self, rho: float, content: float, covariance: Array, draws: Array) -> Row:
        """Measure all regions at one content."""
        obstacle = GaussianObstacle(np.zeros(2), covariance)
        row: Row = {"correlation": rho, "content": content}
        for name, region in REGIONS.items():
            at = np.asarray(region.level(1.0 - content))
            bare = region.parameters(obstacle, np.asarray(0.0))
            wide = region.parameters(obstacle, np.asarray(self.margin))
            if name in BARE:
                row[f"{name}_area_m2"] = float(region.area(bare, at))
                row[f"{name}_frequency"] = float(region.contains(draws, bare, at).mean())
            row[f"{name}_enlarged_m2"] = float(region.area(wide, at))
        row["area_ratio"] = row["rectangle_area_m2"] / row["ellipse_area_m2"]
        row["enlarged_ratio"] = row["rectangle_enlarged_m2"] / row["ellipse_enlarged_m2"]
        row["sum_ratio"] = row["rectangle_enlarged_m2"] / row["sum_enlarged_m2"]
        row["ellipse_content"] = content
        half = REGIONS["rectangle"].level(1.0 - content) * np.asarray(self.deviations)
        row["rectangle_content"] = box_content(half, covariance)
        return row

    def summary(self, rows: list[Row]) -> list[Row]:
        """Ratios and contents per correlation and content."""
        return [pick(row, SUMMARY) for row in rows]

    def pictures(self, result: Result) -> Pictures:
        """One panel per correlation at one content; then ratios and contents over all."""
        rows = [row for row in result.rows if row["content"] == self.content]
        size = (PAGE, 1.0 + 0.95 * PAGE / len(rows))
        figure, panels = subplots(
            1, len(rows), figsize=size, sharex=True, sharey=True, squeeze=False
        )
        for panel, row in zip(panels[0], rows, strict=True):
            _panel(panel, row, json.loads(result.read(_file(row))))
        panels[0][0].set_ylabel("y (m)")
        legend_below(figure, panels[0], ncols=3)
        yield "forecast_regions", figure
        yield "forecast_regions_p", _over_contents(result.rows)

    def quick(self) -> Self:
        """Fewer draws."""
        return reduced(self, draws=20_000)

    def _covariance(self, rho: float) -> Array:
        first, second = self.deviations
        cross = rho * first * second
        return np.array([[first**2, cross], [cross, second**2]])


def _file(row: Row) -> str:
    return f"correlation_{float(row['correlation']):g}.json"


def _panel(panel: Any, row: Row, curves: dict[str, Any]) -> None:
    x, y = np.array(curves["draws"]).T
    panel.plot(x, y, ".", color="0.65", markersize=1.5, linestyle="none", label="draws")
    for name, colour, line in (("ellipse", 1, "-"), ("rectangle", 2, "--")):
        closed = np.array([*curves[name], curves[name][0]])
        label = f"{name}, p = {row['content']:g}"
        panel.plot(closed[:, 0], closed[:, 1], color=COLOURS[colour], ls=line, label=label)
    panel.set(aspect="equal", xlabel="x (m)")
    panel.set_title(
        f"correlation {number(row['correlation'])}\narea ratio {row['area_ratio']:.2f}\n"
        f"rectangle holds {row['rectangle_content']:.3f}"
    )


TITLES = {
    "area_ratio": "area, rectangle / ellipse\nbefore the enlargement",
    "enlarged_ratio": "area, both enlarged:\nrectangle / ellipse with longer axes",
    "sum_ratio": "area, both enlarged:\nrectangle / exact sum of ellipse and disc",
    "gained": "content of the rectangle\nabove the promised p",
}
"""Column of the table, or the content gained -> title of its panel."""


def _over_contents(rows: list[Row]) -> Any:
    """Four panels over p, one line per correlation: the area ratios, the content gained."""
    from matplotlib.ticker import FixedLocator, NullLocator

    figure, axes = subplots(2, 2, figsize=(PAGE, 4.6))
    panels = list(axes.flat)
    tails = sorted({1.0 - float(row["content"]) for row in rows}, reverse=True)
    for i, ((rho,), own) in enumerate(group(rows, "correlation").items()):
        look = {**style(i, MARKERS), "markersize": 3.5, "label": number(rho)}
        for panel, (name, text) in zip(panels, TITLES.items(), strict=True):
            values = [_gained(row) if name == "gained" else row[name] for row in own]
            panel.plot([1.0 - float(row["content"]) for row in own], values, **look)
            panel.set_title(text)
    for panel in panels:
        panel.set_xscale("log")
        panel.set_xlim(1.25 * tails[0], 0.8 * tails[-1])  # from the smallest p to the largest
        panel.xaxis.set_major_locator(FixedLocator(tails))
        panel.xaxis.set_minor_locator(NullLocator())
        panel.set_xticklabels([f"{1.0 - tail:g}" for tail in tails])
        panel.set_xlabel("promised content p")
    for panel in panels[:3]:
        panel.axhline(1.0, color="0.5", linewidth=0.8, linestyle="-")
    legend_below(figure, panels[:1], title="correlation", ncols=6)
    return figure


def _gained(row: Row) -> float:
    return float(row["rectangle_content"]) - float(row["content"])
