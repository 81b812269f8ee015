"""Messages: type hashes against published ones and a second computation, malformed bytes."""

import hashlib
import json
import re
import sys
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.packages.ros.tests.helpers.message_samples import TEN, samples
from wideberth_ros.definitions import ACTIONS, DEFINITIONS
from wideberth_ros.messages import DISTRIBUTIONS, Messages, messages

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

PUBLISHED = {
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "nav_msgs/msg/Path": "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    "geometry_msgs/msg/Twist": "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "geometry_msgs/msg/TwistStamped": (
        "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"
    ),
    "sensor_msgs/msg/LaserScan": (
        "64c191398013af96509d518dac71d5164f9382553fce5c1f8cca5be7924bd828"
    ),
    "nav2_dynamic_msgs/msg/ObstacleArray": (
        "30bef8eb1da85ccb8d8fd860be402b7710dd81b368d1622325aa617436b0cb2a"
    ),
    "nav2_msgs/msg/SpeedLimit": "83d8e4e842559f4d9a988b19d31b162216ec738536389f98438d1a166f91845a",
    "vision_msgs/msg/Detection3DArray": (
        "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
    ),
    "costmap_converter_msgs/msg/ObstacleArrayMsg": (
        "ec79215656d8d48c5b0f6c922ccdc2ccb4b4f10c4c2871d5044f5444fae3090c"
    ),
}
"""As ROS 2 prints them."""


PARTS = {
    "nav2_msgs/action/FollowPath": (
        "7ec8732a3a001bf92b87db3989ef6984b1a4b9b9e62e166543ffa72344ecd194",
        "432bc8fc1c0de59f8181d00bf8dcc7d58e76cebcfd2de471361e62f468ad4428",
        "496acbe672234cdb70be4f93d28a22aabbf441958e2e1ff443a44a96e9f3185b",
    ),
    "nav2_msgs/action/NavigateToPose": (
        "22a9dffbd6733011220460bd52edbc7843c8fc86282d40bc7ad3ca176a9dec10",
        "ddbff7fc6d1e51d774d5defdb8398a57cb23fa8709355002d676408bb4860b85",
        "9ebc544c7d41bd8c6060b191bf9f5e4ddca6c2f61ee9e04fcb62ed5d67218a33",
    ),
}
"""Hashes of goal, result and feedback in public builds of Nav2 for Jazzy and Kilted."""


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_parts_of_actions_have_the_published_hashes(distribution: str) -> None:
    known = Messages(distribution)
    for name, text in ACTIONS.items():
        parts = {f"{name}_{part}": one for part, one in
                 zip(("Goal", "Result", "Feedback"), text.split("---"), strict=True)}  # fmt: skip
        known.add(parts)
        found = [known.type_hash(part) for part in parts]
        assert found == [f"RIHS01_{digest}" for digest in PARTS[name]]


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_type_hashes_are_the_published_ones(distribution: str) -> None:
    known = messages(distribution)
    found = {name: known.type_hash(name) for name in PUBLISHED}
    assert found == {name: f"RIHS01_{digest}" for name, digest in PUBLISHED.items()}


def test_a_char_is_hashed_as_the_number_that_it_is() -> None:
    """ROS 2 itself prints this hash, of the message in which its nodes name themselves."""
    found = messages("jazzy").type_hash("rmw_dds_common/msg/ParticipantEntitiesInfo")
    assert found == "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"
    known = Messages()
    known.add(
        {"a/msg/Letter": "char x", "a/msg/Letters": "char[] x", "a/msg/Both": "a/Letter[2] y"}
    )
    before = {one: known.type_hash(f"a/msg/{one}") for one in ("Letter", "Letters", "Both")}
    known = Messages()
    known.add({"a/msg/Letter": "uint8 x", "a/msg/Letters": "uint8[] x",
               "a/msg/Both": "a/Letter[2] y"})  # fmt: skip
    assert before == {one: known.type_hash(f"a/msg/{one}") for one in before}


NUMBERS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8,
    "uint64": 9, "float32": 10, "float64": 11, "bool": 15, "string": 17,
}  # fmt: skip
"""Type -> its number in REP 2011."""
BELOW = {
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "unique_identifier_msgs/msg/UUID": "uint8[16] uuid",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Point32": "float32 x\nfloat32 y\nfloat32 z",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/msg/Polygon": "geometry_msgs/Point32[] points",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "nav_msgs/msg/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
}
"""Definitions of ROS 2 that ours hold."""


