"""Detectors: one file per method, each finds bodies in the scan of a LiDAR.

`outside_map` and `over_time` wrap another detector and keep what stands still away from it.
"""

from wideberth.framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "chords": "wideberth_perception.detection.chords:Chords",
    "discs": "wideberth_perception.detection.discs:DiscDetector",
    "outside_map": "wideberth_perception.detection.outside_map:OutsideMap",
    "over_time": "wideberth_perception.detection.over_time:OverTime",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
