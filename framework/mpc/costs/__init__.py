"""Costs: what a plan is paid for, on pose, twist and acceleration."""

from ...plugins.lazy import lazy

BUILT_IN = {
    "contouring": "wideberth.framework.mpc.costs.contouring:Contouring",
    "smooth_tracking": "wideberth.framework.mpc.costs.smooth_tracking:SmoothTracking",
    "tracking": "wideberth.framework.mpc.costs.tracking:Tracking",
}

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
