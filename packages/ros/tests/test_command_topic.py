"""Velocities go in the kind that those who listen take, as soon as someone does."""

from typing import Any

import pytest

from wideberth_ros.command_topic import PLAIN, STAMPED, CommandTopic


class Link:
    """A topic whose subscribers come later."""

    def __init__(self) -> None:
        self.kinds: frozenset[str] = frozenset()
        self.sent: list[tuple[str, Any]] = []

    def listeners(self, topic: str) -> frozenset[str]:
        return self.kinds

    def publisher(self, topic: str, kind: str) -> Any:
        return type("Publisher", (), {"send": lambda _, one: self.sent.append((kind, one))})()


@pytest.mark.parametrize("kind", [STAMPED, PLAIN])
def test_who_comes_after_the_first_velocity_is_sent_the_next_one(kind: str) -> None:
    """Also where nothing else makes it look again, as with a clock that stands."""
    link, message = Link(), type("TwistStamped", (), {"twist": "plain"})
    topic = CommandTopic(link, "/cmd_vel", None)  # type: ignore[arg-type]
    topic.send(message)
    assert link.sent == [] and "no subscriber" in topic.problem
    link.kinds = frozenset({kind})
    topic.send(message)
    assert link.sent == [(kind, message if kind == STAMPED else "plain")]
