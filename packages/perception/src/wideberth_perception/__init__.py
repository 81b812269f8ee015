"""Perception: what a robot concludes from its sensors, one group of files per question."""

from wideberth.framework.plugins.lazy import lazy

_NAMES = {
    "detection.groups": "by_gap",
    "detection.hits": "hits_of",
    "detector": "Detector",
    "observed_state": "own_state",
    "physics.body": "LARGE SkidSteerBody",
    "physics.film": "film",
    "physics.scene": "PhysicalPerson PhysicalRobot PhysicalScene",
    "physics.sensors": "InertialUnit Lidar WheelEncoders",
    "physics.slip": "slip_of",
    "physics.world": "PhysicsWorld",
    "state_estimator": "StateEstimator",
    "testing.detector": "check_detector",
    "testing.state_estimator": "check_state_estimator",
    "testing.tracker": "check_tracker",
    "tracker": "Tracker",
    "tracking_scores": "gospa track_scores",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
