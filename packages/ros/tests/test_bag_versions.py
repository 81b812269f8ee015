"""Recordings for each distribution of ROS 2: its own reader takes them.

The reader here shares no code with the writer. It takes metadata by the rules of rosbag2's C++
readers: every key that they ask for is there, of the type that they ask for, and nothing is read
in a form that a version does not have.

=============  ==========  ===========================================================
Distribution   It writes   What publishers offer, as it reads it
=============  ==========  ===========================================================
Humble         5           from version 4 on one text, YAML of a list, policies numbers
Iron           7           the same
Jazzy, Kilted  9           below 9 that text; from 9 on a list, policies names
=============  ==========  ===========================================================

Sources: ros2/rosbag2, rosbag2_storage: humble src/rosbag2_storage/metadata_io.cpp, iron and jazzy
include/rosbag2_storage/yaml.hpp; src/rosbag2_transport/qos.cpp of rosbag2_transport (humble, iron)
and src/rosbag2_storage/qos.cpp (jazzy); Lyrical's is taken to be as Jazzy's.
"""

import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from wideberth_ros.bag import read_bag
from wideberth_ros.bag_writer import STORAGES, BagWriter
from wideberth_ros.encoding import MessageEncoder
from wideberth_ros.messages import DISTRIBUTIONS, messages

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

EPOCH = 10**18
POLICIES: dict[str, dict[str, int]] = {
    "history": {"system_default": 0, "keep_last": 1, "keep_all": 2},
    "reliability": {"system_default": 0, "reliable": 1, "best_effort": 2},
    "durability": {"system_default": 0, "transient_local": 1, "volatile": 2},
    "liveliness": {"system_default": 0, "automatic": 1, "manual_by_topic": 3},
}
"""Name and number of each policy in rmw/types.h."""


def text(node: dict[str, Any], key: str) -> str:
    """A scalar as yaml-cpp converts it to a string; a list or a mapping is no string."""
    value = node[key]
    assert isinstance(value, str | int | float), f"{key} is a {type(value).__name__}, no string"
    return str(value)


def whole(node: dict[str, Any], key: str) -> int:
    value = node[key]
    assert isinstance(value, int) and not isinstance(value, bool) and value >= 0, (key, value)
    return value


@dataclass(frozen=True)
class Reader:
    """What one distribution reads.

    Attributes
    ----------
    lists : the first version whose offers it reads as a list; None where it has none such.
    hashes, custom, named : the first version of which it wants hashes of types, custom data, and
        the distribution's name.
    """

    lists: int | None
    hashes: int | None = 7
    custom: int | None = 6
    named: int | None = None

    def read(self, folder: Path) -> dict[str, list[dict[str, int]]]:
        """Return topic -> what its publishers offer."""
        raw = yaml.safe_load((folder / "metadata.yaml").read_text())
        return self.parsed(raw["rosbag2_bagfile_information"], folder)

    def parsed(self, info: dict[str, Any], folder: Path) -> dict[str, list[dict[str, int]]]:
        version = whole(info, "version")
        assert text(info, "storage_identifier") in ("mcap", "sqlite3")
        whole(info["duration"], "nanoseconds")
        whole(info["starting_time"], "nanoseconds_since_epoch")
        whole(info, "message_count")
        assert all((folder / one).is_file() for one in info["relative_file_paths"])
        assert text(info, "compression_format") == text(info, "compression_mode") == ""
        for one in info["files"]:
            assert text(one, "path") in info["relative_file_paths"]
            whole(one["starting_time"], "nanoseconds_since_epoch")
            whole(one["duration"], "nanoseconds")
            whole(one, "message_count")
        if self.custom is not None and version >= self.custom:
            assert not info["custom_data"]
        if self.named is not None and version >= self.named:
            text(info, "ros_distro")
        found = {}
        for row in info["topics_with_message_count"]:
            whole(row, "message_count")
            topic = row["topic_metadata"]
            assert text(topic, "serialization_format") == "cdr" and text(topic, "type")
            if self.hashes is not None and version >= self.hashes:
                assert text(topic, "type_description_hash").startswith("RIHS01_")
            found[text(topic, "name")] = self.offers(topic, version)
        return found

    def offers(self, topic: dict[str, Any], version: int) -> list[dict[str, int]]:
        """Read what the publishers of a topic offer."""
        if self.lists is not None and version >= self.lists:
            rows = topic["offered_qos_profiles"]
        else:
            assert version >= 4
            rows = yaml.safe_load(text(topic, "offered_qos_profiles"))
        assert isinstance(rows, list)
        return [self.offer(row) for row in rows]

    def offer(self, row: dict[str, Any]) -> dict[str, int]:
        """Read one offer; Humble and Iron know numbers alone, later ones go by the history."""
        numbers = self.lists is None or isinstance(row["history"], int)
        found = {"depth": whole(row, "depth")}
        for name, known in POLICIES.items():
            found[name] = whole(row, name) if numbers else known[text(row, name)]
            assert found[name] in known.values()
        for name in ("deadline", "lifespan", "liveliness_lease_duration"):
            assert whole(row[name], "sec") == whole(row[name], "nsec") == 0  # none was stated
        assert row["avoid_ros_namespace_conventions"] is False
        return found


