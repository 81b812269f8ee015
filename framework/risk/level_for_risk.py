"""The level at which a region keeps an asked collision risk."""

from ..plugins.registry import load, names
from ..region import Guarantee, Region, RiskLevel
from ..values.arrays import probability
from ..values.errors import WideberthError


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


def _guaranteed() -> list[str]:
    """Names of registered regions with a guarantee; broken plug-ins are skipped."""
    found = []
    for name in names("regions"):
        try:
            kind = load("regions", name)
        except WideberthError:
            continue
        if kind.guarantee is not Guarantee.NONE:
            found.append(name)
    return found
