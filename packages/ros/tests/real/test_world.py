"""`wideberth world` and a planner of rclpy: two processes, real topics."""

import json
import signal
from typing import Any

import pytest
import yaml

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.shipped_configs import read_experiment, shipped_text
from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network, Process, python_of
from wideberth.packages.ros.tests.test_from_outside import OF_PLANS
from wideberth_ros.from_outside import chosen_task

PLANNER = ROOT / "packages" / "ros" / "tests" / "helpers" / "rclpy_planner.py"
CASE = "controller=ours"


def world(network: Network, *arguments: object) -> Process:
    """Start the world."""
    command = python_of(network.distribution).with_name("wideberth")
    return network.start(command, "world", "crowdnav", "--case", CASE, *arguments, name="world")


def in_process(seed: int) -> Row:
    """Return the row of an episode that is driven in this process, without what plans say."""
    experiment, _ = read_experiment("crowdnav", [])
    row = experiment.measure(chosen_task(experiment, [CASE], seed)).rows[0]
    return {name: value for name, value in row.items() if name not in OF_PLANS}


def outcomes(planner: Process, robot: Process, seconds: float) -> list[dict[str, Any]]:
    """Return what the world said after each episode."""
    assert planner.ended(seconds) == 0, planner.text() + robot.text()
    return [json.loads(line) for line in planner.text().splitlines() if line.startswith("{")]


def test_stepped_episodes_are_those_of_the_process_itself(network: Network) -> None:
    robot = world(network, "--stepped")
    planner = network.start(
        PLANNER, "crowdnav", CASE, "--stepped", "--episodes", 2, name="planner"
    )
    found = outcomes(planner, robot, 90.0)
    for seed, said in enumerate(found):
        wanted = in_process(seed)
        plain = json.loads(json.dumps({name: said[name] for name in wanted}))
        assert plain == json.loads(json.dumps(_finite(wanted)))
        assert said["outcome"] == said["judged_outcome"] == "success"
    robot.signal(signal.SIGINT)
    assert robot.ended() == 0 and "success after" in robot.text(), robot.text()


def _finite(row: Row) -> Row:
    """Return a row as JSON has it, without numbers that are none."""
    return {name: None if value != value or value in (float("inf"),) else value
            for name, value in row.items()}  # fmt: skip


def test_our_own_node_steps_through_the_same_episode(network: Network) -> None:
    config = network.folder / "node.yaml"
    shipped = yaml.safe_load(shipped_text("crowdnav"))
    node = {
        "follows": {"type": "path", "topic": "/reference", "tolerance": 0.01},
        "sees": {"type": "obstacles", "deviation": 0},
        "stepped": True,
    }
    planner = shipped["controllers"]["ours"]
    config.write_text(yaml.safe_dump({"planner": planner, "node": node}))
    robot = world(network, "--stepped")
    network.node(config, "--ros-args", "-p", "use_sim_time:=true")
    asks = network.start(PLANNER, "crowdnav", CASE, "--watch", name="asks")
    (said,) = outcomes(asks, robot, 90.0)
    wanted = json.loads(json.dumps(_finite(in_process(0))))
    assert {name: said[name] for name in wanted} == wanted
    assert said["outcome"] == "success"


@pytest.mark.parametrize("kind", ["--plain", "--stamped"])
def test_in_real_time_the_verdict_is_the_same(network: Network, kind: str) -> None:
    robot = world(network, "--seed", 3, "--rate", 2)
    planner = network.start(
        PLANNER, "crowdnav", CASE, *[kind] * (kind == "--plain"), name="planner"
    )
    (said,) = outcomes(planner, robot, 90.0)
    assert (said["seed"], said["outcome"]) == (3, "success")
    assert in_process(3)["outcome"] == "success"


def test_a_planner_that_falls_silent_lets_the_robot_stand(network: Network) -> None:
    settings = ("settings.crowdnav.deadlock_after=3", "scenarios.circle.humans=0")
    robot = world(network, "--rate", 5, *(part for one in settings for part in ("--set", one)))
    planner = network.start(PLANNER, "crowdnav", CASE, "--stop-after", 2, name="planner")
    (said,) = outcomes(planner, robot, 90.0)
    assert said["outcome"] == "deadlock" and 4.5 < said["duration"] < 7.0
