"""The settings of a node as parameters of ROS 2: described, changeable where that is safe."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import inf
from typing import Any, final

from wideberth.framework.values.errors import WideberthError

from .link import ros
from .node_settings import NodeSettings

DESCRIPTIONS: Mapping[str, str] = {
    "odometry": "topic of nav_msgs/msg/Odometry",
    "commands": "topic of the velocities",
    "stamped": "send TwistStamped or, if false, Twist; not set: what the subscribers take",
    "base_frame": "frame of the robot",
    "rate": "Hz, of the commands",
    "patience": "s, for which odometry, obstacles or scans may be silent; then the robot brakes",
    "stepped": "decide once for each instant, and answer it: for a simulation that waits",
    "sees.topic": "topic of obstacles or scans",
    "sees.kind": "type of the messages of obstacles",
    "sees.radius": "m, of obstacles whose size is not stated",
    "sees.deviation": "m, of a position whose covariance is not stated, or of a range",
    "sees.own_clock": "whether the sender stamps by a clock of its own, so that arrival counts",
    "follows.topic": "topic of paths or goals",
    "follows.tolerance": "m; a robot that is so near has arrived, and brakes",
    "follows.yaw_tolerance": "rad, by which its heading may then be off",
}
"""Settings that are parameters, by name, and what they are."""
LIMIT, AUTOSTART = "speed_limit", "autostart"
LIVE = frozenset({"patience", LIMIT})
"""Parameters that may change while the node is configured."""


@final
class NodeParameters:
    """Declares the settings of a node as its parameters, and reads them back.

    Parameters
    ----------
    node : of rclpy. settings : their defaults. configured : whether topics are open.
    changed : called with new settings, and with a limit of speed, m/s.
    """

    def __init__(
        self,
        node: Any,
        settings: NodeSettings,
        configured: Callable[[], bool],
        changed: Callable[[NodeSettings, float], None],
    ) -> None:
        self.settings: NodeSettings = settings
        self.limit: float = inf
        """m/s; infinite where there is none."""
        self._configured, self._changed = configured, changed
        for name, text in DESCRIPTIONS.items():
            owner, field = _owner(settings, name)
            if hasattr(owner, field):
                self._declare(node, name, getattr(owner, field), text)
        self._declare(node, LIMIT, 0.0, "m/s, at which it drives at most; 0 for no limit")
        self._declare(node, AUTOSTART, True, "become active at once, without a lifecycle manager")
        self.autostart: bool = bool(node.get_parameter(AUTOSTART).value)
        self._apply([node.get_parameter(name) for name in self._names])
        node.add_on_set_parameters_callback(self._set)

    def _declare(self, node: Any, name: str, value: Any, text: str) -> None:
        kind = ros("rcl_interfaces.msg").ParameterDescriptor
        if name not in LIVE:
            text += "; of a node that is not configured yet"
        description = kind(description=text, dynamic_typing=value is None)
        node.declare_parameter(name, value, description)

    def _set(self, given: list[Any]) -> Any:
        """Take new values; refuse them, with the reason, where they cannot be taken."""
        result = ros("rcl_interfaces.msg").SetParametersResult
        fixed = [one.name for one in given if one.name in self._names and one.name not in LIVE]
        if fixed and self._configured():
            return result(
                successful=False, reason=f"clean the node up first: {fixed[0]} is in use"
            )
        try:
            self._apply(given)
        except WideberthError as error:
            return result(successful=False, reason=str(error))
        self._changed(self.settings, self.limit)
        return result(successful=True)

    @property
    def _names(self) -> list[str]:
        return [*(name for name in DESCRIPTIONS if hasattr(*_owner(self.settings, name))), LIMIT]

    def _apply(self, given: list[Any]) -> None:
        """Take values into the settings, or none of them where one is refused."""
        settings, limit = self.settings, self.limit
        for one in given:
            if one.name == LIMIT:
                if not one.value >= 0.0:
                    raise WideberthError(f"{LIMIT} is {one.value:g} m/s; wanted 0 or more")
                limit = one.value or inf
            elif one.name in DESCRIPTIONS:
                owner, field = _owner(settings, one.name)
                if getattr(owner, field) != one.value:
                    changed = replace(owner, **{field: one.value})
                    part = one.name.partition(".")[0]
                    settings = (
                        changed if owner is settings else replace(settings, **{part: changed})
                    )
        self.settings, self.limit = settings, limit


def _owner(settings: NodeSettings, name: str) -> tuple[Any, str]:
    """Return the part of the settings that has a setting, and the setting's name there."""
    part, dot, field = name.partition(".")
    return (getattr(settings, part), field) if dot else (settings, name)
