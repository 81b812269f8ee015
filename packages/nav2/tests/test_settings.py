"""Settings of the loop, and Nav2's own parameter files."""

from dataclasses import replace
from pathlib import Path

import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.robots import Unicycle
from wideberth_nav2.controllers.dwb import DWB
from wideberth_nav2.controllers.graceful import Graceful
from wideberth_nav2.controllers.local_controllers import VelocityLimits, built
from wideberth_nav2.controllers.mppi import MPPI
from wideberth_nav2.controllers.regulated_pure_pursuit import RegulatedPurePursuit
from wideberth_nav2.controllers.rotation_shim import RotationShim
from wideberth_nav2.controllers.teb import TEB
from wideberth_nav2.costmap.local_costmap import CostmapView
from wideberth_nav2.parameters import NAMES
from wideberth_nav2.server.navigator import Nav2
from wideberth_nav2.server.params_file import read_params_file
from wideberth_nav2.server.params_text import params_text
from wideberth_nav2.server.settings import LoopSettings

FILE = """
amcl:
  ros__parameters: {alpha1: 0.2}
controller_server:
  ros__parameters:
    use_sim_time: true
    controller_frequency: 10.0
    failure_tolerance: 0.4
    goal_checker_plugins: [general_goal_checker]
    progress_checker_plugins: [progress_checker]
    controller_plugins: [FollowPath]
    progress_checker:
      plugin: "nav2_controller::SimpleProgressChecker"
      required_movement_radius: 0.3
    general_goal_checker:
      plugin: "nav2_controller::SimpleGoalChecker"
      xy_goal_tolerance: 0.2
      stateful: true
    FollowPath:
%s
local_costmap:
  local_costmap:
    ros__parameters:
      update_frequency: 4.0
      publish_frequency: 2.0
      global_frame: odom
      rolling_window: true
      width: 5
      height: 4
      resolution: 0.1
      footprint: "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
      plugins: ["voxel_layer", "inflation_layer"]
      inflation_layer:
        plugin: "nav2_costmap_2d::InflationLayer"
        cost_scaling_factor: 4.0
        inflation_radius: 0.6
      voxel_layer:
        plugin: "nav2_costmap_2d::VoxelLayer"
        enabled: true
        observation_sources: scan
        scan: {topic: /scan, obstacle_max_range: 2.4, raytrace_max_range: 2.8, marking: true}
      always_send_full_costmap: true
velocity_smoother:
  ros__parameters:
    smoothing_frequency: 20.0
    max_velocity: [0.4, 0.0, 1.0]
    min_velocity: [-0.4, 0.0, -1.0]
    odom_topic: "odom"
behavior_server:
  ros__parameters:
    cycle_frequency: 10.0
    behavior_plugins: ["spin"]
    spin: {plugin: "nav2_behaviors::Spin"}
    max_rotational_vel: 0.9
"""
GRACEFUL = """
      plugin: "nav2_graceful_controller::GracefulController"
      lambda: 1.5
      v_linear_max: 0.6
      transform_tolerance: 0.1
"""


def read(tmp_path: Path, controller: str, old: str = "", new: str = "") -> LoopSettings:
    file = tmp_path / "nav2_params.yaml"
    file.write_text(
        (FILE % controller.strip("\n")).replace(old, new) if old else FILE % controller
    )
    return read_params_file(file)


def test_a_file_is_read_whole(tmp_path: Path) -> None:
    found = read(tmp_path, GRACEFUL)
    controller = found.make_controller()
    assert isinstance(controller, Graceful)
    assert (controller.lambda_, controller.v_linear_max, controller.k_phi) == (1.5, 0.6, 2.0)
    server = found.make_server()
    assert server.failure_tolerance == 0.4 and server.min_x_velocity_threshold == 1e-4
    assert server.goal_checker.xy_goal_tolerance == 0.2
    assert server.progress_checker.required_movement_radius == 0.3
    assert found.controller_frequency == 10.0 and len(found.footprint) == 4
    view = found.view
    assert (view.width, view.height, view.resolution, view.update_frequency) == (5, 4, 0.1, 4.0)
    assert (view.inflation_radius, view.cost_scaling_factor) == (0.6, 4.0)
    assert (view.obstacle_max_range, view.raytrace_max_range) == (2.4, 2.8)
    assert not view.static_layer
    assert found.make_smoother().max_velocity == (0.4, 0.0, 1.0)
    assert found.make_recoveries().max_rotational_vel == 0.9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lambda", "lamda", "'lamda': did you mean 'lambda"),
        ("v_linear_max", "v_linear_maxx", "did you mean 'v_linear_max'"),
        ("failure_tolerance", "failure_toleranze", "did you mean 'failure_tolerance'"),
        ("xy_goal_tolerance", "xy_goal_tol", "did you mean 'xy_goal_tolerance'"),
        ("inflation_radius", "inflation_radios", "did you mean 'inflation_radius'"),
        ("rolling_window", "roling_window", "did you mean 'rolling_window'"),
        ("max_rotational_vel", "max_rotation_vel", "did you mean 'max_rotational_vel'"),
        ("max_velocity", "max_velocities", "did you mean 'max_velocity'"),
        ("GracefulController", "GracefullController", "did you mean 'nav2_graceful"),
        ("FollowPath:", "FollowPaths:", "did you mean 'FollowPaths'"),
        ("controller_server:", "controller_sever:", "no section controller_server"),
    ],
)
def test_unknown_names_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        read(tmp_path, GRACEFUL, old, new)


