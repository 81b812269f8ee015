"""What is said before an episode begins."""

import logging

import pytest

from wideberth import recommended
from wideberth.experiments.engine.closed_loop import check_starts
from wideberth.robots import Unicycle
from wideberth.simulation.scenarios.doorway import Doorway


@pytest.mark.parametrize(("radius", "warns"), [(0.3, False), (0.34, True)])
def test_a_robot_that_is_too_wide_for_a_door_is_said_to_be(
    radius: float, warns: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """The door is 0.72 m wide; at walls the robot keeps 0.05 m."""
    robot = Unicycle(radius=radius)
    planner = recommended(robot, 0.5, quiet=True, predictor="kalman")
    with caplog.at_level(logging.WARNING, logger="wideberth"):
        check_starts({"": Doorway()}, robot, {"ours": planner})
    assert ("does not fit: no way within 3 m of its path is 0.78 m wide" in caplog.text) is warns
