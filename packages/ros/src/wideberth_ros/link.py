"""Topics of a node of rclpy: messages are made, sent and received as ROS 2's own classes."""

import array
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any, Protocol, final

import numpy as np

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError

from .encoding import MessageTypes
from .relay import mismatches

QUEUE = 10
"""Messages that wait to be sent or taken, as by default in ROS 2."""
TICK = 0.05
"""s, after which signals are looked at."""
Take = Callable[[Any], None]
"""Called with each message that comes."""


class Publisher(Protocol):
    """Sends messages on a topic."""

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber."""
        ...

    def send(self, message: Any) -> None:
        """Send a message."""
        ...


class Transport(Protocol):
    """Makes publishers and subscribers."""

    known: MessageTypes

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> Publisher:
        """Return a publisher; it takes the place of the topic's earlier one.

        Parameters
        ----------
        topic : as in "/odom". kind : type of its messages, as in "nav_msgs/msg/Path".
        kept : whether those who join later are given the last message too.
        """
        ...

    def subscriber(
        self, topic: str, kind: str, take: Take, *, reliable: bool = False, kept: bool = False
    ) -> None:
        """Subscribe to a topic.

        Parameters
        ----------
        topic, kind : as of `publisher`. take : called with each message.
        reliable : whether a lost message is sent again; a publisher that does not offer that is
            then not matched.
        kept : whether to ask for the last messages of before; a publisher that does not keep them
            is then not matched.
        """
        ...

    def listeners(self, topic: str) -> frozenset[str]:
        """Return the types of messages that the subscribers of a topic take."""
        ...

    def mismatches(self) -> tuple[str, ...]:
        """Say which peers are not connected, since their quality of service does not fit ours."""
        ...


def ros(module: str) -> Any:
    """Return a module of ROS 2.

    Raises
    ------
    WideberthError : there is none for this Python.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise WideberthError(
            f"{module} of ROS 2 is not found ({error}); run `source /opt/ros/DISTRIBUTION/"
            "setup.bash` first, with the Python of that ROS; or pip install "
            "'wideberth-ros[kilted]'; or, where the two need different Pythons, see "
            "`wideberth node --relay`"
        ) from None


@cache
def message_class(kind: str) -> Any:
    """Return a class of messages, as nav_msgs.msg.Path for "nav_msgs/msg/Path".

    Where the installation lacks its package it is compiled, see `wideberth_ros.interfaces`.

    Raises
    ------
    WideberthError : there is no such type.
    """
    package, folder, name = kind.split("/")
    try:
        module = import_module(f"{package}.{folder}")
    except ImportError:
        from .interfaces import provide

        provide([package])
        module = ros(f"{package}.{folder}")
    if not hasattr(module, name):
        raise WideberthError(unknown(f"message of {package}", name, dir(module)))
    return getattr(module, name)


@final
class RosMessages:
    """The message types of the ROS 2 that is installed."""

    def __contains__(self, name: str) -> bool:
        """Whether there is a type of this name, as in ``"nav_msgs/msg/Path"``."""
        try:
            return bool(message_class(name))
        except WideberthError:
            return False

    def make(self, name: str, /, **given: Any) -> Any:
        """Return a message; what is not given is zero, empty or False.

        Parameters
        ----------
        name : of its type. given : its fields; arrays are taken to the kind of theirs.

        Raises
        ------
        WideberthError : no such type.
        AssertionError, TypeError : a field that does not fit.
        """
        message = message_class(name)()
        for field, value in given.items():
            setattr(message, field, _fitting(value, getattr(message, field)))
        return message


def _fitting(value: Any, blank: Any) -> Any:
    """Return a value as the kind that a field of a message wants, by its blank value."""
    if isinstance(blank, array.array):
        return array.array(blank.typecode, np.asarray(value).astype(blank.typecode).tobytes())
    if isinstance(blank, np.ndarray):
        return np.asarray(value).astype(blank.dtype).reshape(blank.shape)
    if isinstance(blank, bytes):
        return bytes([value])
    if isinstance(blank, float | int | bool):
        return type(blank)(value)
    return value


