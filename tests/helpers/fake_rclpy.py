"""What the action server uses of rclpy and nav2_msgs, without ROS: topics are lists in memory."""

import sys
from dataclasses import dataclass, field
from enum import Enum
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

CODES = {
    "NONE": 0, "UNKNOWN": 100, "TF_ERROR": 102, "INVALID_PATH": 103,
    "FAILED_TO_MAKE_PROGRESS": 105, "NO_VALID_CONTROL": 106, "CONTROLLER_TIMED_OUT": 107,
}  # fmt: skip


class Message(SimpleNamespace):
    """A message that knows its fields."""

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {name: "" for name in vars(self) if not name.isupper()}


def follow_path(distribution: str) -> Any:
    """Return the action as a distribution has it."""
    feedback = {"distance_to_goal": 0.0, "speed": 0.0}
    result: dict[str, Any] = {"result": None}
    if distribution != "humble":
        result = {"error_code": 0, **CODES}
    if distribution in ("kilted", "lyrical"):
        result["error_msg"] = ""
    return SimpleNamespace(
        Result=lambda: Message(**result),
        Feedback=lambda: (
            Message(tracking_feedback=Message(**feedback))
            if distribution == "lyrical"
            else Message(**feedback)
        ),
    )


@dataclass
class Publisher:
    sent: list[bytes] = field(default_factory=list)

    def publish(self, data: bytes) -> None:
        assert isinstance(data, bytes)
        self.sent.append(data)

    def get_subscription_count(self) -> int:
        return 1


@dataclass
class Node:
    publishers: dict[str, Publisher] = field(default_factory=dict)
    calls: dict[str, Any] = field(default_factory=dict)
    raw: dict[str, bool] = field(default_factory=dict)

    def create_publisher(self, kind: Any, topic: str, quality: Any) -> Publisher:
        return self.publishers.setdefault(topic, Publisher())

    def create_subscription(
        self, kind: Any, topic: str, call: Any, quality: Any, raw: bool = False
    ) -> None:
        self.calls[topic], self.raw[topic] = call, raw


@dataclass
class Handle:
    """A goal as the server sees it."""

    request: Any
    is_cancel_requested: bool = False
    state: str = "executing"
    feedback: list[Any] = field(default_factory=list)

    def succeed(self) -> None:
        self.state = "succeeded"

    def abort(self) -> None:
        self.state = "aborted"

    def canceled(self) -> None:
        self.state = "canceled"

    def publish_feedback(self, message: Any) -> None:
        self.feedback.append(message)


class ActionServer:
    """Keeps what it is given."""

    made: ClassVar[list["ActionServer"]] = []

    def __init__(self, node: Any, kind: Any, name: str, execute: Any, **callbacks: Any) -> None:
        self.name, self.execute, self.callbacks = name, execute, callbacks
        ActionServer.made.append(self)


class Answer(Enum):
    ACCEPT = 1


def install(monkeypatch: Any, distribution: str) -> None:
    """Put the fake where imports find it."""
    everything = SimpleNamespace
    names: dict[str, Any] = {
        "rclpy": {},
        "rclpy.action": {"ActionServer": ActionServer, "GoalResponse": Answer,
                         "CancelResponse": Answer},
        "rclpy.callback_groups": {"ReentrantCallbackGroup": object},
        "rclpy.qos": {
            "QoSProfile": lambda **given: everything(**given),
            "ReliabilityPolicy": everything(RELIABLE=1, BEST_EFFORT=2),
            "DurabilityPolicy": everything(TRANSIENT_LOCAL=1, VOLATILE=2),
        },
        "nav2_msgs.action": {"FollowPath": follow_path(distribution)},
        "nav2_msgs.msg": {"SpeedLimit": object},
    }  # fmt: skip
    for package, kinds in (
        ("nav_msgs", ("Odometry", "Path")), ("tf2_msgs", ("TFMessage",)),
        ("nav2_dynamic_msgs", ("ObstacleArray",)), ("geometry_msgs", ("TwistStamped", "Twist")),
        ("visualization_msgs", ("MarkerArray",)), ("diagnostic_msgs", ("DiagnosticArray",)),
    ):  # fmt: skip
        names[f"{package}.msg"] = dict.fromkeys(kinds, object)
    for name, content in names.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
