"""What everything plugs into: values, interfaces, registry, config; imports no other room."""

from .plugins.lazy import lazy

_NAMES = {
    "calibration": "Calibration MomentCalibration fewest_ranks largest moments rank_quantile",
    "controller": "Controller DrivesRobot",
    "mpc.costs.base": "Cost",
    "mpc.levels.base": "LevelPolicy Promise level_of",
    "mpc.ocp.bodies": "Body BodyPath bodies body_starts",
    "mpc.ocp.problem": "SlotNumbers Slots",
    "mpc.ocp.stage": "Frame slots_of",
    "wideberth.controllers.recommended": "recommended",
    "mpc.planner.rollout": "steer",
    "mpc.planner.rungs": "FallbackRung NotHeld",
    "mpc.slots.base": """
        KnownObstacles LevelledKind PlanningContext SlotAssignment SlotKind SlotSizes Touch
        active_slots next_capacity
    """,
    "mpc.slots.static_polygons": "deviations",
    "mpc.solver": "Solver on_time refuse_misfits solve_many",
    "plugins.config": "build describe load_plugin read_config save_plugin",
    "plugins.registry": "load names register",
    "predictor": "Adaptive AdaptiveFiltering Filtering Fittable Predictor",
    "region": "Auxiliary Constraint Guarantee Region Relation",
    "risk.collision_probability": "collision_probability",
    "robot": "Bounds Quantity Robot",
    "route_planner": "Route RoutePlanner",
    "static_region": "StaticRegion",
    "testing": """
        check_calibration check_controller check_cost check_level check_predictor
        check_region check_robot check_route_planner check_scenario check_slot_kind check_solver
        check_static_region
    """,
    "tracking.identities": "Identities",
    "values.arrays": "Array BoolArray Scalar",
    "values.beliefs": "Beliefs",
    "values.costmap": "Costmap",
    "values.coverage": "Coverage Event",
    "values.errors": "WideberthError",
    "values.footprint": "Discs Outline",
    "values.forecast": "LIGHT Forecast GaussianObstacle Scene",
    "values.measurements": "Measurements",
    "values.motion": "Command Detection Observation Pose Twist",
    "values.occupancy_grid": "OccupancyGrid",
    "values.path": "Path",
    "values.plan": "Plan Status",
    "values.polygon": "Polygon best_direction separation",
    "values.sensing": "Scan",
    "values.tracks": "Tracks",
    "wideberth.predictors.data.forecast_sets": "read_forecasts write_forecasts",
    "wideberth.predictors.data.recordings": "read_tracks",
    "wideberth.predictors.data.resampled": "resampled_tracks",
    "wideberth.predictors.data.windows": "Windows cut_windows windows_of",
    "wideberth.routes.walls": "box walls_around walls_of_segments walls_of_shapes",
    "wideberth.simulation.sensing.perceived": "InertialSample Sightings WheelSample",
}
"""Module -> its public names, which are imported on first use; whole names are of higher rooms."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
