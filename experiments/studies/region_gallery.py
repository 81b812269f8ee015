"""Every region around one Gaussian, side by side."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from textwrap import fill
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import GaussianObstacle, Region, WideberthError, build, load, names
from ...framework.values.arrays import Array, positive, probability
from ...metrics.region_risk import measure
from ...regions.minkowski_sum import MinkowskiSum
from ..drawing.plotting import COLOURS, PAGE, entry, number, subplots, title
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, rounded

ACROSS = 5
"""Panels in one line of the figure."""

SHADES = ((3, "0.92"), (2, "0.84"), (1, "0.74"))
"""Standard deviations and the grey of the ellipse up to there."""

COLUMNS = (
    "region", "area_ratio", "risk_min", "risk_max", "clearance_lost", "relation", "guarantee",
    "remark",
)  # fmt: skip


FIELDS = (
    "level", "promised_tail", "tail", "risk_min", "risk_max", "risk_mean", "area", "area_ratio",
    "clearance_lost", "gap_min", "gap_max", "gap_mean", "effective_level", "relation",
    "guarantee",
)  # fmt: skip
"""Columns of `reading`."""

_LENGTHS = ("clearance_lost", "gap_min", "gap_max", "gap_mean")
"""Differences of lengths in m, known to about 1e-12 m."""


def check_regions(given: Mapping[str, Region], registered: bool, tail: float) -> None:
    """Refuse a study without a region, and a tail that is no probability."""
    probability("tail", tail)
    if not (given or registered):
        raise WideberthError("regions is empty; name one, or set registered to true")


def region_names(given: Mapping[str, Region], registered: bool, kind: type = Region) -> list[str]:
    """Return the given regions, then the registered ones of a kind that none is named after."""
    found = list(given)
    for name in names("regions") if registered else ():
        one: Any = load("regions", name)
        if name not in given and issubclass(one, kind) and 2 in one.dimensions:
            found.append(name)
    return found


def region_of(given: Mapping[str, Region], name: str) -> Region:
    """Return the given region of this name, or the registered one with its defaults.

    Raises
    ------
    WideberthError : no such region, or one that cannot be built without settings.
    """
    region: Region = given[name] if name in given else build("regions", name)
    return region


@final
@dataclass(frozen=True)
class RegionGallery(GridStudy):
    """Every region at level(tail) around one Gaussian, with what the risk meter reads there.

    Areas are those of the enlarged regions over the exact sum of content ellipse and disc of
    the same tail; the risk is the true collision probability of a robot on the boundary. A
    region that is not defined for this Gaussian is listed with the reason.

    Attributes
    ----------
    regions : by name.
    registered : measure every other registered region of two coordinates too.
    tail : 1 - content, or the asked risk where a region's level stands for a risk.
    deviations : m, of the two coordinates.
    correlation : of the two coordinates, within [-0.99, 0.99].
    margin : m, r + r_d.
    """

    regions: Mapping[str, Region] = field(default_factory=dict)
    registered: bool = True
    tail: float = 0.05
    deviations: tuple[float, float] = (1.0, 0.5)
    correlation: float = 0.8
    margin: float = 0.75

    claim: ClassVar[str] = (
        "How the regions of one content differ: their shape, their area, and the largest "
        "collision probability on their boundary."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    def __post_init__(self) -> None:
        check_regions(self.regions, self.registered, self.tail)
        positive("margin", self.margin, zero=True)
        for deviation in self.deviations:
            positive("deviations", deviation, zero=True)
        if not abs(self.correlation) <= 0.99:
            raise WideberthError(
                f"correlation is {self.correlation}; wanted a number within [-0.99, 0.99]"
            )

    def axes(self) -> Axes:
        """Each given region, then every registered one that no given one is named after."""
        return {"region": region_names(self.regions, self.registered)}

    def measure(self, task: Task) -> TaskOutcome:
        """Read the meter, and keep the outline beside the exact sum's."""
        name = str(task.settings["region"])
        obstacle = GaussianObstacle(np.zeros(2), self._covariance())
        try:
            region = region_of(self.regions, name)
            level = region.level(self.tail)
            row = {"region": name, **reading(region, obstacle, self.margin, level)}
        except WideberthError as error:
            empty = dict.fromkeys(FIELDS)
            return TaskOutcome([{"region": name, **empty, "remark": str(error)}])
        exact = MinkowskiSum()
        outlines = {
            "region": _outline(region, obstacle, self.margin, level),
            "exact": _outline(exact, obstacle, self.margin, exact.level(self.tail)),
        }
        files = {f"{name}.json": json.dumps(outlines).encode()}
        return TaskOutcome([row | {"remark": ""}], files=files)

    def summary(self, rows: list[Row]) -> list[Row]:
        """Area, risk, clearance and promise per region, from the smallest to the largest."""
        return [{column: row[column] for column in COLUMNS} for row in _by_area(rows)]

    def pictures(self, result: Result) -> Pictures:
        """Draw one panel per region, on the same scale; what is not defined is listed below."""
        rows = _by_area(result.rows)
        shown = [row for row in rows if not row["remark"]]
        curves = [json.loads(result.read(f"{row['region']}.json")) for row in shown]
        missing = _missing([row for row in rows if row["remark"]])
        yield "region_gallery", _draw(shown, curves, missing, self._covariance(), self.tail)

    def quick(self) -> Self:
        """Keep the first three of the given regions, if any is given."""
        chosen = dict(list(self.regions.items())[:3])
        return replace(self, regions=chosen, registered=self.registered and not chosen)

    def _covariance(self) -> Array:
        first, second = self.deviations
        cross = self.correlation * first * second
        return np.array([[first**2, cross], [cross, second**2]])


