"""One file per question asked of the other rooms, its configs, and the command line."""

BUILT_IN: dict[str, str] = {
    "dynamic_matters": "wideberth.experiments.dynamic_matters:DynamicMatters",
    "comparison": "wideberth.experiments.comparison:Comparison",
    "closed_loop_risk": "wideberth.experiments.closed_loop_risk:ClosedLoopRisk",
    "conservativeness": "wideberth.experiments.conservativeness:Conservativeness",
    "encounter": "wideberth.experiments.encounter:Encounter",
    "flight": "wideberth.experiments.flight:Flight",
    "replay": "wideberth.experiments.replay:Replay",
    "approximation_error": "wideberth.experiments.approximation_error:ApproximationError",
    "boundary_risk": "wideberth.experiments.boundary_risk:BoundaryRisk",
    "ellipse_construction": "wideberth.experiments.ellipse_construction:EllipseConstruction",
    "forecast_regions": "wideberth.experiments.forecast_regions:ForecastRegions",
    "region_gallery": "wideberth.experiments.region_gallery:RegionGallery",
    "prediction_benchmark": "wideberth.experiments.prediction_benchmark:PredictionBenchmark",
    "planner_parts": "wideberth.experiments.planner_parts:PlannerParts",
    "region_price": "wideberth.experiments.region_price:RegionPrice",
    "tuning": "wideberth.experiments.tuning:Tuning",
    "cost_comparison": "wideberth.experiments.cost_comparison:CostComparison",
    "level_policies": "wideberth.experiments.level_policies:LevelPolicies",
}
"""Name of an experiment -> where its class is."""
