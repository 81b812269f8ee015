"""A planner as a node of ROS 2, from a config."""

import shlex
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, final

from numpy import quantile

from wideberth.experiments.engine.progress import say
from wideberth.framework import read_config
from wideberth.framework.controller import Controller, DrivesRobot
from wideberth.framework.plugins.config import build, construct, import_plugins
from wideberth.framework.plugins.io import expanded
from wideberth.framework.plugins.registry import find_modules_beside, unknown
from wideberth.framework.route_planner import RoutePlanner
from wideberth.framework.values.arrays import positive
from wideberth.framework.values.errors import WideberthError, short
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.polygon import Polygon
from wideberth.routes.map_file import read_map
from wideberth.routes.polygons import convex_polygons
from wideberth.routes.replanning import Replanning

from ..managed_node import run_planner
from ..node_settings import NodeSettings
from ..obstacle_sources import ObstacleTopic, ScanTopic
from ..path_sources import GoalTopic, KnownMap, MapPlanner, MapTopic, PathTopic
from ..relayed import run_relayed

KEYS = ("plugins", "robot", "planner", "node")


def read_node(path: Path, overrides: Sequence[str]) -> tuple[Controller, NodeSettings]:
    """Read the config of a node: a planner, and the settings of its topics.

    Parameters
    ----------
    path : a YAML file with ``planner`` (a controller) and ``node`` (see `NodeSettings`); ``robot``
        may hold an anchor.
    overrides : as in ``node.rate=10``.

    Raises
    ------
    WideberthError : no such file, a key that is not known, a value that does not fit, or a
        controller that does not know its robot.
    """
    find_modules_beside(path)
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


@final
@dataclass(frozen=True)
class MapFile:
    """A map in a file, as map.yaml, and the frame it is in."""

    path: str
    frame: str = "map"


@final
@dataclass(frozen=True)
class Goals:
    """Goals, as of `wideberth_ros.path_sources.GoalTopic`, and the map that leads to them.

    Parameters
    ----------
    topic : of the goals. map : `MapTopic` or `MapFile`; None for straight ways.
    planner : finds routes over the map. period : s, between two routes.
    clearance : m beyond the robot's radius, to which routes would rather keep from walls.
    tolerance : m; a robot that is so near has arrived.
    yaw_tolerance : rad, by which its heading may then be off.

    Raises
    ------
    WideberthError : a number that is not above zero.
    """

    topic: str = "/goal_pose"
    map: MapTopic | MapFile | None = None
    planner: RoutePlanner = field(default_factory=partial(build, "route_planners", "smoothed"))
    period: float = 1.0
    clearance: float = 0.5
    tolerance: float = 0.25
    yaw_tolerance: float = 0.25

    def __post_init__(self) -> None:
        Replanning(self.planner, self.period)
        positive("clearance", self.clearance)

    def topic_of_goals(self) -> GoalTopic:
        """Return what a node takes.

        Raises
        ------
        WideberthError : a map that cannot be read.
        """
        near = self.tolerance, self.yaw_tolerance
        if self.map is None:
            return GoalTopic(self.topic, None, *near)
        where: MapTopic | KnownMap = (
            self.map
            if isinstance(self.map, MapTopic)
            else KnownMap(read_map(expanded(Path(self.map.path))), self.map.frame)
        )
        replanning = Replanning(self.planner, self.period)
        over = MapPlanner(where, replanning, self.clearance, _outlines)
        return GoalTopic(self.topic, over, *near)


def _outlines(grid: OccupancyGrid) -> tuple[Polygon, ...]:
    """Cover the occupied cells of a map, to within a cell."""
    return convex_polygons(grid, grid.resolution)


SEES: dict[str, type[Any]] = {"obstacles": ObstacleTopic, "scans": ScanTopic}
FOLLOWS: dict[str, type[Any]] = {"path": PathTopic, "goal": Goals}
MAPS: dict[str, type[Any]] = {"topic": MapTopic, "file": MapFile}
"""Name of a type in the config of a node -> its settings."""


def _settings(path: Path, given: Any) -> NodeSettings:
    """Return the settings of a node, whose nested ones are distinguished by their ``type``."""
    if not isinstance(given, dict):
        raise WideberthError(f"{path}: node is {given!r}; wanted its settings by name")
    given = dict(given)
    try:
        if given.get("sees") is not None:
            given["sees"] = of_type(SEES, given["sees"], "node.sees")
        if (follows := given.get("follows")) is not None:
            if isinstance(follows, dict) and follows.get("type") == "goal" and "map" in follows:
                place = follows["map"]
                found = None if place is None else of_type(MAPS, place, "node.follows.map")
                follows = {**follows, "map": found}
            chosen = of_type(FOLLOWS, follows, "node.follows")
            given["follows"] = chosen.topic_of_goals() if isinstance(chosen, Goals) else chosen
        settings: NodeSettings = construct(NodeSettings, given, "node")
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from None
    return settings


def of_type(kinds: Mapping[str, type[Any]], value: Any, path: str) -> Any:
    """Build what the ``type`` of a mapping names; a text is the name of a type."""
    value = {"type": value} if isinstance(value, str) else value
    if not isinstance(value, Mapping) or "type" not in value:
        wanted = " or ".join(kinds)
        raise WideberthError(f"{path} is {short(value)}; wanted a mapping with type: {wanted}")
    if value["type"] not in kinds:
        raise WideberthError(f"{path}: {unknown('type', str(value['type']), list(kinds))}")
    rest = {key: entry for key, entry in value.items() if key != "type"}
    return construct(kinds[value["type"]], rest, path)


def run_node(
    path: Path,
    overrides: Sequence[str],
    arguments: Sequence[str] = (),
    seconds: float | None = None,
    relay: str | None = None,
) -> None:
    """Run a node until it is stopped.

    Parameters
    ----------
    path, overrides : as of `read_node`.
    arguments : for ROS, as in ``["--ros-args", "-r", "/odom:=/robot/odom"]``.
    seconds : after which it stops; None for never.
    relay : command of the Python that has rclpy; None for this one.

    Raises
    ------
    WideberthError : as `read_node`, or ROS 2 is not found.
    """
    planner, settings = read_node(path, overrides)
    assert isinstance(planner, DrivesRobot)
    begin, used = time.monotonic(), time.process_time()
    given = (planner, planner.robot, settings)
    if relay is None:
        node = run_planner(*given, arguments, seconds)
    else:
        node = run_relayed(*given, shlex.split(relay), arguments, seconds)
    if node is None:
        return
    counts = node.counts
    say(f"{counts.sent} commands, {counts.missed} periods missed, {counts.plans} plans")
    if counts.latency:
        middle, high = (1e3 * quantile(counts.latency, share) for share in (0.5, 0.99))
        own = 1e3 * quantile(counts.deciding, 0.5)
        say(
            f"from odometry to the plan's command: median {middle:.0f} ms, 99 % in {high:.0f} ms; "
            f"the planner itself: median {own:.0f} ms"
        )
    share = (time.process_time() - used) / max(time.monotonic() - begin, 1e-9)
    say(f"processor: {100 * share:.0f} % of one core")