READERS = {
    "humble": Reader(None, hashes=None, custom=None),
    "iron": Reader(None),
    **dict.fromkeys(("jazzy", "kilted", "lyrical"), Reader(9, named=8)),
}
TAKES = {
    "humble": ("humble", "iron", "jazzy", "kilted", "lyrical"),
    **dict.fromkeys(("jazzy", "kilted", "lyrical"), ("jazzy", "kilted", "lyrical")),
}
"""Distribution -> those that read its recordings."""
MOVING = {"depth": 10, "history": 1, "reliability": 1, "durability": 2, "liveliness": 1}
KEPT = MOVING | {"depth": 1, "durability": 1}


@pytest.fixture(params=STORAGES)
def storage(request: Any) -> str:
    return str(request.param)


def written(folder: Path, distribution: str, storage: str) -> Path:
    """Write a transform that moves and one that lasts."""
    wording = MessageEncoder(EPOCH, "map", messages(distribution))
    out = folder / "out"
    with BagWriter(out, wording.known, storage) as bag:
        for k in range(3):
            moved = wording.transform(0.1 * k, "base", (0.1 * k, 0.0, 0.0), 0.0)
            bag.write("/tf", EPOCH + k * 10**8, moved)
        bag.write("/tf_static", EPOCH, wording.transform(0.0, "lidar", (0.0, 0.0, 0.0), 0.0),
                  kept=True)  # fmt: skip
    return out


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_a_distributions_own_reader_takes_its_recordings(
    distribution: str, storage: str, tmp_path: Path
) -> None:
    out = written(tmp_path, distribution, storage)
    for name in TAKES[distribution]:
        assert READERS[name].read(out) == {"/tf": [MOVING], "/tf_static": [KEPT]}
    back = read_bag(out)
    assert back.notes == () and {one.count for one in back.topics.values()} == {3, 1}


@pytest.mark.parametrize("name", ["humble", "iron"])
def test_older_readers_do_not_take_newer_recordings(
    name: str, storage: str, tmp_path: Path
) -> None:
    """The reader of this test is as strict as theirs."""
    out = written(tmp_path, "jazzy", storage)
    with pytest.raises(AssertionError, match="offered_qos_profiles is a list, no string"):
        READERS[name].read(out)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_the_file_alone_says_the_same(distribution: str, tmp_path: Path) -> None:
    """A player that is given the file without its folder takes offers from there, as text."""
    out = written(tmp_path, distribution, "sqlite3")
    (file,) = out.glob("*.db3")
    with sqlite3.connect(file) as base:
        rows = dict(base.execute("SELECT name, offered_qos_profiles FROM topics"))
        (inside,) = base.execute("SELECT metadata_version, metadata FROM metadata")
    for name in TAKES[distribution]:
        reader = READERS[name]
        found = {
            topic: [reader.offer(row) for row in yaml.safe_load(offered)]
            for topic, offered in rows.items()
        }
        assert found == {"/tf": [MOVING], "/tf_static": [KEPT]}
        info = yaml.safe_load(inside[1])
        assert info["version"] == inside[0] and reader.parsed(info, out) == found


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_the_channels_of_mcap_say_the_same(distribution: str, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader", reason="pip install mcap-ros2-support")
    out = written(tmp_path, distribution, "mcap")
    with (out / "out.mcap").open("rb") as stream:
        channels = reader.make_reader(stream).get_summary().channels.values()
        rows = {one.topic: one.metadata["offered_qos_profiles"] for one in channels}
    for name in TAKES[distribution]:
        for topic, wanted in (("/tf", MOVING), ("/tf_static", KEPT)):
            found = [READERS[name].offer(row) for row in yaml.safe_load(rows[topic])]
            assert found == [wanted]
