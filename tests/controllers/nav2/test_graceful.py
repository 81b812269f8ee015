"""What the recorded cases of the graceful controller do not show."""

import numpy as np
import pytest

from wideberth.controllers.nav2 import _graceful_rollout as rollout
from wideberth.controllers.nav2.graceful import Graceful, compiled
from wideberth.controllers.nav2.smooth_control_law import LawParameters
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.controllers.nav2.ticks import FREE, straight, tick, walls


def dear(cost: int) -> Costmap:
    """A free costmap with a strip of this cost across the straight way ahead."""
    cells = (walls((0.25, -0.05, 0.45, 0.05)).cells == 254) * np.uint8(cost)
    return Costmap(cells.astype(np.uint8), FREE.resolution, FREE.origin)


def test_an_approach_that_is_safe_is_not_changed() -> None:
    controller = Graceful()
    controller.new_path(straight(0.7))
    answer = controller.velocity(tick(straight(0.7), costmap=dear(250)))
    assert answer.twist is not None and controller.safe_approach_angle is None
    assert answer.twist.angular == pytest.approx(0.0, abs=1e-9)


def test_the_outline_grows_with_the_speed_unless_it_is_a_triangle() -> None:
    beside = walls((0.3, 0.21, 0.6, 0.26))
    square = 0.19 * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    pose = (0.3, 0.0, 0.0)
    for vertices, hit in ((square, True), (square[:3], False)):
        ground = rollout.Ground(
            beside.cells, *beside.origin, 0.05, (0.0, 0.0, 0.0), vertices, False, False
        )
        assert not compiled().hits(ground, pose, 1.0)
        assert compiled().hits(ground, pose, 1.25) == hit == rollout.hits(ground, pose, 1.25)


def test_what_numba_compiles_is_what_is_written() -> None:
    ground = rollout.Ground(
        dear(252).cells, *FREE.origin, 0.05, (0.1, 0.0, 0.2), np.zeros((3, 2)), True, False
    )
    law = LawParameters(2.0, 1.0, 0.4, 2.0, 1.5, 2.5, 0.1, 0.5, 1.0)
    turning, growth = rollout.Turning(0.5, 1.0, 0.25, 0.75), rollout.Growth(0.5, 0.25, 0.5)
    for target, first in (((0.8, 0.3, 0.5), False), ((0.1, 0.9, 0.0), True)):
        arguments = ground, law, turning, growth, target, False, first, True
        plain, fast = rollout.rolled_out(*arguments), compiled().rolled_out(*arguments)
        assert plain[0] == fast[0] and plain[2:] == pytest.approx(fast[2:], abs=2e-6)
        assert plain[1] == pytest.approx(fast[1], abs=1e-5)
        assert rollout.highest_cost(ground, fast[1]) == compiled().highest_cost(ground, fast[1])
        time = rollout.duration(law, target, False, fast[1])
        assert time == pytest.approx(compiled().duration(law, target, False, fast[1]), rel=1e-4)


def test_reversing_and_a_first_turn_exclude_each_other() -> None:
    with pytest.raises(WideberthError, match="exclude each other"):
        Graceful(allow_backward=True)


def test_a_speed_limit_binds_and_is_lifted() -> None:
    speeds = []
    controller = Graceful()
    for value, percentage in ((0.0, False), (0.2, False), (50.0, True), (0.0, False)):
        controller.limit_speed(value, percentage)
        controller.new_path(straight(1.4))
        answer = controller.velocity(tick(straight(1.4)))
        assert answer.twist is not None
        speeds.append(float(answer.twist.linear[0]))
    assert speeds[0] == speeds[3] > speeds[2] > speeds[1] > 0.0
