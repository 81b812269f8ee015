"""The topic of velocities, in the kind of message that those who listen take."""

from typing import Any, final

from .link import Publisher, Transport

STAMPED, PLAIN = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist"


@final
class CommandTopic:
    """Sends velocities as `TwistStamped` or `Twist`.

    Parameters
    ----------
    link : the network. topic : of the velocities.
    stamped : the kind; None for the one that the subscribers take, and for `TwistStamped`, Nav2's
        from Kilted on, where they take both.
    """

    def __init__(self, link: Transport, topic: str, stamped: bool | None) -> None:
        self.problem: str = ""
        """Why no robot takes the velocities; "" where one does."""
        self._link, self._topic, self._stamped = link, topic, stamped
        self._publisher: Publisher | None = None
        self._kind = ""
        self.agree()

    def agree(self) -> None:
        """Find out who listens, and send what they take."""
        taken = self._link.listeners(self._topic) & {STAMPED, PLAIN}
        kind = self._kind
        if self._stamped is not None:
            kind = STAMPED if self._stamped else PLAIN
        elif taken:
            kind = STAMPED if STAMPED in taken else PLAIN
        if kind != self._kind:
            self._publisher, self._kind = self._link.publisher(self._topic, kind), kind
        self.problem = ""
        if not taken:
            self.problem = f"{self._topic} has no subscriber"
        elif self._kind not in taken:
            wants = PLAIN if self._kind == STAMPED else STAMPED
            wanted = "false" if self._stamped else "true"
            self.problem = (
                f"{self._topic} is sent as {self._kind}, but its subscribers take {wants}: "
                f"set stamped to {wanted}, or leave it out"
            )

    def send(self, message: Any) -> None:
        """Send a velocity, stated as `TwistStamped`."""
        if self._publisher is None:  # a clock that stands would never look again
            self.agree()
        if self._publisher is not None:
            self._publisher.send(message if self._kind == STAMPED else message.twist)
