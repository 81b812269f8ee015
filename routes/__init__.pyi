# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .navfn import NavFn as NavFn
from .smoothed import SmoothedRoutes as SmoothedRoutes
__all__ = ['NavFn', 'SmoothedRoutes']
BUILT_IN: dict[str, str]
