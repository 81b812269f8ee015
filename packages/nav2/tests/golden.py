"""Cases recorded from Nav2: what the tests of its controllers share."""

from collections.abc import Callable
from typing import Any

import numpy as np

from wideberth.framework.values.costmap import Costmap
from wideberth_nav2.controllers.local_controller import Answer
from wideberth_nav2.costmap.footprint import RobotFootprint

Case = dict[str, Any]
Checks = tuple[Callable[[Case], None], ...]
"""What is compared with each case of a file."""


def costmap_of(stored: Case) -> Costmap:
    """The costmap of a case; one that has a geometry alone is free."""
    shape = (stored["height"], stored["width"])
    values, counts = zip(*stored.get("data_rle", [[0, shape[0] * shape[1]]]), strict=True)
    cells = np.repeat(values, counts).reshape(shape).astype(np.uint8)
    return Costmap(cells, stored["resolution"], (stored["origin_x"], stored["origin_y"]))


def footprint_of(robot: Case) -> RobotFootprint:
    """The robot of a case, whose radii have to be those that Nav2 computed."""
    if robot["use_radius"]:
        made = RobotFootprint.round_of(robot["robot_radius"])
    else:
        made = RobotFootprint.of(robot["footprint"])
    assert abs(made.inscribed - robot["inscribed_radius"]) < 1e-12
    assert abs(made.circumscribed - robot["circumscribed_radius"]) < 1e-12
    return made


def assert_equal_answer(answer: Answer, expect: Case, tolerance: float) -> None:
    """The exception by its name, or the velocity within the tolerance."""
    if "exception" in expect:
        assert answer.twist is None and answer.reason
        assert answer.error == expect["exception"]
        return
    assert answer.twist is not None, answer.reason
    assert abs(answer.twist.linear[0] - expect["v"]) <= tolerance
    assert abs(answer.twist.angular - expect["w"]) <= tolerance
