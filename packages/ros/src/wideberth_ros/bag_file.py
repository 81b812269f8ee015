"""The files of a recording of ROS 2: topics, and messages as bytes, of damaged files as well."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, final

from wideberth.framework.values.errors import WideberthError, short
from wideberth.predictors.data.recordings import storage_files

from .mcap_recovery import check_chunks, recovered_messages
from .ros_extra import needed

NO_SCHEMA = "__schemaless__"
"""Type that rosbags gives a channel whose schema the summary of an MCAP file lacks."""


class RawTopic(NamedTuple):
    """A topic as one publisher, or several alike ones, offered it.

    Attributes
    ----------
    name : with its slash. kind : type of its messages.
    publishers : how many the recording names. size : number of its messages.
    """

    name: str
    kind: str
    publishers: int
    size: int


class RawMessage(NamedTuple):
    """A message as it stands in a file.

    Attributes
    ----------
    source : number of its `RawTopic`.
    definition : text of its type; "" where the file has none. received : ns. data : CDR.
    """

    source: int
    definition: str
    received: int
    data: bytes


@final
@dataclass(frozen=True, eq=False)
class RawBag:
    """Topics, messages of the kinds asked for, and what was wrong with the files."""

    topics: tuple[RawTopic, ...]
    messages: tuple[RawMessage, ...]
    notes: tuple[str, ...]


def read_raw(path: Path, kinds: Iterable[str]) -> RawBag:
    """Read all topics of a recording, and the messages of some types.

    A file that is damaged is read up to the damage; the notes say so.

    Parameters
    ----------
    path : a folder of rosbag2, or one of its files (.mcap, .db3).
    kinds : types whose messages are wanted.

    Raises
    ------
    WideberthError : no such recording, nothing in it that can be read, or the extra ``ros`` is
        not installed.
    """
    wanted = frozenset(kinds)
    needed("rosbags.rosbag2")
    files = storage_files(path) if path.exists() else []
    if not files:
        raise WideberthError(
            f"{path} is no recording of ROS 2; wanted a folder with .mcap or .db3 files, or one "
            "of them"
        )
    try:
        return _whole(path, wanted)
    except Exception as error:  # of a damaged file: it fails in any way
        first = short(str(error), 120)
    parts = [_part(file, wanted) for file in files]
    found = _joined(parts)
    if not found.topics:
        raise WideberthError(f"{path} cannot be read as a recording of ROS 2: {first}")
    if found.notes:
        return found
    return RawBag(found.topics, found.messages, (f"its metadata is of no use: {first}",))


def _part(file: Path, wanted: frozenset[str]) -> RawBag:
    """Read one file, as far as it goes."""
    try:
        return _whole(file, wanted)
    except Exception as error:  # see above
        reason = short(str(error), 120)
    if file.suffix != ".mcap":
        return RawBag((), (), (f"{file.name} cannot be read: {reason}",))
    return _scanned(file, wanted)


def _whole(path: Path, wanted: frozenset[str]) -> RawBag:
    """Read a recording, or one of its files, that is sound."""
    for file in storage_files(path):
        if file.suffix == ".mcap":
            check_chunks(file)  # rosbags unpacks a chunk to whatever size it has
    with needed("rosbags.rosbag2").Reader(path) as reader:
        topics = tuple(
            RawTopic(
                *(one.topic, one.msgtype, max(len(one.ext.offered_qos_profiles), 1)), one.msgcount
            )
            for one in reader.connections
        )
        place = {id(one): i for i, one in enumerate(reader.connections)}
        chosen = [one for one in reader.connections if one.msgtype in wanted]
        found = reader.messages(chosen) if chosen else ()
        rows = tuple(
            RawMessage(place[id(one)], one.msgdef.data, received, bytes(data))
            for one, received, data in found
        )
        total = reader.message_count
    if any(file.suffix == ".mcap" for file in storage_files(path)):
        listed = sum(one.size for one in topics)
        indexed = sum(one.size for one in topics if one.kind in wanted)
        if total > listed or indexed > len(rows) or any(one.kind == NO_SCHEMA for one in topics):
            raise WideberthError("the summary of an MCAP file does not name all messages")
    return RawBag(topics, rows, ())


def _scanned(file: Path, wanted: frozenset[str]) -> RawBag:
    """Read an MCAP file record by record, up to its end or to where it is damaged.

    A sound file need not have a summary, and its summary need not repeat all.
    """
    place: dict[int, int] = {}
    topics: list[RawTopic] = []
    rows = []
    remark = "has no complete summary; all {} messages are read"
    try:
        for one in recovered_messages(file):
            if one.channel not in place:
                place[one.channel] = len(topics)
                topics.append(RawTopic(one.topic, one.kind, 1, 0))
            at = place[one.channel]
            topics[at] = topics[at]._replace(size=topics[at].size + 1)
            if one.kind in wanted:
                rows.append(RawMessage(at, one.definition, one.received, one.data))
    except WideberthError as error:
        remark = f"is damaged; the {{}} messages before the damage are read: {error}"
    total = sum(one.size for one in topics)
    note = f"{file.name} {remark.format(total)}"
    return RawBag(tuple(topics), tuple(rows), (note,))


def _joined(parts: list[RawBag]) -> RawBag:
    """Put the files of one recording together."""
    topics: dict[tuple[str, str, int], RawTopic] = {}
    rows: list[RawMessage] = []
    for part in parts:
        seen: dict[tuple[str, str], int] = {}
        keys = []
        for one in part.topics:
            number = seen.setdefault(one[:2], 0)
            seen[one[:2]] += 1
            key = (*one[:2], number)
            keys.append(key)
            before = topics.get(key)
            topics[key] = one._replace(size=one.size + (before.size if before else 0))
        order = list(topics)
        rows += [row._replace(source=order.index(keys[row.source])) for row in part.messages]
    notes = tuple(note for part in parts for note in part.notes)
    return RawBag(tuple(topics.values()), tuple(rows), notes)
