"""Our planner as Nav2's actions FollowPath and NavigateToPose, with their results."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, final

import numpy as np

from wideberth.framework.robot import SpeedLimited
from wideberth.framework.values.errors import WideberthError

from .decoding import decode_message, heading_of
from .following import End, Follower, Following, GoalFollower, PathFollower, ResultCode
from .link import message_class, ros
from .node import PlannerNode

RATE = 20.0
"""Hz, at which a goal is looked at."""
QUEUE = 10
"""Limits of speed that wait to be taken."""
REPLACED, CANCELLED = "a new goal took its place", "it was cancelled"
POSE = "geometry_msgs/msg/PoseStamped"


class GoalServer(ABC):
    """Takes the goals of an action, follows one at a time, and returns how that ended.

    A new goal takes the place of the one before, as in Nav2. A goal that is cancelled lets the
    robot brake; one that comes while the node is inactive is refused.

    Parameters
    ----------
    node : of rclpy. planner : that drives.
    """

    action: ClassVar[str]
    """Its type, as "FollowPath" of nav2_msgs."""
    name: ClassVar[str]

    def __init__(self, node: Any, planner: PlannerNode) -> None:
        action = ros("rclpy.action")
        self.planner: PlannerNode = planner
        self.settings: Following = Following()
        self.kind: Any = message_class(f"nav2_msgs/action/{self.action}")
        self._node = node
        self._handle: Any = None
        self._follower: Follower | None = None
        self._server = action.ActionServer(
            node,
            self.kind,
            self.name,
            lambda handle: self._result(End(ResultCode.UNKNOWN)),
            goal_callback=lambda _: (
                action.GoalResponse.ACCEPT if planner.active else action.GoalResponse.REJECT
            ),
            handle_accepted_callback=self._accept,
            cancel_callback=lambda _: action.CancelResponse.ACCEPT,
        )
        self._timer = node.create_timer(1.0 / RATE, self._look)

    @abstractmethod
    def begin(self, goal: Any) -> tuple[Follower, End | None]:
        """Follow a goal; return what follows it, and why that cannot be."""

    @abstractmethod
    def feedback(self, follower: Follower) -> Any:
        """Return how far it is."""

    def _accept(self, handle: Any) -> None:
        """Follow a goal that was accepted; the goal before it ends."""
        if self._handle is not None:
            self._conclude(self._handle, End(ResultCode.NONE, REPLACED), "abort")
        self._handle = handle
        self._follower, end = self.begin(handle.request)
        if end is not None:
            self._finish(end, "abort")

    def _look(self) -> None:
        """Look at the goal that is followed."""
        if self._handle is None or self._follower is None:
            return
        if self._handle.is_cancel_requested:
            return self._finish(End(ResultCode.NONE, CANCELLED), "canceled")
        end = self._follower.step(self.planner.now)
        if end is None:
            self._handle.publish_feedback(self.feedback(self._follower))
        else:
            self._finish(end, "abort" if end.code else "succeed")
        return None

    def abort(self, reason: str) -> None:
        """End the goal that is followed; the robot brakes."""
        if self._handle is not None:
            self._finish(End(ResultCode.UNKNOWN, reason), "abort")

    def close(self) -> None:
        """Take the action away."""
        self._node.destroy_timer(self._timer)
        self._server.destroy()

    def _finish(self, end: End, state: str) -> None:
        """End the goal that is followed, and let the robot brake."""
        handle, self._handle, self._follower = self._handle, None, None
        self.planner.halt()
        self._conclude(handle, end, state)

    def _conclude(self, handle: Any, end: End, state: str) -> None:
        """Give a goal its state, as "succeed", and its result."""

        def conclude(handle: Any) -> Any:
            getattr(handle, state)()
            return self._result(end)

        handle.execute(conclude)

    def _result(self, end: End) -> Any:
        result = self.kind.Result()
        number = int(getattr(result, end.code.name, getattr(result, "UNKNOWN", end.code)))
        for name, value in (("error_code", number), ("error_msg", end.reason)):
            if hasattr(result, name):  # Humble has neither, Iron and Jazzy have the code alone
                setattr(result, name, value)
        return result


@final
class FollowPathServer(GoalServer):
    """Nav2's action FollowPath: takes a path, drives it, returns how that ended.

    Messages on ``/speed_limit`` slow the robot. Results carry Nav2's codes where the distribution
    has them (from Iron on). Parameters as of `GoalServer`.
    """

    action: ClassVar[str] = "FollowPath"
    name: ClassVar[str] = "follow_path"

    def __init__(self, node: Any, planner: PlannerNode) -> None:
        super().__init__(node, planner)
        speed_limit = message_class("nav2_msgs/msg/SpeedLimit")
        self._limits = node.create_subscription(speed_limit, "speed_limit", self.limit, QUEUE)

    def begin(self, goal: Any) -> tuple[Follower, End | None]:
        """Follow a path; return what follows it, and why that cannot be."""
        follower = PathFollower(self.planner, self.settings, self.planner.now)
        poses = [one.pose for one in goal.path.poses]
        points = np.array([(one.position.x, one.position.y) for one in poses], dtype=np.float64)
        heading = heading_of(poses[-1]) if poses else float("nan")
        frame = str(goal.path.header.frame_id).lstrip("/")
        return follower, follower.begin(frame, points.reshape(-1, 2), heading)

    def feedback(self, follower: Follower) -> Any:
        """Return the distance left; from Lyrical on it is in a message within the feedback."""
        feedback = self.kind.Feedback()
        inner = [getattr(feedback, name) for name in feedback.get_fields_and_field_types()]
        for target in (feedback, *inner):
            if hasattr(target, "distance_to_goal"):
                target.distance_to_goal = follower.distance
                target.speed = follower.speed
        return feedback

    def limit(self, message: Any) -> None:
        """Take a limit of speed: of m/s or of percent of the robot's own; 0 takes it away."""
        value, robot = float(message.speed_limit), self.planner.robot
        if value == 0.0:
            value = float("inf")
        elif message.percentage:
            fast = robot.max_speed if isinstance(robot, SpeedLimited) else float("inf")
            value = 0.01 * value * fast
        self.planner.limit_speed(value)

    def close(self) -> None:
        """Take the action and the topic of limits away."""
        self._node.destroy_subscription(self._limits)
        super().close()


@final
class NavigateToPoseServer(GoalServer):
    """Nav2's action NavigateToPose: takes a goal, to which the planner finds the way itself.

    Parameters as of `GoalServer`; the planner follows goals.
    """

    action: ClassVar[str] = "NavigateToPose"
    name: ClassVar[str] = "navigate_to_pose"

    def __init__(self, node: Any, planner: PlannerNode) -> None:
        super().__init__(node, planner)
        self._begun = planner.now

    def begin(self, goal: Any) -> tuple[Follower, End | None]:
        """Drive to a goal; return what drives there, and why that cannot be."""
        self._begun = self.planner.now
        follower = GoalFollower(self.planner, self.settings, self._begun)
        try:
            decoded = decode_message(POSE, goal.pose)
        except WideberthError as error:
            return follower, End(ResultCode.UNKNOWN, str(error))
        follower.begin(decoded.frame, decoded.content)  # type: ignore[arg-type]
        return follower, None

    def feedback(self, follower: Follower) -> Any:
        """Return the distance left, straight, and the time that it has taken."""
        feedback = self.kind.Feedback()
        feedback.distance_remaining = follower.distance
        taken = self.planner.now - self._begun
        feedback.navigation_time.sec = int(taken)
        feedback.navigation_time.nanosec = int(1e9 * (taken % 1.0))
        return feedback