@final
class RosLink:
    """Publishers and subscribers of a node of rclpy.

    Parameters
    ----------
    node : of rclpy.
    """

    def __init__(self, node: Any) -> None:
        self.known: MessageTypes = RosMessages()
        self._node = node
        self._made: list[tuple[Callable[[Any], Any], Any]] = []
        self._publishers: dict[str, Any] = {}
        self._offered: dict[str, Any] = {}
        self._asked: dict[str, Any] = {}
        """Topic -> quality of service of our publisher, and of our subscription."""

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> Publisher:
        """Return a publisher, see `Transport.publisher`."""
        quality = _quality(True, kept, 1 if kept else QUEUE)
        if topic in self._publishers:  # a process of Fast DDS knows one type a topic
            self._node.destroy_publisher(self._publishers[topic])
        made = self._node.create_publisher(message_class(kind), topic, quality)
        self._publishers[topic], self._offered[topic] = made, quality
        self._made.append((self._node.destroy_publisher, made))
        return _RosPublisher(made)

    def subscriber(
        self, topic: str, kind: str, take: Take, *, reliable: bool = False, kept: bool = False
    ) -> None:
        """Subscribe to a topic, see `Transport.subscriber`."""
        quality = _quality(reliable or kept, kept, QUEUE)
        self._asked[topic] = quality
        made = self._node.create_subscription(message_class(kind), topic, take, quality)
        self._made.append((self._node.destroy_subscription, made))

    def listeners(self, topic: str) -> frozenset[str]:
        """Return the types of messages that the subscribers of a topic take."""
        topic = self._node.resolve_topic_name(topic)
        found = self._node.get_subscriptions_info_by_topic(topic)
        return frozenset(str(one.topic_type) for one in found)

    def mismatches(self) -> tuple[str, ...]:
        """Say which peers are not connected, see `Transport.mismatches`."""
        return tuple(mismatches(self._node, self._offered, self._asked))

    def close(self) -> None:
        """Take all publishers and subscribers away."""
        for destroy, made in self._made:
            destroy(made)
        self._made.clear()


def _quality(reliable: bool, kept: bool, depth: int) -> Any:
    """Return the quality of service of a topic."""
    its = ros("rclpy.qos")
    return its.QoSProfile(
        depth=depth,
        reliability=(
            its.ReliabilityPolicy.RELIABLE if reliable else its.ReliabilityPolicy.BEST_EFFORT
        ),
        durability=its.DurabilityPolicy.TRANSIENT_LOCAL if kept else its.DurabilityPolicy.VOLATILE,
    )


@final
class _RosPublisher:
    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    @property
    def has_subscribers(self) -> bool:
        return bool(self._publisher.get_subscription_count())

    def send(self, message: Any) -> None:
        self._publisher.publish(message)


class Signals:
    """Ends a process that prepares by SIGINT or SIGTERM, and counts them in one that drives."""

    def __init__(self) -> None:
        self.count: int = 0
        """That have come."""
        self.driving: bool = False
        """Whether they are counted alone; otherwise they raise KeyboardInterrupt."""
        for one in (signal.SIGINT, signal.SIGTERM):
            signal.signal(one, self._take)

    def _take(self, *_: Any) -> None:
        self.count += 1
        if not self.driving:
            raise KeyboardInterrupt


@final
class RosProcess(Signals):
    """A process of ROS 2 that works until a signal comes."""

    def spin(
        self,
        executor: Any,
        seconds: float | None = None,
        over: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Let an executor work until a signal comes, for so long, s, or until it is over.

        Returns
        -------
        goes_on : False once a signal has come, or ROS has shut down.
        """
        self.driving = True
        ok, log = ros("rclpy").ok, ros("rclpy.logging").get_logger("wideberth")
        end = float("inf") if seconds is None else time.monotonic() + seconds
        left = TICK
        while ok() and not self.count and left > 0.0 and not over():
            left = end - time.monotonic()
            try:
                executor.spin_once(timeout_sec=max(min(left, TICK), 0.0))
            except Exception as error:  # a peer that is gone: it is said, and the node goes on
                log.error(f"{type(error).__name__}: {error}")
                time.sleep(TICK)
        return ok() and not self.count


@contextmanager
def ros_process(arguments: Sequence[str]) -> Iterator[RosProcess]:
    """Join ROS 2, and leave it at the end.

    Parameters
    ----------
    arguments : for ROS, as in ``["--ros-args", "-r", "/odom:=/robot/odom"]``.

    Raises
    ------
    WideberthError : ROS 2 is not found.
    """
    rclpy = ros("rclpy")
    none = ros("rclpy.signals").SignalHandlerOptions.NO
    process = RosProcess()
    rclpy.init(args=list(arguments), signal_handler_options=none)
    try:
        yield process
    finally:
        process.driving = False
        if rclpy.ok():
            rclpy.shutdown()
