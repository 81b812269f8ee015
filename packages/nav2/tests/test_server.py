"""The controller server: order of steps, tolerance of failures, and every result by its name."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.packages.nav2.tests.ticks import FREE, ROBOT, Scripted, straight
from wideberth_nav2.controllers.local_controller import INVALID_PATH, Answer
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.path_handler import PathHandler
from wideberth_nav2.server.server import (
    ControllerServer,
    ProgressChecker,
    ServerStatus,
    ServerView,
)

LATE = 0.2
REFUSED = Answer.refusal("all is blocked")


def sight(time: float = 0.0, x: float = 0.0, updated: float | None = None) -> ServerView:
    shown = time if updated is None else updated
    return ServerView(time, np.array([x, 0.0, 0.0]), np.zeros(3), FREE, shown, ROBOT)


def server(controller: Scripted, **settings: float) -> ControllerServer:
    made = ControllerServer(
        controller, PathHandler(), GoalChecker(), ProgressChecker(), **settings
    )
    made.begin(straight(3.0), 0.0)
    return made


def test_a_command_is_passed_on() -> None:
    controller = Scripted()
    step = server(controller).tick(sight(), LATE)
    assert step.status is ServerStatus.RUNNING and step.twist is not None
    assert step.twist.linear == (0.2, 0.0) and step.twist.angular == 0.1
    assert controller.calls == ["new_path", "velocity"]


def test_the_goal_is_tested_before_the_controller_is_asked() -> None:
    controller = Scripted()
    following = server(controller)
    following.begin(straight(0.2), 0.0)
    step = following.tick(sight(), LATE)
    assert step.status is ServerStatus.SUCCEEDED and step.twist == step.twist
    assert controller.calls[-1] == "reset" and "velocity" not in controller.calls


def test_a_small_speed_is_none() -> None:
    controller = Scripted()
    following = server(controller, min_x_velocity_threshold=0.01)
    seen = replace(sight(), speed=np.array([0.009, 0.2, 0.0]))
    following.tick(seen, LATE)
    assert controller.ticks[0].speed.tolist() == [0.0, 0.2, 0.0]


def test_without_tolerance_the_first_refusal_ends_the_action() -> None:
    controller = Scripted([REFUSED])
    step = server(controller).tick(sight(), LATE)
    assert step.status is ServerStatus.NO_VALID_CONTROL and step.reason == "all is blocked"
    assert step.twist is not None and step.twist.linear == (0.0, 0.0)
    assert controller.calls[-1] == "reset"


def test_refusals_are_forgiven_until_the_patience_is_exceeded() -> None:
    going = Answer(Twist((0.3, 0.0)))
    controller = Scripted([going, REFUSED, REFUSED, REFUSED, going, REFUSED, REFUSED])
    following = server(controller, failure_tolerance=0.11)
    found = [following.tick(sight(0.05 * i), LATE) for i in range(4)]
    assert [step.status for step in found[:3]] == [ServerStatus.RUNNING] * 3
    assert found[1].twist is not None and found[1].twist.linear == (0.0, 0.0)
    assert found[3].status is ServerStatus.PATIENCE_EXCEEDED
    again = [following.tick(sight(0.05 * i), LATE) for i in range(4, 7)]
    assert [step.status for step in again] == [ServerStatus.RUNNING] * 3  # the clock began anew


def test_a_tolerance_of_minus_one_forgives_for_ever() -> None:
    following = server(Scripted([REFUSED]), failure_tolerance=-1.0)
    assert following.tick(sight(9.0), LATE).status is ServerStatus.RUNNING
    with pytest.raises(WideberthError, match="-2"):
        server(Scripted(), failure_tolerance=-2.0)


def test_other_exceptions_are_not_forgiven() -> None:
    refused = Answer.refusal("the plan is of no use", INVALID_PATH)
    step = server(Scripted([refused]), failure_tolerance=-1.0).tick(sight(), LATE)
    assert step.status is ServerStatus.INVALID_PATH
    other = Answer.refusal("something else", "PlannerException")
    step = server(Scripted([other]), failure_tolerance=-1.0).tick(sight(), LATE)
    assert step.status is ServerStatus.UNKNOWN


def test_an_old_costmap_times_out() -> None:
    following = server(Scripted())
    assert following.tick(sight(1.0, updated=0.55), LATE).status is ServerStatus.RUNNING
    step = following.tick(sight(1.0, updated=0.45), LATE)
    assert step.status is ServerStatus.CONTROLLER_TIMED_OUT and "0.55 s old" in step.reason


def test_a_path_outside_the_costmap_is_invalid() -> None:
    following = server(Scripted())
    following.begin(straight(2.0, start=9.0), 0.0)
    step = following.tick(sight(), LATE)
    assert step.status is ServerStatus.INVALID_PATH and "costmap" in step.reason


def test_a_path_of_two_equal_poses_is_followed_to_its_place() -> None:
    following = server(Scripted())
    following.begin(np.zeros((2, 3)), 0.0)
    assert following.tick(sight(x=1.0), LATE).status is ServerStatus.RUNNING
    assert following.tick(sight(x=0.1), LATE).status is ServerStatus.SUCCEEDED


def test_a_robot_that_does_not_move_on_has_failed() -> None:
    following = server(Scripted())
    times = np.arange(0.0, 10.3, 0.1)
    found = [following.tick(sight(float(time)), LATE).status for time in times]
    assert set(found[:101]) == {ServerStatus.RUNNING}
    assert found[-1] is ServerStatus.FAILED_TO_MAKE_PROGRESS


def test_a_replanned_path_keeps_the_progress_and_a_new_action_does_not() -> None:
    following = server(Scripted())
    following.tick(sight(0.0), LATE)
    following.replan(straight(3.0))
    assert following.tick(sight(10.1), LATE).status is ServerStatus.FAILED_TO_MAKE_PROGRESS
    following.again(10.1)
    assert following.tick(sight(10.2), LATE).status is ServerStatus.RUNNING


def test_a_retry_goes_on_where_the_path_was_left() -> None:
    following = server(Scripted())
    for x in np.arange(0.0, 2.0, 0.5):
        seen = replace(sight(x=float(x)), costmap=_moved(float(x)))
        following.tick(seen, LATE)
    following.again(1.0)
    assert following.path_handler.rest[0, 0] == pytest.approx(1.5)


def _moved(x: float):
    return replace(FREE, origin=(x - 1.5, -1.5))


def test_a_command_that_is_no_number_is_not_published() -> None:
    step = server(Scripted([Answer(Twist((np.nan, 0.0)))])).tick(sight(), LATE)
    assert (
        step.twist is None and step.status is ServerStatus.RUNNING and "not finite" in step.reason
    )
