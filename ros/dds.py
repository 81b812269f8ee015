"""Topics of ROS 2 over DDS, without ROS: names, types and qualities as its own nodes have."""

import logging
import os
import socket
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from stat import S_ISSOCK
from typing import Any, final
from xml.sax.saxutils import quoteattr

from ..framework.values.errors import WideberthError
from .dds_types import idl_class
from .messages import MOST_BYTES, Messages
from .ros_extra import needed
from .wire import NODE, CountingPublisher, CountingSubscriber

LOOPBACK, OWN_CHOICE = "lo", "default"
"""Interfaces: nothing leaves the computer; what Cyclone DDS or CYCLONEDDS_URI choose."""
DEPTH = 10
"""Messages that are kept for a reader, as in ROS 2."""
GRAPH, ENTITIES = "ros_discovery_info", "rmw_dds_common/msg/ParticipantEntitiesInfo"
"""Topic on which the nodes of ROS 2 say which publishers and subscribers are theirs, its type."""
AT_ONCE = 64
"""Messages that are taken at once."""
_LOG = logging.getLogger("wideberth")


@final
class Raw:
    """A message as bytes, which Cyclone DDS writes and reads as they are."""

    def __init__(self, data: bytes) -> None:
        self.data: bytes = data
        self.sample_info: Any = None

    def serialize(self, **_: Any) -> bytes:
        """Return the bytes."""
        return self.data


@cache
def _raw_class(known: Messages, name: str) -> Any:
    """Return the class of a message, of which Cyclone DDS reads bytes alone.

    Fields are read by `Messages.read`, which bounds what a malformed message can do.
    """
    made = idl_class.__wrapped__(known, name)
    made.serialize = lambda self, **_: self.data
    made.deserialize = classmethod(lambda cls, data, **_: Raw(bytes(data[: MOST_BYTES + 1])))
    made.deserialize_key = classmethod(lambda cls, data, **_: None)
    return made


@cache
def _domain(number: int, interface: str) -> Any:
    """Return the domain of this process; a second one of the same number cannot be set up."""
    address = (
        '<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>'
        "<AllowMulticast>false</AllowMulticast></General>"
        '<Discovery><Peers><Peer address="127.0.0.1"/></Peers>'
        "<ParticipantIndex>auto</ParticipantIndex>"
        "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex></Discovery>"
        if interface == LOOPBACK
        else f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces></General>"
    )
    text = f'<CycloneDDS><Domain id="any"><General>{address}</Domain></CycloneDDS>'
    try:
        return needed("cyclonedds.domain").Domain(number, text)
    except Exception as error:
        raise WideberthError(
            f"DDS cannot be set up on the interface {interface!r} ({error}); see that it exists, "
            "and that this process uses one interface alone"
        ) from None


def udp_sockets(first: int, count: int) -> list[socket.socket]:
    """Return this process' UDP sockets of IPv4 that listen on some ports, for Linux alone.

    They are further handles of the same sockets; the caller closes them.

    Parameters
    ----------
    first, count : of the ports.
    """
    found = []
    folder = Path("/proc/self/fd")
    for name in [one.name for one in folder.iterdir()] if folder.is_dir() else ():
        try:
            if not S_ISSOCK(os.fstat(int(name)).st_mode):
                continue
            one = socket.socket(fileno=os.dup(int(name)))
        except OSError:  # closed in the meantime
            continue
        kind = one.family == socket.AF_INET and one.type == socket.SOCK_DGRAM
        if kind and first <= one.getsockname()[1] < first + count:
            found.append(one)
        else:
            one.close()
    return found


def _bind_to_loopback(domain: int) -> None:
    """Tie the sockets of a domain to the loopback interface; Cyclone DDS opens them to all.

    A domain has the ports from 7400 + 250 domain on (DDSI-RTPS 2.5, 9.6.2).
    """
    sockets = udp_sockets(7400 + 250 * domain, 250)
    tied = bool(sockets)
    for one in sockets:
        try:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, LOOPBACK.encode())
        except (OSError, AttributeError):  # an old kernel, another system
            tied = False
        one.close()
    if not tied:
        _LOG.warning(
            "the UDP ports of the DDS domain %d could not be tied to the loopback interface: "
            "Cyclone DDS listens on them on all interfaces; let a firewall close them", domain,
        )  # fmt: skip