def test_mppi_of_a_file(tmp_path: Path) -> None:
    text = """
      plugin: "nav2_mppi_controller::MPPIController"
      batch_size: 500
      model_dt: 0.1
      vy_max: 0.5
      motion_model: "DiffDrive"
      visualize: true
      TrajectoryVisualizer: {trajectory_step: 5, time_step: 3}
      AckermannConstraints: {min_turning_r: 0.3}
      critics: [CostCritic, GoalCritic]
      CostCritic: {enabled: true, cost_power: 1, cost_weight: 3.0, consider_footprint: false}
      GoalCritic: {enabled: true, threshold_to_consider: 1.2}
"""
    made = read(tmp_path, text).make_controller()
    assert isinstance(made, MPPI) and made.batch_size == 500 and made.min_turning_r == 0.3
    assert [type(critic).__name__ for critic in made.critics] == ["CostCritic", "GoalCritic"]
    with pytest.raises(WideberthError, match="cost_weight"):
        read(tmp_path, text, "cost_weight", "cost_wait")


NEWEST = """
      plugin: "nav2_mppi_controller::MPPIController"
      time_steps: 56
      model_dt: 0.1
      batch_size: 100
      vy_std: 0.2
      vy_max: 0.5
      ay_max: 3.0
      ay_min: -3.0
      model_delay_vx: 0.0
      model_delay_vy: 0.1
      motion_model: %s
      diff_drive: {plugin: "mppi::DiffDriveMotionModel"}
      omni: {plugin: "mppi::OmniMotionModel"}
      car: {plugin: "mppi::AckermannMotionModel", min_turning_r: 0.4}
      visualize: true
      publish_critics_stats: false
      publish_optimal_trajectory: true
      TrajectoryVisualizer: {trajectory_step: 5, time_step: 3}
      TrajectoryValidator:
        plugin: "mppi::DefaultOptimalTrajectoryValidator"
        collision_lookahead_time: 1.5
        consider_footprint: false
      critics: [CostCritic, GoalAngleCritic, PathAlignCritic, PathAngleCritic]
      CostCritic:
        enabled: true
        cost_power: 1
        near_collision_cost: 253
        consider_footprint: false
        inflation_layer_name: "inflation_layer"
      GoalAngleCritic: {symmetric_yaw_tolerance: false}
      PathAlignCritic: {critic_index_to_visualize: 2, use_path_orientations: false}
      TwirlingCritic: {enabled: true, cost_weight: 10.0}
"""
"""Names that files of Nav2's newest version have."""


@pytest.mark.parametrize(("name", "model"), [("diff_drive", "diff_drive"), ("car", "ackermann")])
def test_the_newest_files_are_read(tmp_path: Path, name: str, model: str) -> None:
    found = read(tmp_path, NEWEST % name)
    made = found.make_controller()
    assert isinstance(made, MPPI) and made.motion_model == model
    assert made.min_turning_r == (0.4 if name == "car" else 0.2)
    assert made.collision_lookahead_time == 1.5
    again = tmp_path / "again.yaml"
    again.write_text(params_text(found))
    assert read_params_file(again) == found


