"""Wide berth: robot motion planning around moving obstacles with uncertain futures.

What a version promises to keep stands in docs/promise.md; what is not listed there may change.
"""

from importlib import import_module

__version__ = "1.0.0rc1"

_NAMES = {
    "wideberth.framework": """
        Adaptive Command Controller Costmap Detection Discs Fittable Forecast GaussianObstacle
        Identities Observation OccupancyGrid Outline Path Plan Polygon Pose Predictor Region Robot
        Route RoutePlanner Scene StaticRegion Tracks Twist WideberthError Windows build
        cut_windows load load_plugin names recommended register resampled_tracks save_plugin
        walls_around walls_of_segments walls_of_shapes
    """,
    "wideberth.routes.inflation": "Inflation",
    "wideberth.routes.polygons": "convex_polygons grid_of_polygons",
    "wideberth.routes.rerouting": "Rerouting",
    "wideberth.experiments": "open_result run",
}
"""Module -> its names that are public here, which are imported on first use."""
_ROOMS = """
    controllers draw experiments framework metrics people predictors regions robots
    routes simulation solvers
"""

# The name is whole: relative imports would make a second copy of the package when pytest imports
# the checkout folder itself.
__getattr__, __dir__, __all__ = import_module("wideberth.framework.plugins.lazy").lazy(
    "wideberth",
    [
        *(f"{module}:{name}" for module, names in _NAMES.items() for name in names.split()),
        *(f"wideberth.{room}" for room in _ROOMS.split()),
    ],
)
