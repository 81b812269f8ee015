"""What publishers and subscribers of every wire share: types are checked, losses counted."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

from ..framework.plugins.registry import unknown
from ..framework.values.errors import WideberthError
from .messages import Messages

NODE = "wideberth"
"""Name of our node in the graph of ROS 2."""


class CountingPublisher(ABC):
    """Sends messages of one type.

    A subclass gives `put` and `has_subscribers`.

    Parameters
    ----------
    known : the message types. kind : that of the messages.
    """

    def __init__(self, known: Messages, kind: str) -> None:
        self.known: Messages = known
        self.kind: str = kind
        self.failed: int = 0
        """Messages that could not be sent."""
        known.prepare(kind)

    @property
    @abstractmethod
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber."""

    @abstractmethod
    def put(self, data: bytes) -> None:
        """Hand a message to the wire; raises whatever the library does where it cannot."""

    def send(self, message: Any) -> None:
        """Send a message; what cannot be sent is counted.

        Raises
        ------
        WideberthError : a message of another type.
        """
        if message.__msgtype__ != self.kind:
            raise WideberthError(unknown("type on this topic", message.__msgtype__, [self.kind]))
        data = self.known.to_bytes(message)
        try:
            self.put(data)
        except Exception:  # a full queue, a network or a router that is gone
            self.failed += 1


class CountingSubscriber(ABC):
    """Takes messages of one type.

    A subclass gives `taken`.

    Parameters
    ----------
    known : the message types. kind : that of the messages.
    """

    def __init__(self, known: Messages, kind: str) -> None:
        self.known: Messages = known
        self.kind: str = kind
        self.refused: int = 0
        """Messages that were malformed."""
        self.reason: str = ""
        """Why the last of them was refused."""
        known.prepare(kind)

    @abstractmethod
    def taken(self) -> Iterator[bytes]:
        """Yield what has come, as bytes; raises whatever the library does where it cannot."""

    def take(self) -> Iterator[Any]:
        """Yield the messages that have come; malformed ones are counted and left out."""
        try:
            for data in self.taken():
                try:
                    message = self.known.read(self.kind, data)
                except WideberthError as error:
                    self._refuse(error)
                else:
                    yield message
        except Exception as error:  # of something that is being closed
            self._refuse(error)

    def _refuse(self, error: Exception) -> None:
        self.refused += 1
        self.reason = str(error)
