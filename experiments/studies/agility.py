"""How quickly a robot may turn and change its speed, by name, as a parameter of a study."""

from collections.abc import Mapping
from dataclasses import fields, replace
from math import radians
from typing import Any

from ...framework import Robot, WideberthError
from ...framework.plugins.registry import unknown

AGILITY: Mapping[str, Mapping[str, float]] = {
    "shipped": {"max_yaw_rate": 1.0, "max_acceleration": 0.7, "max_yaw_acceleration": 1.0},
    "service": {
        "max_yaw_rate": radians(120.0),
        "max_acceleration": 1.0,
        "max_yaw_acceleration": radians(120.0),
    },
    "person": {"max_yaw_rate": 3.0, "max_acceleration": 3.0, "max_yaw_acceleration": 10.0},
}
"""Limits of a robot with a heading by name, in rad/s, m/s^2 and rad/s^2.

``shipped`` are those of the config `random_crowd`; ``service`` those of the base of TIAGo, which
also drives 1 m/s (PAL Robotics, ``mobile_base_controller.yaml`` of ``pmb2_robot``); with
``person`` a robot turns about and stops from 1 m/s as fast as someone who walks, in a third of a
second: a round number, not a measured one.
"""


def agile(robot: Robot, name: str, place: str) -> Robot:
    """Return a robot with the limits of this name; its size and its speed stay.

    Parameters
    ----------
    name : of `AGILITY`.
    place : where the robot stands in the config, for messages.

    Raises
    ------
    WideberthError : no such name, or a robot without these limits.
    """
    if name not in AGILITY:
        raise WideberthError(f"agility: {unknown('name', name, AGILITY)}")
    made: Any = robot
    lacking = set(AGILITY[name]) - {entry.name for entry in fields(made)}
    if lacking:
        raise WideberthError(
            f"agility: {place} is a {type(robot).__name__} without {', '.join(sorted(lacking))}; "
            "take a unicycle"
        )
    changed: Robot = replace(made, **AGILITY[name])
    return changed
