# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .crowds.base import Crowd as Crowd
from .engine.agents import RobotAgent as RobotAgent
from .engine.agents import ScriptedAgent as ScriptedAgent
from .engine.episode import run_episode as run_episode
from .engine.settings import Settings as Settings
from .log.episode_log import Episode as Episode
from .physics.body import LARGE as LARGE
from .physics.body import SkidSteerBody as SkidSteerBody
from .physics.film import film as film
from .physics.scene import PhysicalPerson as PhysicalPerson
from .physics.scene import PhysicalRobot as PhysicalRobot
from .physics.scene import PhysicalScene as PhysicalScene
from .physics.sensors import InertialUnit as InertialUnit
from .physics.sensors import Lidar as Lidar
from .physics.sensors import WheelEncoders as WheelEncoders
from .physics.slip import slip_of as slip_of
from .physics.world import PhysicsWorld as PhysicsWorld
from .scenarios.base import Placement as Placement
from .scenarios.base import Range as Range
from .scenarios.base import Scenario as Scenario
from .scenarios.base import checked_range as checked_range
from .scenarios.base import draw_value as draw_value
from .scenarios.placing import draw_place as draw_place
__all__ = ['Crowd', 'Episode', 'InertialUnit', 'LARGE', 'Lidar', 'PhysicalPerson', 'PhysicalRobot', 'PhysicalScene', 'PhysicsWorld', 'Placement', 'Range', 'RobotAgent', 'Scenario', 'ScriptedAgent', 'Settings', 'SkidSteerBody', 'WheelEncoders', 'checked_range', 'draw_place', 'draw_value', 'film', 'run_episode', 'slip_of']
