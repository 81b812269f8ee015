"""Nav2's own parameter files, `nav2_params.yaml`, as settings of the loop."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ...framework.plugins.yamlfile import parse, read_config
from ...framework.values.errors import WideberthError, nearest
from .dwb import PATH_LENGTH_TOLERANCE
from .local_costmap import View
from .mppi import MODELS, PLUGIN_OF
from .parameters import at_default, effective, names_of, refuse_unknown
from .recoveries import Recoveries
from .settings import Settings
from .velocity_smoother import VelocitySmoother

PLUGINS = {
    "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController": (
        "regulated_pure_pursuit"
    ),
    "nav2_graceful_controller::GracefulController": "graceful",
    "vector_pursuit_controller::VectorPursuitController": "vector_pursuit",
    "dwb_core::DWBLocalPlanner": "dwb",
    "nav2_mppi_controller::MPPIController": "mppi",
    "teb_local_planner::TebLocalPlannerROS": "teb",
    "nav2_rotation_shim_controller::RotationShimController": "rotation_shim",
}
"""Names of controllers in Nav2's files -> ours."""
PARTS = {
    "nav2_controller::SimpleGoalChecker": "goal_checker",
    "nav2_controller::SimpleProgressChecker": "progress_checker",
    "nav2_controller::FeasiblePathHandler": "path_handler",
}
"""Names of other plug-ins of the controller server -> the settings that they go to."""
_WITHOUT_ROS = frozenset(
    """
    action_server_result_timeout allow_parameter_qos_overrides always_send_full_costmap
    behavior_plugins bond_heartbeat_period bond_timeout controller_plugins costmap_topic
    enable_stamped_cmd_vel filters footprint_topic global_costmap_topic global_footprint_topic
    global_frame goal_checker_plugins initial_transform_timeout introspection_mode
    local_costmap_topic local_footprint_topic local_frame map_topic odom_topic
    path_handler_plugins progress_checker_plugin progress_checker_plugins publish_frequency
    publish_zero_velocity robot_base_frame service_introspection_mode speed_limit_topic
    stamp_smoothed_velocity_with_smoothing_time subscribe_to_stamped_footprint
    transform_tolerance use_realtime_priority use_sim_time
    """.split()
)
"""Parameters of nodes that have no meaning without ROS."""
_OF_PATHS = (
    "prune_distance", "max_robot_pose_search_dist", "enforce_path_inversion",
    "inversion_xy_tolerance", "inversion_yaw_tolerance",
)  # fmt: skip
"""Parameters of the path handler that were the controllers' own before there was one."""
_OF_TEB = {
    "teb_autosize": True, "exact_arc_length": False, "feasibility_check_lookahead_distance": -1.0,
    "max_vel_y": 0.0, "min_turning_radius": 0.0, "cmd_angle_instead_rotvel": False,
    "legacy_obstacle_association": False, "costmap_converter_plugin": "",
    "optimization_activate": True, "obstacle_cost_exponent": 1.0,
    "weight_velocity_obstacle_ratio": 0.0, "simple_exploration": False,
    "selection_alternative_time_cost": False, "switching_blocking_period": 0.0,
    "roadmap_graph_area_length_scale": 1.0, "delete_detours_backwards": True,
    "selection_dropping_probability": 0.0, "divergence_detection_enable": False,
}  # fmt: skip
"""Parameters of TEB that ours has at this value alone, the original's default."""
_OF_TEB_WITHOUT_EFFECT = frozenset(
    """
    acc_lim_y costmap_converter_rate costmap_converter_spin_thread
    divergence_detection_max_chi_squared enable_multithreading footprint_model.line_end
    footprint_model.line_start footprint_model.vertices global_plan_prune_distance
    h_signature_prescaler is_footprint_dynamic
    obstacle_keypoint_offset obstacle_poses_affected obstacle_proximity_lower_bound
    obstacle_proximity_ratio_max_vel obstacle_proximity_upper_bound optimization_verbose
    publish_feedback selection_viapoint_cost_scale shrink_horizon_backup
    shrink_horizon_min_duration via_points_ordered viapoints_all_candidates visualize_hc_graph
    visualize_with_time_as_z_axis_scale weight_acc_lim_y weight_kinematics_turning_radius
    weight_max_vel_y weight_viapoint wheelbase xy_goal_tolerance yaw_goal_tolerance
    """.split()
)
"""Parameters of TEB for other robots, for what the table above switches off, or for pictures."""
_LAYER = frozenset(
    """
    clearing combination_method data_type enabled expected_update_rate footprint_clearing_enabled
    map_subscribe_transient_local mark_threshold marking max_obstacle_height min_obstacle_height
    observation_persistence observation_sources obstacle_min_range origin_z plugin
    publish_voxel_map raytrace_min_range sensor_frame subscribe_to_updates tf_filter_tolerance
    topic transport_type unknown_threshold z_resolution z_voxels
    """.split()
)
"""Parameters of layers that have no effect in the plane."""
_SEEN = frozenset(
    """
    cost_scaling_factor inf_is_valid inflate_around_unknown inflate_unknown inflation_radius
    obstacle_max_range raytrace_max_range
    """.split()
)
"""Parameters of layers that a view has."""


