"""Costs of a plan's stages beside the paper's. One file per cost."""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "contouring": "wideberth.controllers.costs.contouring:Contouring",
    "smooth_tracking": "wideberth.controllers.costs.smooth_tracking:SmoothTracking",
    "tracking": "wideberth.framework.mpc.costs.tracking:Tracking",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
