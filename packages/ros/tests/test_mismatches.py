"""Peers whose quality of service does not fit hear nothing: the node says so."""

from types import SimpleNamespace
from typing import Any

import pytest

from wideberth.packages.ros.tests.test_node import Loop
from wideberth_ros.link import RosLink

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")


def test_a_peer_that_is_not_connected_is_in_the_status() -> None:
    loop = Loop()
    loop.path()
    loop.turn()
    for unmatched in ((), ("/cmd_vel does not reach the subscriber base",)):
        loop.network.unmatched = unmatched
        loop.node.publish_diagnostics()
        said = loop.network.wires["/diagnostics"].gone[-1].status[0]
        assert said.message == "; ".join(("driving", *unmatched))
        assert said.level == len(unmatched)


def quality(reliability: str, durability: str) -> Any:
    named = {"reliability": reliability, "durability": durability}
    return SimpleNamespace(**{key: SimpleNamespace(name=value) for key, value in named.items()})


STRONG, WEAK = quality("RELIABLE", "TRANSIENT_LOCAL"), quality("BEST_EFFORT", "VOLATILE")
COMMANDS = quality("RELIABLE", "VOLATILE")


@pytest.mark.parametrize(
    ("offered", "asked", "why"),
    [
        (STRONG, WEAK, ""), (STRONG, STRONG, ""), (COMMANDS, WEAK, ""), (COMMANDS, COMMANDS, ""),
        (WEAK, COMMANDS, "its reliability is BEST_EFFORT, and RELIABLE is asked for"),
        (COMMANDS, STRONG, "its durability is VOLATILE, and TRANSIENT_LOCAL is asked for"),
    ],
)  # fmt: skip
def test_what_a_link_offers_and_asks_for_is_compared_with_its_peers(
    offered: Any, asked: Any, why: str
) -> None:
    def of(one: Any) -> Any:
        return lambda topic: [SimpleNamespace(node_name="peer", qos_profile=one)]

    node = SimpleNamespace(
        resolve_topic_name=str, get_subscriptions_info_by_topic=of(asked),
        get_publishers_info_by_topic=of(offered),
    )  # fmt: skip
    link = RosLink(node)
    link._offered, link._asked = {"/cmd_vel": offered}, {"/plan": asked}
    said = ("/cmd_vel does not reach the subscriber", "/plan does not come from the publisher")
    assert link.mismatches() == (tuple(f"{words} peer, {why}" for words in said) if why else ())
