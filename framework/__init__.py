"""What everything plugs into: values, interfaces, registry, config; imports no other room."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .config import build as build
    from .config import describe as describe
    from .config import read_config as read_config
    from .controller import Controller as Controller
    from .errors import WideberthError as WideberthError
    from .footprint import Discs as Discs
    from .footprint import Outline as Outline
    from .forecast import Forecast as Forecast
    from .forecast import GaussianObstacle as GaussianObstacle
    from .forecast import Scene as Scene
    from .motion import Command as Command
    from .motion import Detection as Detection
    from .motion import Observation as Observation
    from .motion import Pose as Pose
    from .motion import Twist as Twist
    from .path import Path as Path
    from .plan import Plan as Plan
    from .polygon import Polygon as Polygon
    from .predictor import Adaptive as Adaptive
    from .predictor import Fittable as Fittable
    from .predictor import Predictor as Predictor
    from .region import Region as Region
    from .registry import load as load
    from .registry import names as names
    from .registry import register as register
    from .resampling import resampled_tracks as resampled_tracks
    from .robot import Robot as Robot
    from .saved import load_plugin as load_plugin
    from .saved import save_plugin as save_plugin
    from .static_region import StaticRegion as StaticRegion
    from .tracks import Tracks as Tracks
    from .windows import Windows as Windows
    from .windows import cut_windows as cut_windows

_HOME = {
    "build": "config", "describe": "config", "read_config": "config",
    "Controller": "controller", "WideberthError": "errors",
    "Discs": "footprint", "Outline": "footprint",
    "Forecast": "forecast", "GaussianObstacle": "forecast", "Scene": "forecast",
    "Command": "motion", "Detection": "motion", "Observation": "motion", "Pose": "motion",
    "Twist": "motion",
    "Path": "path", "Plan": "plan", "Polygon": "polygon",
    "Adaptive": "predictor", "Fittable": "predictor", "Predictor": "predictor",
    "Region": "region",
    "load": "registry", "names": "registry", "register": "registry",
    "resampled_tracks": "resampling", "Robot": "robot",
    "load_plugin": "saved", "save_plugin": "saved",
    "StaticRegion": "static_region", "Tracks": "tracks",
    "Windows": "windows", "cut_windows": "windows",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import public names on first use."""
    if name in _HOME:
        return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return sorted(_HOME)
