"""What the recorded cases of the graceful controller do not show."""

from itertools import pairwise
from math import hypot

import numpy as np
import pytest

from wideberth.framework.values.costmap import Costmap
from wideberth.packages.nav2.tests.ticks import FREE, straight, tick, walls
from wideberth_nav2.controllers import _graceful_rollout as rollout
from wideberth_nav2.controllers.graceful import Graceful, compiled
from wideberth_nav2.controllers.smooth_control_law import LawParameters, regular_velocity


def dear(cost: int, low: float = -0.05) -> Costmap:
    """A free costmap with a strip of this cost across the straight way ahead."""
    cells = (walls((0.25, low, 0.45, 0.05)).cells == 254) * np.uint8(cost)
    return Costmap(cells.astype(np.uint8), FREE.resolution, FREE.origin)


def test_an_approach_that_is_safe_is_not_changed() -> None:
    controller = Graceful()
    controller.new_path(straight(0.7))
    answer = controller.velocity(tick(straight(0.7), costmap=dear(250)))
    assert answer.twist is not None and controller._approach is None
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
    turning, growth = rollout.Turning(0.5, 1.0, 0.25, 0.75), rollout.RolloutGrowth(0.5, 0.25, 0.5)
    for target, first in (((0.8, 0.3, 0.5), False), ((0.1, 0.9, 0.0), True)):
        arguments = ground, law, turning, growth, target, False, first, True
        plain, fast = rollout.rolled_out(*arguments), compiled().rolled_out(*arguments)
        assert plain[0] == fast[0] and plain[2:] == pytest.approx(fast[2:], abs=2e-6)
        assert plain[1] == pytest.approx(fast[1], abs=1e-5)
        assert rollout.highest_cost(ground, fast[1]) == compiled().highest_cost(ground, fast[1])
        time = rollout.duration(law, target, False, fast[1])
        assert time == pytest.approx(compiled().duration(law, target, False, fast[1]), rel=1e-4)


def test_a_first_turn_forbids_to_drive_backwards() -> None:
    plan = straight(1.0)
    plan[:, 0] *= -1.0  # leads to the back
    ahead, back = (
        Graceful(allow_backward=True),
        Graceful(allow_backward=True, initial_rotation=False),
    )
    assert (ahead.allow_backward, back.allow_backward) == (False, True)
    speeds = [float(one.velocity(tick(plan)).twist.linear[0]) for one in (ahead, back)]
    assert speeds[0] == 0.0 > speeds[1]  # the one turns first, the other reverses


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


def test_a_speed_limit_in_metres_per_second_limits_the_turns_alike() -> None:
    controller = Graceful(v_linear_max=0.5, v_angular_max=1.0, rotation_scaling_factor=1.0)
    behind = straight(1.0)
    behind[:, 0] *= -1.0
    rates = []
    for value, percentage in ((0.0, False), (0.2, False), (40.0, True)):
        controller.limit_speed(value, percentage)
        controller.new_path(behind)
        twist = controller.velocity(tick(behind)).twist
        assert twist is not None
        rates.append(abs(float(twist.angular)))
    assert rates == pytest.approx([np.pi, 0.4 * np.pi, 0.4 * np.pi])


def sought(
    controller: Graceful, ground: rollout.Ground, stored: float | None
) -> tuple[float | None, tuple[float, float]]:
    """Seek an approach to (0.7, 0) in a plain loop; return the heading and the first command."""
    law = LawParameters(2.0, 1.0, 0.4, 2.0, 1.5, 2.5, 0.1, 0.5, 1.0)
    turning, growth = rollout.Turning(0.5, 1.0, 0.25, 0.75), rollout.RolloutGrowth(0.5, 0.25, 0.5)
    best, command = np.inf, (0.0, 0.0)
    for i in range(63):
        angle = 0.1 * i + (stored or 0.0)
        target = (0.7, 0.0, angle)
        free, poses, *first = compiled().rolled_out(
            ground, law, turning, growth, target, False, False, True
        )
        if not free:
            continue
        time, highest = 0.0, 0
        for before, after in pairwise(poses.tolist()):
            speed = abs(regular_velocity(law, target, tuple(before), False)[0])
            time += hypot(after[0] - before[0], after[1] - before[1]) / max(speed, 1e-3)
        for x, y, _ in poses.tolist():
            highest = max(highest, rollout.cell_cost(ground, x, y))
        if time < best:
            best = time
            if highest < 252:
                command = (first[0], first[1])
                if angle == stored:
                    break
                stored = angle
    return stored, command


def test_the_approach_is_the_quickest_one_that_is_safe() -> None:
    controller, plan = Graceful(), straight(0.7)
    seen = tick(plan, costmap=dear(252, low=0.0))
    ground, _ = Graceful.seen(seen)
    controller.new_path(plan)
    headings = []
    stored: float | None = None
    for _ in range(4):
        stored, command = sought(controller, ground, stored)
        answer = controller.velocity(seen)
        assert answer.twist is not None
        assert controller._approach == stored is not None
        found = (float(answer.twist.linear[0]), float(answer.twist.angular))
        assert found == pytest.approx(command, abs=1e-9) and abs(found[1]) > 0.1
        headings.append(stored)
    assert headings[-2] == headings[-1]  # the heading found before is kept
    controller.new_path(plan)
    assert controller._approach is None
