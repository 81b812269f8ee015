# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .kf_hungarian import KfHungarian as KfHungarian
from .nearest import Nearest as Nearest
from .obstacle_tracker import ObstacleTracker as ObstacleTracker
__all__ = ['KfHungarian', 'Nearest', 'ObstacleTracker']
BUILT_IN: dict[str, str]
