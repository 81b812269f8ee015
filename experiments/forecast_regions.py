"""The content ellipse against Lütkepohl's rectangle, for several correlations."""

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from wideberth.experiments.base import Experiment, Outcome, Result, Row, Task
from wideberth.experiments.plotting import COLOURS, PAGE, paper_style, save
from wideberth.framework.arrays import Array, positive, probability, whole
from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import GaussianObstacle
from wideberth.regions.luetkepohl_rectangle import LuetkepohlRectangle, box_content
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum


@final
@dataclass(frozen=True)
class ForecastRegions(Experiment):
    """Area and content of both regions, before and after the enlargement by the margin.

    The paper compares them at p = 0.90 for one covariance that it does not give, and concludes
    that the ellipse is less conservative. The content ellipse is the smallest set of its
    content, so before the enlargement that always holds; after it we measure.

    Attributes
    ----------
    content : p, which both regions promise.
    correlations : of the two coordinates, each within (-1, 1).
    deviations : m, of the two coordinates.
    margin : m, r + r_d, for the columns after the enlargement.
    draws : random positions per correlation, a check of the contents.
    """

    content: float = 0.9
    correlations: tuple[float, ...] = (0.0, 0.5, 0.8, 0.95)
    deviations: tuple[float, float] = (1.0, 1.0)
    margin: float = 1.5
    draws: int = 200_000

    claim: ClassVar[str] = (
        "The ellipse covers a smaller area than the rectangle and is less conservative."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory, luetkepohl2005new"

    def __post_init__(self) -> None:
        probability("content", self.content)
        positive("margin", self.margin, zero=True)
        whole("draws", self.draws)
        for deviation in self.deviations:
            positive("deviations", deviation)
        if not self.correlations or max(abs(rho) for rho in self.correlations) > 0.99:
            raise WideberthError(
                f"correlations is {self.correlations}; wanted numbers within [-0.99, 0.99]"
            )

    def tasks(self) -> Sequence[Task]:
        """One task per correlation."""
        return [
            Task(f"correlation {rho:g}", seed=i, settings={"correlation": rho})
            for i, rho in enumerate(self.correlations)
        ]

    def measure(self, task: Task) -> Outcome:
        """Areas, exact contents and their frequencies among random draws."""
        rho = float(task.settings["correlation"])
        covariance = self._covariance(rho)
        obstacle = GaussianObstacle(np.zeros(2), covariance)
        ellipse, rectangle = MinkowskiSum(), LuetkepohlRectangle()
        s, z = ellipse.level(1 - self.content), rectangle.level(1 - self.content)
        rng = np.random.default_rng(task.seed)
        draws = rng.standard_normal((self.draws, 2)) @ np.linalg.cholesky(covariance).T
        row: Row = {"correlation": rho}
        curves: dict[str, Any] = {"draws": draws[:150].round(6).tolist()}
        for name, region, level in (("ellipse", ellipse, s), ("rectangle", rectangle, z)):
            # Without margin the sum is the ellipse itself, whose test is the quicker one.
            test = MahalanobisEllipse() if name == "ellipse" else region
            at = np.asarray(level)
            bare = region.parameters(obstacle, np.asarray(0.0))
            wide = region.parameters(obstacle, np.asarray(self.margin))
            row[f"{name}_area_m2"] = float(region.area(bare, at))
            row[f"{name}_enlarged_m2"] = float(region.area(wide, at))
            row[f"{name}_frequency"] = float(test.contains(draws, bare, at).mean())
            curves[name] = region.boundary(bare, level, 360).round(9).tolist()
        row["area_ratio"] = row["rectangle_area_m2"] / row["ellipse_area_m2"]
        row["enlarged_ratio"] = row["rectangle_enlarged_m2"] / row["ellipse_enlarged_m2"]
        row["ellipse_content"] = self.content
        row["rectangle_content"] = box_content(z * np.asarray(self.deviations), covariance)
        return Outcome([row], files={f"correlation_{rho:g}.json": json.dumps(curves).encode()})

    def summary(self, rows: list[Row]) -> list[Row]:
        """Ratios and contents per correlation."""
        columns = (
            "correlation", "area_ratio", "enlarged_ratio", "rectangle_content",
            "rectangle_frequency", "ellipse_frequency",
        )  # fmt: skip
        return [{column: row[column] for column in columns} for row in rows]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """One panel per correlation."""
        with paper_style():
            from matplotlib import pyplot

            rows = result.rows
            size = (PAGE, 1.0 + 0.95 * PAGE / len(rows))
            figure, panels = pyplot.subplots(
                1, len(rows), figsize=size, sharex=True, sharey=True, squeeze=False
            )
            for panel, row in zip(panels[0], rows, strict=True):
                _panel(panel, row, json.loads(result.read(_file(row))))
            panels[0][0].set_ylabel("y (m)")
            handles, labels = panels[0][0].get_legend_handles_labels()
            named = {text: f"{text}, p = {self.content:g}" for text in ("ellipse", "rectangle")}
            labels = [named.get(text, text) for text in map(str, labels)]
            figure.legend(handles, labels, loc="outside lower center", ncols=3)
            return save(figure, folder, "forecast_regions")

    def quick(self) -> Self:
        """Fewer draws."""
        return replace(self, draws=min(self.draws, 20_000))

    def _covariance(self, rho: float) -> Array:
        first, second = self.deviations
        cross = rho * first * second
        return np.array([[first**2, cross], [cross, second**2]])


def _file(row: Row) -> str:
    return f"correlation_{float(row['correlation']):g}.json"


def _panel(panel: Any, row: Row, curves: dict[str, Any]) -> None:
    x, y = np.array(curves["draws"]).T
    panel.plot(x, y, ".", color="0.65", markersize=1.5, linestyle="none", label="draws")
    for name, colour, style in (("ellipse", 1, "-"), ("rectangle", 2, "--")):
        closed = np.array([*curves[name], curves[name][0]])
        panel.plot(closed[:, 0], closed[:, 1], color=COLOURS[colour], ls=style, label=name)
    panel.set_aspect("equal")
    panel.set_xlabel("x (m)")
    panel.set_title(
        f"correlation {row['correlation']:g}\narea ratio {row['area_ratio']:.2f}\n"
        f"rectangle holds {row['rectangle_content']:.3f}"
    )


if __name__ == "__main__":
    from wideberth.experiments.cli import main

    sys.argv[1:1] = ["run", "forecast_regions"]
    main()
