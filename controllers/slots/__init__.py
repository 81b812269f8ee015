"""Kinds of things that a plan keeps clear of, beside those of every planner. One file per kind.

Every planner has `GaussianDiscs` and `StaticPolygons` of `wideberth.framework.mpc.slots`.
"""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "between_steps": "wideberth.controllers.slots.between_steps:BetweenSteps",
    "drawn_futures": "wideberth.controllers.slots.drawn_futures:DrawnFutures",
    "ways": "wideberth.controllers.slots.ways:Ways",
}
"""What ``further_kinds`` of a planner may name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
