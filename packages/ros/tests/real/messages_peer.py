"""One of two processes that exchange compiled messages; ``python messages_peer.py give|take``.

``give`` publishes one message of each kind again and again and serves FollowPath; ``take`` prints
what it got, and what became of two goals.
"""

import ctypes
import json
import sys
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from wideberth_ros.interfaces import provide

provide(["tf2_msgs", "nav2_dynamic_msgs", "vision_msgs", "nav2_msgs"])

from geometry_msgs.msg import PoseStamped, TransformStamped  # noqa: E402
from nav2_dynamic_msgs.msg import Obstacle, ObstacleArray  # noqa: E402
from nav2_msgs.action import FollowPath  # noqa: E402
from nav2_msgs.msg import SpeedLimit  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from vision_msgs.msg import Detection3D, Detection3DArray  # noqa: E402

KINDS = {"tf": TFMessage, "people": ObstacleArray, "seen": Detection3DArray, "limit": SpeedLimit}


def samples() -> dict[str, Any]:
    transform = TransformStamped(child_frame_id="base_link")
    transform.header.frame_id = "odom"
    transform.transform.translation.x = 1.5
    person = Obstacle(score=0.5, position_covariance=[0.25] * 9)
    person.uuid.uuid[3] = 7
    person.velocity.y = -0.75
    seen = Detection3D(id="child")
    seen.bbox.size.z = 1.75
    return {
        "tf": TFMessage(transforms=[transform, transform]),
        "people": ObstacleArray(obstacles=[person] * 3),
        "seen": Detection3DArray(detections=[seen]),
        "limit": SpeedLimit(percentage=True, speed_limit=40.0),
    }


def give(node: Node) -> None:
    """Publish, and serve goals: five steps of feedback each, ended early where cancelled."""
    group = ReentrantCallbackGroup()

    async def follow(goal: Any) -> Any:
        result = FollowPath.Result()
        for step in range(50):
            if goal.is_cancel_requested:
                goal.canceled()
                return result
            if step == 5 and len(goal.request.path.poses) == 2:
                goal.abort()
                result.error_code = FollowPath.Result.FAILED_TO_MAKE_PROGRESS
                result.error_msg = goal.request.controller_id
                return result
            goal.publish_feedback(FollowPath.Feedback(distance_to_goal=10.0 - step, speed=0.5))
            node.get_clock().sleep_for(rclpy.duration.Duration(seconds=0.02))
        goal.succeed()
        return result

    server = ActionServer(node, FollowPath, "follow_path", follow, callback_group=group,
                          cancel_callback=lambda goal: CancelResponse.ACCEPT)  # fmt: skip
    given = {name: node.create_publisher(kind, name, 1) for name, kind in KINDS.items()}
    node.create_timer(0.05, lambda: [given[name].publish(one) for name, one in samples().items()])
    executor = MultiThreadedExecutor(3)
    executor.add_node(node)
    executor.spin()
    server.destroy()


def take(node: Node) -> dict[str, Any]:
    """Return what was received, and what became of a goal that fails and one that is cancelled."""
    got: dict[str, Any] = {}
    for name, kind in KINDS.items():
        node.create_subscription(kind, name, lambda one, name=name: got.setdefault(name, one), 1)
    client = ActionClient(node, FollowPath, "follow_path")
    assert client.wait_for_server(timeout_sec=10.0)
    shown: list[float] = []

    def drive(poses: int, cancelled: bool) -> Any:
        goal = FollowPath.Goal(controller_id="mpc")
        goal.path.poses = [PoseStamped()] * poses
        before = len(shown)
        sent = client.send_goal_async(
            goal, lambda one: shown.append(one.feedback.distance_to_goal)
        )
        rclpy.spin_until_future_complete(node, sent, timeout_sec=10.0)
        result = sent.result().get_result_async()
        while cancelled and len(shown) == before:
            rclpy.spin_once(node, timeout_sec=1.0)
        if cancelled:
            sent.result().cancel_goal_async()
        rclpy.spin_until_future_complete(node, result, timeout_sec=10.0)
        return result.result()

    failed, cancelled = drive(2, False), drive(1, True)
    while len(got) < len(KINDS):
        rclpy.spin_once(node, timeout_sec=1.0)
    hashes = {
        name: str(node.get_publishers_info_by_topic(name)[0].topic_type_hash) for name in KINDS
    }
    return {
        "same": {name: got[name] == one for name, one in samples().items()},
        "failed": [failed.status, failed.result.error_code, failed.result.error_msg],
        "cancelled": cancelled.status,
        "feedback": shown[:5],
        "hashes": hashes,
        "actions": {name: action_hash(name) for name in ("FollowPath", "NavigateToPose")},
    }


def action_hash(name: str) -> str:
    """Ask the compiled code of nav2_msgs for the hash of an action."""
    get = getattr(ctypes.CDLL("libnav2_msgs__rosidl_generator_c.so"),
                  f"nav2_msgs__action__{name}__get_type_hash")  # fmt: skip
    get.restype = ctypes.POINTER(ctypes.c_uint8 * 33)
    version, *digest = get(None).contents
    return f"RIHS{version:02}_{bytes(digest).hex()}"


if __name__ == "__main__":
    rclpy.init()
    if sys.argv[1] == "give":
        give(Node("giver"))
    else:
        print(json.dumps(take(Node("taker"))))
