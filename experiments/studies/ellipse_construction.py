"""The construction of the paper's region: content ellipse, enlarged ellipse and exact sum."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import GaussianObstacle
from ...framework.risk.collision_probability import collision_probability
from ...framework.values.arrays import positive, probability, whole
from ...regions.mahalanobis_ellipse import MahalanobisEllipse
from ...regions.minkowski_sum import MinkowskiSum
from ..drawing.plotting import COLOURS, subplots
from ..engine.closed_loop import group
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, reduced

CURVES = ("inner ellipse", "outer ellipse", "exact sum")


@final
@dataclass(frozen=True)
class EllipseConstruction(GridStudy):
    """Boundaries of the three sets for one covariance, their areas and collision risks.

    The paper's figure shows the inner ellipse of content p and the outer one with its axes longer
    by r + r_d; the exact sum is ours. It gives no covariance: the default is a thin one,
    so that the gap can be seen.

    Attributes
    ----------
    content : p of the inner ellipse.
    deviations : m, along the axes of the covariance, the larger one first.
    turn : degrees from the x axis to the major axis.
    radius, obstacle_radius : m, r and r_d.
    count : points per boundary.
    """

    content: float = 0.95
    deviations: tuple[float, float] = (1.0, 0.1)
    turn: float = 30.0
    radius: float = 0.75
    obstacle_radius: float = 0.75
    count: int = 720

    claim: ClassVar[str] = (
        "Inner ellipse of content p, outer ellipse with axes longer by r + r_d; the latter "
        "approximates the exact sum."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def __post_init__(self) -> None:
        probability("content", self.content)
        for deviation in self.deviations:
            positive("deviations", deviation)
        positive("radius", self.radius, zero=True)
        positive("obstacle_radius", self.obstacle_radius)
        whole("count", self.count, least=8)

    def axes(self) -> Axes:
        """Each set."""
        return {"curve": CURVES}

    def measure(self, task: Task) -> TaskOutcome:
        """Points of one boundary, with the collision risk of a robot centred there."""
        name = str(task.settings["curve"])
        margin = self.radius + self.obstacle_radius
        turn = np.radians(self.turn)
        major, minor = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        wide, narrow = self.deviations
        covariance = wide**2 * np.outer(major, major) + narrow**2 * np.outer(minor, minor)
        obstacle = GaussianObstacle(np.zeros(2), covariance)
        region = MinkowskiSum() if name == "exact sum" else MahalanobisEllipse()
        used = 0.0 if name == "inner ellipse" else margin
        parameters = region.parameters(obstacle, np.asarray(used))
        level = region.level(1.0 - self.content)
        points = region.boundary(parameters, level, self.count)
        risk = collision_probability(-points, covariance, np.asarray(margin))
        distance = MinkowskiSum().signed_distance(
            points, MinkowskiSum().parameters(obstacle, np.asarray(0.0)), np.asarray(level)
        )
        area = float(region.area(parameters, np.asarray(level)))
        rows: list[Row] = [
            {
                "curve": name,
                "x_m": round(float(x), 9),
                "y_m": round(float(y), 9),
                "clearance_m": round(float(gap), 9) + 0.0,
                "collision_risk": round(float(chance), 12),
                "area_m2": area,
            }
            for (x, y), gap, chance in zip(points, distance, risk, strict=True)
        ]
        return TaskOutcome(rows)

    def summary(self, rows: list[Row]) -> list[Row]:
        """Area, smallest clearance to the inner ellipse and largest risk on each boundary."""
        return [
            {
                "curve": name,
                "area_m2": chosen[0]["area_m2"],
                "smallest_clearance_m": min(float(row["clearance_m"]) for row in chosen),
                "largest_collision_risk": max(float(row["collision_risk"]) for row in chosen),
            }
            for (name,), chosen in group(rows, "curve").items()
        ]

    def pictures(self, result: Result) -> Pictures:
        """Draw the three boundaries, and the disc where the outer ellipse falls short most."""
        figure, panel = subplots(figsize=(3.5, 3.5))
        self._draw(panel, result.rows)
        figure.legend(loc="outside lower center", ncols=2)
        yield "ellipse_construction", figure

    def quick(self) -> Self:
        """Fewer points."""
        return reduced(self, count=180)

    def _draw(self, panel: Any, rows: list[Row]) -> None:
        curves = {name: some for (name,), some in group(rows, "curve").items()}
        for name, label, colour, line in (
            ("inner ellipse", "inner ellipse", 0, "-"),
            ("outer ellipse", r"outer, axes + $\rho$", 2, "--"),
            ("exact sum", "exact sum", 1, "-."),
        ):
            closed = np.array([(row["x_m"], row["y_m"]) for row in curves[name]])
            closed = np.concatenate([closed, closed[:1]])
            panel.plot(*closed.T, color=COLOURS[colour], linestyle=line, label=label)
        worst = min(curves["outer ellipse"], key=lambda row: float(row["clearance_m"]))
        margin = self.radius + self.obstacle_radius
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        panel.plot(
            worst["x_m"] + margin * np.cos(angle), worst["y_m"] + margin * np.sin(angle),
            color="0.4", linestyle=":", linewidth=0.9,
            label=rf"disc $\rho$ = {margin:g} m, worst place",
        )  # fmt: skip
        panel.plot(worst["x_m"], worst["y_m"], "o", color="0.4", markersize=3)
        panel.plot(0.0, 0.0, "+", color="0.1", markersize=6)
        lost = margin - float(worst["clearance_m"])
        panel.set_title(f"p = {self.content:g}, clearance lost at most {lost:.2f} m")
        panel.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
