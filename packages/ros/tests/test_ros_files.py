"""Files for ROS 2: launch files against a fake of launch, the view of RViz against the node."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from wideberth.experiments.cli.app import main
from wideberth.packages.ros.tests.test_node import Loop
from wideberth_ros.cli.ros_files import FOLDER
from wideberth_ros.cli.ros_node import read_node

EXAMPLES = Path(__file__).parents[3] / "examples" / "nav2"


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return what a launch file starts."""

    def made(**given: Any) -> Any:
        return SimpleNamespace(**given)

    for name, content in (
        ("launch", {"LaunchDescription": lambda entries: entries}),
        ("launch.actions", {"DeclareLaunchArgument": lambda name, **given: made(**given),
                            "ExecuteProcess": made}),
        ("launch.substitutions", {"LaunchConfiguration": lambda name: f"<{name}>"}),
        ("launch_ros.actions", {"Node": made}),
    ):  # fmt: skip
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return lambda path: runpy.run_path(str(path))["generate_launch_description"]()


def test_nav2_is_launched_with_our_node_in_the_place_of_its_controller(launched: Any) -> None:
    found = launched(EXAMPLES / "follow_path.launch.py")
    commands = [one.cmd for one in found if hasattr(one, "cmd")]
    assert commands == [["wideberth", "node", "<config>"]]
    nodes = {one.executable for one in found if hasattr(one, "executable")}
    assert "controller_server" not in nodes and "bt_navigator" in nodes
    params = yaml.safe_load((EXAMPLES / "nav2_params.yaml").read_text())
    configured = set(params) - {"global_costmap"}
    assert configured <= nodes
    costmap = params["global_costmap"]["global_costmap"]["ros__parameters"]
    planner, _ = read_node(EXAMPLES.parent / "node.yaml", [])
    assert costmap["robot_radius"] == planner.robot.radius  # type: ignore[attr-defined]


def test_the_launch_file_starts_our_node(launched: Any) -> None:
    (command,) = [
        one.cmd for one in launched(FOLDER / "node.launch.py.txt") if hasattr(one, "cmd")
    ]
    words = ["wideberth", "node", "<config>", "--ros-args", "-p"]
    assert command == [*words, ["use_sim_time:=", "<use_sim_time>"]]


def test_the_view_shows_what_the_node_publishes() -> None:
    view = yaml.safe_load((FOLDER / "node.rviz").read_text())["Visualization Manager"]
    network = Loop().network
    shown = {one["Name"]: one["Topic"]["Value"] for one in view["Displays"] if "Topic" in one}
    for name in ("Plan", "Forecast", "Regions"):
        kind = network.wires[shown[name]].kind
        assert kind.endswith("Path" if name == "Plan" else "MarkerArray")
    assert shown["Scan"] == "/scan" and shown["Map"] == "/map"


def test_files_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["show", "ros", "node.rviz"])
    assert capsys.readouterr().out == (FOLDER / "node.rviz").read_text()
    with pytest.raises(SystemExit):
        main(["show", "ros", "node.rvis"])
    assert "did you mean 'node.rviz'" in capsys.readouterr().err
