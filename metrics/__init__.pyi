# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .episode import clearance as clearance
from .episode import path_length as path_length
from .scoring import covered as covered
from .scoring import displacement as displacement
from .scoring import reached_tail as reached_tail
__all__ = ['clearance', 'covered', 'displacement', 'path_length', 'reached_tail']
