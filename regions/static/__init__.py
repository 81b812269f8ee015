"""Static regions: constraints that keep a robot clear of fixed polygons. One file per method."""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "dual": "wideberth.regions.static.dual:Dual",
    "separating_line": "wideberth.regions.static.separating_line:StaticSeparatingLine",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
