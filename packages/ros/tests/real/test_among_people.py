"""A real node drives a real robot to goals among people who move."""

import json
import math
import signal
from itertools import pairwise
from typing import Any

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network, Process, Robot

HERE = ROOT / "packages/ros/tests/real"
GOALS = ("--set", "node.follows={type: goal, topic: /goal_pose}")
NEAR, TURNED = 0.25, 0.25
"""m and rad, of a robot that has arrived."""
BRAKING = 1.0
"""m/s^2; what the robot can do."""


def near(row: dict[str, Any], x: float, y: float, yaw: float) -> bool:
    """Whether the robot stands at a goal."""
    away = ((row["x"] - x) ** 2 + (row["y"] - y) ** 2) ** 0.5
    stands = bool(row["speed"] == row["rate"] == 0.0)
    return stands and away <= NEAR and abs(math.remainder(row["yaw"] - yaw, math.tau)) <= TURNED


@pytest.mark.parametrize("idle", [20, pytest.param(40, marks=pytest.mark.slow)])
def test_goals_a_new_goal_no_sight_and_an_end(network: Network, idle: int) -> None:
    """A drive among idle participants: two goals, people unseen for a while, SIGINT on the way."""
    if network.keeper is None and idle > 30:
        pytest.skip("Fast DDS finds no more participants without multicast")
    crowd = network.start(HERE / "crowd_peer.py", idle, name="crowd")
    robot = network.robot("--people", 2)
    node = network.node(ROOT / "examples/node.yaml", *GOALS)
    looker = network.start(HERE / "graph_peer.py", name="looker")
    assert looker.ended() == 0, looker.text()
    looks_right(json.loads(looker.text().splitlines()[-1]))
    robot.says("waiting for a goal")

    robot.say("goal 2.7 2 0")
    robot.until(lambda row: abs(row["speed"]) > 0.3)
    robot.say("goal 2.7 -0.5 0")  # takes the place of the first
    unseen = robot.until(lambda row: row["x"] > 0.5)
    robot.say("silent")
    stood = robot.until(lambda row: row["speed"] == 0.0)
    assert stood["time"] - unseen["time"] < 0.5 + abs(unseen["speed"]) / BRAKING + 1.0
    robot.says("obstacles are silent")
    robot.say("seen")
    robot.until(lambda row: abs(row["speed"]) > 0.1)
    robot.until(lambda row: near(row, 2.7, -0.5, 0.0))
    assert min(row["clearance"] for row in robot.rows() if row["speed"]) > 0.0

    robot.say("goal 0 0 0")
    robot.until(lambda row: abs(row["speed"]) > 0.3)
    node.signal(signal.SIGINT)
    ends_in_a_stand(robot, node)
    assert crowd.child.poll() is None


def ends_in_a_stand(robot: Robot, node: Process) -> None:
    """The node ends well; its last velocities go down to zero as the robot can brake."""
    begin = robot.rows()[-1]
    assert node.ended() == 0, node.text()
    last = robot.until(lambda row: True)
    ramp = [row for row in robot.rows() if row["wall"] >= begin["wall"]]
    assert last["speed"] == last["rate"] == 0.0, ramp
    speeds = [abs(row["speed"]) for row in ramp]
    assert all(after <= before + 1e-9 for before, after in pairwise(speeds[4:])), speeds
    assert "Traceback" not in node.text()


def looks_right(found: dict[str, Any]) -> None:
    """What the command line of ROS 2 would show of the node."""
    assert found["patience"] == [0.5, 0.75]
    assert found["changed"] == found["back"] == [True, ""]
    assert found["refused"] == [False, "node.patience is -1; wanted a finite number above 0"]
    assert found["fixed"] == [False, "clean the node up first: rate is in use"]
    assert {"odometry", "rate", "sees.topic", "follows.tolerance", "use_sim_time"} <= set(
        found["names"]
    )
    assert [text.partition(",")[0] for text in found["described"]] == ["s", "Hz"]
    assert found["state"] == "active"
    assert set(found["ways"]) == {"deactivate", "shutdown"}
    assert found["actions"] == {
        "/follow_path": ["nav2_msgs/action/FollowPath"],
        "/navigate_to_pose": ["nav2_msgs/action/NavigateToPose"],
    }
    publishes, listens = found["publishes"], found["listens"]
    assert publishes["/cmd_vel"] == ["geometry_msgs/msg/TwistStamped"]
    assert publishes["/wideberth/plan"] == ["nav_msgs/msg/Path"]
    assert publishes["/diagnostics"] == ["diagnostic_msgs/msg/DiagnosticArray"]
    assert listens["/odom"] == ["nav_msgs/msg/Odometry"]
    assert listens["/obstacles"] == ["nav2_dynamic_msgs/msg/ObstacleArray"]
    assert listens["/goal_pose"] == ["geometry_msgs/msg/PoseStamped"]
    assert listens["/tf"] == listens["/tf_static"] == ["tf2_msgs/msg/TFMessage"]


@pytest.mark.slow
def test_twenty_drives_among_eight(network: Network) -> None:
    """To and fro, 12 m each time; what the node counted is printed."""
    robot = network.robot("--people", 8, "--spacing", 3.0)
    node = network.node(ROOT / "examples/node.yaml", *GOALS)
    robot.says("waiting for a goal")
    took, stood = [], []
    for number in range(20):
        x, yaw = (12.0, 0.0) if number % 2 == 0 else (0.0, math.pi)
        begin = robot.rows()[-1]["time"]
        robot.say(f"goal {x} 0 {yaw}")
        there = robot.until(lambda row, x=x: math.hypot(row["x"] - x, row["y"]) < NEAR, 120.0)
        end = robot.until(lambda row, x=x, yaw=yaw: near(row, x, 0.0, yaw), 10.0)
        took.append(end["time"] - begin)
        stood.append(end["time"] - there["time"])
    clearance = min(row["clearance"] for row in robot.rows() if row["speed"])
    node.signal(signal.SIGTERM)
    ends_in_a_stand(robot, node)
    print(f"took {min(took):.0f} to {max(took):.0f} s, stood {max(stood):.1f} s after; clearance "
          f"{clearance:.2f} m; {node.text().splitlines()[-3:]}")  # fmt: skip
    assert max(stood) < 3.0 + 3.0, "braking, and a turn on the spot to the goal's heading"
    assert clearance > 0.0