def test_the_plugin_says_what_a_motion_model_is(tmp_path: Path) -> None:
    twisted = NEWEST.replace("DiffDriveMotionModel", "AckermannMotionModel") % "diff_drive"
    found = read(tmp_path, twisted)
    assert found.make_controller().motion_model == "ackermann"  # type: ignore[attr-defined]
    again = tmp_path / "again.yaml"
    again.write_text(params_text(found))
    assert read_params_file(again) == found
    named = (
        NEWEST.replace("car:", "Ackermann:").replace('plugin: "mppi::AckermannMotionModel", ', "")
        % "Ackermann"
    )
    made = read(tmp_path, named).make_controller()
    assert isinstance(made, MPPI)
    assert (made.motion_model, made.min_turning_r) == ("ackermann", 0.4)
    with pytest.raises(WideberthError, match=r"OmniMotionModel.*'diff_drive' or 'ackermann'"):
        read(tmp_path, NEWEST % "omni")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("consider_footprint: false\n      critics", "consider_footprint: true\n      critics",
         "TrajectoryValidator.consider_footprint is True; here it can be False alone"),
        ("mppi::DefaultOptimalTrajectoryValidator", "my::Validator", "my::Validator"),
        ("symmetric_yaw_tolerance: false", "symmetric_yaw_tolerance: true", "False alone"),
        ("collision_lookahead_time", "collision_look_time", "TrajectoryValidator.collision_look"),
    ],
)  # fmt: skip
def test_what_is_not_offered_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in NEWEST
    with pytest.raises(WideberthError, match=message):
        read(tmp_path, NEWEST.replace(old, new) % "diff_drive")


def test_parameters_of_paths_go_to_the_handler_where_a_file_has_none(tmp_path: Path) -> None:
    given = "      prune_distance: 1.7\n      max_robot_pose_search_dist: 1.2\n"
    found = read(tmp_path, NEWEST % "diff_drive" + given)
    handler = found.make_server().path_handler
    assert (handler.prune_distance, handler.max_robot_pose_search_dist) == (1.7, 1.2)
    own = """    path_handler:
      plugin: "nav2_controller::FeasiblePathHandler"
      prune_distance: 2.5
    FollowPath:
"""
    found = read(tmp_path, NEWEST % "diff_drive" + given, "    FollowPath:\n", own)
    assert found.make_server().path_handler.prune_distance == 2.5
    assert found.make_server().path_handler.max_robot_pose_search_dist is None
    humble = (
        WINDOW
        + """      prune_plan: true
      prune_distance: 0.5
      forward_prune_distance: 1.5
"""
    )
    assert read(tmp_path, humble).make_server().path_handler.prune_distance == 1.5
    with pytest.raises(WideberthError, match="DWB's prune_plan is False"):
        read(tmp_path, humble.replace("prune_plan: true", "prune_plan: false"))
    screw = """
      plugin: "vector_pursuit_controller::VectorPursuitController"
      max_robot_pose_search_dist: 1.2
"""
    made = read(tmp_path, screw).make_controller()
    assert made.max_robot_pose_search_dist == 1.2  # type: ignore[attr-defined]


def test_rotate_to_goal_has_its_path_length_under_nav2s_name(tmp_path: Path) -> None:
    node = "    failure_tolerance: 0.4\n    FollowPathpath_length_tolerance: 0.6\n"
    given = (
        WINDOW + "      path_length_tolerance: 0.7\n"
        "      RotateToGoal.path_length_tolerance: 0.8\n"
    )
    found = read(tmp_path, given, "    failure_tolerance: 0.4\n", node)
    made = found.make_controller()
    assert isinstance(made, DWB)
    assert made.critics[0].path_length_tolerance == 0.6  # type: ignore[attr-defined]
    again = tmp_path / "again.yaml"
    again.write_text(params_text(found))
    assert read_params_file(again) == found
    plain = read(tmp_path, given).make_controller()
    assert plain.critics[0].path_length_tolerance == 1.0  # type: ignore[attr-defined]


def test_unknown_cells_are_inflated_as_a_file_says(tmp_path: Path) -> None:
    old, new = "inflation_radius: 0.6", "inflation_radius: 0.6\n        inflate_%sunknown: true"
    for name in ("", "around_"):
        view = read(tmp_path, GRACEFUL, old, new % name).view
        assert (view.inflate_unknown, view.inflate_around_unknown) == (not name, bool(name))


def test_dwb_behind_a_shim_of_a_file(tmp_path: Path) -> None:
    text = """
      plugin: "nav2_rotation_shim_controller::RotationShimController"
      primary_controller: "dwb_core::DWBLocalPlanner"
      angular_dist_threshold: 0.6
      max_vel_x: 0.26
      max_vel_theta: 1.0
      xy_goal_tolerance: 0.22
      critics: ["RotateToGoal", "PathDist"]
      PathDist.scale: 32.0
"""
    made = read(tmp_path, text).make_controller()
    assert isinstance(made, RotationShim) and made.angular_dist_threshold == 0.6
    assert isinstance(made.primary, DWB) and made.primary.max_vel_x == 0.26
    assert made.primary.critics[0].xy_goal_tolerance == 0.22  # type: ignore[attr-defined]


