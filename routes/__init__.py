"""Global route planners on costmaps, and maps of cells as files and polygons. One file each."""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "navfn": "wideberth.routes.navfn:NavFn",
    "smoothed": "wideberth.routes.smoothed:SmoothedRoutes",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(
    __name__,
    [
        *BUILT_IN.values(),
        "wideberth.routes.inflation:Inflation",
        "wideberth.routes.map_file:read_map",
        "wideberth.routes.polygons:convex_polygons",
        "wideberth.routes.polygons:grid_of_polygons",
        "wideberth.routes.replanning:Replanning",
        "wideberth.routes.rerouting:Rerouting",
    ],
)
