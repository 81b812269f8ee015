# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .calibration import check_calibration as check_calibration
from .controller import check_controller as check_controller
from .cost import check_cost as check_cost
from .laws import CHECKS as CHECKS
from .laws import Law as Law
from .laws import laws_of as laws_of
from .level import check_level as check_level
from .predictor import check_predictor as check_predictor
from .region import check_region as check_region
from .robot import check_robot as check_robot
from .route_planner import check_route_planner as check_route_planner
from .slot_kind import check_slot_kind as check_slot_kind
from .solver import check_solver as check_solver
from .static_region import check_static_region as check_static_region
from ...simulation.scenarios.checking import check_scenario as check_scenario
__all__ = ['CHECKS', 'Law', 'check_calibration', 'check_controller', 'check_cost', 'check_level', 'check_predictor', 'check_region', 'check_robot', 'check_route_planner', 'check_scenario', 'check_slot_kind', 'check_solver', 'check_static_region', 'laws_of']
