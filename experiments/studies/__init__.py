"""Studies: one file per question, with its figure."""

from ...framework.plugins.lazy import lazy

_HERE = "wideberth.experiments.studies"

BUILT_IN: dict[str, str] = {
    "comparison": f"{_HERE}.comparison:Comparison",
    "encounter": f"{_HERE}.encounter:Encounter",
    "replay": f"{_HERE}.replay:Replay",
    "approximation_error": f"{_HERE}.approximation_error:ApproximationError",
    "ellipse_construction": f"{_HERE}.ellipse_construction:EllipseConstruction",
    "forecast_regions": f"{_HERE}.forecast_regions:ForecastRegions",
    "region_gallery": f"{_HERE}.region_gallery:RegionGallery",
    "convex_certificates": f"{_HERE}.convex_certificates:ConvexCertificates",
    "prediction_benchmark": f"{_HERE}.prediction_benchmark:PredictionBenchmark",
    "planner_parts": f"{_HERE}.planner_parts:PlannerParts",
    "tuning": f"{_HERE}.tuning:Tuning",
    "known_futures": f"{_HERE}.known_futures:KnownFutures",
    "guarantees": f"{_HERE}.guarantees:Guarantees",
    "reacting_calibration": f"{_HERE}.reacting_calibration:ReactingCalibration",
    "first_sight": f"{_HERE}.first_sight:FirstSight",
}
"""Name of a study -> where its class is."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
