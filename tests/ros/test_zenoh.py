"""Topics over Zenoh as rmw_zenoh has them, and a robot in another process."""

import json
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path
from socket import socket
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.ros.messages import messages
from wideberth.ros.zenoh_link import ZenohLink, attachment, key_of, quality_of
from wideberth.tests.helpers import zenoh_robot
from wideberth.tests.helpers.bags import obstacles, odometry
from wideberth.tests.ros.test_dds import check_commands, first, until

zenoh = pytest.importorskip("zenoh", reason="pip install 'wideberth[zenoh]'")
pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

ODOMETRY = "nav_msgs/msg/Odometry"


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def listens(port: int) -> bool:
    """Tell whether somebody listens on a port."""
    with socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture(scope="module")
def router() -> Any:
    """A router in this process, and where it is."""
    where = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([where]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield session, where
    session.close()


@pytest.fixture
def links(router: Any) -> Any:
    found = [ZenohLink(messages(), 5, router[1]) for _ in range(2)]
    yield found
    for one in found:
        one.close()


def test_messages_come_as_they_were_sent(links: Any) -> None:
    sender, taker = links[0].publisher("/a/b", ODOMETRY), links[1].subscriber("/a/b", ODOMETRY)
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
    with pytest.raises(WideberthError, match="wanted one with its slash"):
        links[0].publisher("odom", ODOMETRY)


def test_who_joins_late_is_given_what_is_kept(links: Any) -> None:
    sender = links[0].publisher("/kept", ODOMETRY, kept=True)
    assert not sender.has_subscribers
    for k in range(3):
        sender.send(odometry(k, (0, 0, 0), (0, 0, 0)))
    taker = links[1].subscriber("/kept", ODOMETRY, reliable=True, kept=True)
    assert first(taker).header.stamp.sec == 2
    until(lambda: sender.has_subscribers)


def test_malformed_bytes_are_counted(links: Any, router: Any) -> None:
    taker = links[0].subscriber("/bad", ODOMETRY)
    whole = messages().to_bytes(odometry(0.0, (0, 0, 0), (0, 0, 0)))
    key = key_of(5, "/bad", ODOMETRY, messages().type_hash(ODOMETRY))
    found: list[Any] = []
    sender = router[0].declare_publisher(key)
    until(lambda: sender.matching_status.matching)
    for data in (whole[:50], b"", whole):
        sender.put(data)
    until(lambda: found.extend(taker.take()) or found)
    assert len(found) == 1 and taker.refused == 2 and taker.reason


def test_keys_and_tokens_are_those_of_rmw_zenoh(links: Any, router: Any) -> None:
    """Written out by its design page; a token per node, publisher and subscriber."""
    hashed = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
    twist = "geometry_msgs/msg/Twist"
    assert key_of(5, "/robot/cmd_vel", twist, hashed) == (
        f"5/robot/cmd_vel/geometry_msgs::msg::dds_::Twist_/{hashed}"
    )
    assert quality_of(True, False) == "1:2:1,10:,:,:,,"
    assert quality_of(False, False) == "2:2:1,10:,:,:,,"
    assert quality_of(True, True) == "1:1:1,1:,:,:,,"
    links[0].publisher("/robot/cmd_vel", twist)
    links[1].subscriber("/robot/cmd_vel", twist, reliable=True, kept=True)
    kind = f"%robot%cmd_vel/geometry_msgs::msg::dds_::Twist_/{hashed}"
    zids = [str(one._session.zid()) for one in links]
    wanted = {
        f"@ros2_lv/5/{zids[0]}/0/0/NN/%/%/wideberth",
        f"@ros2_lv/5/{zids[1]}/0/0/NN/%/%/wideberth",
        f"@ros2_lv/5/{zids[0]}/0/1/MP/%/%/wideberth/{kind}/1:2:1,10:,:,:,,",
        f"@ros2_lv/5/{zids[1]}/0/1/MS/%/%/wideberth/{kind}/1:1:1,1:,:,:,,",
    }

    def graph() -> set[str]:
        found = router[0].liveliness().get("@ros2_lv/5/**")
        return {str(one.ok.key_expr) for one in found}

    until(lambda: graph() == wanted)
    links[0].close()
    until(lambda: len(graph()) == 2)  # it has left the graph


def test_an_attachment_is_that_of_rmw_zenoh() -> None:
    """As zenoh's own serialiser writes the two numbers and the sixteen bytes."""
    from zenoh import ext

    identity = bytes(range(16))
    found = attachment(7, 123456789, identity)
    theirs = [ext.Int64(7), ext.Int64(123456789), [ext.UInt8(one) for one in identity]]
    wanted = b"".join(ext.z_serialize(one).to_bytes() for one in theirs)
    assert found == wanted and len(found) == 33


def test_without_a_router_one_line_says_what_to_start() -> None:
    with pytest.raises(WideberthError, match="no router of Zenoh answers at tcp"):
        ZenohLink(messages(), 0, f"tcp/127.0.0.1:{free_port()}")


def start_robot(port: int, out: Path, seconds: float, way: float) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, zenoh_robot.__file__, str(port), str(seconds), str(out), str(way)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def start_node(folder: Path, port: int) -> "subprocess.Popen[str]":
    config = folder / "node.yaml"
    config.write_text(
        "robot: &robot\n  {type: unicycle, radius: 0.3, max_yaw_rate: 1.0, "
        "max_yaw_acceleration: 1.0}\n"
        "planner: {<<: recommended, robot: *robot, period: 0.2, dt: 0.25, horizon: 20, "
        f"track_dt: 0.25}}\nnode: {{wire: {{type: zenoh, router: tcp/127.0.0.1:{port}}}}}\n"
    )
    script = "from wideberth.experiments.cli.app import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", script, "node", str(config), "--seconds", "300"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def check_drive(out: Path) -> Any:
    """Check commands, attachments and the graph; return what the robot wrote."""
    found = json.loads(out.read_text())
    check_commands(np.array(found["heard"]).reshape(-1, 5))
    assert np.hypot(*found["pose"][:2]) >= 0.2
    notes = [bytes.fromhex(one) for one in found["notes"]]
    numbers = [struct.unpack_from("<q", one)[0] for one in notes]
    assert np.diff(numbers).tolist() == [1] * (len(numbers) - 1)
    assert len({one[16:] for one in notes}) == 1
    assert sum("/MS/" in one and "%odom/" in one for one in found["graph"]) == 1
    return found


def test_a_robot_of_another_process_is_driven(tmp_path: Path) -> None:
    out, port = tmp_path / "heard.json", free_port()
    robot = start_robot(port, out, 120.0, 0.2)
    until(lambda: listens(port))
    node = start_node(tmp_path, port)
    said, _ = robot.communicate(timeout=180)
    node.send_signal(signal.SIGINT)
    told, _ = node.communicate(timeout=60)
    assert out.is_file(), said + told
    check_drive(out)


@pytest.mark.slow
def test_a_router_that_is_killed_and_started_again_is_found(tmp_path: Path) -> None:
    first_out, second_out, port = tmp_path / "first.json", tmp_path / "second.json", free_port()
    robot = start_robot(port, first_out, 120.0, 99.0)
    until(lambda: listens(port))
    node = start_node(tmp_path, port)
    time.sleep(20.0)
    robot.send_signal(signal.SIGKILL)
    robot.communicate()
    time.sleep(3.0)
    assert node.poll() is None
    robot = start_robot(port, second_out, 120.0, 0.2)
    said, _ = robot.communicate(timeout=180)
    node.send_signal(signal.SIGKILL)
    told, _ = node.communicate(timeout=60)
    assert second_out.is_file(), said + told
    rows = np.array(check_drive(second_out)["heard"])
    assert np.abs(rows[0, 1:3]).max() <= 3 * 0.05 * 0.7  # it begins at the new robot's own speed
