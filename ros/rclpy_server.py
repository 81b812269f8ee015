"""Our planner as Nav2's action FollowPath, on a computer that has ROS 2 (rclpy)."""

import threading
import time
from collections import deque
from collections.abc import Iterator
from importlib import import_module
from typing import Any, final

import numpy as np

from ..framework.robot import SpeedLimited
from ..framework.values.errors import WideberthError
from .decoding import heading_of
from .following import End, Follower, Following, ResultCode
from .messages import Messages
from .node import PlannerNode

QUEUE = 10
"""Messages that wait to be taken."""
RATE = 20.0
"""Hz, at which a goal is looked at."""


def needs_ros(module: str) -> Any:
    """Return a module of ROS 2.

    Raises
    ------
    WideberthError : there is none, or its environment is not set up.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise WideberthError(
            f"this needs {module} of ROS 2, which is not found: source /opt/ros/DISTRIBUTION/"
            "setup.bash first; without ROS there is `wideberth node`"
        ) from error


@final
class RclpyLink:
    """Publishers and subscribers of a node of rclpy, with messages as bytes.

    Parameters
    ----------
    node : of rclpy. known : our message types of the same distribution.
    """

    def __init__(self, node: Any, known: Messages) -> None:
        self.known: Messages = known
        self._node = node

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> "_Sender":
        """Return a publisher."""
        quality = _quality(True, kept)
        self.known.prepare(kind)
        return _Sender(self._node.create_publisher(_type(kind), topic, quality), self.known)

    def subscriber(
        self, topic: str, kind: str, *, reliable: bool = False, kept: bool = False
    ) -> "_Taker":
        """Return a subscriber."""
        taker = _Taker(kind, self.known)
        self.known.prepare(kind)
        self._node.create_subscription(
            _type(kind), topic, taker.come, _quality(reliable, kept), raw=True
        )
        return taker


def _type(kind: str) -> Any:
    """Return a message class of ROS 2, as in nav_msgs.msg.Path."""
    package, folder, name = kind.split("/")
    return getattr(needs_ros(f"{package}.{folder}"), name)


def _quality(reliable: bool, kept: bool) -> Any:
    its = needs_ros("rclpy.qos")
    return its.QoSProfile(
        depth=1 if kept else QUEUE,
        reliability=(
            its.ReliabilityPolicy.RELIABLE if reliable else its.ReliabilityPolicy.BEST_EFFORT
        ),
        durability=its.DurabilityPolicy.TRANSIENT_LOCAL if kept else its.DurabilityPolicy.VOLATILE,
    )


@final
class _Sender:
    def __init__(self, publisher: Any, known: Messages) -> None:
        self._publisher = publisher
        self._known = known

    @property
    def has_subscribers(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def send(self, message: Any) -> None:
        self._publisher.publish(self._known.to_bytes(message))


@final
class _Taker:
    def __init__(self, kind: str, known: Messages) -> None:
        self.kind: str = kind
        self.refused: int = 0
        self._known = known
        self._waiting: deque[bytes] = deque(maxlen=QUEUE)

    def come(self, data: bytes) -> None:
        """Keep a message until it is taken; of too many the oldest is lost."""
        self._waiting.append(bytes(data))

    def take(self) -> Iterator[Any]:
        while self._waiting:
            try:
                yield self._known.read(self.kind, self._waiting.popleft())
            except WideberthError:
                self.refused += 1


@final
class FollowPathServer:
    """Nav2's action FollowPath: takes a path, drives it, returns how that ended.

    A new goal takes the place of the one before, as in Nav2. A goal that is cancelled lets the
    robot brake. Messages on ``/speed_limit`` slow it. Results carry Nav2's codes where the
    distribution has them (from Iron on).

    Parameters
    ----------
    node : of rclpy. planner : that drives; its `run` is up to the caller.
    settings : when a goal has ended. name : of the action.
    """

    def __init__(
        self,
        node: Any,
        planner: PlannerNode,
        settings: Following | None = None,
        name: str = "follow_path",
    ) -> None:
        action = needs_ros("rclpy.action")
        self.planner: PlannerNode = planner
        self.settings: Following = Following() if settings is None else settings
        self._kind = needs_ros("nav2_msgs.action").FollowPath
        self._number = 0
        self._lock = threading.Lock()
        self._server = action.ActionServer(
            node,
            self._kind,
            name,
            self.execute,
            goal_callback=lambda _: action.GoalResponse.ACCEPT,
            cancel_callback=lambda _: action.CancelResponse.ACCEPT,
            callback_group=needs_ros("rclpy.callback_groups").ReentrantCallbackGroup(),
        )
        speed_limit = needs_ros("nav2_msgs.msg").SpeedLimit
        node.create_subscription(speed_limit, "speed_limit", self.limit, QUEUE)

    def limit(self, message: Any) -> None:
        """Take a limit of speed: of m/s or of percent of the robot's own; 0 takes it away."""
        value, robot = float(message.speed_limit), self.planner.robot
        if value == 0.0:
            value = float("inf")
        elif message.percentage:
            fast = robot.max_speed if isinstance(robot, SpeedLimited) else float("inf")
            value = 0.01 * value * fast
        self.planner.limit_speed(value)

    def execute(self, handle: Any) -> Any:
        """Follow the path of a goal; return the result of the action."""
        with self._lock:
            self._number += 1
            own = self._number
            follower = Follower(self.planner, self.settings, time.monotonic())
            path = handle.request.path
            places = [(one.pose.position.x, one.pose.position.y) for one in path.poses]
            points = np.array(places, dtype=np.float64).reshape(-1, 2)
            heading = heading_of(path.poses[-1].pose) if path.poses else float("nan")
            end = follower.begin(str(path.header.frame_id).lstrip("/"), points, heading)
            if end is not None:
                self.planner.halt()
        while end is None:
            with self._lock:  # a goal that is replaced leaves no command behind
                replaced, cancelled = own != self._number, bool(handle.is_cancel_requested)
                if not replaced and not cancelled:
                    end = follower.step(time.monotonic())
                if not replaced and (cancelled or end is not None):
                    self.planner.halt()
            if replaced:
                handle.abort()
                return self._result(End(ResultCode.NONE, "a new goal took its place"))
            if cancelled:
                handle.canceled()
                return self._result(End(ResultCode.NONE, "it was cancelled"))
            if end is None:
                self._feed_back(handle, follower)
                time.sleep(1.0 / RATE)
        (handle.abort if end.code else handle.succeed)()
        return self._result(end)

    def _feed_back(self, handle: Any, follower: Follower) -> None:
        """Publish the distance left; from Lyrical on it is in a message within the feedback."""
        feedback = self._kind.Feedback()
        inner = [getattr(feedback, name) for name in feedback.get_fields_and_field_types()]
        for target in (feedback, *inner):
            if hasattr(target, "distance_to_goal"):
                target.distance_to_goal = float(follower.distance)
                target.speed = float(follower.speed)
        handle.publish_feedback(feedback)

    def _result(self, end: End) -> Any:
        result = self._kind.Result()
        number = int(getattr(result, end.code.name, end.code))
        for name, value in (("error_code", number), ("error_msg", end.reason)):
            if hasattr(result, name):  # Humble has neither, Iron and Jazzy have the code alone
                setattr(result, name, value)
        return result


def serve(planner: Any, robot: Any, settings: Any) -> None:
    """Serve FollowPath with a controller until ROS shuts down.

    Parameters
    ----------
    planner : a controller. robot : its model. settings : a `NodeSettings`.

    Raises
    ------
    WideberthError : ROS 2 is not found, or its distribution is another one.
    """
    rclpy = needs_ros("rclpy")
    executors = needs_ros("rclpy.executors")
    rclpy.init()
    node = rclpy.create_node("wideberth_controller")
    driver = PlannerNode(
        planner, robot, settings, RclpyLink(node, Messages(settings.distribution))
    )
    FollowPathServer(node, driver)
    runner = threading.Thread(target=driver.run, name="commands", daemon=True)
    runner.start()
    executor = executors.MultiThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin()
    except KeyboardInterrupt:
        pass
    finally:
        driver.stop()
        runner.join(timeout=5.0)
        node.destroy_node()
        if rclpy.ok():
            rclpy.shutdown()