def test_old_names_are_read() -> None:
    made = built("regulated_pure_pursuit", {"desired_linear_vel": 0.3})
    assert isinstance(made, RegulatedPurePursuit) and made.max_linear_vel == 0.3


def test_unknown_controllers_are_refused() -> None:
    with pytest.raises(WideberthError, match="did you mean 'graceful'"):
        LoopSettings("gracefull")
    with pytest.raises(WideberthError, match="cannot be imported"):
        LoopSettings("nowhere:Nothing")
    with pytest.raises(WideberthError, match="no LocalController"):
        LoopSettings("wideberth_nav2.costmap.local_costmap:CostmapView")
    made = LoopSettings("wideberth.packages.nav2.tests.ticks:Scripted").make_controller()
    assert type(made).__name__ == "Scripted"


@pytest.mark.parametrize(
    "local",
    [
        "dwb",
        "graceful",
        "mppi",
        "mppi_foresight",
        "regulated_pure_pursuit",
        "rotation_shim",
        "teb",
        "vector_pursuit",
    ],
)
def test_limits_reach_every_controller(local: str) -> None:
    limits = VelocityLimits(0.7, 0.3, 0.8, 0.1)
    bound = LoopSettings.shipped(local).within(limits)
    values = {value for value in bound.parameters.values() if isinstance(value, float)}
    assert {0.3, 0.7} <= values
    assert bound.make_smoother().max_accel == (0.8, 0.0, 0.1)
    bound.make_controller()


def test_limits_reach_the_controller_behind_a_shim() -> None:
    slow = VelocityLimits(0.2, 0.3, 0.7, 0.1)
    made = LoopSettings("rotation_shim").within(slow).make_controller()
    assert isinstance(made, RotationShim) and isinstance(made.primary, RegulatedPurePursuit)
    assert (made.rotate_to_heading_angular_vel, made.primary.max_linear_vel) == (0.3, 0.2)
    inner = {"primary_controller": "mppi"}
    made = LoopSettings("rotation_shim", inner).within(slow).make_controller()
    assert isinstance(made, RotationShim) and isinstance(made.primary, MPPI)
    assert (made.primary.vx_max, made.primary.vx_min, made.primary.wz_max) == (0.2, -0.2, 0.3)
    inner = {"primary_controller": "teb"}
    bound = LoopSettings("rotation_shim", inner).driving(Unicycle(radius=0.5)).within(slow)
    made = bound.make_controller()
    assert made.primary.robot_radius == 0.5  # type: ignore[attr-defined]
    assert made.primary.max_vel_x_backwards == 0.2  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("local", "name", "before", "after"),
    [
        ("mppi", "vx_min", None, -0.2), ("mppi", "vx_min", -0.1, -0.1), ("mppi", "vx_min", 0, 0),
        ("mppi_foresight", "vx_min", None, -0.2), ("teb", "max_vel_x_backwards", None, 0.2),
        ("teb", "max_vel_x_backwards", 0.5, 0.2), ("dwb", "min_vel_x", -0.26, -0.2),
        ("dwb", "min_vel_x", None, 0.0),
    ],
)  # fmt: skip
def test_nothing_reverses_faster_than_its_limit(
    local: str, name: str, before: float | None, after: float
) -> None:
    given = {} if before is None else {name: before}
    bound = LoopSettings(local, given).within(VelocityLimits(0.2, 0.3, 0.7, 0.1))
    assert bound.parameters[name] == after
    usual = {"mppi": MPPI, "mppi_foresight": MPPI, "dwb": DWB, "teb": TEB}[local]
    assert VelocityLimits(9.0, 9.0, 9.0, 9.0).parameters(local)[name] == getattr(usual, name)


@pytest.mark.parametrize(
    ("local", "name"),
    [("mppi", "vx_min"), ("teb", "max_vel_x_backwards"), ("dwb", "min_vel_x"),
     ("regulated_pure_pursuit", "min_linear_vel")],
)  # fmt: skip
@pytest.mark.parametrize("back", [0.0, 0.1])
def test_a_robot_that_hardly_reverses_does_not_with_nav2(
    local: str, name: str, back: float
) -> None:
    robot = Unicycle(max_reverse_speed=back)
    made = Nav2(
        robot, LoopSettings(local, {name: -0.5} if local == "dwb" else {}), robot_limits=True
    )
    bound = made.chosen
    assert abs(bound.parameters[name]) == pytest.approx(back)
    assert bound.make_smoother().min_velocity == pytest.approx((-back, 0.0, -0.3))


