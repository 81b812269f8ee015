"""Wide berth: robot motion planning around moving obstacles with uncertain futures."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .framework import Adaptive as Adaptive
    from .framework import Command as Command
    from .framework import Controller as Controller
    from .framework import Detection as Detection
    from .framework import Discs as Discs
    from .framework import Fittable as Fittable
    from .framework import Forecast as Forecast
    from .framework import GaussianObstacle as GaussianObstacle
    from .framework import Observation as Observation
    from .framework import Outline as Outline
    from .framework import Path as Path
    from .framework import Plan as Plan
    from .framework import Polygon as Polygon
    from .framework import Pose as Pose
    from .framework import Predictor as Predictor
    from .framework import Region as Region
    from .framework import Robot as Robot
    from .framework import Scene as Scene
    from .framework import StaticRegion as StaticRegion
    from .framework import Tracks as Tracks
    from .framework import Twist as Twist
    from .framework import WideberthError as WideberthError
    from .framework import Windows as Windows
    from .framework import build as build
    from .framework import cut_windows as cut_windows
    from .framework import load as load
    from .framework import load_plugin as load_plugin
    from .framework import names as names
    from .framework import register as register
    from .framework import resampled_tracks as resampled_tracks
    from .framework import save_plugin as save_plugin

__version__ = "0.1.0"

# Imports stay late: eager ones would make a second copy of the package when pytest imports the
# checkout folder itself, and would cost seconds (statsmodels, cvxpy, JAX) in every script.
_PUBLIC = (
    "Adaptive", "Command", "Controller", "Detection", "Discs", "Fittable", "Forecast",
    "GaussianObstacle", "Observation", "Outline", "Path", "Plan", "Polygon", "Pose", "Predictor",
    "Region", "Robot", "Scene", "StaticRegion", "Tracks", "Twist", "WideberthError", "Windows",
    "build", "cut_windows", "load", "load_plugin", "names", "register", "resampled_tracks",
    "save_plugin",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import public names on first use."""
    if name in _PUBLIC:
        return getattr(import_module("wideberth.framework"), name)
    raise AttributeError(f"module 'wideberth' has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return [*_PUBLIC, "__version__"]
