# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .constant_velocity import ConstantVelocityController as ConstantVelocityController
from .dynamic_window import DynamicWindow as DynamicWindow
from .moussaid_force import MoussaidForce as MoussaidForce
from .orca import Orca as Orca
from .policy import Policy as Policy
from .pure_pursuit import PurePursuit as PurePursuit
from .social_force import SocialForceController as SocialForceController
from .withdrawing import Withdrawing as Withdrawing
from ..framework.mpc.planner.planner import Planner as Planner
from ..routes.around_crowds import AroundCrowds as AroundCrowds
__all__ = ['AroundCrowds', 'ConstantVelocityController', 'DynamicWindow', 'MoussaidForce', 'Orca', 'Planner', 'Policy', 'PurePursuit', 'SocialForceController', 'Withdrawing']
BUILT_IN: dict[str, str]
