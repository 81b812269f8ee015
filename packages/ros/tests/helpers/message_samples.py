"""Messages of ROS 2 whose fields are drawn, to be written and read."""

from functools import cache
from typing import Any

import numpy as np

from wideberth_ros.messages import messages

TEN = (
    "nav_msgs/msg/Odometry", "nav_msgs/msg/Path", "sensor_msgs/msg/LaserScan",
    "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage",
    "visualization_msgs/msg/MarkerArray", "nav_msgs/msg/OccupancyGrid",
    "nav2_dynamic_msgs/msg/ObstacleArray", "costmap_converter_msgs/msg/ObstacleArrayMsg",
    "mpc_planner_msgs/msg/ObstacleArray", "vision_msgs/msg/Detection3DArray",
    "diagnostic_msgs/msg/DiagnosticArray",
)  # fmt: skip
"""Messages that are written and read here."""


def drawn(name: str, rng: np.random.Generator, depth: int = 0) -> Any:
    """Return a message whose fields are all drawn, sequences of 0 to 3 entries."""
    known = messages()

    def value(kind: Any) -> Any:
        what, inner = kind
        if what.name == "NAME":
            return drawn(inner, rng, depth + 1)
        if what.name == "BASE":
            if inner[0] == "string":
                return "".join(rng.choice(list("abc é"), rng.integers(0, 9)))
            if inner[0] == "bool":
                return bool(rng.integers(2))
            return number(inner[0], ()).item()
        element, length = inner
        count = length if what.name == "ARRAY" else int(rng.integers(0, 4))
        if element[0].name == "BASE" and element[1][0] not in ("string", "bool"):
            return number(element[1][0], (count,))
        return [value(element) for _ in range(count)]

    def number(base: str, shape: tuple[int, ...]) -> Any:
        if base.startswith("float"):
            return np.asarray(rng.normal(size=shape), base)
        base = {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(base, base)
        return np.asarray(rng.integers(0, 120, shape), base)

    return known.make(name, **{key: value(kind) for key, kind in known.fields(name)})


@cache
def samples(name: str) -> list[Any]:
    rng = np.random.default_rng(sum(name.encode()))
    return [messages().make(name), *(drawn(name, rng) for _ in range(5))]
