# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .between_steps import BetweenSteps as BetweenSteps
from .drawn_futures import DrawnFutures as DrawnFutures
from .ways import Ways as Ways
__all__ = ['BetweenSteps', 'DrawnFutures', 'Ways']
BUILT_IN: dict[str, str]
