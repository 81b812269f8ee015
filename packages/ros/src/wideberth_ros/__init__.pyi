# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .bag import Bag as Bag
from .bag import read_bag as read_bag
from .forecast_node import ForecastSettings as ForecastSettings
from .node_settings import NodeSettings as NodeSettings
__all__ = ['Bag', 'ForecastSettings', 'NodeSettings', 'read_bag']
