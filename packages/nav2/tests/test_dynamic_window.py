"""What the recorded cases of the dynamic window do not show."""

import pytest

from wideberth_nav2.controllers.regulated_pure_pursuit import nearest_to_curvature


@pytest.mark.parametrize(
    ("angular", "wanted"),
    [((0.2, 0.6), 0.2), ((-0.6, -0.2), -0.2), ((-0.1, 0.3), 0.0)],
)
def test_straight_on_a_robot_that_turns_stops_turning_as_far_as_it_can(
    angular: tuple[float, float], wanted: float
) -> None:
    assert nearest_to_curvature((0.1, 0.4), angular, 0.5, 0.0, 1.0) == (0.4, wanted)
    assert nearest_to_curvature((-0.4, -0.1), angular, -0.5, 0.0, -1.0) == (-0.4, wanted)
