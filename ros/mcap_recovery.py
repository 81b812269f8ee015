"""Recovery of a damaged MCAP file: everything before the damage is read."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, final

from .ros_extra import needed

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x03, 0x04, 0x05, 0x06


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

    def messages(self, data: bytes) -> Iterator[RecoveredMessage]:
        """Yield the messages of records that are whole."""
        place = 0
        while place + 9 <= len(data):
            kind, size = data[place], int.from_bytes(data[place + 1 : place + 9], "little")
            body = data[place + 9 : place + 9 + size]
            place += 9 + size
            if kind == _CHUNK:
                yield from self.messages(_unpacked(body))
            if len(body) < size:
                return
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


def recovered_messages(path: Path) -> Iterator[RecoveredMessage]:
    """Yield the messages of an MCAP file up to where it is damaged or ends."""
    data = path.read_bytes()
    scan = _Scan()
    try:
        yield from scan.messages(data[len(MAGIC) :] if data.startswith(MAGIC) else b"")
    except (struct.error, UnicodeDecodeError, RecursionError):
        return


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
            return bytes(_zstd().ZstdDecompressor().decompress(rest))
        if how == b"lz4":
            return bytes(needed("lz4.frame").LZ4FrameDecompressor().decompress(rest))
    except Exception:  # decoders raise what they like
        return b""
    return rest


def _zstd() -> Any:
    """Return the library that unpacks zstd; Python has it from 3.14 on."""
    import sys

    return needed("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
