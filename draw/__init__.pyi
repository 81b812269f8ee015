# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .forecasts import forecast as forecast
from .forecasts import region as region
from .maps import grid as grid
from .maps import path as path
from .maps import polygon as polygon
from .plans import plan as plan
from .shapes import ellipses as ellipses
from .style import COLOURS as COLOURS
from .style import paper_style as paper_style
__all__ = ['COLOURS', 'ellipses', 'forecast', 'grid', 'paper_style', 'path', 'plan', 'polygon', 'region']
