"""A relay between a planner and ROS 2, for a Python of ROS that is not the planner's.

It is a program of its own, which needs rclpy alone and Python 3.8 or newer: ``wideberth node``
starts it by its ``--relay``. Frames go through its input and output: a line of JSON, and as many
bytes of a message in CDR as its ``size`` says. When its input ends it sends a velocity of zero, if
the last one was not.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

import json
import os
import sys
import threading
import time
from typing import Any, BinaryIO

VELOCITIES = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped")
"""Types of which a last message of zero is sent."""
LOOK = 0.5
"""s, after which it is looked anew who listens."""


def message_class(kind: str) -> Any:
    """Return the class of a type, as of "nav_msgs/msg/Path"; None if it is not installed."""
    package, folder, name = kind.split("/")
    try:
        return getattr(__import__(f"{package}.{folder}", fromlist=[name]), name)
    except (ImportError, AttributeError):
        return None


POLICIES = (("reliability", "RELIABLE"), ("durability", "TRANSIENT_LOCAL"))
"""Of a quality of service, and the value that a subscription gets only where it is offered."""


def mismatches(node: Any, offered: dict[str, Any], asked: dict[str, Any]) -> list[str]:
    """Say which peers of a node are not connected, since their quality of service does not fit.

    Parameters
    ----------
    node : of rclpy. offered, asked : quality of its publishers and subscriptions, by topic.
    """
    found = []
    for topic, quality in sorted(offered.items()):
        for peer in node.get_subscriptions_info_by_topic(node.resolve_topic_name(topic)):
            why = unfit(quality, peer.qos_profile)
            if why:
                found.append(f"{topic} does not reach the subscriber {peer.node_name}, {why}")
    for topic, quality in sorted(asked.items()):
        for peer in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
            why = unfit(peer.qos_profile, quality)
            if why:
                found.append(f"{topic} does not come from the publisher {peer.node_name}, {why}")
    return found


def unfit(offered: Any, asked: Any) -> str:
    """Say why a publisher's quality of service does not do for a subscription; "" if it does."""
    for policy, strong in POLICIES:
        wanted, given = getattr(asked, policy).name, getattr(offered, policy).name
        if wanted == strong != given:
            return f"its {policy} is {given}, and {wanted} is asked for"
    return ""


class Relay:
    """Publishes and subscribes as the frames of its input say.

    Parameters
    ----------
    node : of rclpy. source, sink : binary streams of frames.
    """

    def __init__(self, node: Any, source: BinaryIO, sink: BinaryIO) -> None:
        self.node: Any = node
        self.source: BinaryIO = source
        self.sink: BinaryIO = sink
        self.publishers: dict[tuple[str, str], Any] = {}
        self.last: dict[tuple[str, str], bytes] = {}
        self.watched: set[str] = set()
        self.offered: dict[str, Any] = {}
        self.asked: dict[str, Any] = {}
        self.lock: threading.Lock = threading.Lock()
        node.create_timer(LOOK, self.look)

    def put(self, head: dict[str, Any], data: bytes = b"") -> None:
        """Write a frame."""
        line = json.dumps({**head, "size": len(data)}).encode() + b"\n"
        try:
            with self.lock:
                self.sink.write(line + data)
                self.sink.flush()
        except OSError:  # the planner is gone: the input ends too
            pass

    def run(self) -> None:
        """Do what the frames of the input say, until it ends."""
        for line in iter(self.source.readline, b""):
            head = json.loads(line)
            getattr(self, head["do"])(head, self.source.read(head["size"]))

    def publisher(self, head: dict[str, Any], _: bytes) -> None:
        """Open a topic to send on."""
        kind = message_class(head["kind"])
        if kind is None:
            return self.put({"lacks": head["kind"]})
        quality = self.quality(True, head["kept"])
        for key in [key for key in self.publishers if key[0] == head["topic"]]:
            self.node.destroy_publisher(self.publishers.pop(key))
            self.last.pop(key, None)
        made = self.node.create_publisher(kind, head["topic"], quality)
        self.publishers[head["topic"], head["kind"]] = made
        self.offered[head["topic"]] = quality
        self.watched.add(head["topic"])
        return None

    def subscriber(self, head: dict[str, Any], _: bytes) -> None:
        """Open a topic to take from."""
        topic, kind = head["topic"], message_class(head["kind"])
        if kind is None:
            return self.put({"lacks": head["kind"]})
        quality = self.asked[topic] = self.quality(head["reliable"] or head["kept"], head["kept"])

        def take(data: bytes) -> None:
            self.put({"message": topic, "kind": head["kind"]}, bytes(data))

        self.node.create_subscription(kind, topic, take, quality, raw=True)
        return None

    def watch(self, head: dict[str, Any], _: bytes) -> None:
        """Say from now on who listens to a topic."""
        self.watched.add(head["topic"])
        self.look()

    def send(self, head: dict[str, Any], data: bytes) -> None:
        """Send a message."""
        key = head["topic"], head["kind"]
        if key in self.publishers:
            self.publishers[key].publish(data)
            self.last[key] = data

    def look(self) -> None:
        """Say who listens, and who cannot."""
        found = {}
        for topic in sorted(self.watched):
            every = self.node.get_subscriptions_info_by_topic(self.node.resolve_topic_name(topic))
            found[topic] = sorted({one.topic_type for one in every})
        unmatched = mismatches(self.node, dict(self.offered), dict(self.asked))
        self.put({"listeners": found, "mismatches": unmatched})

    def stop(self) -> None:
        """Send a velocity of zero where the last one was not."""
        from rclpy.serialization import deserialize_message, serialize_message

        for (topic, kind), data in self.last.items():
            if kind in VELOCITIES:
                message = deserialize_message(data, message_class(kind))
                twist = getattr(message, "twist", message)
                if twist.linear.x or twist.linear.y or twist.linear.z or twist.angular.z:
                    twist.linear.x = twist.linear.y = twist.linear.z = twist.angular.z = 0.0
                    self.publishers[topic, kind].publish(serialize_message(message))

    @staticmethod
    def quality(reliable: bool, kept: bool) -> Any:
        """Return the quality of service of a topic."""
        from rclpy.qos import DurabilityPolicy as Durability
        from rclpy.qos import QoSProfile
        from rclpy.qos import ReliabilityPolicy as Reliability

        return QoSProfile(
            depth=10,
            reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
            durability=Durability.TRANSIENT_LOCAL if kept else Durability.VOLATILE,
        )


def spin(executor: Any) -> None:
    """Take messages until ROS is shut down."""
    import rclpy
    from rclpy.executors import ExternalShutdownException

    while rclpy.ok():
        try:
            executor.spin_once(timeout_sec=0.5)
        except ExternalShutdownException:
            return


def main() -> None:
    """Relay until the input ends."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    sink = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what ROS prints is no frame
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("wideberth")
    relay = Relay(node, sys.stdin.buffer, sink)
    relay.put({"distribution": os.environ.get("ROS_DISTRO", "")})
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=spin, args=(executor,), daemon=True)
    spinning.start()
    try:
        relay.run()
    finally:
        relay.stop()
        time.sleep(0.1)  # a publisher that is destroyed at once may not send any more
        rclpy.shutdown()
        spinning.join(1.0)


if __name__ == "__main__":
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the planner brakes first, and ends the input
    main()
