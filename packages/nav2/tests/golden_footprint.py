"""The outline of a robot equals Nav2's: corners, radii and costs."""

import numpy as np

from wideberth.packages.nav2.tests.golden import Case, Checks, costmap_of
from wideberth_nav2.costmap.footprint import RobotFootprint, outline_cost


def corners_radii_and_costs_are_equal(footprint: Case) -> None:
    if "queries" in footprint:
        check_costs(footprint)
    else:
        check_corners(footprint)


def robot_of(case: Case) -> RobotFootprint:
    """The polygon of a case, or the one that stands for its disc."""
    padding = case.get("footprint_padding", 0.0)
    if "footprint" in case:
        return RobotFootprint.of(case["footprint"], padding)
    return RobotFootprint.round_of(case["radius"], padding)


def check_corners(case: Case) -> None:
    made, expect = robot_of(case), case["expect"]
    assert np.abs(made.vertices - expect["points"]).max() < 1e-12
    assert abs(made.inscribed - expect["inscribed_radius"]) < 1e-12
    assert abs(made.circumscribed - expect["circumscribed_radius"]) < 1e-12


def check_costs(case: Case) -> None:
    robot, costmap = robot_of(case), costmap_of(case["costmap"])
    for query in case["queries"]:
        pose = np.array(query["pose"])
        assert robot.cost(costmap, pose) == query["cost"], pose
        plain = outline_cost(
            costmap.cells, *costmap.origin, costmap.resolution, robot.vertices, *pose
        )
        assert plain == query["cost"], pose


CHECKS: dict[str, Checks] = {
    "footprint": (corners_radii_and_costs_are_equal,),
}
