# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .detection.groups import by_gap as by_gap
from .detection.hits import hits_of as hits_of
from .observed_state import own_state as own_state
__all__ = ['by_gap', 'hits_of', 'own_state']
