# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .contouring import Contouring as Contouring
from .smooth_tracking import SmoothTracking as SmoothTracking
from ...framework.mpc.costs.tracking import Tracking as Tracking
__all__ = ['Contouring', 'SmoothTracking', 'Tracking']
BUILT_IN: dict[str, str]
