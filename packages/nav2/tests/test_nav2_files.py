"""Nav2's parameter files as configs of ours, and back."""

import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from wideberth.experiments.cli.app import main
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.robots import Unicycle
from wideberth.tests.helpers.nav2_params import FILES, text_of
from wideberth_nav2.cli.nav2_files import config_of
from wideberth_nav2.server.navigator import Nav2
from wideberth_nav2.server.params_file import read_params, read_params_file

PARAMS = """
controller_server:
  ros__parameters:
    controller_frequency: 10.0
    goal_checker: {plugin: "nav2_controller::SimpleGoalChecker", xy_goal_tolerance: 0.2}
    FollowPath:
      plugin: "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
      desired_linear_vel: 0.4
local_costmap:
  local_costmap:
    ros__parameters: {width: 4, height: 4, robot_radius: 0.22}
velocity_smoother:
  ros__parameters:
    max_velocity: [0.7, 0.0, 1.0]
    min_velocity: [-0.7, 0.0, -1.0]
    max_accel: [2.5, 0.0, 3.2]
    max_decel: [-2.0, 0.0, -3.2]
"""


@pytest.fixture
def params(tmp_path: Path) -> Path:
    path = tmp_path / "nav2_params.yaml"
    path.write_text(PARAMS)
    return path


def run(capsys: Any, *words: Any) -> tuple[int, str]:
    with pytest.raises(SystemExit) as stop:
        main(["nav2", *map(str, words)])
    found = capsys.readouterr()
    return int(stop.value.code or 0), (found.out + found.err).replace("\n", " ")


def test_a_parameter_file_becomes_a_config(params: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "config.yaml"
    code, said = run(capsys, params, "--out", out)
    assert code == 0 and "compares both" in said
    experiment: Any = read_experiment(str(out), [])[0]
    assert experiment.robot == Unicycle(0.22, 0.7, 1.0, 2.0, 3.2)
    nav2, ours = experiment.planners["nav2"], experiment.planners["ours"]
    assert isinstance(nav2, Nav2) and isinstance(ours, Planner)
    assert nav2.chosen == read_params_file(params)
    assert ours.robot == experiment.robot
    assert ours.reference_speed == experiment.speed == pytest.approx(0.5)


def test_a_speed_backwards_becomes_the_robot_s(params: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "config.yaml"
    params.write_text(PARAMS.replace("min_velocity: [-0.7", "min_velocity: [0.0"))
    assert run(capsys, params, "--out", out)[0] == 0
    experiment: Any = read_experiment(str(out), [])[0]
    assert experiment.planners["ours"].robot == Unicycle(
        0.22, 0.7, 1.0, 2.0, 3.2, max_reverse_speed=0.0
    )


def test_the_config_becomes_the_parameter_file_again(
    params: Path, tmp_path: Path, capsys: Any
) -> None:
    config, back, again = (tmp_path / f"{name}.yaml" for name in ("config", "back", "again"))
    assert run(capsys, params, "--out", config)[0] == 0
    assert run(capsys, config, "--out", back)[0] == 0
    assert read_params_file(back) == read_params_file(params)
    assert run(capsys, back, "--out", again)[0] == 0
    assert yaml.safe_load(again.read_text()) == yaml.safe_load(config.read_text())


def recommended(said: str) -> list[str]:
    """The words of the command that is recommended next."""
    program, *words = shlex.split(said.split("`")[1])
    assert program == "wideberth"
    return words


@pytest.mark.parametrize("name", ["nav2_humble", "nav2_jazzy", "turtlebot4"])
def test_the_recommended_command_runs(
    name: str, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = tmp_path / "nav2_params.yaml"
    given.write_text(text_of(name))
    code, said = run(capsys, given, "--out", "my config.yaml")
    assert code == 0
    with pytest.raises(SystemExit) as stop:
        main([*recommended(said), "--quick", "--set", "settings.time_limit=1.0"])
    assert not stop.value.code, capsys.readouterr().err
    (table,) = tmp_path.rglob("table.csv")
    assert len(table.read_text().splitlines()) == 3  # a head and a row for each of both


@pytest.mark.parametrize("name", FILES)
def test_every_episode_of_a_config_can_be_drawn(name: str, tmp_path: Path) -> None:
    """A slow robot has no time to go as far in the recording."""
    path = tmp_path / "nav2_params.yaml"
    path.write_text(text_of(name))
    config = tmp_path / "config.yaml"
    settings = read_params(path).settings
    config.write_text(config_of(settings, str(path)))
    experiment: Any = read_experiment(str(config), [])[0]
    assert len(experiment.tasks()) == 2 * experiment.seeds
    shipped: Any = read_experiment("replay", [])[0]
    longest = shipped.reach / shipped.speed
    assert experiment.reach / experiment.speed <= longest * (1.0 + 1e-12)
    assert experiment.reach <= shipped.reach


def test_what_is_passed_over_is_said(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "nav2_params.yaml"
    path.write_text(text_of("linorobot2"))
    code, said = run(capsys, path, "--out", tmp_path / "config.yaml")
    assert code == 0
    assert "stands twice, the last value holds: plugin (line" in said
    (passed,) = [one for one in said.splitlines() if "not modelled, passed over: " in one]
    assert "FollowPath.angular_dist_threshold" in passed and "scan.clearing" in passed


def test_any_planner_gives_its_limits(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "nav2_params.yaml"
    assert run(capsys, "replay", "--planner", "kalman", "--out", out)[0] == 0
    found = read_params_file(out)
    assert (found.robot_radius, found.controller_frequency) == (0.3, 5.0)
    smoother = found.make_smoother()
    assert smoother.max_velocity == pytest.approx((1.0, 0.0, 1.0))
    assert smoother.max_accel == pytest.approx((0.7, 0.0, 1.0))


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("robot_radius: 0.22", "resolution: 0.05", "states no size of the robot"),
        ("desired_linear_vel", "desired_linear_velo", "did you mean"),
        ("max_accel", "max_acel", "did you mean 'max_accel'"),
        ("FollowPath:", "FollowPaths:", "did you mean 'FollowPaths'"),
    ],
)
def test_what_cannot_be_read_is_named(
    params: Path, tmp_path: Path, capsys: Any, old: str, new: str, cause: str
) -> None:
    params.write_text(PARAMS.replace(old, new))
    code, said = run(capsys, params, "--out", tmp_path / "x.yaml")
    assert code == 2 and cause in said and not (tmp_path / "x.yaml").exists()


def test_bad_arguments_are_named(params: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "x.yaml"
    for words, cause in (
        ((params, "--out", params), "exists and is not replaced"),
        (("replay", "--planner", "kalmann", "--out", out), "did you mean 'kalman'"),
        (("region_gallery", "--out", out), "has no planner"),
        (("no_such_config", "--out", out), "no_such_config"),
    ):
        code, said = run(capsys, *words)
        assert code == 2 and cause in said
