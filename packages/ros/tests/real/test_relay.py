"""A planner whose Python has no rclpy drives over a relay in a Python that has it."""

import os
import signal
import sys
from itertools import pairwise
from pathlib import Path

from wideberth.packages.ros.tests.helpers.ros_processes import (
    ROOT,
    Network,
    Process,
    Robot,
    python_of,
)

GOALS = ("--set", "node.follows={type: goal, topic: /goal_pose}")
STEP = 1.0 * 0.05
"""m/s, by which the robot can brake in a period."""
ENTER = "import os, sys; os.execv(sys.argv[1], sys.argv[1:])"


def relayed(network: Network) -> tuple[Robot, Process]:
    """Start a robot, and a node of this Python that waits for a goal."""
    robot = network.robot("--people", 2)
    command = Path(sys.executable).with_name("wideberth")
    relay = ("--relay", python_of(network.distribution))
    words = [command, "node", ROOT / "examples/node.yaml", *GOALS, *relay]
    node = network.start("-c", ENTER, *words, name="node", **network.messages())
    robot.until(lambda row: row["status"] == "waiting for a goal")
    robot.say("goal 6 0 0")
    robot.until(lambda row: abs(row["speed"]) > 0.2)
    return robot, node


def test_a_planner_that_ends_brakes_over_the_relay(network: Network) -> None:
    robot, node = relayed(network)
    begin = len(robot.rows())
    os.kill(node.child.pid, signal.SIGINT)
    assert node.ended() == 0, node.text()
    speeds = [abs(row["speed"]) for row in robot.rows()[begin:]]
    assert speeds[-1] == 0.0
    assert max(before - after for before, after in pairwise(speeds)) < 4 * STEP


def test_where_the_planner_is_killed_the_relay_stops_the_robot(network: Network) -> None:
    robot, node = relayed(network)
    os.kill(node.child.pid, signal.SIGKILL)
    begin = robot.rows()[-1]["wall"]
    stood = robot.until(lambda row: row["speed"] == row["rate"] == 0.0, 5.0)
    assert stood["wall"] - begin < 0.4, "the robot's own watch has not stopped it"
