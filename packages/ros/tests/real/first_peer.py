"""``python first_peer.py N goal|path``: N processes' worth of first messages, each published once.

Each comes from a participant of its own, as by ``ros2 topic pub``: it waits until its topic has a
subscriber, publishes, and leaves. The messages are of no use, so that the node's diagnostics
count what came. Prints that count.
"""

import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

USELESS = PoseStamped()
USELESS.header.frame_id, USELESS.pose.position.x = "odom", float("nan")
MESSAGES = {
    "goal": ("goal_pose", USELESS),
    "path": ("plan", Path(header=USELESS.header, poses=[USELESS, USELESS])),
}
LEAVES = 1.0
"""s, after which a publisher leaves. The 0.1 s of the command line's --once are too few on a busy
computer: of 50 such messages a plain subscriber of rclpy got 49."""


def made(name: str) -> tuple[Context, Node]:
    context = Context()
    context.init(args=[])
    return context, Node(name, context=context)


def published(number: int, topic: str, message: Any) -> None:
    """Publish a message, as its publisher's first and only one."""
    context, node = made(f"first_{number}")
    publisher = node.create_publisher(type(message), topic, 10)
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    publisher.publish(message)
    time.sleep(LEAVES)
    node.destroy_node()
    context.shutdown()


def main() -> None:
    """Publish, and print how many came."""
    count, (topic, message) = int(sys.argv[1]), MESSAGES[sys.argv[2]]
    context, node = made("counter")
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    came = 0

    def diagnosed(message: Any) -> None:
        nonlocal came
        values = {one.key: one.value for one in message.status[0].values}
        came = int(values["refused"])

    node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, 10)
    for number in range(count):
        published(number, topic, message)
    end = time.monotonic() + 3.0
    while came < count and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    print(came)


if __name__ == "__main__":
    main()
