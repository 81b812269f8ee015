"""Kinds of things that a plan keeps clear of, one file each."""

from ...plugins.lazy import lazy

BUILT_IN = {
    "drawn_futures": "wideberth.framework.mpc.slots.drawn_futures:DrawnFutures",
    "between_steps": "wideberth.framework.mpc.slots.between_steps:BetweenSteps",
    "ways": "wideberth.framework.mpc.slots.ways:Ways",
}
"""What a config may add: every planner has `GaussianDiscs` and `StaticPolygons`."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