@final
class Link:
    """A participant of a DDS domain, and a node by the name of `NODE` in the graph of ROS 2.

    Parameters
    ----------
    known : the message types.
    domain : number of the domain, as ROS_DOMAIN_ID.
    interface : name of a network interface; "lo" keeps everything on this computer, "default"
        leaves it to Cyclone DDS.

    Raises
    ------
    WideberthError : the extra ``ros`` is not installed, or there is no such interface or domain.
    """

    def __init__(self, known: Messages, domain: int = 0, interface: str = LOOPBACK) -> None:
        if not 0 <= domain <= 232:
            raise WideberthError(f"domain is {domain}; wanted 0 to 232")
        library = needed("cyclonedds.domain")
        if interface != OWN_CHOICE:
            _domain(domain, interface)
        self.known: Messages = known
        its = needed("cyclonedds.qos")
        ours = its.Qos(its.Policy.Userdata(b"enclave=/;"))  # so that rmw knows it as one of ROS
        try:
            self._participant: Any = library.DomainParticipant(domain, qos=ours)
        except Exception as error:
            raise WideberthError(f"DDS cannot join the domain {domain}: {error}") from None
        if interface == LOOPBACK:
            _bind_to_loopback(domain)
        self._writers: list[Any] = []
        self._readers: list[Any] = []
        self._graph: DdsPublisher | None = DdsPublisher(
            known, self._writer(GRAPH, ENTITIES, True), ENTITIES
        )
        self._announce()

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> "DdsPublisher":
        """Return a publisher of a topic.

        Parameters
        ----------
        topic : as ROS 2 names it, with its slash. kind : type of its messages.
        kept : whether those who join later are given the last message too.
        """
        writer = self._writer(_wire_topic(topic), kind, kept)
        self._writers.append(writer.guid)
        self._announce()
        return DdsPublisher(self.known, writer, kind)

    def subscriber(
        self, topic: str, kind: str, *, reliable: bool = False, kept: bool = False
    ) -> "DdsSubscriber":
        """Return a subscriber of a topic.

        Parameters
        ----------
        topic, kind : as of `publisher`.
        reliable : whether a lost message is sent again; a publisher that does not offer that is
            then not matched.
        kept : whether to ask for the last message of before; a publisher that does not keep it is
            then not matched.
        """
        made, quality = (
            self._topic(_wire_topic(topic), kind),
            _quality(self.known, kind, reliable, kept),
        )
        reader = needed("cyclonedds.sub").DataReader(self._participant, made, quality)
        self._readers.append(reader.guid)
        self._announce()
        return DdsSubscriber(self.known, reader, kind)

    def close(self) -> None:
        """Leave the domain, as soon as its publishers and subscribers are gone."""
        self._graph = self._participant = None

    def _writer(self, name: str, kind: str, kept: bool) -> Any:
        made, quality = self._topic(name, kind), _quality(self.known, kind, True, kept)
        return needed("cyclonedds.pub").DataWriter(self._participant, made, quality)

    def _topic(self, name: str, kind: str) -> Any:
        made = _raw_class(self.known, kind)
        return needed("cyclonedds.topic").Topic(self._participant, name, made)

    def _announce(self) -> None:
        """Announce this node's publishers and subscribers in the graph of ROS 2."""
        assert self._graph is not None
        known, prefix = self.known, "rmw_dds_common/msg/"

        def gid(guid: Any) -> Any:
            made = known.make(f"{prefix}Gid")
            made.data[:16] = list(guid.bytes)  # Humble has eight zeros more
            return made

        node = known.make(
            f"{prefix}NodeEntitiesInfo", node_namespace="/", node_name=NODE,
            reader_gid_seq=[gid(one) for one in self._readers],
            writer_gid_seq=[gid(one) for one in self._writers],
        )  # fmt: skip
        own = gid(self._participant.guid)
        self._graph.send(known.make(ENTITIES, gid=own, node_entities_info_seq=[node]))


def _wire_topic(topic: str) -> str:
    """Return the name that a topic of ROS 2 has in DDS."""
    if not topic.startswith("/"):
        raise WideberthError(f"topic is {topic!r}; wanted one with its slash, as in '/odom'")
    return f"rt{topic}"


def _quality(known: Messages, kind: str, reliable: bool, kept: bool) -> Any:
    """Return the quality of service that ROS 2 has."""
    its = needed("cyclonedds.qos")
    wait = needed("cyclonedds.util").duration(milliseconds=100)
    policy = its.Policy
    return its.Qos(
        policy.Reliability.Reliable(wait) if reliable else policy.Reliability.BestEffort,
        policy.History.KeepLast(1 if kept else DEPTH),
        policy.Durability.TransientLocal if kept else policy.Durability.Volatile,
        policy.DataRepresentation(use_cdrv0_representation=True),  # what ROS 2 speaks
        policy.Userdata(f"typehash={known.type_hash(kind)};".encode()),
    )


@final
class DdsPublisher(CountingPublisher):
    """Sends messages of one type over DDS; see `Link.publisher`."""

    def __init__(self, known: Messages, writer: Any, kind: str) -> None:
        super().__init__(known, kind)
        self._writer = writer
        self._made = writer.topic.data_type

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber."""
        try:
            return bool(self._writer.get_matched_subscriptions())
        except Exception:  # of an entity that is being closed
            return False

    def put(self, data: bytes) -> None:
        """Hand a message to Cyclone DDS."""
        sample = self._made.__new__(self._made)
        sample.data = data
        self._writer.write(sample)


@final
class DdsSubscriber(CountingSubscriber):
    """Takes messages of one type from DDS; see `Link.subscriber`."""

    def __init__(self, known: Messages, reader: Any, kind: str) -> None:
        super().__init__(known, kind)
        self._reader = reader
        self._invalid = needed("cyclonedds.internal").InvalidSample

    def taken(self) -> Iterator[bytes]:
        """Yield what has come; an invalid sample says that a publisher has gone."""
        for one in self._reader.take(AT_ONCE):
            if not isinstance(one, self._invalid):
                yield one.data
