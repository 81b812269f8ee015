"""Topics of ROS 2 over Zenoh, in the format of rmw_zenoh: keys, attachments, liveliness."""

import json
import os
import struct
import time
from collections.abc import Iterator
from typing import Any, final

from ..framework.plugins.extras import from_extra
from ..framework.values.errors import WideberthError, short
from .messages import Messages
from .wire import NODE, CountingPublisher, CountingSubscriber

ROUTER = "tcp/127.0.0.1:7447"
"""Where the router of rmw_zenoh is, on the same computer."""
DEPTH = 10
"""Messages that are kept for a reader, as in ROS 2."""


def _zenoh(module: str) -> Any:
    return from_extra(module, "zenoh", "the wire of Zenoh needs eclipse-zenoh")


def wire_name(kind: str) -> str:
    """Return the name that a type has on the wire.

    Examples
    --------
    >>> wire_name("nav_msgs/msg/Path")
    'nav_msgs::msg::dds_::Path_'
    """
    package, folder, name = kind.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def key_of(domain: int, topic: str, kind: str, hashed: str) -> str:
    """Return the key of a topic: ``DOMAIN/TOPIC/TYPE/HASH``."""
    return f"{domain}/{topic.strip('/')}/{wire_name(kind)}/{hashed}"


def quality_of(reliable: bool, kept: bool) -> str:
    """Return a quality of service as a token of liveliness holds it.

    Numbers are those of rmw: reliability (1, or 2 for best effort), durability (1 for transient
    local, or 2), history (1, the last ones) and its depth; the rest is rmw_zenoh's default.
    """
    return f"{1 if reliable else 2}:{1 if kept else 2}:1,{1 if kept else DEPTH}:,:,:,,"


def attachment(number: int, time_ns: int, identity: bytes) -> bytes:
    """Return what goes with a message: its number, when it was sent, and by whom (16 bytes)."""
    return struct.pack("<qqB", number, time_ns, len(identity)) + identity


@final
class ZenohLink:
    """A session of Zenoh, as a client of a router; nothing listens.

    Parameters
    ----------
    known : the message types.
    domain : number of the domain, as ROS_DOMAIN_ID.
    router : where rmw_zenoh's router is.

    Raises
    ------
    WideberthError : eclipse-zenoh is not installed, or there is no router.
    """

    def __init__(self, known: Messages, domain: int = 0, router: str = ROUTER) -> None:
        library = _zenoh("zenoh")
        self.known: Messages = known
        config = library.Config()
        try:
            for key, value in (
                ("mode", "client"),
                ("connect/endpoints", [router]),
                ("scouting/multicast/enabled", False),
                ("timestamping/enabled", True),  # what is kept is ordered by it
            ):
                config.insert_json5(key, json.dumps(value))
            self._session: Any = library.open(config)
        except Exception as error:
            raise WideberthError(
                f"no router of Zenoh answers at {router} ({short(str(error), 80)}); start one, as "
                "in `ros2 run rmw_zenoh_cpp rmw_zenohd`, or name another"
            ) from None
        self._domain = domain
        self._count = 0
        self._tokens = [self._token("NN", "")]
        self._open: list[Any] = []

    def _token(self, what: str, rest: str) -> Any:
        """Announce to the graph of ROS 2 a node, publisher or subscriber."""
        number, self._count = self._count, self._count + 1
        head = f"@ros2_lv/{self._domain}/{self._session.zid()}/0/{number}/{what}/%/%/{NODE}"
        return self._session.liveliness().declare_token(head + rest)

    def _enter(self, what: str, topic: str, kind: str, quality: str) -> str:
        """Check a topic, announce it, and return its key."""
        if not topic.startswith("/"):
            raise WideberthError(f"topic is {topic!r}; wanted one with its slash, as in '/odom'")
        hashed = self.known.type_hash(kind)
        name = topic.replace("/", "%")
        self._tokens.append(self._token(what, f"/{name}/{wire_name(kind)}/{hashed}/{quality}"))
        return key_of(self._domain, topic, kind, hashed)

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> "ZenohPublisher":
        """Return a publisher of a topic; see `wideberth.ros.dds.Link.publisher`."""
        key = self._enter("MP", topic, kind, quality_of(True, kept))
        plain = self._session.declare_publisher(key)
        self._open.append(plain)
        sender = plain
        if kept:
            its = _zenoh("zenoh.ext")
            sender = its.declare_advanced_publisher(
                self._session, key, cache=its.CacheConfig(1), publisher_detection=True
            )
            self._open.append(sender)
        return ZenohPublisher(self.known, sender, plain, kind)

    def subscriber(
        self, topic: str, kind: str, *, reliable: bool = False, kept: bool = False
    ) -> "ZenohSubscriber":
        """Return a subscriber of a topic; see `wideberth.ros.dds.Link.subscriber`."""
        key = self._enter("MS", topic, kind, quality_of(reliable, kept))
        channel = _zenoh("zenoh").handlers.RingChannel(DEPTH)
        if kept:
            its = _zenoh("zenoh.ext")
            history = its.HistoryConfig(detect_late_publishers=True)
            reader = its.declare_advanced_subscriber(self._session, key, channel, history=history)
        else:
            reader = self._session.declare_subscriber(key, channel)
        self._open.append(reader)
        return ZenohSubscriber(self.known, reader, kind)

    def close(self) -> None:
        """Leave the network; without that the process may not end."""
        for one in (*self._tokens, *self._open):
            one.undeclare()
        self._tokens, self._open = [], []
        self._session.close()


@final
class ZenohPublisher(CountingPublisher):
    """Sends messages of one type over Zenoh; see `ZenohLink.publisher`."""

    def __init__(self, known: Messages, sender: Any, plain: Any, kind: str) -> None:
        super().__init__(known, kind)
        self._sender, self._plain = sender, plain
        self._identity = os.urandom(16)
        self._number = 0

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber."""
        try:
            return bool(self._plain.matching_status.matching)
        except Exception:  # of a session that is being closed
            return False

    def put(self, data: bytes) -> None:
        """Hand a message to the router."""
        self._number += 1
        note = attachment(self._number, time.time_ns(), self._identity)
        self._sender.put(data, attachment=note)


@final
class ZenohSubscriber(CountingSubscriber):
    """Takes messages of one type from Zenoh; see `ZenohLink.subscriber`."""

    def __init__(self, known: Messages, reader: Any, kind: str) -> None:
        super().__init__(known, kind)
        self._reader = reader

    def taken(self) -> Iterator[bytes]:
        """Yield what has come."""
        for _ in range(DEPTH):
            sample = self._reader.try_recv()
            if sample is None:
                return
            yield sample.payload.to_bytes()
