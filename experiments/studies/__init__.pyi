# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .approximation_error import ApproximationError as ApproximationError
from .comparison import Comparison as Comparison
from .convex_certificates import ConvexCertificates as ConvexCertificates
from .ellipse_construction import EllipseConstruction as EllipseConstruction
from .encounter import Encounter as Encounter
from .first_sight import FirstSight as FirstSight
from .forecast_regions import ForecastRegions as ForecastRegions
from .guarantees import Guarantees as Guarantees
from .known_futures import KnownFutures as KnownFutures
from .planner_parts import PlannerParts as PlannerParts
from .prediction_benchmark import PredictionBenchmark as PredictionBenchmark
from .reacting_calibration import ReactingCalibration as ReactingCalibration
from .region_gallery import RegionGallery as RegionGallery
from .replay import Replay as Replay
from .tuning import Tuning as Tuning
__all__ = ['ApproximationError', 'Comparison', 'ConvexCertificates', 'EllipseConstruction', 'Encounter', 'FirstSight', 'ForecastRegions', 'Guarantees', 'KnownFutures', 'PlannerParts', 'PredictionBenchmark', 'ReactingCalibration', 'RegionGallery', 'Replay', 'Tuning']
BUILT_IN: dict[str, str]