def plainly_hashed(name: str) -> str:
    """Hash a definition by the rules of REP 2011, from its text alone."""
    texts = BELOW | DEFINITIONS
    seen: dict[str, Any] = {}

    def field(line: str) -> dict[str, Any]:
        base, array, own = re.fullmatch(r"([\w/]+)(\[\d*\])? (\w+)", line).groups()  # type: ignore
        count = int(array[1:-1] or 0) if array else 0
        offset = 0 if array is None else 48 if count else 144
        nested = "" if base in NUMBERS else base.replace("/", "/msg/")
        if nested:
            described(nested)
        kind = {"type_id": offset + NUMBERS.get(base, 1), "capacity": count}
        kind |= {"string_capacity": 0, "nested_type_name": nested}
        return {"name": own, "type": kind}

    def described(one: str) -> dict[str, Any]:
        if one not in seen:
            lines = texts[one].strip().splitlines()
            seen[one] = {"type_name": one, "fields": [field(line) for line in lines]}
        return seen[one]

    whole = {"type_description": described(name)}
    whole["referenced_type_descriptions"] = [seen[one] for one in sorted(seen) if one != name]
    return "RIHS01_" + hashlib.sha256(json.dumps(whole).encode()).hexdigest()


@pytest.mark.parametrize("name", sorted(DEFINITIONS))
def test_hashes_of_our_definitions_agree_with_a_plain_computation(name: str) -> None:
    assert messages().type_hash(name) == plainly_hashed(name)


def test_one_field_changes_the_hash(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "vision_msgs/msg/ObjectHypothesis"
    before = messages().type_hash(name)
    monkeypatch.setitem(DEFINITIONS, name, "string class_id\nfloat32 score")
    assert Messages().type_hash(name) == plainly_hashed(name) != before


@pytest.mark.parametrize("name", TEN)
def test_what_is_written_is_read_back(name: str) -> None:
    known = messages()
    for message in samples(name):
        assert known.to_bytes(known.read(name, known.to_bytes(message))) == known.to_bytes(message)


def test_malformed_bytes_raise_one_error_and_nothing_else() -> None:
    known, rng = messages(), np.random.default_rng(3)
    refused = 0
    for k in range(10_000):
        name = TEN[k % len(TEN)]
        data = bytearray(known.to_bytes(samples(name)[k % 6]))
        kind = k % 3
        if kind == 0:
            data = data[: rng.integers(0, len(data))]
        elif kind == 1:
            place = rng.integers(0, len(data), 4)
            for i in place:
                data[i] = rng.integers(256)
        else:
            data = bytearray(rng.bytes(int(rng.integers(0, 400))))
        try:
            known.read(name, bytes(data))
        except WideberthError:
            refused += 1
    assert 2000 < refused < 10_000


def test_bad_input_is_refused_by_name() -> None:
    known = messages()
    for wrong, cause in (
        (lambda: Messages("jazy"), "did you mean 'jazzy'"),
        (lambda: known.make("nav_msgs/msg/Paths"), "did you mean 'nav_msgs/msg/Path'"),
        (lambda: known.make("nav_msgs/msg/Path", pose=[]), "did you mean 'poses'"),
        (lambda: known.to_bytes(known.make("nav_msgs/msg/Path", poses=3)), "cannot be written"),
        (lambda: known.read("nav_msgs/msg/Path", b"\0" * (2**26 + 1)), "at most"),
        (lambda: known.read("nav_msgs/msg/Path", b"\0\1"), "2 bytes are no nav_msgs/msg/Path"),
        (lambda: Messages().add({"a/msg/B": "c/D x"}), "holds c/msg/D, which is not defined"),
        (lambda: Messages().add({"a/msg/B": "int32 ["}), "a/msg/B: this is no definition"),
        (lambda: Messages().add({"nav_msgs/msg/Path": "int32 x"}), "give it another name"),
    ):
        with pytest.raises(WideberthError, match=re.escape(cause)):
            wrong()


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(WideberthError, match=r"pip install 'wideberth\[ros\]'"):
        Messages()


def test_a_type_is_prepared_by_its_name() -> None:
    known = Messages()
    for name in sorted(known.store.fielddefs):
        known.prepare(name)
    with pytest.raises(WideberthError, match="there is no message"):
        known.prepare("nav_msgs/msg/Pathh")
