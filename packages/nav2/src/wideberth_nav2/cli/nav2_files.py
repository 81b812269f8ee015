"""Nav2's parameter files as configs of ours, and back."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wideberth.controllers.recommended import HEADROOM, recommended
from wideberth.experiments.engine.closed_loop import controllers_of
from wideberth.experiments.engine.shipped_configs import config_path, read_experiment
from wideberth.framework import read_config
from wideberth.framework.controller import DrivesRobot
from wideberth.framework.plugins.config import describe
from wideberth.framework.plugins.yamlfile import dump
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError, nearest
from wideberth.robots import Unicycle

from ..server.navigator import Nav2, limits_of
from ..server.params_text import params_text
from ..server.settings import LoopSettings

AROUND = "replay"
"""The shipped config whose robot and planners are replaced."""


def config_of(settings: LoopSettings, place: str) -> str:
    """Return a config that compares Nav2, as a parameter file sets it, with our planner.

    It is the shipped config `replay` with a robot that has the limits of the velocity smoother and
    the radius of the local costmap (of a footprint: of the disc around it). Two planners drive it:
    ``nav2`` with the settings of the file, and ``ours``, the recommended one, which drives at the
    largest speed over 1.4. A robot that is slower than that of `replay` crosses as much less of
    the recording's ground: it meets its person as soon after its start.

    Parameters
    ----------
    settings : of the file. place : what the file is called in messages.

    Raises
    ------
    WideberthError : no radius and no footprint; limits that are zero.
    """
    robot = _robot(settings, place)
    ours = recommended(robot, robot.max_speed / HEADROOM, quiet=True)
    nav2 = Nav2(robot, settings)
    config = read_config(config_path(AROUND))
    config["robot"] = describe(robot)
    config["planners"] = {
        "nav2": _plain(describe(nav2)), "ours": _plain(describe(ours))
    }  # fmt: skip
    config["reach"] *= min(ours.reference_speed / config["speed"], 1.0)
    config["speed"] = ours.reference_speed
    return dump(config)


def _robot(settings: LoopSettings, place: str) -> Unicycle:
    """Return the robot that the settings are for."""
    corners = np.array(settings.footprint).reshape(-1, 2)
    radius = settings.robot_radius
    if radius is None and not len(corners):
        raise WideberthError(
            f"{place} states no size of the robot; local_costmap needs robot_radius or footprint"
        )
    reach = float(np.linalg.norm(corners, axis=1).max()) if len(corners) else float(radius or 0.0)
    smoother = settings.make_smoother()
    gain = np.minimum(smoother.max_accel, -np.array(smoother.max_decel))
    fastest, back = float(smoother.max_velocity[0]), -float(smoother.min_velocity[0])
    return Unicycle(
        radius=reach,
        max_speed=fastest,
        max_yaw_rate=float(smoother.max_velocity[2]),
        max_acceleration=float(gain[0]),
        max_yaw_acceleration=float(gain[2]),
        max_reverse_speed=None if back >= fastest else max(back, 0.0),
    )


def _plain(value: Any) -> Any:
    """Return a value of mappings, lists, numbers and text alone, as YAML has them."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value if isinstance(value, bool | int | float | str | None) else str(value)


def params_of(config: str, planner: str | None = None) -> str:
    """Return one of Nav2's parameter files for a planner of a config.

    Of the controller ``nav2`` it has all settings. Of any other planner it has what Nav2 sets as
    well: limits of velocity and acceleration, radius, rate; the rest is Nav2's default.

    Parameters
    ----------
    config : a YAML file, or the name of a shipped config.
    planner : its name there; by default that of the first ``nav2``, else the first one.

    Raises
    ------
    WideberthError : no such config or planner.
    """
    experiment, _ = read_experiment(config, [])
    found = controllers_of(experiment)
    if not found:
        raise WideberthError(f"{config} has no planner; wanted a config with a controller")
    first = next((name for name, one in found.items() if isinstance(one, Nav2)), next(iter(found)))
    name = first if planner is None else planner
    if name not in found:
        known = ", ".join(found)
        raise WideberthError(
            f"{config} has no planner {name!r}{nearest(name, found)} It has {known}"
        )
    chosen = found[name]
    if isinstance(chosen, Nav2):
        return params_text(chosen.chosen)
    if not isinstance(chosen, DrivesRobot):
        raise WideberthError(f"{name} does not know its robot; choose another planner")
    robot: Robot = chosen.robot
    settings = LoopSettings().within(limits_of(robot))
    rate = 1.0 / chosen.period
    return params_text(replace(settings, robot_radius=robot.radius, controller_frequency=rate))
