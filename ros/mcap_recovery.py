"""Chunks of MCAP files: bounds for what they unpack to, and all that is before a damaged place.

A few kilobytes of a chunk can unpack to gigabytes. Such a chunk counts as damage.
"""

import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, final

from ..framework.values.errors import WideberthError
from .ros_extra import needed

LARGEST_CHUNK = 2**26
"""Bytes that one chunk may unpack to. Recorders begin a new chunk after 1 to 4 MB; one is larger
only where a single message is."""
MOST_TIMES = 100
"""How many times the size of a damaged file all of its chunks may unpack to, beyond one of the
largest chunks."""
MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06


class RecoveredMessage(NamedTuple):
    """One message that could be read.

    Attributes
    ----------
    channel : number of its channel. topic, kind : of that channel.
    definition : text of its type. received : ns. data : CDR.
    """

    channel: int
    topic: str
    kind: str
    definition: str
    received: int
    data: bytes


@final
@dataclass(eq=False)
class _Scan:
    """Reads record after record, and keeps what messages refer to."""

    schemas: dict[int, tuple[str, str]] = field(default_factory=dict)
    channels: dict[int, tuple[int, str]] = field(default_factory=dict)
    whole: bool = True

    def messages(self, data: bytes) -> Iterator[RecoveredMessage]:
        """Yield the messages of a file's records that are whole, those of its chunks included."""
        capacity = LARGEST_CHUNK + MOST_TIMES * len(data)
        end, kind = len(MAGIC), 0
        for kind, body in _records(data, len(MAGIC)):
            end += 9 + len(body)
            if kind == _CHUNK:
                records = _unpacked(body)
                self.whole &= _agrees(body, records)
                capacity -= len(records)
                if capacity < 0:
                    raise WideberthError(f"it unpacks to {MOST_TIMES} times its size and more")
                yield from self.of(_records(records))
            yield from self.of([(kind, body)])
        self.whole &= kind == _FOOTER and data[end:] == MAGIC

    def of(self, records: Iterable[tuple[int, bytes]]) -> Iterator[RecoveredMessage]:
        """Yield the messages among records, up to one that no chunk may hold, as another chunk."""
        for kind, body in records:
            if kind == _SCHEMA:
                number, name, _, text = _texts("<H", body, 3)
                self.schemas[number] = (name, text)
            elif kind == _CHANNEL:
                number, schema, topic = _texts("<HH", body, 1)
                self.channels[number] = (schema, topic)
            elif kind == _MESSAGE and len(body) >= 22:
                number, _, received = struct.unpack_from("<HIQ", body)
                schema, topic = self.channels.get(number, (-1, ""))
                name, text = self.schemas.get(schema, ("", ""))
                yield RecoveredMessage(number, topic, name, text, received, body[22:])
            else:
                return


def recovered_messages(path: Path) -> Iterator[RecoveredMessage]:
    """Yield the messages of an MCAP file up to where it is damaged or ends.

    Raises
    ------
    WideberthError : after the messages that can be read, a record or a chunk that is not whole, a
        chunk that unpacks to more than `LARGEST_CHUNK`, or chunks that unpack to more than
        `MOST_TIMES` the size of the file.
    """
    data, scan = path.read_bytes(), _Scan()
    try:
        yield from scan.messages(data if data.startswith(MAGIC) else b"")
    except (struct.error, UnicodeDecodeError):
        scan.whole = False
    if not scan.whole:
        raise WideberthError("a record or a chunk is not whole")


def check_chunks(path: Path) -> None:
    """Refuse an MCAP file with a chunk that unpacks to more than `LARGEST_CHUNK` bytes.

    Raises
    ------
    WideberthError : there is such a chunk.
    """
    end = path.stat().st_size
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        while len(head := file.read(9)) == 9:
            body = min(int.from_bytes(head[1:], "little"), end - file.tell())
            if head[0] == _CHUNK:
                _unpacked(file.read(body))
            else:
                file.seek(body, os.SEEK_CUR)


def _records(data: bytes, place: int = 0) -> Iterator[tuple[int, bytes]]:
    """Yield the records of a file or a chunk, up to one that is not whole; of a chunk its part."""
    while place + 9 <= len(data) and data[place]:
        kind, size = data[place], int.from_bytes(data[place + 1 : place + 9], "little")
        body = data[place + 9 : place + 9 + size]
        place += 9 + size
        if len(body) == size or kind == _CHUNK:
            yield kind, body


def _texts(numbers: str, body: bytes, count: int) -> tuple[Any, ...]:
    """Return the numbers that a record begins with, and the texts behind them."""
    found = list(struct.unpack_from(numbers, body))
    place = struct.calcsize(numbers)
    for _ in range(count):
        (size,) = struct.unpack_from("<I", body, place)
        place += 4 + size
        found.append(body[place - size : place].decode())
    return tuple(found)


def _unpacked(body: bytes) -> bytes:
    """Return the records of a chunk, as far as they are there."""
    if len(body) < 40:
        return b""
    (size,) = struct.unpack_from("<I", body, 28)
    how, rest = body[32 : 32 + size], body[40 + size :]
    try:
        if how == b"zstd":
            rest = bytes(_zstd().ZstdDecompressor().decompress(rest, LARGEST_CHUNK + 1))
        if how == b"lz4":
            decoder = needed("lz4.frame").LZ4FrameDecompressor()
            rest = bytes(decoder.decompress(rest, LARGEST_CHUNK + 1))
    except Exception:  # decoders raise what they like
        return b""
    if len(rest) > LARGEST_CHUNK:
        raise WideberthError(f"a chunk unpacks to more than {LARGEST_CHUNK} bytes")
    return rest


def _agrees(body: bytes, records: bytes) -> bool:
    """Whether the records of a chunk have the size and the checksum that it states."""
    size, checksum = struct.unpack_from("<QI", body.ljust(28, b"\0"), 16)
    return len(records) == size and checksum in (0, zlib.crc32(records))


def _zstd() -> Any:
    """Return the library that unpacks zstd; Python has it from 3.14 on."""
    import sys

    return needed("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
