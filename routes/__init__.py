"""Global route planners on costmaps, and maps of cells as files and polygons. One file each."""

from ..framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "navfn": "wideberth.routes.navfn:NavFn",
    "smoothed": "wideberth.routes.smoothed:SmoothedRoutes",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
