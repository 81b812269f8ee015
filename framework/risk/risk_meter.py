"""The risk meter: what a region keeps and what it costs, for one obstacle and margin."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from ..numerics.geometry import sum_volume
from ..plugins.registry import load, names
from ..region import Guarantee, Region, RiskLevel
from ..values.arrays import probability
from ..values.errors import WideberthError
from ..values.forecast import GaussianObstacle
from .risk_boundary import outline
from .risk_surface import surface
from .risk_walk import start


@dataclass(frozen=True)
class RiskReport:
    """What a region keeps and costs at one level.

    The content ellipse (3-D: ellipsoid) and the exact sum, with which it is compared, are those
    of the tail that the region promises, ``region.tail(level, D)``.

    Attributes
    ----------
    level : the region's level.
    promised_tail : ``region.tail(level, D)``.
    tail : Pr(obstacle outside the un-enlarged region), measured; 1 where that region is empty,
        nan where it is not defined or the covariance is singular.
    risk_min, risk_max : collision probability along the boundary, refined.
    risk_mean : mean over the boundary's length, in 3-D over its area.
    area, area_ratio : m^2 (3-D: volume, m^3), and over that of the exact sum.
    clearance_lost : m, margin less the smallest distance of a boundary point to the content
        ellipse; at most 0 for a region that encloses the exact sum.
    gap_min, gap_max, gap_mean : m, by how much the region reaches beyond the exact sum along a
        ray from the mean; a negative one lets the robot nearer. The mean is over the directions.
    """

    level: float
    promised_tail: float
    tail: float
    risk_min: float
    risk_max: float
    risk_mean: float
    area: float
    area_ratio: float
    clearance_lost: float
    gap_min: float
    gap_max: float
    gap_mean: float

    @property
    def content(self) -> float:
        """Probability that the un-enlarged region holds the obstacle."""
        return 1.0 - self.tail

    @property
    def effective_level(self) -> float:
        """-Phi^-1(risk_max): the level of the exact sum that guarantees the same risk."""
        return -float(special.ndtri(self.risk_max))


def level_for_risk(region: Region, risk: float, dimension: int = 2) -> float:
    """Level at which the true collision probability outside the region is at most ``risk``.

    The region's own where it has one (the exact sum: Phi^-1(1 - risk)). Any other region with
    a guarantee keeps the risk below the tail of its level, so that level(tail=risk) does.

    Raises
    ------
    WideberthError : the region guarantees nothing, or a risk outside (0, 1).
    """
    probability("risk", risk)
    if region.guarantee is Guarantee.NONE:
        raise WideberthError(
            f"{type(region).__name__} guarantees no collision risk at any level; use one that "
            f"does: {', '.join(_guaranteed()) or 'none is registered'}"
        )
    if isinstance(region, RiskLevel):
        return float(region.level_for_risk(risk))
    return float(region.level(risk, dimension))


def measure(region: Region, obstacle: GaussianObstacle, margin: float, level: float) -> RiskReport:
    """Measure one region around one obstacle.

    In 2-D extremes are taken over at least 721 points and then refined within the neighbours of
    the best by two rounds of a search that narrows the bracket 32 times each. In 3-D they are
    taken over 4096 points and refined around the best; see `framework.risk_surface.surface`.
    There ``risk_mean``, ``gap_mean`` and ``tail`` are quadratures. Against finer ones they were
    within 1e-3 of themselves with deviations within a factor of five, within 2e-2 with ten. A
    hundred times thinner the tail and the gap were within 3e-2 and the mean risk within 5e-2,
    but for a flat box on the world axes (0.25), whose risk all lies along a narrow rim.

    Parameters
    ----------
    region : of the obstacle's dimensions; star-shaped around the mean, as convex ones are.
    obstacle : mean (D,) m and covariance (D, D) m^2; D is 2 or 3.
    margin : m, the radii together.
    level : the region's own.

    Raises
    ------
    WideberthError : other dimensions, more than one obstacle, a level of tail 0, or a region
        that is empty or unbounded at this level.
    """
    walk = start(region, obstacle, margin, level)
    size = len(walk.axes)
    found = outline(walk) if size == 2 else surface(walk)
    coarse, fine = found.coarse, found.fine
    area = float(region.area(walk.parameters, np.asarray(level)))
    exact = float(sum_volume(walk.axes, np.asarray(margin)))
    return RiskReport(
        level=float(level),
        promised_tail=region.tail(level, size),
        tail=found.tail,
        risk_min=float(fine.risk.min()),
        risk_max=float(fine.risk.max()),
        risk_mean=float(found.extent @ coarse.risk),
        area=area,
        area_ratio=area / exact,
        clearance_lost=margin - float(fine.clearance.min()),
        gap_min=float(fine.gap.min()),
        gap_max=float(fine.gap.max()),
        gap_mean=float(found.directions @ coarse.gap),
    )


def _guaranteed() -> list[str]:
    """Names of registered regions with a guarantee; a broken plug-in is passed over."""
    found = []
    for name in names("regions"):
        try:
            kind = load("regions", name)
        except WideberthError:
            continue
        if kind.guarantee is not Guarantee.NONE:
            found.append(name)
    return found
