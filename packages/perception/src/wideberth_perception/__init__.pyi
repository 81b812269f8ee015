# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .detection.groups import by_gap as by_gap
from .detection.hits import hits_of as hits_of
from .detector import Detector as Detector
from .observed_state import own_state as own_state
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
from .state_estimator import StateEstimator as StateEstimator
from .testing.detector import check_detector as check_detector
from .testing.state_estimator import check_state_estimator as check_state_estimator
from .testing.tracker import check_tracker as check_tracker
from .tracker import Tracker as Tracker
from .tracking_scores import gospa as gospa
from .tracking_scores import track_scores as track_scores
__all__ = ['Detector', 'InertialUnit', 'LARGE', 'Lidar', 'PhysicalPerson', 'PhysicalRobot', 'PhysicalScene', 'PhysicsWorld', 'SkidSteerBody', 'StateEstimator', 'Tracker', 'WheelEncoders', 'by_gap', 'check_detector', 'check_state_estimator', 'check_tracker', 'film', 'gospa', 'hits_of', 'own_state', 'slip_of', 'track_scores']
