"""Robots of the size and limits of robot_sf's, none of which drives backwards."""

from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot

LIMITS = {
    "unicycle": {"max_acceleration": 1.0, "max_yaw_rate": 1.0, "max_yaw_acceleration": 1.0},
    "differential_drive": {
        "max_acceleration": 1.0, "max_yaw_rate": 1.0, "max_yaw_acceleration": 1.0,
        "max_wheel_speed": 2.5, "max_wheel_acceleration": 1.5,
    },
    "unicycle_velocity": {"max_yaw_rate": 1.0},
    "bicycle": {"max_acceleration": 1.0},
}  # fmt: skip
"""Limits of each beside its speed, in SI units."""
AHEAD = sorted(LIMITS)
"""Robots with a speed ahead, and so with one backwards."""
SPEED = 1.4
"""m/s, of the reference."""


def forwards(name: str) -> Robot:
    """Return a robot of 1 m that drives at up to 2 m/s, and never backwards."""
    size = {"radius": 1.0, "max_speed": 2.0, "max_reverse_speed": 0.0}
    made: Robot = build("robots", {"type": name, **size, **LIMITS[name]})
    return made
