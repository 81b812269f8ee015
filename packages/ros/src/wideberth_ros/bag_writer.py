"""Recordings of ROS 2, written."""

from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError

from .messages import Messages
from .ros_extra import needed

STORAGES = ("mcap", "sqlite3")
TEXT, LIST = 8, 9
"""Versions of rosbag2's metadata: up to 8 what publishers offer is one text of numbers, from 9 on
a list of names. Humble writes 5 and reads the text; Jazzy and later write 9 and read both."""
VERSIONS = {"humble": TEXT, "jazzy": LIST, "kilted": LIST, "lyrical": LIST}
"""Distribution -> version that its own readers take."""


@final
class BagWriter:
    """Writes messages into a folder of rosbag2; to be used in a ``with`` block.

    Parameters
    ----------
    folder : that must not exist yet.
    known : the message types; their distribution's own readers take the recording.
    storage : one of `STORAGES`.

    Raises
    ------
    WideberthError : the folder exists or cannot be made, another storage, or the extra ``ros`` is
        not installed.
    """

    def __init__(self, folder: Path, known: Messages, storage: str = "mcap") -> None:
        if storage not in STORAGES:
            raise WideberthError(unknown("storage", storage, list(STORAGES)))
        library = needed("rosbags.rosbag2")
        if folder.exists():
            raise WideberthError(
                f"{folder} exists; a recording is not replaced: give another name"
            )
        self.folder: Path = folder
        self.known: Messages = known
        self._open: dict[tuple[str, str], Any] = {}
        plugin = library.StoragePlugin[storage.upper()]
        version = VERSIONS[known.distribution]
        self._bag: Any = library.Writer(folder, version=version, storage_plugin=plugin)

    def __enter__(self) -> Self:
        """Open the files."""
        try:
            self._bag.open()
        except OSError as error:
            raise WideberthError(
                f"{self.folder} cannot be made: {error.strerror}; give another folder with --out"
            ) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        place: TracebackType | None,
    ) -> None:  # fmt: skip
        """Close the files."""
        self._bag.__exit__(kind, error, place)

    def write(self, topic: str, received: int, message: Any, *, kept: bool = False) -> None:
        """Write a message.

        Parameters
        ----------
        topic : with its slash. received : ns.
        message : see `Messages.make`.
        kept : whether those who join later are given it too (of maps and static frames).
        """
        kind = message.__msgtype__
        if (topic, kind) not in self._open:
            self._open[topic, kind] = self._bag.add_connection(
                topic, kind, typestore=self.known.store, offered_qos_profiles=[_offered(kept)]
            )
        self._bag.write(self._open[topic, kind], received, self.known.to_bytes(message))


def _offered(kept: bool) -> Any:
    """Return how a publisher of ROS 2 offers a topic."""
    its = needed("rosbags.interfaces")
    lasting = its.QosDurability.TRANSIENT_LOCAL if kept else its.QosDurability.VOLATILE
    forever = its.QosTime(0, 0)
    return its.Qos(
        its.QosHistory.KEEP_LAST, 1 if kept else 10, its.QosReliability.RELIABLE, lasting,
        forever, forever, its.QosLiveliness.AUTOMATIC, forever, False,
    )  # fmt: skip
