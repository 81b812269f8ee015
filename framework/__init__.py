"""What everything plugs into: values, interfaces, registry, config; imports no other room."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .plugins import moved

if TYPE_CHECKING:
    from .controller import Controller as Controller
    from .plugins.config import build as build
    from .plugins.config import describe as describe
    from .plugins.config import load_plugin as load_plugin
    from .plugins.config import read_config as read_config
    from .plugins.config import save_plugin as save_plugin
    from .plugins.registry import load as load
    from .plugins.registry import names as names
    from .plugins.registry import register as register
    from .predictor import Adaptive as Adaptive
    from .predictor import Fittable as Fittable
    from .predictor import Predictor as Predictor
    from .region import Region as Region
    from .robot import Robot as Robot
    from .static_region import StaticRegion as StaticRegion
    from .tracking.resampling import resampled_tracks as resampled_tracks
    from .tracking.windows import Windows as Windows
    from .tracking.windows import cut_windows as cut_windows
    from .values.errors import WideberthError as WideberthError
    from .values.footprint import Discs as Discs
    from .values.footprint import Outline as Outline
    from .values.forecast import Forecast as Forecast
    from .values.forecast import GaussianObstacle as GaussianObstacle
    from .values.forecast import Scene as Scene
    from .values.motion import Command as Command
    from .values.motion import Detection as Detection
    from .values.motion import Observation as Observation
    from .values.motion import Pose as Pose
    from .values.motion import Twist as Twist
    from .values.path import Path as Path
    from .values.plan import Plan as Plan
    from .values.polygon import Polygon as Polygon
    from .values.tracks import Tracks as Tracks

_NAMES = {
    "plugins.config": "build describe load_plugin read_config save_plugin",
    "controller": "Controller",
    "values.errors": "WideberthError",
    "values.footprint": "Discs Outline",
    "values.forecast": "Forecast GaussianObstacle Scene",
    "values.motion": "Command Detection Observation Pose Twist",
    "values.path": "Path",
    "values.plan": "Plan",
    "values.polygon": "Polygon",
    "predictor": "Adaptive Fittable Predictor",
    "region": "Region",
    "plugins.registry": "load names register",
    "tracking.resampling": "resampled_tracks",
    "robot": "Robot",
    "static_region": "StaticRegion",
    "values.tracks": "Tracks",
    "tracking.windows": "Windows cut_windows",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}


moved.install()


def __getattr__(name: str) -> Any:
    """Import public names on first use."""
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(_HOME)
