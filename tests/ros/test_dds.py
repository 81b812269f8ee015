"""Topics over DDS, and a robot in another process that shares no code with the node."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from socket import AF_INET, SO_BINDTODEVICE, SOCK_DGRAM, SOL_SOCKET, socket
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.experiments.cli.ros_node import read_node
from wideberth.perception.detection import OverTime
from wideberth.ros.dds import DdsSubscriber, Link, Raw, udp_sockets
from wideberth.ros.messages import messages
from wideberth.ros.node_settings import Dds, NodeSettings
from wideberth.ros.obstacle_sources import ScanTopic
from wideberth.ros.path_sources import GoalTopic, KnownMap, MapTopic
from wideberth.tests.helpers import ros_robot
from wideberth.tests.helpers.bags import obstacles, odometry

pytest.importorskip("cyclonedds", reason="pip install 'wideberth[ros]'")
pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

ODOMETRY = "nav_msgs/msg/Odometry"
CONFIG = """
robot: &robot {type: unicycle, radius: 0.3, max_yaw_rate: 1.0, max_yaw_acceleration: 1.0}
planner: {<<: recommended, robot: *robot, period: 0.2, dt: 0.25, horizon: 20, track_dt: 0.25}
node: {domain: %d}
"""
SPEED, RATE, ACCELERATION, TURN = 0.7, 1.0, 0.7, 1.0


def datagrams_arrive() -> bool:
    """Tell whether this computer can send a datagram to itself."""
    try:
        with socket(AF_INET, SOCK_DGRAM) as taker, socket(AF_INET, SOCK_DGRAM) as sender:
            taker.settimeout(5.0)
            taker.bind(("127.0.0.1", 0))
            sender.sendto(b"x", taker.getsockname())
            return taker.recv(8) == b"x"
    except OSError:
        return False


if not datagrams_arrive():
    pytest.skip("127.0.0.1 takes no datagrams", allow_module_level=True)


def domain() -> int:
    """Return a domain that no other test uses at the same time, with ports below 32768."""
    return 20 + os.getpid() % 80


def until(done: Any, seconds: float = 60.0) -> None:
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def links() -> tuple[Link, Link]:
    return Link(messages(), domain()), Link(messages(), domain())


def test_messages_come_as_they_were_sent(links: Any) -> None:
    sender, taker = links[0].publisher("/a", ODOMETRY), links[1].subscriber("/a", ODOMETRY)
    until(lambda: sender.has_subscribers)
    sent = [odometry(k, (k, -k, 0.1), (0.5, 0.0, 0.1)) for k in range(8)]
    for message in sent:
        sender.send(message)
    found: list[Any] = []
    until(lambda: found.extend(taker.take()) or len(found) == 8)
    assert [messages().to_bytes(one) for one in found] == [
        messages().to_bytes(one) for one in sent
    ]
    with pytest.raises(WideberthError, match="type on this topic"):
        sender.send(obstacles(0.0, [(1, 1)]))


def test_who_joins_late_is_given_what_is_kept(links: Any) -> None:
    sender = links[0].publisher("/kept", ODOMETRY, kept=True)
    for k in range(3):
        sender.send(odometry(k, (0, 0, 0), (0, 0, 0)))
    taker = links[1].subscriber("/kept", ODOMETRY, reliable=True, kept=True)
    found: list[Any] = []
    until(lambda: found.extend(taker.take()) or found)
    assert [one.header.stamp.sec for one in found] == [2]


def first(taker: Any) -> Any:
    """Return the first message that comes."""
    found: list[Any] = []
    until(lambda: found.extend(taker.take()) or found)
    return found[0]


def test_a_publisher_that_goes_and_comes_again_is_no_error(links: Any) -> None:
    taker = links[1].subscriber("/gone", ODOMETRY)
    for k in range(2):
        sender = links[0].publisher("/gone", ODOMETRY)
        until(partial(getattr, sender, "has_subscribers"))
        sender.send(odometry(k, (0, 0, 0), (0, 0, 0)))
        assert first(taker).header.stamp.sec == k
        del sender
        time.sleep(0.1)
        assert list(taker.take()) == []  # it is told that nobody sends any more
    assert taker.refused == 0


class Malformed:
    """A reader that hands out what it is given."""

    def __init__(self, *payloads: Any) -> None:
        self.payloads = payloads

    def take(self, count: int) -> Any:
        if self.payloads == ("raise",):
            raise RuntimeError("gone")
        return self.payloads


def test_malformed_bytes_are_counted() -> None:
    whole = messages().to_bytes(odometry(0.0, (0, 0, 0), (0, 0, 0)))
    reader = Malformed(Raw(whole[:50]), Raw(whole), Raw(b""), Raw(bytes(2**26 + 1)))
    taker = DdsSubscriber(messages(), reader, ODOMETRY)
    assert len(list(taker.take())) == 1
    assert taker.refused == 3 and "at most" in taker.reason
    taker = DdsSubscriber(messages(), Malformed("raise"), ODOMETRY)
    assert list(taker.take()) == [] and (taker.refused, taker.reason) == (1, "gone")


def test_names_and_qualities_are_those_of_ros(links: Any) -> None:
    from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
    from cyclonedds.qos import Policy

    kept = links[0].publisher("/robot/plan", "nav_msgs/msg/Path", kept=True)
    reader = BuiltinDataReader(links[1]._participant, BuiltinTopicDcpsPublication)
    found: list[Any] = []
    until(
        lambda: (
            found.extend(
                one
                for one in reader.take(100)
                if getattr(one, "topic_name", "") == "rt/robot/plan"
            )
            or found
        )
    )
    (one,) = found[:1]
    assert one.type_name == "nav_msgs::msg::dds_::Path_"
    hashed = messages().type_hash("nav_msgs/msg/Path")
    assert one.qos[Policy.Userdata].data == f"typehash={hashed};".encode()
    assert one.qos[Policy.Durability.TransientLocal] and kept.failed == 0
    assert Policy.DataRepresentation(use_cdrv0_representation=True) in one.qos


def test_bad_domains_and_interfaces_are_named() -> None:
    with pytest.raises(WideberthError, match="domain is 300; wanted 0 to 232"):
        Link(messages(), 300)
    with pytest.raises(WideberthError, match="interface 'no_such_card'"):
        Link(messages(), 11, "no_such_card")
    with pytest.raises(WideberthError, match="wanted one with its slash"):
        Link(messages(), domain()).publisher("odom", ODOMETRY)


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux alone")
def test_nothing_beyond_this_computer_is_listened_to(links: Any) -> None:
    """Each socket is bound to 127.0.0.1, or to the loopback interface."""
    found = udp_sockets(7400 + 250 * domain(), 250)
    assert len(found) >= 2
    for one in found:
        device = one.getsockopt(SOL_SOCKET, SO_BINDTODEVICE, 16).rstrip(b"\0")
        assert device == b"lo" or one.getsockname()[0] == "127.0.0.1"
        one.close()


def start_node(folder: Path, number: int, seconds: float) -> "subprocess.Popen[str]":
    config = folder / "node.yaml"
    config.write_text(CONFIG % number)
    script = "from wideberth.experiments.cli.app import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", script, "node", str(config), "--seconds", str(seconds)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def start_robot(
    peer: list[str], out: Path, number: int, seconds: float
) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*peer, str(number), str(seconds), str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


PEERS = ("cyclone", "fast")
FAST = Path(__file__).parents[1] / "data" / "c" / "fast_dds_robot.cpp"
HEADERS = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")


@pytest.fixture(scope="module")
def peer(request: Any, tmp_path_factory: Any) -> list[str]:
    """The command that starts a robot: of Cyclone DDS in Python, or of Fast DDS in C++."""
    if request.param == "cyclone":
        return [sys.executable, ros_robot.__file__]
    if not (HEADERS.is_file() and shutil.which("g++")):
        pytest.skip("Fast DDS is not installed: apt install libfastrtps-dev g++")
    program = tmp_path_factory.mktemp("fast") / "robot"
    libraries = ["-lfastrtps", "-lfastcdr"]
    made = subprocess.run(
        ["g++", "-std=c++17", "-Wall", "-Werror", str(FAST), "-o", str(program), *libraries],
        capture_output=True, text=True,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    return [str(program)]


def heard(out: Path) -> np.ndarray:
    """Return what the robot heard: s, m/s, rad/s, and its own speeds, a row per command."""
    text = out.read_text()
    if text.startswith("{"):
        return np.array(json.loads(text)["heard"]).reshape(-1, 5)
    whole = [line.split() for line in text.splitlines(keepends=True) if line.endswith("\n")]
    return np.array(whole, dtype=float).reshape(-1, 5)


def check_commands(rows: np.ndarray) -> None:
    """Check that no command passes a limit, nor what the robot can follow."""
    assert (np.abs(rows[:, 1]) <= SPEED + 1e-9).all()
    assert (np.abs(rows[:, 2]) <= RATE + 1e-9).all()
    step = np.abs(rows[:, 1:3] - rows[:, 3:])
    # At most two commands are lost in between; each follows within a period of 0.05 s.
    assert (step <= 3 * 0.05 * np.array([ACCELERATION, TURN]) + 1e-6).all()


def counted(said: str) -> tuple[int, int, int]:
    found = re.search(r"(\d+) commands, (\d+) periods missed, (\d+) plans", said)
    assert found, said
    return int(found[1]), int(found[2]), int(found[3])


@pytest.mark.parametrize("peer", PEERS, indirect=True)
def test_a_robot_of_another_process_is_driven(peer: list[str], tmp_path: Path) -> None:
    out = tmp_path / "heard.json"
    robot = start_robot(peer, out, domain(), 300.0)
    node = start_node(tmp_path, domain(), 8.0)
    said, _ = node.communicate(timeout=120)
    time.sleep(1.0)
    assert robot.poll() is None
    robot.terminate()
    robot.communicate(timeout=60)
    sent, _, plans = counted(said)
    rows = heard(out)
    assert plans >= 1 and sent > 5 and len(rows) > 5  # a busy computer gets no farther
    check_commands(rows)
    assert rows[:, 1].max() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("peer", PEERS, indirect=True)
def test_a_minute_in_which_either_side_is_killed(peer: list[str], tmp_path: Path) -> None:
    """Kill the node and start it again, then the robot."""
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    number = domain()
    robot = start_robot(peer, first, number, 45.0)
    node = start_node(tmp_path, number, 60.0)
    time.sleep(20.0)
    node.send_signal(signal.SIGKILL)
    node.communicate()
    time.sleep(3.0)
    node = start_node(tmp_path, number, 45.0)
    time.sleep(15.0)
    robot.send_signal(signal.SIGKILL)
    robot.communicate()
    time.sleep(3.0)
    robot = start_robot(peer, second, number, 18.0)
    said, _ = node.communicate(timeout=90)
    robot.communicate(timeout=60)
    sent, missed, _ = counted(said)
    assert missed < 0.5 * sent, said  # below 1 % on a quiet computer; a busy one misses more
    for out in (first, second):
        rows = heard(out)
        check_commands(rows)
        assert rows[-100:, 1].max() > 0.2 and len(rows) > 100
    rows = heard(first)
    after = int(np.diff(rows[:, 0]).argmax()) + 1  # the first command after the node was killed
    assert rows[after, 0] - rows[after - 1, 0] > 2.0
    assert rows[after - 1, 1] > 0.2 and rows[after, 3] == 0.0  # the robot had braked


EXAMPLE = Path(__file__).parents[2] / "examples" / "node_scans.yaml"


def in_the_hall(tmp_path: Path, seconds: float, *way: str) -> tuple[Any, str]:
    """Let the node drive a robot that sends scans, tf, a map and a goal; return what both say."""
    out, config = tmp_path / "heard.json", tmp_path / "node.yaml"
    text = EXAMPLE.read_text().replace("domain: 0", f"domain: {domain()}")
    config.write_text(text.replace("map: {type: topic, topic: /map}", "map: {type: topic}"))
    command = [sys.executable, ros_robot.__file__, str(domain()), str(seconds), str(out)]
    robot = subprocess.Popen(
        [*command, "scans", *way], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    script = "from wideberth.experiments.cli.app import main; main()"
    node = subprocess.Popen(
        [sys.executable, "-c", script, "node", str(config), "--seconds", "300"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    said, _ = robot.communicate(timeout=2 * seconds + 60)
    node.send_signal(signal.SIGINT)
    told, _ = node.communicate(timeout=60)
    assert out.is_file(), said
    assert node.returncode == 0 and "commands, " in told and "Error" not in told, told
    found = json.loads(out.read_text())
    check_commands(np.array(found["heard"]).reshape(-1, 5))
    return found, told


def test_a_robot_with_a_lidar_sets_out_for_its_goal(tmp_path: Path) -> None:
    found, told = in_the_hall(tmp_path, 120.0, "0.2")
    assert np.linalg.norm(found["pose"][:2]) > 0.2, told
    assert min(found["nearest"]) > 0.0


@pytest.mark.slow
def test_a_robot_with_a_lidar_drives_through_the_door_to_its_goal(tmp_path: Path) -> None:
    found, told = in_the_hall(tmp_path, 120.0)
    # How near it comes to anybody hangs on how busy the computer is;
    # test_obstacle_sources.py measures that.
    assert found["away"] < 0.4, told


def test_the_shipped_examples_are_read() -> None:
    planner, settings = read_node(EXAMPLE.with_name("node.yaml"), [])
    assert (settings, planner.period) == (NodeSettings(), 0.2)
    _, settings = read_node(EXAMPLE, [])
    assert isinstance(settings.sees, ScanTopic) and isinstance(settings.sees.detector, OverTime)
    follows = settings.follows
    assert isinstance(follows, GoalTopic) and follows.over is not None
    assert follows.over.map == MapTopic()


def test_configs_of_a_node_are_read(tmp_path: Path) -> None:
    path = tmp_path / "node.yaml"
    path.write_text(CONFIG % 3)
    planner, settings = read_node(path, ["node.rate=10", "node.wire=dds"])
    assert (settings.domain, settings.rate, settings.wire) == (3, 10, Dds())
    _, settings = read_node(path, ["node.wire.type=dds", "node.wire.interface=default"])
    assert settings.wire == Dds("default")
    assert planner.period == 0.2
    for text, cause in (
        ("node: {}", "has no planner"),
        (CONFIG % 3 + "nodes: {}", "did you mean 'node'"),
        (CONFIG.replace("domain: %d", "domian: 3"), "did you mean 'domain'"),
        (CONFIG.replace("domain: %d", "domain: three"), "node.domain: came 'three'"),
        (CONFIG.replace("domain: %d", "domain: true"), "node.domain: came True"),
        (CONFIG.replace("domain: %d", "sees: {topic: /scan}"), "type: obstacles or scans"),
        (CONFIG.replace("domain: %d", "wire: tcp"), "node.wire: unknown type 'tcp'"),
        (CONFIG.replace("domain: %d", "sees: {type: scan}"), "node.sees: unknown type 'scan'"),
        (CONFIG.replace("domain: %d", "sees: {type: scans, detector: disks}"), "'discs'"),
        (CONFIG.replace("domain: %d", "follows: {type: goal, map: 3}"), "type: topic or file"),
        (CONFIG.replace("domain: %d", "follows: {type: goal, map: file}"), "'path' is missing"),
        (CONFIG.replace("domain: %d", "follows: {type: path, map: x}"), "unknown key 'map'"),
        (CONFIG.replace("domain: %d", "follows: {type: goal, clearance: 0}"), "clearance"),
        (CONFIG.replace("{domain: %d}", "3"), "wanted its settings by name"),
    ):
        path.write_text(text)
        with pytest.raises(WideberthError, match=cause):
            read_node(path, [])


def test_a_map_in_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "hall.pgm").write_bytes(b"P5 3 2 255\n" + bytes([255, 255, 0, 255, 0, 255]))
    (tmp_path / "hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.5\norigin: [1.0, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    config = tmp_path / "node.yaml"
    follows = f"follows: {{type: goal, map: {{type: file, path: {tmp_path}/hall.yaml}}}}"
    config.write_text(CONFIG.replace("domain: %d", follows))
    _, settings = read_node(config, ["node.sees=scans", "node.follows.tolerance=0.5"])
    follows = settings.follows
    assert isinstance(settings.sees, ScanTopic)
    assert isinstance(follows, GoalTopic) and follows.over is not None
    assert follows.tolerance == 0.5 and isinstance(follows.over.map, KnownMap)
    assert follows.over.map.grid.cells.tolist() == [[0, 100, 0], [0, 0, 100]]


def gid_of(key: Any, length: int) -> list[int]:
    return [*key.bytes, *[0] * (length - 16)]


@pytest.mark.parametrize(("distribution", "length"), [("humble", 24), ("jazzy", 16)])
def test_the_graph_of_ros_has_our_node_and_what_is_its(distribution: str, length: int) -> None:
    """Read as rmw does, by a type written by hand: who joins late hears of all of it."""
    from cyclonedds.builtin import (
        BuiltinDataReader,
        BuiltinTopicDcpsParticipant,
        BuiltinTopicDcpsPublication,
        BuiltinTopicDcpsSubscription,
    )
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    number = domain() + 1
    link = Link(messages(distribution), number)
    kept = [
        link.publisher("/robot/plan", "nav_msgs/msg/Path", kept=True),
        link.subscriber("/robot/odom", ODOMETRY),
        link.subscriber("/tf", "tf2_msgs/msg/TFMessage"),
    ]
    other = DomainParticipant(number)
    quality = Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)),
        Policy.Durability.TransientLocal,
        Policy.History.KeepLast(1),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    kind = ros_robot.graph_type(length)
    reader = DataReader(other, Topic(other, "ros_discovery_info", kind), quality)
    (said,) = first_whole(reader)
    (node,) = said.node_entities_info_seq
    assert (node.node_namespace, node.node_name) == ("/", "wideberth")
    writers = topics_by_key(other, BuiltinTopicDcpsPublication, length)
    readers = topics_by_key(other, BuiltinTopicDcpsSubscription, length)
    assert [writers[tuple(one.data)] for one in node.writer_gid_seq] == ["rt/robot/plan"]
    assert [readers[tuple(one.data)] for one in node.reader_gid_seq] == ["rt/robot/odom", "rt/tf"]
    people = BuiltinDataReader(other, BuiltinTopicDcpsParticipant).take(10)
    (own,) = [one for one in people if gid_of(one.key, length) == list(said.gid.data)]
    assert own.qos[Policy.Userdata].data == b"enclave=/;"
    del kept, link


def first_whole(reader: Any) -> list[Any]:
    """Return what a reader has been given, as soon as there is something."""
    found: list[Any] = []
    until(lambda: found.extend(reader.take(10)) or found)
    return found


def topics_by_key(participant: Any, kind: Any, length: int) -> dict[tuple[int, ...], str]:
    """Return the topic of each publisher or subscriber that Cyclone DDS itself has found."""
    from cyclonedds.builtin import BuiltinDataReader

    found = BuiltinDataReader(participant, kind).take(200)
    return {tuple(gid_of(one.key, length)): one.topic_name for one in found}
