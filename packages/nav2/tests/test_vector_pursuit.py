"""Vector pursuit aims at the point and the heading that the original takes."""

from math import atan2

import numpy as np
import pytest

from wideberth_nav2.controllers.vector_pursuit import VectorPursuit

PLAN = np.array([[0.1, 0.0, 2.0], [0.4, 0.1, -1.0], [0.7, 0.4, 0.5], [0.8, 0.9, 3.0]])
"""A bent plan in the robot's frame; its yaws have nothing to do with its steps."""


@pytest.mark.parametrize(
    ("reach", "place", "step"),
    [(0.05, 0, 1), (0.35, 1, 1), (0.7, 2, 2), (1.1, 3, 3), (5.0, 3, 3)],
)
def test_a_pose_of_the_plan_has_the_heading_of_the_step_that_ends_at_it(
    reach: float, place: int, step: int
) -> None:
    """The first pose has that of the step that begins there."""
    dx, dy = PLAN[step, :2] - PLAN[step - 1, :2]
    found = VectorPursuit(
        lookahead_dist=reach, use_interpolation=False, use_heading_from_path=False
    ).target(PLAN)
    assert found == pytest.approx([*PLAN[place, :2], atan2(dy, dx)], abs=1e-12)
    kept = VectorPursuit(lookahead_dist=reach, use_interpolation=False).target(PLAN)
    assert kept == pytest.approx(PLAN[place], abs=1e-12)
