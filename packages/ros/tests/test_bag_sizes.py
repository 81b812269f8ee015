"""A small MCAP file that unpacks to gigabytes is read up to the chunk that does so."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth_ros import mcap_recovery
from wideberth_ros.bag_file import read_raw

ODOMETRY = "nav_msgs/msg/Odometry"


def zstd(data: bytes) -> bytes:
    return bytes(mcap_recovery._zstd().compress(data))


def lz4(data: bytes) -> bytes:
    library: Any = pytest.importorskip("lz4.frame")
    return bytes(library.compress(data))


def record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def chunk(packed: bytes, how: str, size: int) -> bytes:
    """Return a chunk of packed records."""
    name = how.encode()
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(name)) + name
    return record(0x06, head + struct.pack("<Q", len(packed)) + packed)


def message(channel: int = 1) -> bytes:
    return record(0x05, struct.pack("<HIQQ", channel, 0, 0, 0) + b"data")


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


HEAD = (
    mcap_recovery.MAGIC
    + record(0x01, text("ros2") + text(""))
    + record(0x03, struct.pack("<H", 1) + text(ODOMETRY) + text("ros2msg") + text("float64 x"))
    + record(0x04, struct.pack("<HH", 1, 1) + text("/odom") + text("cdr") + struct.pack("<I", 0))
)
TAIL = (
    record(0x0F, struct.pack("<I", 0))
    + record(0x02, struct.pack("<QQI", 0, 0, 0))
    + mcap_recovery.MAGIC
)
"""Of a file that is sound."""


@pytest.mark.parametrize(("pack", "how"), [(zstd, "zstd"), (lz4, "lz4")])
@pytest.mark.parametrize("tail", [b"", TAIL], ids=["damaged", "sound"])
def test_a_chunk_that_unpacks_to_more_ends_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pack: Callable[[bytes], bytes], how: str,
    tail: bytes,
) -> None:  # fmt: skip
    monkeypatch.setattr(mcap_recovery, "LARGEST_CHUNK", 10_000)
    whole, large = 100 * message(), 1000 * message()
    assert len(whole) < 10_000 < len(large)
    path = tmp_path / "a.mcap"
    path.write_bytes(HEAD + chunk(pack(whole), how, len(whole))
                     + chunk(pack(large), how, len(large)) + message() + tail)  # fmt: skip
    found = read_raw(path, [ODOMETRY])
    assert len(found.messages) == 100
    assert found.notes == (
        "a.mcap is damaged; the 100 messages before the damage are read: a chunk unpacks to more "
        "than 10000 bytes",
    )


def test_a_bomb_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """256 MB of zeros and 64 of them behind each other, in 0.5 MB."""
    sizes: list[int] = []
    decoder = mcap_recovery._zstd().ZstdDecompressor

    class Counted:
        def decompress(self, data: bytes, *limits: int) -> bytes:
            found: bytes = decoder().decompress(data, *limits)
            sizes.append(len(found))
            return found

    class Library:
        ZstdDecompressor = Counted

    path = tmp_path / "a.mcap"
    packed = zstd(bytes(2**28))
    path.write_bytes(HEAD + message() + chunk(64 * packed, "zstd", 2**34))
    monkeypatch.setattr(mcap_recovery, "_zstd", Library)
    found = read_raw(path, [ODOMETRY])
    assert len(found.messages) == 1 and max(sizes) == mcap_recovery.LARGEST_CHUNK + 1


def test_many_chunks_of_a_small_file_end_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_recovery, "LARGEST_CHUNK", 10_000)
    monkeypatch.setattr(mcap_recovery, "MOST_TIMES", 1)
    whole = 200 * message()
    path = tmp_path / "a.mcap"
    chunks = 50 * chunk(zstd(whole), "zstd", len(whole))
    path.write_bytes(HEAD + chunks)
    found = read_raw(path, [ODOMETRY])
    most = (10_000 + len(HEAD + chunks)) // len(whole)
    assert len(found.messages) == 200 * most < 200 * 50
    assert found.notes[-1].endswith("it unpacks to 1 times its size and more")


def test_a_chunk_within_a_chunk_is_not_opened(tmp_path: Path) -> None:
    """Each would multiply what the file unpacks to."""
    inner = chunk(zstd(message()), "zstd", len(message()))
    path = tmp_path / "a.mcap"
    path.write_bytes(HEAD + chunk(zstd(message() + inner), "zstd", 0))
    assert len(read_raw(path, [ODOMETRY]).messages) == 1


@pytest.mark.parametrize("kind", [0x00, 0x01, 0x05, 0x06, 0x80])
def test_a_chunk_ends_at_a_record_that_it_may_not_hold(tmp_path: Path, kind: int) -> None:
    """Or else millions of empty records take a minute."""
    path = tmp_path / "a.mcap"
    records = message() + record(kind, b"") + message()
    path.write_bytes(HEAD + chunk(zstd(records), "zstd", 0) + message())
    assert len(read_raw(path, [ODOMETRY]).messages) == 2


@pytest.mark.parametrize("size", [2**40, 2**63, 2**64 - 1])
def test_a_record_that_states_any_size(tmp_path: Path, size: int) -> None:
    path = tmp_path / "a.mcap"
    for kind in (0x05, 0x06):
        path.write_bytes(HEAD + message() + struct.pack("<BQ", kind, size) + bytes(10) + TAIL)
        assert len(read_raw(path, [ODOMETRY]).messages) == 1
