"""Bytes of messages: ours against those of ROS 2 itself."""

from wideberth.packages.ros.tests.helpers.message_samples import TEN
from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network

PEER = ROOT / "packages/ros/tests/real/bytes_peer.py"


def test_our_bytes_are_those_of_ros(network: Network) -> None:
    """What recordings hold, and what a relay passes on, is what a node of ROS 2 writes."""
    peer = network.start(PEER, network.distribution, name="peer")
    assert peer.ended() == 0, peer.text()
    assert peer.text().splitlines()[-1] == f"{len(TEN)} types, others: []"
