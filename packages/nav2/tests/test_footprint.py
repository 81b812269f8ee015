"""What the recorded cases of the footprint do not show."""

import numpy as np

from wideberth.packages.nav2.tests.golden import costmap_of
from wideberth_nav2.costmap.footprint import RobotFootprint, line_cost


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
