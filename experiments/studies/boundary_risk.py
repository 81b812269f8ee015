"""The true collision probability along the boundary of each region."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import GaussianObstacle, WideberthError
from ...framework.values.arrays import positive
from ...metrics.region_risk import along_boundary
from ..drawing.plotting import COLOURS, PAGE, entry, number, subplots, title
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, reduced
from .region_family import FIELDS, RegionStudy, exceeds, family, member, reading, rounded

SMALLEST = 1e-6
"""Risks below this are drawn at the left edge, with an arrow."""

COLUMNS = ("case", "region", "area_ratio", "risk_min", "risk_max", "clearance_lost", "remark")


@final
@dataclass(frozen=True)
class BoundaryRisk(RegionStudy):
    """Each region at level(tail) against the risk meter, for several covariances and margins.

    A robot on the boundary keeps clear as far as the region asks; its true collision
    probability there is what the region in fact allows. Areas are those of the enlarged
    regions over the exact sum of content ellipse and disc of the same tail.

    Attributes
    ----------
    cases : deviation along x, deviation along y, margin r + r_d, all in m.
    """

    cases: tuple[tuple[float, float, float], ...] = (
        *((1.0, 0.5, 1.5), (1.0, 0.1, 1.5)),
        *((0.3, 0.1, 1.5), (3.0, 1.0, 1.5)),
    )

    claim: ClassVar[str] = (
        "The regions are conservative: on their boundary the collision probability is below 1 - p."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def validate(self) -> None:
        """Refuse no case, and lengths below 0."""
        if not self.cases:
            raise WideberthError("cases is empty; name at least one")
        for first, second, margin in self.cases:
            positive("deviations", first, zero=True)
            positive("deviations", second, zero=True)
            positive("margin", margin, zero=True)

    def axes(self) -> Axes:
        """Each case with each region."""
        return {
            "case": range(len(self.cases)),
            "region": family(self.regions, self.registered),
        }

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

    def pictures(self, result: Result) -> Pictures:
        """Draw one panel per case: from the smallest to the largest risk, one row per region."""
        yield "boundary_risk", _draw(result.rows, self.tail)

    def quick(self) -> Self:
        """Keep the first two cases and three regions."""
        return reduced(self.three(), cases=2)


def _draw(rows: list[Row], tail: float) -> Any:
    """Draw a panel per case."""
    regions, cases = _by_area(rows), sorted({row["case"] for row in rows})
    size = (PAGE, 1.2 + 0.17 * len(regions))
    figure, panels = subplots(1, len(cases), figsize=size, sharey=True, squeeze=False)
    for panel, case in zip(panels[0], cases, strict=True):
        own = {row["region"]: row for row in rows if row["case"] == case}
        _panel(panel, [own[name] for name in regions], tail)
    panels[0][0].set_yticks(range(len(regions)), [title(name) for name in regions])
    panels[0][0].set_ylim(len(regions) - 0.4, -0.6)
    _legend(figure, tail)
    return figure


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
    panel.set(xscale="log", xlim=(0.5 * SMALLEST, 2.0), xticks=[1e-6, 1e-4, 1e-2, 1.0])
    panel.minorticks_off()
    first, second, margin = (float(rows[0][key]) for key in ("sigma_x_m", "sigma_y_m", "margin_m"))
    panel.text(1.02, 1.02, "area", fontsize=6, transform=panel.transAxes)
    panel.set_xlabel("collision probability")
    panel.set_title(
        rf"$\sigma$ = ({first:g}, {second:g}) m," + "\n" + rf"$\rho$ = {margin:g} m", fontsize=7
    )


def _legend(figure: Any, tail: float) -> None:
    look: dict[str, Any] = {"marker": "o", "markersize": 3.6, "linestyle": "-", "linewidth": 2.2}
    below, above = f"boundary, at most {number(tail)}", f"boundary, above {number(tail)} in part"
    entries = [
        entry(below, color=COLOURS[1], **look),
        entry(above, color=COLOURS[2], markerfacecolor="white", **look),
        entry("mean over the length", color="black", marker="|"),
        entry("area: region over exact sum"),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
