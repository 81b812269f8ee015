"""Detectors: one file per method, each finds bodies in the scan of a LiDAR.

`outside_map` and `over_time` wrap another detector and keep what stands still away from it.
"""

from ...framework.plugins.lazy import lazy

BUILT_IN: dict[str, str] = {
    "chords": "wideberth.perception.detection.chords:Chords",
    "discs": "wideberth.perception.detection.discs:DiscDetector",
    "outside_map": "wideberth.perception.detection.outside_map:OutsideMap",
    "over_time": "wideberth.perception.detection.over_time:OverTime",
}
"""Name -> where the class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
