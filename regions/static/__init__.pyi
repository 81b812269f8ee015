# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .dual import Dual as Dual
from .separating_line import StaticSeparatingLine as StaticSeparatingLine
__all__ = ['Dual', 'StaticSeparatingLine']
BUILT_IN: dict[str, str]
