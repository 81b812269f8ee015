"""The rotation shim turns first, then hands over."""

import numpy as np
import pytest

from wideberth.packages.nav2.tests.ticks import Scripted, straight, tick, walls
from wideberth_nav2.controllers.local_controller import CONTROLLER_EXCEPTION, NO_VALID_CONTROL
from wideberth_nav2.controllers.rotation_shim import RotationShim


def shim(**settings: object) -> tuple[RotationShim, Scripted]:
    primary = Scripted()
    made = RotationShim(primary, **settings)  # type: ignore[arg-type]
    made.new_path(straight(3.0))
    return made, primary


def test_it_turns_until_the_path_is_ahead_and_not_again() -> None:
    made, primary = shim()
    yaw, rate, turned = 2.0, 0.0, 0
    for _ in range(200):
        seen = tick(straight(3.0), (0.0, 0.0, yaw), speed=np.array([0.0, 0.0, rate]))
        answer = made.velocity(seen)
        assert answer.twist is not None
        if primary.ticks:
            break
        assert answer.twist.linear == (0.0, 0.0) and answer.twist.angular < 0.0
        rate = float(answer.twist.angular)
        yaw += 0.05 * rate
        turned += 1
    assert turned > 5 and abs(yaw) <= 0.3925  # not 0.785: it turns on once it turns
    made.velocity(tick(straight(3.0), (0.0, 0.0, 2.0)))
    assert len(primary.ticks) == 2


def test_within_the_threshold_it_does_not_begin() -> None:
    made, primary = shim()
    made.velocity(tick(straight(3.0), (0.0, 0.0, 0.78)))
    assert primary.ticks


def test_its_yaw_rate_grows_with_the_measured_one_and_stops_in_time() -> None:
    made, _ = shim()
    answer = made.velocity(tick(straight(3.0), (0.0, 0.0, 2.0), speed=np.array([0.0, 0.0, -0.4])))
    assert answer.twist is not None and answer.twist.angular == pytest.approx(-0.4 - 3.2 / 20)
    fast = np.array([0.0, 0.0, -9.0])
    answer = made.velocity(tick(straight(3.0), (0.0, 0.0, 0.5), speed=fast))
    assert answer.twist is not None
    assert answer.twist.angular == pytest.approx(-np.sqrt(2.0 * 3.2 * 0.5))


def test_open_loop_starts_from_its_own_last_yaw_rate() -> None:
    made, _ = shim(closed_loop=False)
    rates = [made.velocity(tick(straight(3.0), (0.0, 0.0, 2.0))).twist for _ in range(3)]
    assert [r.angular for r in rates] == pytest.approx([-0.16, -0.32, -0.48])  # type: ignore[union-attr]


def test_a_blocked_turn_is_refused() -> None:
    beside = walls((0.0, 0.15, 0.5, 0.3))
    made, primary = shim()
    answer = made.velocity(tick(straight(3.0), (0.0, 0.0, 2.0), costmap=beside))
    assert answer.twist is None and answer.error == NO_VALID_CONTROL and not primary.ticks


def test_a_plan_of_one_pose_is_an_exception() -> None:
    made, _ = shim()
    answer = made.velocity(tick(straight(0.0), (0.0, 0.0, 2.0)))
    assert answer.error == CONTROLLER_EXCEPTION


def test_it_turns_once_for_a_goal_if_so_wished() -> None:
    made, primary = shim(rotate_to_heading_once=True)
    made.velocity(tick(straight(3.0)))
    made.new_path(straight(3.0))
    made.velocity(tick(straight(3.0), (0.0, 0.0, 2.0)))
    assert len(primary.ticks) == 2
    made.new_path(straight(2.0))
    made.velocity(tick(straight(2.0), (0.0, 0.0, 2.0)))
    assert len(primary.ticks) == 2


def test_it_turns_at_the_goal_if_so_wished() -> None:
    made, primary = shim(rotate_to_goal_heading=True)
    plan = straight(0.1)
    answer = made.velocity(tick(plan, (0.1, 0.0, -0.3), goal=np.array([0.1, 0.0, 0.5])))
    assert answer.twist is not None and answer.twist.angular > 0.0 and not primary.ticks
