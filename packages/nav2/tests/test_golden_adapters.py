"""The adapters of recorded cases take every form of a case, and fail where ours differs."""

from typing import Any

import numpy as np
import pytest

from wideberth.packages.nav2.tests import golden_footprint, golden_graceful
from wideberth.packages.nav2.tests.golden import Case
from wideberth.packages.nav2.tests.ticks import straight
from wideberth_nav2.controllers.local_controller import NO_VALID_CONTROL

SIDE = 60
RADIUS = 0.22
ROUND = {
    "use_radius": True, "robot_radius": RADIUS, "inscribed_radius": RADIUS * np.cos(np.pi / 16),
    "circumscribed_radius": RADIUS, "track_unknown": False,
}  # fmt: skip


def map_with(*cells: tuple[int, int, int]) -> Case:
    """A stored costmap of 3 m x 3 m about the origin with single costs (mx, my, cost)."""
    costs = np.zeros((SIDE, SIDE), int)
    for mx, my, cost in cells:
        costs[my, mx] = cost
    return {
        "width": SIDE, "height": SIDE, "resolution": 0.05, "origin_x": -1.5, "origin_y": -1.5,
        "data_rle": [[int(cost), 1] for cost in costs.ravel()],
    }  # fmt: skip


def circle(*queries: tuple[float, float, float, int]) -> Case:
    """A disc whose foremost corner lies in cell (34, 30) where it stands at the origin."""
    return {
        "kind": "footprint_cost_circle_16gon",
        "radius": RADIUS,
        "costmap": map_with((34, 30, 254), (30, 30, 253), (30, 34, 90)),
        "queries": [{"pose": [x, y, yaw], "cost": cost} for x, y, yaw, cost in queries],
    }


def test_costs_of_a_disc_are_compared() -> None:
    """Its outline alone counts, not the cell that it stands on; a vertex off the map is lethal."""
    golden_footprint.corners_radii_and_costs_are_equal(
        circle((0.0, 0.0, 0.0, 254), (-0.06, 0.0, 0.0, 90), (1.0, 1.0, 0.3, 0), (1.4, 0, 0, 254))
    )
    with pytest.raises(AssertionError):
        golden_footprint.corners_radii_and_costs_are_equal(circle((0.0, 0.0, 0.0, 253)))


def stuck(lethal: bool, **expect: Any) -> Case:
    """Graceful with an obstacle under the robot, or on a free map, at one tick."""
    blocked = [(mx, my, 254) for mx in range(28, 33) for my in range(28, 33)] if lethal else []
    return {
        "params": {}, "robot": ROUND, "costmap": map_with(*blocked),
        "path": straight(1.2, start=0.05).tolist(), "global_goal": [1.2, 0.0, 0.0],
        "ticks": [{"pose": [0.0, 0.0, 0.0], "speed_v": 0.0, "speed_w": 0.0, "expect": expect}],
    }  # fmt: skip


def test_graceful_throws_where_the_original_throws() -> None:
    golden_graceful.commands_are_equal(stuck(True, exception=NO_VALID_CONTROL, what="Collision"))
    state = {"do_initial_rotation": False, "safe_approach_angle": None}
    golden_graceful.commands_are_equal(stuck(True, exception=NO_VALID_CONTROL, **state))
    for wrong in (
        stuck(False, exception=NO_VALID_CONTROL),
        stuck(True, exception="InvalidPath"),
        stuck(True, exception=NO_VALID_CONTROL, do_initial_rotation=True),
        stuck(True, v=0.1, w=0.0, do_initial_rotation=False),
    ):
        with pytest.raises(AssertionError):
            golden_graceful.commands_are_equal(wrong)
