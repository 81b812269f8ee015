# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .controller import Controller as Controller
from .mpc.planner.recommended import recommended as recommended
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
from .route_planner import Route as Route
from .route_planner import RoutePlanner as RoutePlanner
from .static_region import StaticRegion as StaticRegion
from .tracking.resampling import resampled_tracks as resampled_tracks
from .tracking.windows import Windows as Windows
from .tracking.windows import cut_windows as cut_windows
from .values.costmap import Costmap as Costmap
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
from .values.occupancy_grid import OccupancyGrid as OccupancyGrid
from .values.path import Path as Path
from .values.plan import Plan as Plan
from .values.polygon import Polygon as Polygon
from .values.tracks import Tracks as Tracks
from .values.walls import walls_around as walls_around
from .values.walls import walls_of_segments as walls_of_segments
from .values.walls import walls_of_shapes as walls_of_shapes
__all__ = ['Adaptive', 'Command', 'Controller', 'Costmap', 'Detection', 'Discs', 'Fittable', 'Forecast', 'GaussianObstacle', 'Observation', 'OccupancyGrid', 'Outline', 'Path', 'Plan', 'Polygon', 'Pose', 'Predictor', 'Region', 'Robot', 'Route', 'RoutePlanner', 'Scene', 'StaticRegion', 'Tracks', 'Twist', 'WideberthError', 'Windows', 'build', 'cut_windows', 'describe', 'load', 'load_plugin', 'names', 'read_config', 'recommended', 'register', 'resampled_tracks', 'save_plugin', 'walls_around', 'walls_of_segments', 'walls_of_shapes']
