"""Our planner as Nav2's action FollowPath: goals are taken, followed, ended, with its results."""

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from ..framework.robot import SpeedLimited
from .decoding import heading_of
from .following import End, Follower, Following, ResultCode
from .link import message_class, ros
from .node import PlannerNode

RATE = 20.0
"""Hz, at which a goal is looked at."""
QUEUE = 10
"""Limits of speed that wait to be taken."""
REPLACED, CANCELLED = "a new goal took its place", "it was cancelled"


@final
@dataclass
class _Goal:
    """A goal that is followed."""

    handle: Any
    follower: Follower


@final
class FollowPathServer:
    """Nav2's action FollowPath: takes a path, drives it, returns how that ended.

    A new goal takes the place of the one before, as in Nav2. A goal that is cancelled lets the
    robot brake. Messages on ``/speed_limit`` slow it. Results carry Nav2's codes where the
    distribution has them (from Iron on).

    Parameters
    ----------
    node : of rclpy. planner : that drives.
    settings : when a goal has ended. name : of the action.
    """

    def __init__(
        self,
        node: Any,
        planner: PlannerNode,
        settings: Following | None = None,
        name: str = "follow_path",
    ) -> None:
        action = ros("rclpy.action")
        self.planner: PlannerNode = planner
        self.settings: Following = Following() if settings is None else settings
        self._node = node
        self._goal: _Goal | None = None
        self._kind = message_class("nav2_msgs/action/FollowPath")
        self._server = action.ActionServer(
            node,
            self._kind,
            name,
            lambda handle: self._result(End(ResultCode.UNKNOWN)),
            goal_callback=lambda _: (
                action.GoalResponse.ACCEPT if planner.active else action.GoalResponse.REJECT
            ),
            handle_accepted_callback=self.accept,
            cancel_callback=lambda _: action.CancelResponse.ACCEPT,
        )
        speed_limit = message_class("nav2_msgs/msg/SpeedLimit")
        self._limits = node.create_subscription(speed_limit, "speed_limit", self.limit, QUEUE)
        self._timer = node.create_timer(1.0 / RATE, self.step)

    def accept(self, handle: Any) -> None:
        """Follow the path of a goal that was accepted; the goal before it ends."""
        if self._goal is not None:
            self._conclude(self._goal, End(ResultCode.NONE, REPLACED), "abort")
        follower = Follower(self.planner, self.settings, self.planner.now)
        self._goal = _Goal(handle, follower)
        path = handle.request.path
        places = [(one.pose.position.x, one.pose.position.y) for one in path.poses]
        points = np.array(places, dtype=np.float64).reshape(-1, 2)
        heading = heading_of(path.poses[-1].pose) if path.poses else float("nan")
        end = follower.begin(str(path.header.frame_id).lstrip("/"), points, heading)
        if end is not None:
            self._finish(end, "abort")

    def step(self) -> None:
        """Look at the goal that is followed."""
        if self._goal is None:
            return
        follower = self._goal.follower
        if self._goal.handle.is_cancel_requested:
            return self._finish(End(ResultCode.NONE, CANCELLED), "canceled")
        end = follower.step(self.planner.now)
        if end is None:
            self._feed_back(self._goal)
        else:
            self._finish(end, "abort" if end.code else "succeed")
        return None

    def abort(self, reason: str) -> None:
        """End the goal that is followed; the robot brakes."""
        if self._goal is not None:
            self._finish(End(ResultCode.UNKNOWN, reason), "abort")

    def close(self) -> None:
        """Take the action away."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._limits)
        self._server.destroy()

    def limit(self, message: Any) -> None:
        """Take a limit of speed: of m/s or of percent of the robot's own; 0 takes it away."""
        value, robot = float(message.speed_limit), self.planner.robot
        if value == 0.0:
            value = float("inf")
        elif message.percentage:
            fast = robot.max_speed if isinstance(robot, SpeedLimited) else float("inf")
            value = 0.01 * value * fast
        self.planner.limit_speed(value)

    def _finish(self, end: End, state: str) -> None:
        """End the goal that is followed, and let the robot brake."""
        assert self._goal is not None
        goal, self._goal = self._goal, None
        self.planner.halt()
        self._conclude(goal, end, state)

    def _conclude(self, goal: _Goal, end: End, state: str) -> None:
        """Give a goal its state, as "succeed", and its result."""

        def conclude(handle: Any) -> Any:
            getattr(handle, state)()
            return self._result(end)

        goal.handle.execute(conclude)

    def _feed_back(self, goal: _Goal) -> None:
        """Publish the distance left; from Lyrical on it is in a message within the feedback."""
        feedback = self._kind.Feedback()
        inner = [getattr(feedback, name) for name in feedback.get_fields_and_field_types()]
        for target in (feedback, *inner):
            if hasattr(target, "distance_to_goal"):
                target.distance_to_goal = float(goal.follower.distance)
                target.speed = float(goal.follower.speed)
        goal.handle.publish_feedback(feedback)

    def _result(self, end: End) -> Any:
        result = self._kind.Result()
        number = int(getattr(result, end.code.name, end.code))
        for name, value in (("error_code", number), ("error_msg", end.reason)):
            if hasattr(result, name):  # Humble has neither, Iron and Jazzy have the code alone
                setattr(result, name, value)
        return result
