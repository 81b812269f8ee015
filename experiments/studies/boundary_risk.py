"""The true collision probability along the boundary of each region."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework.region import Region
from ...framework.risk.risk_meter import along_boundary
from ...framework.values.arrays import positive, probability
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import GaussianObstacle
from ..drawing.plotting import COLOURS, PAGE, number, paper_style, save, subplots
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from .region_family import FIELDS, exceeds, family, member, reading, rounded, title

SMALLEST = 1e-6
"""Risks below this are drawn at the left edge, with an arrow."""

COLUMNS = ("case", "region", "area_ratio", "risk_min", "risk_max", "clearance_lost", "remark")


@final
@dataclass(frozen=True)
class BoundaryRisk(Experiment):
    """Each region at level(tail) against the risk meter, for several covariances and margins.

    A robot on the boundary keeps clear as far as the region asks; its true collision
    probability there is what the region in fact allows. Areas are those of the enlarged
    regions over the exact sum of content ellipse and disc of the same tail.

    Attributes
    ----------
    regions : by name.
    registered : measure every other registered region of two coordinates too.
    cases : deviation along x, deviation along y, margin r + r_d, all in m.
    tail : 1 - content, or the asked risk where a region's level stands for a risk.
    """

    regions: Mapping[str, Region] = field(default_factory=dict)
    registered: bool = True
    cases: tuple[tuple[float, float, float], ...] = (
        (1.0, 0.5, 1.5),
        (1.0, 0.1, 1.5),
        (0.3, 0.1, 1.5),
        (3.0, 1.0, 1.5),
    )
    tail: float = 0.05

    claim: ClassVar[str] = (
        "The regions are conservative: on their boundary the collision probability is below 1 - p."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    captions: ClassVar[Mapping[str, str]] = {
        "boundary_risk": (
            "True collision probability along each region's boundary, from least to largest: "
            "right of the dotted line a region is too small for its tail."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("risk_max", "area_ratio", "clearance_lost")

    def __post_init__(self) -> None:
        probability("tail", self.tail)
        if not self.cases or not (self.regions or self.registered):
            raise WideberthError("cases and regions must each name at least one")
        for first, second, margin in self.cases:
            positive("deviations", first, zero=True)
            positive("deviations", second, zero=True)
            positive("margin", margin, zero=True)

    def tasks(self) -> Sequence[Task]:
        """One task per case and region."""
        return [
            Task(f"{name} {i}", settings={"case": i, "region": name})
            for i in range(len(self.cases))
            for name in family(self.regions, self.registered)
        ]

    def measure(self, task: Task) -> TaskOutcome:
        """Read the meter, and keep the risk against the direction."""
        number, name = int(task.settings["case"]), str(task.settings["region"])
        first, second, margin = self.cases[number]
        obstacle = GaussianObstacle(np.zeros(2), np.diag([first**2, second**2]))
        row: Row = {
            "case": number, "sigma_x_m": first, "sigma_y_m": second, "margin_m": margin,
            "region": name,
        }  # fmt: skip
        try:
            region = member(self.regions, name)
            level = region.level(self.tail)
            row |= reading(region, obstacle, margin, level)
            edge = along_boundary(region, obstacle, margin, level, 181)
        except WideberthError as error:
            return TaskOutcome([row | dict.fromkeys(FIELDS) | {"remark": str(error)}])
        curve = {"angle_deg": np.degrees(edge.angles).round(6).tolist()}
        curve["risk"] = [rounded(value) for value in edge.risk]
        content = json.dumps(curve).encode()
        return TaskOutcome([row | {"remark": ""}], files={f"{number}_{name}.json": content})

    def summary(self, rows: list[Row]) -> list[Row]:
        """Area, risk and clearance per case and region."""
        return [
            {column: row[column] for column in COLUMNS[:-1]}
            | {"above_tail": None if row["remark"] else exceeds(row, self.tail)}
            for row in rows
        ]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw one panel per case: from the smallest to the largest risk, one row per region."""
        rows = result.rows
        regions = _by_area(rows)
        count = len(self.cases)
        with paper_style():
            size = (PAGE, 1.2 + 0.17 * len(regions))
            figure, panels = subplots(1, count, figsize=size, sharey=True, squeeze=False)
            for number, panel in enumerate(panels[0]):
                own = {row["region"]: row for row in rows if row["case"] == number}
                _panel(panel, [own[name] for name in regions], self.tail)
            panels[0][0].set_yticks(range(len(regions)), [title(name) for name in regions])
            panels[0][0].set_ylim(len(regions) - 0.4, -0.6)
            _legend(figure, self.tail)
            return save(figure, folder, "boundary_risk")

    def quick(self) -> Self:
        """Keep the first two cases and three regions."""
        chosen = dict(list(self.regions.items())[:3])
        return replace(
            self, regions=chosen, registered=self.registered and not chosen, cases=self.cases[:2]
        )


