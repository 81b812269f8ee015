# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .navfn import NavFn as NavFn
from .smoothed import Smoothed as Smoothed
__all__ = ['NavFn', 'Smoothed']
BUILT_IN: dict[str, str]
