"""A planner whose Python is not that of ROS: a relay in the other one has its topics."""

import json
import subprocess
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from queue import Empty, Queue
from typing import Any, final

from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError

from .encoding import MessageTypes
from .leaving import brake, decide_forever
from .link import Publisher, Signals, Take
from .messages import DISTRIBUTIONS, Messages
from .node import PlannerNode
from .node_settings import NodeSettings

RELAY = Path(__file__).with_name("relay.py")
"""The program that the Python of ROS runs."""
LONGEST_START = 20.0
"""s, after which a relay that has not begun is given up."""


@final
class RelayLink:
    """Topics of ROS 2 in another process, see `wideberth_ros.relay`.

    Parameters
    ----------
    command : starts the Python of ROS; the relay's file and arguments are put behind.
    arguments : for ROS, as in ``["--ros-args", "-r", "/odom:=/robot/odom"]``.

    Raises
    ------
    WideberthError : the relay does not begin.
    """

    def __init__(self, command: Sequence[str], arguments: Sequence[str] = ()) -> None:
        words = [*command, str(RELAY), *arguments]
        try:
            self._process = subprocess.Popen(
                words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        except OSError as error:
            raise WideberthError(f"the relay {command[0]!r} cannot be started: {error}") from None
        self._listeners: dict[str, frozenset[str]] = {}
        self._mismatches: tuple[str, ...] = ()
        self._takes: dict[tuple[str, str], Take] = {}
        self._lock = threading.Lock()
        begun: Queue[str | None] = Queue()
        threading.Thread(target=self._read, args=(begun,), name="relay", daemon=True).start()
        try:
            distribution = begun.get(timeout=LONGEST_START)
        except Empty:
            distribution = None
        if distribution is None:
            self._process.kill()
            self.close()
            raise WideberthError(
                f"the relay {command[0]!r} did not begin (its message, if any, is above); it "
                "needs rclpy: run `source /opt/ros/DISTRIBUTION/setup.bash` first"
            )
        known = distribution if distribution in DISTRIBUTIONS else DISTRIBUTIONS[1]
        self._known = Messages(known)
        self.known: MessageTypes = self._known
        self.lacks: str = ""
        """A type of messages that the relay's installation does not have; "" where it has all."""

    @property
    def alive(self) -> bool:
        """Whether the relay runs."""
        return self._process.poll() is None

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> Publisher:
        """Return a publisher, see `wideberth_ros.link.Transport.publisher`."""
        self._put({"do": "publisher", "topic": topic, "kind": kind, "kept": kept})
        return _RelayPublisher(self, topic, kind)

    def subscriber(
        self, topic: str, kind: str, take: Take, *, reliable: bool = False, kept: bool = False
    ) -> None:
        """Subscribe to a topic, see `wideberth_ros.link.Transport.subscriber`."""
        self._known.prepare(kind)
        self._takes[topic, kind] = take
        head = {"do": "subscriber", "topic": topic, "kind": kind}
        self._put({**head, "reliable": reliable, "kept": kept})

    def listeners(self, topic: str) -> frozenset[str]:
        """Return the types of messages that the subscribers of a topic take."""
        if topic not in self._listeners:
            self._listeners[topic] = frozenset()
            self._put({"do": "watch", "topic": topic})
        return self._listeners[topic]

    def mismatches(self) -> tuple[str, ...]:
        """Say which peers are not connected, see `wideberth_ros.link.Transport.mismatches`."""
        return self._mismatches

    def send(self, topic: str, kind: str, message: Any) -> None:
        """Send a message."""
        self._put({"do": "send", "topic": topic, "kind": kind}, self._known.to_bytes(message))

    def close(self) -> None:
        """End the relay."""
        with self._lock:
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def _put(self, head: dict[str, Any], data: bytes = b"") -> None:
        line = json.dumps({**head, "size": len(data)}).encode() + b"\n"
        try:
            with self._lock:
                assert self._process.stdin is not None
                self._process.stdin.write(line + data)
                self._process.stdin.flush()
        except (OSError, ValueError):  # the relay is gone: `alive` says so
            pass

    def _read(self, begun: "Queue[str | None]") -> None:
        """Take the frames of the relay until it ends."""
        source = self._process.stdout
        assert source is not None
        with source:
            for line in iter(source.readline, b""):
                head = json.loads(line)
                data = source.read(head["size"])
                if "distribution" in head:
                    begun.put(head["distribution"])
                elif "listeners" in head:
                    found = head["listeners"].items()
                    self._listeners.update({topic: frozenset(kinds) for topic, kinds in found})
                    self._mismatches = tuple(head["mismatches"])
                elif "lacks" in head:
                    self.lacks = head["lacks"]
                else:
                    self._take(head["message"], head["kind"], data)
        begun.put(None)

    def _take(self, topic: str, kind: str, data: bytes) -> None:
        try:
            message = self._known.read(kind, data)
        except WideberthError:  # of another definition than ours: it is as if it had not come
            self.lacks = kind
        else:
            self._takes[topic, kind](message)


@final
class _RelayPublisher:
    def __init__(self, link: RelayLink, topic: str, kind: str) -> None:
        self._link, self._topic, self._kind = link, topic, kind

    @property
    def has_subscribers(self) -> bool:
        return bool(self._link.listeners(self._topic))

    def send(self, message: Any) -> None:
        self._link.send(self._topic, self._kind, message)


def run_relayed(
    controller: Controller,
    robot: Robot,
    settings: NodeSettings,
    command: Sequence[str],
    arguments: Sequence[str] = (),
    seconds: float | None = None,
) -> PlannerNode:
    """Run a planner over a relay until it is stopped; return its last state.

    Parameters
    ----------
    controller, robot, settings : as of `PlannerNode`. command, arguments : as of `RelayLink`.
    seconds : after which it stops; None for never.

    Raises
    ------
    WideberthError : the relay does not begin, ends, or lacks a type of messages.
    """
    signals, link = Signals(), RelayLink(command, arguments)
    try:
        node = PlannerNode(controller, robot, settings, link)
        node.warm_up()
        signals.driving = True
        due, over = threading.Event(), threading.Event()
        threading.Thread(target=decide_forever, args=(node, due, over), daemon=True).start()
        period, begin = 1.0 / settings.rate, time.monotonic()
        end = float("inf") if seconds is None else begin + seconds
        tick = planned = reported = begin
        while not signals.count and link.alive and not link.lacks and tick < end:
            node.publish()
            if tick >= planned:
                due.set()
                planned += controller.period
            if tick >= reported:
                node.publish_diagnostics()
                reported += 1.0
            tick = max(tick + period, time.monotonic() - period)
            time.sleep(max(tick - time.monotonic(), 0.0))
        over.set()
        brake(node, lambda: signals.count > 1)
        if link.lacks:
            raise WideberthError(f"the ROS of the relay has no {link.lacks}; install its package")
        if not link.alive:
            raise WideberthError("the relay has ended; its last message is above")
    finally:
        link.close()
    return node
