# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .contouring import Contouring as Contouring
from .tracking import Tracking as Tracking
__all__ = ['Contouring', 'Tracking']
BUILT_IN: dict[str, str]
