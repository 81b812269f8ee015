"""Goals of Nav2's action FollowPath, in simulated time that is faster or slower than ours."""

import math
import signal
from statistics import median

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network

SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")
NO_PEOPLE = ("--set", "node.sees=null")


@pytest.mark.parametrize("factor", [5.0, pytest.param(0.5, marks=pytest.mark.slow)])
def test_goals_of_follow_path(network: Network, factor: float) -> None:
    robot = network.robot("--factor", factor)
    node = network.node(ROOT / "examples/node.yaml", *NO_PEOPLE, *SIMULATED)
    robot.until(lambda row: row["read"])  # a goal in a frame that it does not know is refused
    robot.says("waiting for a path")
    robot.says("waiting for a path")

    robot.say("action 0 0 2 0")
    arrived = robot.until(lambda row: row["ends"] == ["succeeded 0"], 30.0)
    assert arrived["speed"] < 0.1
    stands = robot.until(lambda row: row["speed"] == 0.0, 3.0)
    assert math.hypot(stands["x"] - 2.0, stands["y"]) < 0.25
    moving = [row for row in robot.rows() if row["speed"] > 0.0]
    left = [row["feedback"] for row in moving if not math.isnan(row["feedback"])]
    assert left[0] > 1.5 and left[-1] < 0.5 and left == sorted(left, reverse=True)
    assert moving[-1]["time"] - moving[0]["time"] > 4.0, "s of simulated time"
    late = [abs(row["time"] - row["stamp"]) for row in moving]
    assert median(late) < 0.1 + 0.25 * factor, "commands are stamped in simulated time"

    robot.say("action 2 0 6 0")
    robot.until(lambda row: row["speed"] > 0.2)
    robot.say("action 2 0 6 1")  # takes the place of the one before
    robot.until(lambda row: row["ends"][1:] == ["aborted 0"])
    robot.say("cancel")
    robot.until(lambda row: row["ends"][2:] == ["canceled 0"])
    robot.until(lambda row: row["speed"] == 0.0)
    robot.says("waiting for a path")

    robot.say("action 4 0 8 0")
    robot.until(lambda row: row["speed"] > 0.2)
    node.signal(signal.SIGINT)
    assert node.ended() == 0, node.text()
    assert "Traceback" not in node.text() and "Error" not in node.text(), node.text()
    last = robot.until(lambda row: True)
    assert last["speed"] == last["rate"] == 0.0
    assert last["ends"][3:] == ["aborted 100"], "UNKNOWN: the planner leaves"
