"""Peers whose quality of service does not fit hear nothing: the node says so."""

from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from wideberth.ros.link import RosLink
from wideberth.tests.ros.test_node import Loop

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")


def test_a_peer_that_is_not_connected_is_in_the_status() -> None:
    loop = Loop()
    loop.path()
    loop.turn()
    for unmatched in ((), ("/cmd_vel is not connected with the subscriber base: durability",)):
        loop.network.unmatched = unmatched
        loop.node.publish_diagnostics()
        said = loop.network.wires["/diagnostics"].gone[-1].status[0]
        assert said.message == "; ".join(("driving", *unmatched))
        assert said.level == len(unmatched)


def test_what_a_link_offers_and_asks_for_is_compared_with_its_peers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By the rule of ROS itself; here one that wants the two to be equal."""
    quality = SimpleNamespace(ERROR="error")
    peers = {"out": "volatile", "in": "kept"}

    def check(offered: str, asked: str) -> tuple[str, str]:
        return ("ok", "") if offered == asked else ("error", f"offers {offered}, asks {asked}")

    qos = ModuleType("rclpy.qos")
    qos.QoSCompatibility, qos.qos_check_compatible = quality, check  # type: ignore[attr-defined]
    monkeypatch.setitem(__import__("sys").modules, "rclpy", ModuleType("rclpy"))
    monkeypatch.setitem(__import__("sys").modules, "rclpy.qos", qos)

    def of(side: str) -> Any:
        return lambda topic: [SimpleNamespace(node_name="peer", qos_profile=peers[side])]

    node = SimpleNamespace(
        resolve_topic_name=str, get_subscriptions_info_by_topic=of("out"),
        get_publishers_info_by_topic=of("in"),
    )  # fmt: skip
    link = RosLink(node)
    link._offered, link._asked = {"/cmd_vel": "volatile"}, {"/tf_static": "kept"}
    assert link.mismatches() == ()
    peers.update(out="kept", **{"in": "volatile"})
    assert link.mismatches() == (
        "/cmd_vel is not connected with the subscriber peer: offers volatile, asks kept",
        "/tf_static is not connected with the publisher peer: offers volatile, asks kept",
    )
