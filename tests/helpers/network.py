"""A network of ROS 2 that is not there: messages wait until they are delivered."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from wideberth_ros.messages import messages


@dataclass
class Wire:
    """A topic: what has come, and what has gone."""

    kind: str
    take: Callable[[Any], None] = lambda message: None
    has_subscribers: bool = True
    come: list[Any] = field(default_factory=list)
    gone: list[Any] = field(default_factory=list)

    def send(self, message: Any) -> None:
        """Keep a message that can be written."""
        messages().to_bytes(message)
        self.gone.append(message)


@dataclass
class Network:
    """All topics by name; one robot takes the commands, of the kinds that it listens to."""

    listened: frozenset[str] = frozenset({"geometry_msgs/msg/TwistStamped"})
    known: Any = field(default_factory=messages)
    wires: dict[str, Wire] = field(default_factory=dict)
    unmatched: tuple[str, ...] = ()

    def publisher(self, topic: str, kind: str, **_: Any) -> Wire:
        """Return a topic, anew where its kind is another one."""
        if topic not in self.wires or self.wires[topic].kind != kind:
            self.wires[topic] = Wire(kind)
        return self.wires[topic]

    def subscriber(self, topic: str, kind: str, take: Callable[[Any], None], **_: Any) -> None:
        """Let what comes on a topic be taken."""
        self.publisher(topic, kind).take = take

    def listeners(self, topic: str) -> frozenset[str]:
        """Return the kinds that subscribers of a topic take."""
        return self.listened

    def mismatches(self) -> tuple[str, ...]:
        """Return what was set as unmatched."""
        return self.unmatched

    def deliver(self) -> None:
        """Deliver what has come."""
        for wire in list(self.wires.values()):
            found, wire.come = wire.come, []
            for message in found:
                wire.take(message)
