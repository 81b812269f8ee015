"""The first message of a publisher that the node has just met is not lost."""

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import ROOT, Network

FOLLOWS = {"goal": "{type: goal, topic: /goal_pose}", "path": "{type: path, topic: /plan}"}


@pytest.mark.parametrize(
    ("kind", "tries"),
    [
        ("goal", 4),
        pytest.param("goal", 50, marks=pytest.mark.slow),
        pytest.param("path", 50, marks=pytest.mark.slow),
    ],
)
def test_first_messages_come(network: Network, kind: str, tries: int) -> None:
    settings = ("--set", "node.sees=null", "--set", f"node.follows={FOLLOWS[kind]}")
    network.node(ROOT / "examples/node.yaml", *settings)
    peer = network.start(ROOT / "packages/ros/tests/real/first_peer.py", tries, kind, name="peer")
    assert peer.ended(120.0) == 0, peer.text()
    assert peer.text() == f"{tries}\n"
