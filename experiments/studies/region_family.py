"""All regions side by side: which there are, what they are called, how their numbers are kept."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Self, final

from ...framework import GaussianObstacle, Region, WideberthError, build, load, names
from ...framework.values.arrays import probability
from ...metrics.region_risk import measure
from .grid import GridStudy, Row

FIELDS = (
    "level", "promised_tail", "tail", "risk_min", "risk_max", "risk_mean", "area", "area_ratio",
    "clearance_lost", "gap_min", "gap_max", "gap_mean", "effective_level", "relation",
    "guarantee",
)  # fmt: skip
"""Columns of `reading`."""

_LENGTHS = ("clearance_lost", "gap_min", "gap_max", "gap_mean")
"""Differences of lengths in m, known to about 1e-12 m."""


@dataclass(frozen=True)
class RegionStudy(GridStudy):
    """Regions beside each other, each at the level of one tail.

    Parameters
    ----------
    regions : by name.
    registered : measure every other registered region of two coordinates too.
    tail : 1 - content, or the asked risk where a region's level stands for a risk.
    """

    regions: Mapping[str, Region] = field(default_factory=dict)
    registered: bool = True
    tail: float = 0.05

    @final
    def __post_init__(self) -> None:
        probability("tail", self.tail)
        if not (self.regions or self.registered):
            raise WideberthError("regions is empty; name one, or set registered to true")
        self.validate()

    def validate(self) -> None:
        """Refuse settings that make no study; those of all studies of regions are checked."""
        return

    @final
    def three(self) -> Self:
        """Return a copy with the first three of the given regions alone, if any is given."""
        chosen = dict(list(self.regions.items())[:3])
        return replace(self, regions=chosen, registered=self.registered and not chosen)


def family(given: Mapping[str, Region], registered: bool, dimension: int = 2) -> list[str]:
    """Names of the regions to compare: the given ones, then the registered ones.

    A registered region that a given one is named after stands for that one alone, and one of
    other dimensions is left out.
    """
    found = list(given)
    if registered:
        others = [name for name in names("regions") if name not in found]
        found += [name for name in others if dimension in load("regions", name).dimensions]
    return found


def member(given: Mapping[str, Region], name: str) -> Region:
    """Return the given region of this name, or the registered one with its defaults.

    Raises
    ------
    WideberthError : no such region, or one that cannot be built without settings.
    """
    region: Region = given[name] if name in given else build("regions", name)
    return region


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


def rounded(value: float, length: bool = False) -> float:
    """Round what differs between processors: to nine digits, lengths to 1e-9 m."""
    if length:
        return round(value, 9) + 0.0
    return 0.0 if abs(value) <= 1e-12 else float(f"{value:.9g}")  # NaN stays
