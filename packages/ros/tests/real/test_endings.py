"""However a node or a robot ends, the robot does not go on by itself."""

import signal
import time
from pathlib import Path

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network, Process, Robot

HERE = ROOT / "packages/ros/tests/real"
CONFIG = """
planner:
  type: moody_planner:Moody
  robot: {type: unicycle, radius: 0.3, max_yaw_rate: 1.0, max_yaw_acceleration: 1.0}
node: {sees: null, follows: {type: path, topic: /plan}}
"""
SOON = 0.3
"""s: 0.2 s, and a step of the robot and one of its notes."""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A node whose planner drives straight on, and fails for a while."""
    file = tmp_path / "node.yaml"
    file.write_text(CONFIG, encoding="utf-8")
    return file


def started(network: Network, config: Path, *arguments: str) -> Process:
    return network.node(config, *arguments, PYTHONPATH=str(HERE))


def drives(robot: Robot) -> None:
    """Let the robot drive, from where it is, along its way."""
    robot.says("waiting for a path")
    x, y, before = (robot.rows()[-1][name] for name in ("x", "y", "commands"))
    end = time.monotonic() + 10.0
    while robot.rows()[-1]["commands"] == before:  # a node that was killed seems to listen
        assert time.monotonic() < end
        robot.say(f"path {x} {y} {x + 50} {y}")
        time.sleep(0.5)
    robot.until(lambda row: row["speed"] > 0.5)


def stood_after(robot: Robot, node: Process, begin: float) -> float:
    """Return s from a time until the last velocity, which is zero, of a node that ends well."""
    assert node.ended() == 0, node.text()
    assert "Traceback" not in node.text(), node.text()
    last = robot.until(lambda row: True)
    assert last["speed"] == last["rate"] == 0.0
    return float(last["came"] - begin)


def test_failures_signals_and_sudden_deaths(network: Network, config: Path) -> None:
    robot = network.robot("--command", "Twist")
    node = started(network, config)
    drives(robot)
    failed = robot.says("the controller failed: 'in a mood'")
    robot.until(lambda row: row["speed"] == 0.0, failed["speed"] + 1.0)
    robot.until(lambda row: row["speed"] > 0.5)
    robot.say("lost")
    robot.until(lambda row: row["speed"] == 0.0, 3.0)
    robot.says("odometry is silent")
    robot.say("found")
    robot.until(lambda row: row["speed"] > 0.5)
    node.signal(signal.SIGINT)
    robot.until(lambda row: row["speed"] < 0.5)  # it brakes
    node.signal(signal.SIGINT)
    begin = robot.rows()[-1]["wall"]
    assert stood_after(robot, node, begin) < SOON

    node = started(network, config)
    drives(robot)
    node.signal(signal.SIGKILL)
    node.ended()
    number = robot.until(lambda row: True)["commands"]
    node = started(network, config)
    drives(robot)  # it goes on from the velocity that the robot has
    robot.until(lambda row: row["commands"] > number + 10)
    assert all(row["speed"] > 0.4 for row in robot.rows() if row["commands"] >= number)
    robot.signal(signal.SIGKILL)
    robot.ended()
    robot = network.robot("--command", "TwistStamped")  # takes another kind than before
    robot.until(lambda row: row["speed"] > 0.5)  # the node goes on with its path
    node.signal(signal.SIGTERM)
    stood_after(robot, node, 0.0)

    node = started(network, config, "--set", "node.stamped=false")
    said = robot.says("set stamped to true")["status"]
    assert "/cmd_vel is sent as geometry_msgs/msg/Twist, but its subscribers take" in said
    node.signal(signal.SIGTERM)
    assert node.ended() == 0
