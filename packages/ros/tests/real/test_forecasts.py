"""Forecasts of people who are seen late, over a real ROS 2, to a planner that joins late."""

import json
import signal

import numpy as np

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network

PEER = ROOT / "packages/ros/tests/real/forecast_peer.py"
CELLS = "forecast.cells={horizon: 0.01, step: 0.01}"
RUN = "from wideberth.experiments.cli.app import main; main()"


def test_people_are_drawn_where_they_are_by_now(network: Network) -> None:
    config = ROOT / "examples" / "forecast.yaml"
    node = network.start("-c", RUN, "forecast", config, "--set", CELLS, name="forecast")
    crowd = network.start(PEER, name="crowd")
    assert crowd.ended(90.0) == 0, crowd.text() + node.text()
    found = json.loads(crowd.text().splitlines()[-1])
    assert len(found["off"]) >= 30, crowd.text() + node.text()
    assert abs(np.median(found["off"])) < 0.05  # and 0.15 m behind without the age
    assert 0.0 <= np.median(found["ages"]) < 0.1
    node.signal(signal.SIGINT)
    assert node.ended() == 0 and "forecasts" in node.text()