def test_critics_know_the_inflation_of_the_view() -> None:
    given = {"critics": ["CostCritic", "ObstaclesCritic"]}
    view = CostmapView(inflation_radius=0.8, cost_scaling_factor=4.0)
    made = LoopSettings("mppi", given, view=view).make_controller()
    assert isinstance(made, MPPI)
    cost, obstacles = made.critics
    assert cost.cost_scaling_factor == 4.0  # type: ignore[attr-defined]
    assert obstacles.inflation_radius == 0.8  # type: ignore[attr-defined]
    assert obstacles.cost_scaling_factor == 4.0  # type: ignore[attr-defined]
    own = {**given, "ObstaclesCritic.cost_scaling_factor": 5.0}
    made = LoopSettings("mppi", own, view=view).make_controller()
    assert made.critics[1].cost_scaling_factor == 5.0  # type: ignore[attr-defined]


def test_teb_of_a_file_keeps_its_radius(tmp_path: Path) -> None:
    text = """
      plugin: "teb_local_planner::TebLocalPlannerROS"
      footprint_model: {type: circular, radius: 0.17}
      costmap_converter_rate: 5
      max_vel_x: 0.26
"""
    found = read(tmp_path, text)
    robot = Unicycle(radius=0.5)
    assert found.driving(robot).make_controller().robot_radius == 0.17  # type: ignore[attr-defined]
    made = LoopSettings("teb").driving(robot).make_controller()
    assert made.robot_radius == 0.5  # type: ignore[attr-defined]
    assert LoopSettings("graceful").driving(robot) == LoopSettings("graceful")


def test_controllers_are_told_the_frequency_of_their_ticks() -> None:
    for local in ("regulated_pure_pursuit", "dwb", "teb", "vector_pursuit", "rotation_shim"):
        made = LoopSettings(local, controller_frequency=10.0).make_controller()
        assert made.controller_frequency == 10.0  # type: ignore[attr-defined]
    with pytest.raises(WideberthError, match="controller's period"):
        LoopSettings("mppi", controller_frequency=10.0)  # slower than its model
    LoopSettings("graceful", controller_frequency=10.0)


SHIM = """
      plugin: "nav2_rotation_shim_controller::RotationShimController"
      primary_controller: "nav2_mppi_controller::MPPIController"
      angular_dist_threshold: 0.6
      motion_model: "Ackermann"
      model_dt: 0.1
      AckermannConstraints: {min_turning_r: 0.3}
      critics: [CostCritic]
      CostCritic: {cost_weight: 3.0}
"""
CIRCLE = """
      plugin: "teb_local_planner::TebLocalPlannerROS"
      footprint_model: {type: circular, radius: 0.17}
      max_vel_x: 0.26
"""
WINDOW = """
      plugin: "dwb_core::DWBLocalPlanner"
      xy_goal_tolerance: 0.22
      critics: ["RotateToGoal", "PathDist"]
      PathDist.scale: 32.0
"""


@pytest.mark.parametrize("controller", [GRACEFUL, SHIM, CIRCLE, WINDOW])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ('plugins: ["voxel_layer"', 'plugins: ["static_layer", "voxel_layer"'),
        (
            'footprint: "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"',
            "robot_radius: 0.22",
        ),
    ],
)
def test_a_file_comes_back_from_its_settings(
    tmp_path: Path, controller: str, old: str, new: str
) -> None:
    found = read(tmp_path, controller, old, new)
    again = tmp_path / "again.yaml"
    again.write_text(params_text(found))
    assert read_params_file(again) == found
    assert params_text(read_params_file(again)) == params_text(found)


def test_shipped_settings_come_back_from_their_file(tmp_path: Path) -> None:
    for plugin in sorted(NAMES["controllers"].values()):
        found = replace(
            LoopSettings.shipped(plugin).within(VelocityLimits(0.7, 0.3, 0.8, 0.1)),
            view=CostmapView.privileged(),
        )
        file = tmp_path / f"{plugin}.yaml"
        file.write_text(params_text(found))
        back = read_params_file(file)
        assert (back.local, back.view) == (found.local, found.view)
        assert dict(back.parameters) == dict(found.parameters)
        assert back.make_smoother().max_velocity == found.make_smoother().max_velocity


def test_a_controller_that_nav2_lacks_has_no_file() -> None:
    with pytest.raises(WideberthError, match="has no controller 'mppi_foresight'; it has"):
        params_text(LoopSettings("mppi_foresight"))
