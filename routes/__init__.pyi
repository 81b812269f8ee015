# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .inflation import Inflation as Inflation
from .map_file import read_map as read_map
from .navfn import NavFn as NavFn
from .polygons import convex_polygons as convex_polygons
from .polygons import grid_of_polygons as grid_of_polygons
from .replanning import Replanning as Replanning
from .rerouting import Rerouting as Rerouting
from .smoothed import SmoothedRoutes as SmoothedRoutes
__all__ = ['Inflation', 'NavFn', 'Replanning', 'Rerouting', 'SmoothedRoutes', 'convex_polygons', 'grid_of_polygons', 'read_map']
BUILT_IN: dict[str, str]
