"""Measures of forecasts, plans and episodes, each defined once."""

from ..framework.plugins.lazy import lazy

_NAMES = {
    "episode": "clearance path_length",
    "scoring": "covered displacement reached_tail",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
