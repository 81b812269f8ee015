"""Trackers: one file per method, each follows obstacles from scan to scan."""

from wideberth.framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "kf_hungarian": "wideberth_perception.tracking.kf_hungarian:KfHungarian",
    "nearest": "wideberth_perception.tracking.nearest:Nearest",
    "obstacle_tracker": "wideberth_perception.tracking.obstacle_tracker:ObstacleTracker",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