def read_params_file(path: Path | str, controller: str = "FollowPath") -> Settings:
    """Read the settings of the loop from one of Nav2's parameter files.

    Of its sections the controller server, the local costmap, the velocity smoother and the
    behaviour server are read; what they lack has the default of Nav2's code. Names that have no
    meaning without ROS (topics, frames, drawing) are passed over.

    Parameters
    ----------
    path : of the file.
    controller : name of the controller in the file.

    Raises
    ------
    WideberthError : no such file or controller, a plug-in or a name that is not known; the nearest
        known one is named.
    """
    file = Path(path)
    nodes = {name: _section(value) for name, value in read_config(file).items()}
    if "controller_server" not in nodes:
        raise WideberthError(f"{file} has no section controller_server; is it one of Nav2's?")
    settings = _server(nodes["controller_server"], controller)
    costmap = _section(nodes.get("local_costmap", {}).get("local_costmap", {}))
    settings |= _costmap(costmap, "local_costmap")
    for node, kind, name in (
        ("velocity_smoother", VelocitySmoother, "velocity_smoother"),
        ("behavior_server", Recoveries, "recoveries"),
    ):
        given = {
            key: value for key, value in nodes.get(node, {}).items() if key not in _WITHOUT_ROS
        }
        if node == "behavior_server":
            given = {key: value for key, value in given.items() if not isinstance(value, Mapping)}
        refuse_unknown(node, given, names_of(kind))
        settings[name] = given
    return Settings(**settings)


def _section(value: Any) -> dict[str, Any]:
    """Return the parameters of a node."""
    if not isinstance(value, Mapping):
        return {}
    inner = value.get("ros__parameters", value)
    return dict(inner) if isinstance(inner, Mapping) else {}


def _server(given: Mapping[str, Any], controller: str) -> dict[str, Any]:
    """Return the settings of the controller server and its plug-ins."""
    plugins = {
        name: value for name, value in given.items()
        if isinstance(value, Mapping) and "plugin" in value
    }  # fmt: skip
    if controller not in plugins:
        raise WideberthError(
            f"controller_server has no controller {controller!r}{nearest(controller, plugins)} "
            f"Plug-ins there: {', '.join(sorted(plugins)) or 'none'}"
        )
    settings: dict[str, Any] = {"server": {}}
    paths: dict[str, Any] = {}
    tolerance = f"{controller}path_length_tolerance"
    for name, value in plugins.items():
        part = PARTS.get(str(value["plugin"]))
        if part is not None:
            settings[part] = {key: entry for key, entry in value.items() if key != "plugin"}
        elif name == controller:
            more = {PATH_LENGTH_TOLERANCE: given[tolerance]} if tolerance in given else {}
            chosen, paths = _controller({**value, **more})
            settings |= chosen
        elif str(value["plugin"]) not in PLUGINS:
            near = nearest(str(value["plugin"]), [*PLUGINS, *PARTS])
            raise WideberthError(f"{name}.plugin is {value['plugin']!r}, which is not known{near}")
    settings.setdefault("path_handler", paths)  # a handler of the file's own has all of them
    passed = _WITHOUT_ROS | plugins.keys() | {tolerance}
    plain = {key: value for key, value in given.items() if key not in passed}
    settings["controller_frequency"] = float(plain.pop("controller_frequency", 20.0))
    known = [
        "failure_tolerance", "min_x_velocity_threshold", "min_y_velocity_threshold",
        "min_theta_velocity_threshold", "costmap_update_timeout", "controller_frequency",
    ]  # fmt: skip
    refuse_unknown("controller_server", plain, known)
    settings["server"] = plain
    return settings


