# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .crowds.base import Crowd as Crowd
from .engine.agents import RobotAgent as RobotAgent
from .engine.agents import ScriptedAgent as ScriptedAgent
from .engine.episode import run_episode as run_episode
from .engine.settings import Settings as Settings
from .log.episode_log import Episode as Episode
from .scenarios.base import Placement as Placement
from .scenarios.base import Range as Range
from .scenarios.base import Scenario as Scenario
from .scenarios.base import checked_range as checked_range
from .scenarios.base import draw_value as draw_value
from .scenarios.placing import draw_place as draw_place
__all__ = ['Crowd', 'Episode', 'Placement', 'Range', 'RobotAgent', 'Scenario', 'ScriptedAgent', 'Settings', 'checked_range', 'draw_place', 'draw_value', 'run_episode']
