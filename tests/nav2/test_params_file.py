"""Files of Nav2 from Humble to main and of robots are read, and nothing is lost in silence."""

from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.nav2.controllers.local_controllers import built
from wideberth.nav2.controllers.mppi import MPPI
from wideberth.nav2.costmap.local_costmap import CostmapView
from wideberth.nav2.parameters import NAMES
from wideberth.nav2.server.params_file import read_params, read_params_file
from wideberth.nav2.server.params_text import params_text
from wideberth.tests.helpers.nav2_params import FILES, parameters_of, text_of
from wideberth.tests.nav2.ticks import straight, tick

NODES = {"controller_server", "local_costmap", "velocity_smoother", "behavior_server"}


def file_of(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "nav2_params.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", FILES)
def test_files_in_use_are_read(name: str, tmp_path: Path) -> None:
    read = read_params(file_of(tmp_path, text_of(name)))
    server = parameters_of(name, "controller_server")
    plugin = server["FollowPath.plugin"]
    assert NAMES["controllers"][plugin] == read.settings.local
    read.settings.make_controller()
    for key, value in read.settings.parameters.items():
        assert server.get(f"FollowPath.{key}", value) == value
    shared = read.settings.parameters.keys() & {key.removeprefix("FollowPath.") for key in server}
    assert len(shared) >= 13
    smoother = parameters_of(name, "velocity_smoother")
    assert read.settings.velocity_smoother.items() <= smoother.items()
    assert read_params(file_of(tmp_path, text_of(name, nested=False))).settings == read.settings


@pytest.mark.parametrize("name", FILES)
def test_no_parameter_is_lost_in_silence(name: str, tmp_path: Path) -> None:
    """It is set, listed, known to mean nothing here, or of a plug-in that is not in use."""
    read = read_params(file_of(tmp_path, text_of(name)))
    made, listed = read.settings, {one.rpartition(".")[2] for one in read.passed_over}
    kept = {key.rpartition(".")[2] for key in made.parameters}
    for part in (made.server, made.path_handler, made.goal_checker, made.progress_checker,
                 made.velocity_smoother, made.recoveries):  # fmt: skip
        kept |= part.keys()
    kept |= vars(made.view).keys() | {"controller_frequency", "footprint", "robot_radius"}
    nothing = {*NAMES["without_ros"], *NAMES["layers_without_effect"], *NAMES["without_effect"]}
    nothing |= {*NAMES["only"]["layers"], "footprint_clearing_enabled"}
    other = {"plugins", "primary_controller", "desired_linear_vel", "trajectory_step"}
    sideways = {"vy_max", "vy_std", "ay_max", "ay_min", "model_delay_vy", "time_step"}
    once = {"prune_plan", "forward_prune_distance", "path_length_tolerance", "min_turning_r"}
    renamed = {"trans_stopped_velocity", "xy_goal_tolerance", "forward_preference"}
    only = {"symmetric_yaw_tolerance", "consider_footprint"}
    known = kept | listed | nothing | other | sideways | once | renamed | only
    for node in NODES:
        for key in parameters_of(name, node):
            assert key.rpartition(".")[2] in known, (node, key)


@pytest.mark.parametrize(
    ("name", "passed"),
    [
        ("nav2_kilted", "local_costmap.keepout_filter.filter_info_topic"),
        ("nav2_lyrical", "local_costmap.keepout_filter.override_lethal_cost"),
        ("nav2_main", "local_costmap.keepout_filter.lethal_override_cost"),
        ("turtlebot3_waffle", "behavior_server.transform_timeout"),
        ("linorobot2", "FollowPath.angular_dist_threshold"),
        ("neobotix_mp_400", "FollowPath.use_approach_linear_velocity_scaling"),
        ("rosbot_mppi", "FollowPath.AckermannConstrains.min_turning_r"),
    ],
)
def test_what_is_not_modelled_is_listed(name: str, passed: str, tmp_path: Path) -> None:
    path = file_of(tmp_path, text_of(name))
    read = read_params(path)
    assert passed in read.passed_over
    assert any(passed in remark for remark in read.remarks)
    with pytest.warns(UserWarning, match="not modelled, passed over: .*"):
        assert read_params_file(path) == read.settings


def test_a_file_without_remarks_has_none(tmp_path: Path) -> None:
    assert read_params(file_of(tmp_path, text_of("nav2_humble"))).remarks == ()


