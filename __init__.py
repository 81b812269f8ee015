"""Wide berth: robot motion planning around moving obstacles with uncertain futures."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .framework import (  # isort: skip
        Adaptive, Command, Controller, Detection, Discs, Fittable, Forecast,
        GaussianObstacle, Observation, Outline, Path, Plan, Polygon, Pose, Predictor,
        Region, Robot, Scene, StaticRegion, Tracks, Twist, WideberthError, Windows,
        build, cut_windows, load, load_plugin, names, register, resampled_tracks,
        save_plugin,
    )  # fmt: skip

__version__ = "0.1.0"

# Imports stay late: eager ones would make a second copy of the package when pytest imports the
# checkout folder itself, and would cost seconds (statsmodels, cvxpy, JAX) in every script.
__all__ = (
    "Adaptive", "Command", "Controller", "Detection", "Discs", "Fittable", "Forecast",
    "GaussianObstacle", "Observation", "Outline", "Path", "Plan", "Polygon", "Pose", "Predictor",
    "Region", "Robot", "Scene", "StaticRegion", "Tracks", "Twist", "WideberthError", "Windows",
    "build", "cut_windows", "load", "load_plugin", "names", "register", "resampled_tracks",
    "save_plugin",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import public names on first use."""
    if name in __all__:
        return getattr(import_module("wideberth.framework"), name)
    raise AttributeError(f"module 'wideberth' has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return [*__all__, "__version__"]
