"""The outline of a robot equals Nav2's: corners, radii and costs."""

import numpy as np

from wideberth.controllers.nav2.footprint import RobotFootprint, outline_cost
from wideberth.tests.controllers.nav2.golden import Case, Checks, costmap_of


def corners_radii_and_costs_are_equal(footprint: Case) -> None:
    if "radius" in footprint:
        check_corners(footprint)
    else:
        check_costs(footprint)


def check_corners(case: Case) -> None:
    expect = case["expect"]
    made = RobotFootprint.round_of(case["radius"], case.get("footprint_padding", 0.0))
    assert np.abs(made.vertices - expect["points"]).max() < 1e-12
    assert abs(made.inscribed - expect["inscribed_radius"]) < 1e-12
    assert abs(made.circumscribed - expect["circumscribed_radius"]) < 1e-12


def check_costs(case: Case) -> None:
    robot, costmap = RobotFootprint.of(case["footprint"]), costmap_of(case["costmap"])
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
