"""Formats of other software: messages, recordings and parameter files of ROS 2."""

from wideberth.framework.plugins.lazy import lazy

_NAMES = {
    "bag": "Bag read_bag",
    "forecast_node": "ForecastSettings",
    "node_settings": "NodeSettings",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
