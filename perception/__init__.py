"""Perception: what a robot concludes from its sensors, one group of files per question."""

from ..framework.plugins.lazy import lazy, targets_in

_NAMES = {
    "detection.groups": "by_gap",
    "detection.hits": "hits_of",
    "observed_state": "own_state",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, targets_in(__name__, _NAMES))
