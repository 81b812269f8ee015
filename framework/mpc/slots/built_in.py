"""The kinds of things that every planner keeps clear of."""

from ...region import Region
from ...static_region import StaticRegion
from .base import SlotKind
from .gaussian_discs import GaussianDiscs
from .static_polygons import StaticPolygons


def built_in(region: Region, static_region: StaticRegion | None = None) -> tuple[SlotKind, ...]:
    """Return the built-in kinds in the order in which problems hold them.

    Parameters
    ----------
    region : keeps clear of forecast obstacles.
    static_region : keeps clear of observed polygons; None where none may be observed.
    """
    return GaussianDiscs(region), StaticPolygons(static_region)
