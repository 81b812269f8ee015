"""The kinds of things that every planner keeps clear of."""

from ...region import Region
from ...static_region import StaticRegion
from .base import SlotKind
from .gaussian_discs import GaussianDiscs
from .static_polygons import StaticPolygons
from .ways import DiscsAndWays, Ways


def built_in(
    region: Region, static_region: StaticRegion | None = None, ways: Ways | None = None
) -> tuple[SlotKind, ...]:
    """Return the built-in kinds in the order in which problems hold them.

    Parameters
    ----------
    region : keeps clear of forecast obstacles.
    static_region : keeps clear of observed polygons; None where none may be observed.
    ways : of the obstacles, which are kept free as well; None where they are not.
    """
    discs = GaussianDiscs(region) if ways is None else DiscsAndWays(region, ways)
    return discs, StaticPolygons(static_region)