def test_a_key_that_stands_twice_has_its_last_value(tmp_path: Path) -> None:
    """linorobot2 names the rotation shim first and DWB after it: in ROS it is DWB alone."""
    read = read_params(file_of(tmp_path, text_of("linorobot2")))
    assert read.settings.local == "dwb"
    assert [key.split()[0] for key in read.twice] == [
        "plugin", "resolution", "max_obstacle_height"
    ]  # fmt: skip
    assert any("plugin (line " in remark for remark in read.remarks)


TWICE = """
controller_server:
  ros__parameters:
    FollowPath:
      plugin: "dwb_core::DWBLocalPlanner"
      critics: ["PathDist"]
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
      desired_linear_vel: 0.3
    FollowPath.lookahead_dist: 0.7
  ros__parameters: {failure_tolerance: 0.5}
robot1:
  local_costmap:
    local_costmap:
      ros__parameters: {width: 4}
velocity_smoother: {ros__parameters: {max_velocity: [0.4, 0.0, 1.0], smoothing_frequency: 10.0}}
/**/velocity_smoother: {ros__parameters: {smoothing_frequency: 30.0}}
"""


def test_blocks_that_stand_twice_are_merged(tmp_path: Path) -> None:
    """As rcl_yaml_param_parser does, which keeps one value for each dotted name of a node."""
    read = read_params(file_of(tmp_path, TWICE))
    made = read.settings
    assert made.local == "regulated_pure_pursuit"
    assert made.parameters == {"desired_linear_vel": 0.3, "lookahead_dist": 0.7}
    assert made.server == {"failure_tolerance": 0.5} and made.view.width == 4
    smoother = made.make_smoother()
    assert (smoother.max_velocity[0], smoother.smoothing_frequency) == (0.4, 30.0)
    assert [key.split()[0] for key in read.twice] == ["FollowPath", "plugin", "ros__parameters"]
    assert read.passed_over == ("FollowPath.critics",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("lethal_override_cost", "inflation_radios", ""),
        ("cost_scaling_factor", "cost_scaling_fector", "did you mean 'cost_scaling_factor'"),
        ("nav2_controller::SimpleGoalChecker", "nav2_controller::SimpleGoalCheker", "did you"),
        ('plugins: ["voxel_layer", "inflation_layer"]', "plugins: 3", "wanted a list of names"),
        ("robot_radius: 0.22", "robot_radius: wide", "robot_radius is 'wide'"),
        ("controller_frequency: 20.0", "controller_frequency: []", "controller_frequency"),
    ],
)
def test_what_is_modelled_is_checked(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = text_of("nav2_main")
    assert old in text
    path = file_of(tmp_path, text.replace(old, new))
    if not message:  # a name of a part that is not modelled may be any
        assert "local_costmap.keepout_filter.inflation_radios" in read_params(path).passed_over
        return
    with pytest.raises(WideberthError, match=message):
        read_params(path)


def test_a_plugin_that_adds_a_condition_stands_as_the_one_it_adds_to(tmp_path: Path) -> None:
    text = text_of("nav2_humble").replace("::SimpleGoalChecker", "::StoppedGoalChecker")
    text = text.replace("::SimpleProgressChecker", "::MyProgressChecker")
    read = read_params(file_of(tmp_path, text))
    assert read.settings.goal_checker["xy_goal_tolerance"] == 0.25
    assert "progress_checker" not in read.settings.progress_checker
    listed = [one for one in read.passed_over if ".plugin: " in one]
    assert [one.rpartition("::")[2] for one in listed] == [
        "MyProgressChecker", "StoppedGoalChecker"
    ]  # fmt: skip


def test_of_two_goal_checkers_the_listed_one_counts(tmp_path: Path) -> None:
    more = """    precise_goal_checker:
      plugin: "nav2_controller::SimpleGoalChecker"
      xy_goal_tolerance: 0.01
    FollowPath:
"""
    text = text_of("nav2_humble").replace("    FollowPath:\n", more, 1)
    assert read_params(file_of(tmp_path, text)).settings.goal_checker["xy_goal_tolerance"] == 0.25


@pytest.mark.parametrize("name", ["nav2_main", "turtlebot3_burger", "neobotix_mp_400"])
def test_a_file_comes_back_from_what_was_read(name: str, tmp_path: Path) -> None:
    read = read_params(file_of(tmp_path, text_of(name)))
    again = read_params(file_of(tmp_path, params_text(read.settings)))
    assert again.settings == read.settings and again.remarks == ()


def test_no_samples_sideways_are_two_of_one_value(tmp_path: Path) -> None:
    """As in the original, whose iterator makes two of none; the speed sideways is 0 in both."""
    read = read_params(file_of(tmp_path, text_of("turtlebot3_burger")))
    assert read.settings.parameters["vy_samples"] == 0

    def twist(count: int) -> tuple[float, ...]:
        more = {"vy_samples": count, "controller_frequency": 20.0}
        made = built("dwb", {**read.settings.parameters, **more})
        found = made.velocity(tick(straight(1.0))).twist
        assert found is not None
        return (*found.linear, found.angular)

    assert twist(0) == twist(2)
    with pytest.raises(WideberthError, match="vy_samples is -1"):
        twist(-1)


def test_mppi_of_the_newest_files_has_their_values(tmp_path: Path) -> None:
    made = read_params(file_of(tmp_path, text_of("nav2_main"))).settings.make_controller()
    assert isinstance(made, MPPI)
    assert (made.batch_size, made.motion_model, len(made.critics)) == (2000, "diff_drive", 8)


LAYERED = """
controller_server:
  ros__parameters:
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
local_costmap:
  local_costmap:
    ros__parameters:
      plugins: ["map", "marks", "rings"]
      map: {plugin: "nav2_costmap_2d::StaticLayer", enabled: true}
      marks:
        plugin: "nav2_costmap_2d::VoxelLayer"
        enabled: true
        footprint_clearing_enabled: true
        combination_method: 1
        observation_sources: scan
        scan: {obstacle_max_range: 2.0, obstacle_min_range: 0, marking: true, clearing: true}
      rings: {plugin: "nav2_costmap_2d::InflationLayer", enabled: true, inflation_radius: 0.7}
"""


def test_layers_that_are_not_enabled_are_left_out(tmp_path: Path) -> None:
    """A layer is what its plug-in says, whatever its name."""

    def view(text: str) -> CostmapView:
        read = read_params(file_of(tmp_path, text))
        assert read.remarks == ()
        again = read_params(file_of(tmp_path, params_text(read.settings)))
        assert again.settings == read.settings and again.remarks == ()
        return read.settings.view

    whole = view(LAYERED)
    assert whole.static_layer and whole.obstacle_layer
    assert (whole.inflation_radius, whole.obstacle_max_range) == (0.7, 2.0)
    none = view(LAYERED.replace(" enabled: true", " enabled: false"))
    assert not none.static_layer and not none.obstacle_layer
    assert (none.inflation_radius, none.obstacle_max_range) == (0.0, 2.5)
    assert view(LAYERED.replace('["map", "marks", "rings"]', "[]")) == none
    usual = view(LAYERED[: LAYERED.index("local_costmap")])
    assert usual.static_layer and usual.obstacle_layer and usual.inflation_radius == 0.55


@pytest.mark.parametrize(
    ("old", "new", "passed"),
    [
        ("marking: true", "marking: false", "marks.scan.marking"),
        ("clearing: true", "clearing: false", "marks.scan.clearing"),
        ("obstacle_min_range: 0", "obstacle_min_range: 0.3", "marks.scan.obstacle_min_range"),
        ("combination_method: 1", "combination_method: 0", "marks.combination_method"),
        ("clearing_enabled: true", "clearing_enabled: false", "marks.footprint_clearing_enabled"),
        ("Layer\", enabled", "Layer\", footprint_clearing_enabled: true, enabled",
         "map.footprint_clearing_enabled"),
        ("::StaticLayer", "::MyLayer", "map.plugin: nav2_costmap_2d::MyLayer"),
    ],
)  # fmt: skip
def test_what_a_view_has_at_one_value_alone_is_listed_at_others(
    old: str, new: str, passed: str, tmp_path: Path
) -> None:
    text = LAYERED.replace(old, new, 1)
    assert f"local_costmap.{passed}" in read_params(file_of(tmp_path, text)).passed_over


def plain_file(controller: str = "", costmap: str = "", more: str = "") -> str:
    return f"""controller_server:
  ros__parameters:
    FollowPath: {{plugin: "dwb_core::DWBLocalPlanner"{controller}}}
local_costmap: {{local_costmap: {{ros__parameters: {{robot_radius: 0.22{costmap}}}}}}}
{more}"""


def test_of_six_velocities_those_of_the_plane_count(tmp_path: Path) -> None:
    """vx, vy, vz and the rates of roll, pitch and yaw, as newer files of Nav2 have them."""
    smoother = """velocity_smoother:
  ros__parameters:
    max_velocity: [0.3, 0.1, 0.0, 0.0, 0.0, 1.0]
    min_velocity: [-0.1, -0.2, 0.0, 0.0, 0.0, -1.0]
    max_accel: [1.0, 0.4, 0.5, 0.0, 0.0, 2.0]
    max_decel: [-1.0, -0.4, 0.0, 0.0, 0.0, -2.0]
    deadband_velocity: [0.01, 0.02, 0.0, 0.0, 0.0, 0.03]
"""
    read = read_params(file_of(tmp_path, plain_file(more=smoother)))
    assert read.settings.velocity_smoother == {
        "max_velocity": [0.3, 0.1, 1.0],
        "min_velocity": [-0.1, -0.2, -1.0],
        "max_accel": [1.0, 0.4, 2.0],
        "max_decel": [-1.0, -0.4, -2.0],
        "deadband_velocity": [0.01, 0.02, 0.03],
    }
    assert read.passed_over == ("velocity_smoother.max_accel: of z, roll and pitch",)


@pytest.mark.parametrize("text", ["''", '""', "'[]'", "[]"])
def test_an_empty_footprint_leaves_the_radius(tmp_path: Path, text: str) -> None:
    read = read_params(file_of(tmp_path, plain_file(costmap=f", footprint: {text}")))
    assert read.settings.footprint == () and read.settings.robot_radius == 0.22


def test_mppi_without_noise_of_the_yaw_rate_drives(tmp_path: Path) -> None:
    mppi = plain_file(', plugin: "nav2_mppi_controller::MPPIController", wz_std: 0.0')
    mppi = mppi.replace('plugin: "dwb_core::DWBLocalPlanner", ', "")
    settings = read_params(file_of(tmp_path, mppi)).settings
    controller = built(settings.local, settings.parameters)
    assert isinstance(controller, MPPI)
    for k in range(5):
        twist = controller.velocity(tick(straight(3.0), time=0.05 * k)).twist
        assert twist is not None
        assert np.isfinite(twist.linear).all() and twist.angular == 0.0
    assert twist.linear[0] > 0.0
    with pytest.raises(WideberthError, match="vx_std is 0"):
        built("mppi", {"vx_std": 0.0})


COSTMAP = "local_costmap: {ros__parameters: {width: 5}}"


@pytest.mark.parametrize(
    ("more", "names"),
    [
        ("robot2: {controller_server: {ros__parameters: {failure_tolerance: 1.0}}}", "/, /robot2"),
        ("/robot2/controller_server: {ros__parameters: {failure_tolerance: 1.0}}", "/, /robot2"),
        (f"robot1: {{local_costmap: {{{COSTMAP}}}}}", "/, /robot1"),
        ("a/velocity_smoother: {ros__parameters: {}}\nb: {behavior_server: {ros__parameters: {}}}",
         "/, /a, /b"),
    ],
)  # fmt: skip
def test_two_robots_in_one_file_are_refused(tmp_path: Path, more: str, names: str) -> None:
    path = file_of(tmp_path, plain_file(more=more))
    with pytest.raises(WideberthError, match=f"robots, in the namespaces {names}; wanted those"):
        read_params(path)


@pytest.mark.parametrize(
    "more",
    [
        f"/**/local_costmap: {{{COSTMAP}}}",
        COSTMAP,
        "robot2: {global_costmap: {global_costmap: {ros__parameters: {width: 9}}}}",
    ],
)
def test_other_namespaces_are_no_other_robot(tmp_path: Path, more: str) -> None:
    """Wildcards hold for all, and a costmap has a namespace of its own."""
    text = plain_file().replace("local_costmap: {local_costmap", "local_costmap: {/local_costmap")
    wanted = 3 if "global" in more else 5
    assert read_params(file_of(tmp_path, f"{text}{more}")).settings.view.width == wanted


def test_one_robot_in_a_namespace_is_read(tmp_path: Path) -> None:
    text = "".join(f"  {line}\n" for line in plain_file().splitlines())
    read = read_params(file_of(tmp_path, f"robot1:\n{text}"))
    assert read.settings == read_params(file_of(tmp_path, plain_file())).settings
