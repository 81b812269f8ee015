"""Messages that were compiled, between two processes of a real ROS 2."""

import json
import signal
import time

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network
from wideberth_ros.messages import messages

PEER = ROOT / "packages/ros/tests/real/messages_peer.py"
ABORTED, CANCELED, NO_PROGRESS = 6, 5, 105
"""States of goals, and an error of FollowPath."""
ACTIONS = {
    "FollowPath": "9d95513552fb578cfb933d7e0160273911269cbdf4b348f1acb87d8a903b13cf",
    "NavigateToPose": "a56dba8a3234a1215e610180dc703ae25bbf406dded8b54887891c9732857eab",
}
"""Hashes in public builds of Nav2 for Jazzy and Kilted."""
KINDS = {
    "tf": "tf2_msgs/msg/TFMessage",
    "people": "nav2_dynamic_msgs/msg/ObstacleArray",
    "seen": "vision_msgs/msg/Detection3DArray",
    "limit": "nav2_msgs/msg/SpeedLimit",
}

PROVIDE = (
    "from wideberth_ros.interfaces import provide; provide(['tf2_msgs']); import tf2_msgs.msg"
)


def test_two_processes_exchange_messages_and_goals(network: Network) -> None:
    giver = network.start(PEER, "give", name="giver")
    taker = network.start(PEER, "take", name="taker")
    assert taker.ended(60.0) == 0, taker.text() + giver.text()
    found = json.loads(taker.text().splitlines()[-1])
    assert found["same"] == dict.fromkeys(KINDS, True)
    assert found["failed"] == [ABORTED, NO_PROGRESS, "mpc"]
    assert found["cancelled"] == CANCELED
    assert found["feedback"] == [10.0, 9.0, 8.0, 7.0, 6.0]
    known = messages(network.distribution)
    assert found["hashes"] == {name: known.type_hash(kind) for name, kind in KINDS.items()}
    assert found["actions"] == {name: f"RIHS01_{one}" for name, one in ACTIONS.items()}
    again = network.start("-c", PROVIDE, name="again")
    assert again.ended() == 0 and again.text() == ""


def test_without_a_compiler_the_error_names_what_to_install(network: Network) -> None:
    code = f"import os; os.environ['PATH'] = ''; {PROVIDE}"
    done = network.start("-c", code, name="bare", WIDEBERTH_CACHE=str(network.folder))
    assert done.ended() == 1
    last = done.text().splitlines()[-1].partition("WideberthError: ")[2]
    assert last == (
        "tf2_msgs is not installed, and to compile its messages a compiler of C and C++, or the "
        "headers of Python, is missing; install ros-$ROS_DISTRO-tf2-msgs, or g++ and python3-dev"
    )


@pytest.mark.slow
def test_a_process_that_is_killed_leaves_no_half_package(network: Network) -> None:
    first = network.start("-c", PROVIDE, name="first", WIDEBERTH_CACHE=str(network.folder))
    first.prints("compiling the messages of tf2_msgs (once)")
    time.sleep(0.3)
    first.signal(signal.SIGKILL)
    first.ended()
    assert not list((network.folder / "ros").glob("tf2_msgs_*"))
    second = network.start("-c", PROVIDE, name="second", WIDEBERTH_CACHE=str(network.folder))
    assert second.ended() == 0, second.text()
    assert len(list((network.folder / "ros").glob("tf2_msgs_*"))) == 1
