"""What everything plugs into: values, interfaces, registry, config; imports no other room."""

from .plugins.lazy import lazy

_NAMES = {
    "plugins.config": "build describe load_plugin read_config save_plugin",
    "controller": "Controller",
    "mpc.planner.recommended": "recommended",
    "values.costmap": "Costmap",
    "values.errors": "WideberthError",
    "values.footprint": "Discs Outline",
    "values.forecast": "Forecast GaussianObstacle Scene",
    "values.motion": "Command Detection Observation Pose Twist",
    "values.occupancy_grid": "OccupancyGrid",
    "values.path": "Path",
    "values.plan": "Plan",
    "values.polygon": "Polygon",
    "values.walls": "walls_around walls_of_segments walls_of_shapes",
    "predictor": "Adaptive Fittable Predictor",
    "region": "Region",
    "plugins.registry": "load names register",
    "tracking.resampling": "resampled_tracks",
    "robot": "Robot",
    "route_planner": "Route RoutePlanner",
    "static_region": "StaticRegion",
    "values.tracks": "Tracks",
    "tracking.windows": "Windows cut_windows",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(
    __name__,
    [f"{__name__}.{module}:{name}" for module, names in _NAMES.items() for name in names.split()],
)
