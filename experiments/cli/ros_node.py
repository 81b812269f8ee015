"""A planner as a node of ROS 2, from a config."""

import time
from collections.abc import Sequence
from dataclasses import fields, replace
from math import inf
from pathlib import Path
from typing import Any

from numpy import quantile

from ...bridges.dds import Link
from ...bridges.messages import messages
from ...bridges.node import PlannerNode
from ...bridges.node_settings import NodeSettings
from ...bridges.rclpy_server import serve
from ...framework.controller import Controller, DrivesRobot
from ...framework.plugins.config import build, import_plugins
from ...framework.plugins.registry import unknown
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from ..engine.progress import say

KEYS = ("plugins", "robot", "planner", "node")


def read_node(path: Path, overrides: Sequence[str]) -> tuple[Controller, NodeSettings]:
    """Read the config of a node: a planner, and the settings of its topics.

    Parameters
    ----------
    path : a YAML file with ``planner`` (a controller) and ``node`` (see `NodeSettings`); ``robot``
        may hold an anchor.
    overrides : as in ``node.domain=3``.

    Raises
    ------
    WideberthError : no such file, a key that is not known, a value that does not fit, or a
        controller that does not know its robot.
    """
    config = read_config(path, list(overrides))
    for key in config:
        if key not in KEYS:
            raise WideberthError(f"{path}: {unknown('key', key, list(KEYS))}")
    if "planner" not in config:
        raise WideberthError(
            f"{path} has no planner; wanted one, as in planner: {{type: mpc, ...}}"
        )
    import_plugins(config.get("plugins", []))
    planner: Controller = build("controllers", config["planner"], "planner")
    if not isinstance(planner, DrivesRobot):
        raise WideberthError(f"{path}: the planner does not know its robot")
    return planner, _settings(path, config.get("node") or {})


def _settings(path: Path, given: Any) -> NodeSettings:
    if not isinstance(given, dict):
        raise WideberthError(f"{path}: node is {given!r}; wanted its settings by name")
    known = {one.name: one for one in fields(NodeSettings)}
    for key, value in given.items():
        if key not in known:
            raise WideberthError(f"{path}: {unknown('setting of node', key, list(known))}")
        usual = known[key].default
        number = isinstance(value, int | float) and isinstance(usual, float)
        if not (isinstance(value, type(usual)) or number) or (
            isinstance(value, bool) and not isinstance(usual, bool)
        ):
            kind = type(usual).__name__
            raise WideberthError(f"{path}: node.{key} is {value!r}; wanted a {kind}, as {usual!r}")
    return NodeSettings(**given)


def run_node(path: Path, overrides: Sequence[str], seconds: float | None = None) -> PlannerNode:
    """Run a node until it is stopped; return it.

    Parameters
    ----------
    path, overrides : as of `read_node`. seconds : after which it stops.

    Raises
    ------
    WideberthError : as `read_node`, or the network cannot be joined.
    """
    planner, settings = read_node(path, overrides)
    assert isinstance(planner, DrivesRobot)
    link = Link(messages(settings.distribution), settings.domain, settings.interface)
    node = PlannerNode(planner, planner.robot, settings, link)
    where = "this computer alone" if settings.interface == "lo" else settings.interface
    say(f"domain {settings.domain}, {where}; {settings.odometry} -> {settings.commands}")
    begin, used = time.monotonic(), time.process_time()
    try:
        node.run(inf if seconds is None else seconds)
    except KeyboardInterrupt:
        node.stop()
    counts = node.counts
    say(f"{counts.sent} commands, {counts.missed} periods missed, {counts.plans} plans")
    if counts.latency:
        middle, high = (1e3 * quantile(counts.latency, share) for share in (0.5, 0.99))
        say(f"from odometry to the plan's command: median {middle:.0f} ms, 99 % in {high:.0f} ms")
    share = (time.process_time() - used) / max(time.monotonic() - begin, 1e-9)
    say(f"processor: {100 * share:.0f} % of one core")
    return node


def run_server(path: Path, overrides: Sequence[str]) -> None:
    """Serve Nav2's action FollowPath until ROS shuts down; it needs ROS 2 on this computer.

    Parameters
    ----------
    path, overrides : as of `read_node`. Its topic of paths is not listened to.

    Raises
    ------
    WideberthError : as `read_node`, or ROS 2 is not found.
    """
    planner, settings = read_node(path, overrides)
    assert isinstance(planner, DrivesRobot)
    serve(planner, planner.robot, replace(settings, path=""))