def reading(region: Region, obstacle: GaussianObstacle, margin: float, level: float) -> Row:
    """Read the risk meter into a line of a table, with what the region declares of itself.

    Raises
    ------
    WideberthError : the region is not defined here; see `metrics.region_risk.measure`.
    """
    report = measure(region, obstacle, margin, level)
    values = {key: rounded(value, key in _LENGTHS) for key, value in asdict(report).items()}
    return {
        **values,
        "effective_level": rounded(report.effective_level),
        "relation": str(region.relation),
        "guarantee": str(region.guarantee),
    }


def exceeds(row: Row, tail: float) -> bool:
    """Whether the risk exceeds the tail, but for rounding: a risk contour has it everywhere."""
    return float(row["risk_max"]) > tail * (1 + 1e-6)


def _outline(
    region: Region, obstacle: GaussianObstacle, margin: float, level: float
) -> list[list[float]]:
    parameters = region.parameters(obstacle, np.asarray(margin))
    edge: list[list[float]] = region.boundary(parameters, level, 361).round(9).tolist()
    return edge


def _by_area(rows: list[Row]) -> list[Row]:
    """From the smallest to the largest region; those not defined last."""
    return sorted(rows, key=lambda row: np.inf if row["remark"] else float(row["area_ratio"]))


def _draw(
    rows: list[Row], curves: list[dict[str, Any]], missing: str, covariance: Array, tail: float
) -> Any:
    """Draw one panel per region, and say below which are missing."""
    across = min(ACROSS, max(len(rows), 1))
    lines = -(-max(len(rows), 1) // across)
    height = 0.5 + PAGE / (across + 0.5) * _flatness(curves)  # of one panel, title too
    size = (PAGE, 0.7 + height * lines + 0.12 * (missing.count("\n") + bool(missing)))
    figure, panels = subplots(lines, across, figsize=size, sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(rows) :]:
        panel.set_axis_off()
    for panel, row, curve in zip(panels.flat, rows, curves, strict=False):
        _panel(panel, row, curve, covariance, tail)
    for panel in panels[:, 0]:
        panel.set_ylabel("y (m)")
    for panel in panels.flat[max(len(rows) - across, 0) : len(rows)]:
        panel.set_xlabel("x (m)")
        panel.tick_params(labelbottom=True)
    _legend(figure, tail)
    if missing:
        figure.supxlabel(missing, fontsize=6, x=0.01, ha="left")
    return figure


def _missing(rows: list[Row]) -> str:
    """Name the regions that are not defined here, each with the reason, in lines."""
    notes = [f"Not defined here: {title(row['region'])} ({row['remark']})." for row in rows]
    return "\n".join(fill(note, 135) for note in notes)


def _flatness(curves: list[dict[str, Any]]) -> float:
    """Height over width of the common frame of all outlines."""
    points = np.concatenate([curve[name] for curve in curves for name in curve] or [np.eye(2)])
    width, height = np.ptp(points, axis=0)
    return float(np.clip(height / width, 0.3, 2.0)) if width else 2.0


def _panel(panel: Any, row: Row, curves: dict[str, Any], covariance: Array, tail: float) -> None:
    """Draw one region over the Gaussian and the exact sum."""
    values, vectors = np.linalg.eigh(covariance)
    around = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = np.stack([np.cos(around), np.sin(around)])
    for count, shade in SHADES:
        x, y = vectors @ (count * np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
        panel.fill(x, y, color=shade, linewidth=0.0)
    above = exceeds(row, tail)
    for name, colour, style, width in (
        ("region", COLOURS[2] if above else COLOURS[1], "-", 1.6),
        ("exact", "black", (0, (3, 2)), 0.8),
    ):
        closed = np.array([*curves[name], curves[name][0]])
        panel.plot(closed[:, 0], closed[:, 1], color=colour, linestyle=style, linewidth=width)
    panel.set_aspect("equal")
    panel.grid(False)
    sign = "> tail" if above else "≤ tail"
    panel.set_title(title(row["region"]), fontsize=6.6, fontweight="bold", pad=18)
    panel.text(
        0.5, 1.04, f"area {float(row['area_ratio']):.2f}, risk "
        f"{number(100 * float(row['risk_max']), '.2g')} % {sign}\nguarantee: {row['guarantee']}",
        transform=panel.transAxes, ha="center", fontsize=5.6,
    )  # fmt: skip


def _legend(figure: Any, tail: float) -> None:
    from matplotlib.patches import Patch

    entries = [
        entry(f"region, risk at most {number(tail)}", color=COLOURS[1], linestyle="-"),
        entry(f"region, risk above {number(tail)}", color=COLOURS[2], linestyle="-"),
        entry("exact sum", color="black", linestyle=(0, (3, 2)), linewidth=0.8),
        *(Patch(color=shade, label=rf"{count} $\sigma$") for count, shade in SHADES[::-1]),
    ]
    figure.legend(handles=entries, loc="outside upper center", ncols=len(entries))
