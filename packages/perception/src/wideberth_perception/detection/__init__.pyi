# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .chords import Chords as Chords
from .discs import DiscDetector as DiscDetector
from .outside_map import OutsideMap as OutsideMap
from .over_time import OverTime as OverTime
__all__ = ['Chords', 'DiscDetector', 'OutsideMap', 'OverTime']
BUILT_IN: dict[str, str]