def _by_area(rows: list[Row]) -> list[str]:
    """Names of the regions, from the smallest to the largest mean share of the exact area."""
    sizes: dict[str, list[float]] = {}
    for row in rows:
        known = [] if row["remark"] else [float(row["area_ratio"])]
        sizes.setdefault(row["region"], []).extend(known)
    return sorted(sizes, key=lambda name: float(np.mean(sizes[name] or [np.inf])))


def _panel(panel: Any, rows: list[Row], tail: float) -> None:
    """Draw the ranges of one case, with the area over the exact sum's at the right."""
    for place, row in enumerate(rows):
        if row["remark"]:
            panel.text(0.5, place, "not defined", transform=panel.get_yaxis_transform(),
                       ha="center", va="center", fontsize=6, color="0.4")  # fmt: skip
            continue
        low, middle, high = (
            max(float(row[key]), SMALLEST) for key in ("risk_min", "risk_mean", "risk_max")
        )
        above = exceeds(row, tail)
        colour = COLOURS[2] if above else COLOURS[1]
        panel.plot([low, high], [place, place], "-", color=colour, linewidth=2.2)
        panel.plot(middle, place, "|", color="black", markersize=5)
        face = "white" if above else colour
        if float(row["risk_min"]) < SMALLEST:
            panel.plot(SMALLEST, place, "<", color=colour, markersize=4)
        panel.plot(high, place, "o", color=colour, markerfacecolor=face, markersize=3.6)
        panel.text(1.02, place, f"{float(row['area_ratio']):.2f}", va="center", fontsize=6,
                   transform=panel.get_yaxis_transform())  # fmt: skip
    panel.axvline(tail, color="black", linestyle=":", linewidth=0.9)
    panel.set_xscale("log")
    panel.set_xlim(0.5 * SMALLEST, 2.0)
    panel.set_xticks([1e-6, 1e-4, 1e-2, 1.0])
    panel.minorticks_off()
    first, second, margin = (float(rows[0][key]) for key in ("sigma_x_m", "sigma_y_m", "margin_m"))
    panel.text(1.02, 1.02, "area", fontsize=6, transform=panel.transAxes)
    panel.set_xlabel("collision probability")
    panel.set_title(
        rf"$\sigma$ = ({first:g}, {second:g}) m," + "\n" + rf"$\rho$ = {margin:g} m", fontsize=7
    )


def _legend(figure: Any, tail: float) -> None:
    from matplotlib.lines import Line2D

    def line(colour: str, face: str, label: str) -> Any:
        return Line2D([], [], color=colour, marker="o", markerfacecolor=face, markersize=3.6,
                      linestyle="-", linewidth=2.2, label=label)  # fmt: skip

    entries = [
        line(COLOURS[1], COLOURS[1], f"boundary, at most {number(tail)}"),
        line(COLOURS[2], "white", f"boundary, above {number(tail)} in part"),
        Line2D([], [], color="black", marker="|", linestyle="", label="mean over the length"),
        Line2D([], [], linestyle="", label="area: region over exact sum"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
