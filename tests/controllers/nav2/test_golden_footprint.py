"""The outline of a robot equals Nav2's: corners, radii and costs."""

import numpy as np
import pytest

from wideberth.controllers.nav2.footprint import RobotFootprint, line_cost, outline_cost
from wideberth.tests.controllers.nav2.golden import Case, costmap_of, parametrize


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    parametrize(metafunc, "footprint")


def test_corners_radii_and_costs_are_equal(footprint: Case) -> None:
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


def test_unknown_exceeds_lethal_only_where_it_comes_first() -> None:
    cells = np.zeros((1, 4), np.uint8)
    cells[0, 1], cells[0, 2] = 255, 254
    assert line_cost(cells, 0, 0, 1, 0) == 255
    assert line_cost(cells, 0, 0, 3, 0) == 254


def test_a_corner_off_the_map_is_lethal() -> None:
    costmap = costmap_of(
        {"width": 9, "height": 9, "resolution": 0.1, "origin_x": 0, "origin_y": 0}
    )
    robot = RobotFootprint.round_of(0.2)
    assert robot.cost(costmap, np.array([0.45, 0.45, 0.3])) == 0
    assert robot.cost(costmap, np.array([0.15, 0.45, 0.3])) == 254
    assert robot.cost(costmap, np.array([0.45, 0.75, 0.3])) == 254