def _controller(given: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the name and the parameters of a controller, and those of the path handler."""
    plugin = str(given["plugin"])
    if plugin not in PLUGINS:
        hint = f"{nearest(plugin, PLUGINS)} Known: {', '.join(sorted(PLUGINS))}"
        raise WideberthError(f"the controller's plugin is {plugin!r}; there is none such{hint}")
    local = PLUGINS[plugin]
    flat = effective(dict(_flat(given)))
    primary = flat.pop("primary_controller", None)
    if primary is not None:
        if primary not in PLUGINS:
            raise WideberthError(f"primary_controller is {primary!r}{nearest(primary, PLUGINS)}")
        flat["primary_controller"] = PLUGINS[primary]
    inner = flat.get("primary_controller", local)
    paths = _of_paths(flat, inner)
    if inner == "mppi":
        model = str(flat.get("motion_model"))
        if flat.get(f"{model}.plugin", "") == PLUGIN_OF.get(MODELS.get(model, model)):
            flat.pop(f"{model}.plugin")  # it says what the name says
    if inner == "teb":
        flat = _of_teb(flat)
    return {"local": local, "parameters": flat}, paths


def _of_paths(flat: dict[str, Any], controller: str) -> dict[str, Any]:
    """Take what belongs to the path handler out of a controller's parameters.

    DWB once kept ``prune_distance`` behind the robot, where the handler keeps nothing, and
    ``forward_prune_distance`` ahead of it. Vector pursuit prunes by itself, up to a distance of
    its own.
    """
    if controller == "dwb":
        flat.pop("prune_distance", None)
        if "forward_prune_distance" in flat:
            flat["prune_distance"] = flat.pop("forward_prune_distance")
    own = ("max_robot_pose_search_dist",) if controller == "vector_pursuit" else ()
    return {name: flat.pop(name) for name in _OF_PATHS if name in flat and name not in own}


def _of_teb(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return TEB's parameters by the names that its class has.

    Raises
    ------
    WideberthError : a part of the original is switched on that is not offered here.
    """
    found = {key: value for key, value in flat.items() if key not in _OF_TEB_WITHOUT_EFFECT}
    found = at_default("TEB", found, _OF_TEB)
    apart = found.pop("global_plan_viapoint_sep", -1.0)
    if apart > 0.0:
        raise WideberthError(
            f"TEB's global_plan_viapoint_sep is {apart!r}; here it can be at most 0, which is off"
        )
    model = found.pop("footprint_model.type", "point")
    radius = found.pop("footprint_model.radius", 0.0)
    if model not in ("point", "circular"):
        raise WideberthError(
            f"TEB's footprint_model.type is {model!r}; wanted 'point', or 'circular' with a "
            "footprint_model.radius that encloses the robot"
        )
    if model == "circular":
        found["robot_radius"] = float(radius)
    return found


def _flat(given: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    """Yield dotted names and values."""
    for key, value in given.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}.{inner}", entry) for inner, entry in _flat(value))
        else:
            yield key, value


def _costmap(given: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return the view and the robot's outline of a costmap."""
    view: dict[str, Any] = {"inflation_radius": 0.55, "cost_scaling_factor": 10.0}
    settings: dict[str, Any] = {}
    layers = given.get("plugins", ["static_layer", "obstacle_layer", "inflation_layer"])
    view["static_layer"] = any("static" in str(name) for name in layers)
    for name, value in given.items():
        if isinstance(value, Mapping):
            view |= _layer(value, f"{place}.{name}")
        elif name == "footprint":
            settings["footprint"] = _outline(value)
        elif name == "robot_radius":
            settings["robot_radius"] = float(value)
        elif name not in _WITHOUT_ROS and name != "plugins":
            refuse_unknown(place, [name], [*names_of(View), "footprint", "robot_radius"])
            view[name] = value
    return settings | {"view": View(**view)}


def _layer(given: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return what a layer of a costmap sets of the view."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        if isinstance(value, Mapping):
            found |= _layer(value, f"{place}.{name}")
        elif name not in _LAYER | _WITHOUT_ROS:
            refuse_unknown(place, [name], _SEEN | _LAYER)
            found[name] = value
    return found


def _outline(value: Any) -> tuple[tuple[float, float], ...]:
    """Return the corners that Nav2 writes as text, [[x, y], ...]."""
    corners = parse(value, "footprint") if isinstance(value, str) else value
    try:
        return tuple((float(x), float(y)) for x, y in corners)
    except (TypeError, ValueError):
        raise WideberthError(f"footprint is {value!r}; wanted [[x, y], ...] in m") from None
