"""Where a node gets its path from: a topic of paths, or goals to which it plans a route."""

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, inf, nan, pi
from typing import final

import numpy as np

from ..framework.route_planner import Route
from ..framework.values.arrays import FARTHEST, Array, positive
from ..framework.values.costmap import Costmap
from ..framework.values.occupancy_grid import OccupancyGrid
from ..framework.values.polygon import Polygon
from ..routes.inflation import Inflation
from ..routes.replanning import KeptRoute, Replanning
from .decoding import DecodedMessage, Goal
from .frames import composed, inverted, within_pi
from .obstacle_sources import check_topic
from .own_motion import OwnMotion

NEAR, AGAIN = 10.0, 3.0
"""m from the robot, to which walls of a map are outlined; m, after which that is done anew."""
MOVED, TURNED = 0.02, 0.005
"""m and rad; routes and walls are placed anew when the map's frame has moved so far against the
odometry's, where the robot is. A wall 10 m away is then up to 0.08 m off."""


@final
@dataclass(frozen=True)
class PathTopic:
    """A topic of `nav_msgs/msg/Path`, which is followed as it comes.

    Parameters
    ----------
    topic : of the paths.
    tolerance : m from the path's end, see `wideberth.framework.control.end_of_path.Arrival`.
    yaw_tolerance : rad, by which its heading may then be off that of the last pose; from pi on any
        heading will do. The defaults of both are Nav2's.

    Raises
    ------
    WideberthError : no topic, a tolerance that is not above zero.
    """

    topic: str = "/plan"
    tolerance: float = 0.25
    yaw_tolerance: float = 0.25

    def __post_init__(self) -> None:
        check_topic("node.follows.topic", self.topic)
        for name in ("tolerance", "yaw_tolerance"):
            positive(f"node.follows.{name}", getattr(self, name))


@final
@dataclass(frozen=True)
class MapTopic:
    """A topic of `nav_msgs/msg/OccupancyGrid`, of which the last message is kept for who joins.

    Raises
    ------
    WideberthError : no topic.
    """

    topic: str = "/map"

    def __post_init__(self) -> None:
        check_topic("node.follows.map.topic", self.topic)


@final
@dataclass(frozen=True, eq=False)
class KnownMap:
    """A map that is there from the start, and the frame it is in."""

    grid: OccupancyGrid
    frame: str = "map"


@final
@dataclass(frozen=True, eq=False)
class MapPlanner:
    """Plans routes over a map.

    Parameters
    ----------
    map : where it comes from.
    replanning : finds the routes.
    clearance : m beyond the robot's radius, to which routes would rather keep from walls.
    outlines : covers the occupied cells of a map by polygons, of which the controller is given
        those within `NEAR` m; None where the map shapes the routes alone.

    Raises
    ------
    WideberthError : a clearance that is not above zero.
    """

    map: MapTopic | KnownMap
    replanning: Replanning
    clearance: float = 0.5
    outlines: Callable[[OccupancyGrid], tuple[Polygon, ...]] | None = None

    def __post_init__(self) -> None:
        positive("node.follows.clearance", self.clearance)


@final
@dataclass(frozen=True, eq=False)
class GoalTopic:
    """A topic of `geometry_msgs/msg/PoseStamped`: goals, as RViz sends them.

    The robot drives to the place, brakes, and turns on the spot to the heading of the pose. A
    heading is passed over where the quaternion is all zeros or the robot cannot turn on the spot.

    Parameters
    ----------
    topic : of the goals.
    over : plans the route; None for a straight line from where the robot is when a goal comes.
    tolerance : m; a robot that is so near has arrived, and brakes.
    yaw_tolerance : rad, by which its heading may then be off; from pi on any heading will do.
        The defaults of both are Nav2's.

    Raises
    ------
    WideberthError : no topic, a tolerance that is not above zero.
    """

    topic: str = "/goal_pose"
    over: MapPlanner | None = None
    tolerance: float = 0.25
    yaw_tolerance: float = 0.25

    def __post_init__(self) -> None:
        check_topic("node.follows.topic", self.topic)
        for name in ("tolerance", "yaw_tolerance"):
            positive(f"node.follows.{name}", getattr(self, name))


@final
@dataclass(frozen=True, eq=False)
class RouteResult:
    """A route to the newest goal: points (P, 2) in m of a frame, or why there is none."""

    frame: str
    points: Array
    reason: str = ""


@final
@dataclass(frozen=True)
class SpinGoal:
    """A heading of a frame, rad, to which a robot at its goal turns on the spot."""

    frame: str
    heading: float


@final
class GoalPlanner:
    """Plans the route to the newest goal.

    `receive` and `request` are called under the node's lock; `plan_route` and `outline_walls`,
    which may take long, without it.

    Parameters
    ----------
    settings : the goals' topic and the map. radius : m, of the robot.
    turns : whether the robot can turn on the spot.
    walls : whether the controller is given the map's walls.
    """

    def __init__(
        self, settings: GoalTopic, radius: float, turns: bool = True, walls: bool = True
    ) -> None:
        self._over, self._radius, self._near = settings.over, radius, settings.tolerance
        self._skew = settings.yaw_tolerance if turns else inf
        self._there = False
        self._outlines_walls = walls
        self._walls: tuple[KnownMap, Array, tuple[Polygon, ...]] | None = None
        self._placed: Array | None = None
        self._last_request: RouteRequest | None = None
        self.walls: tuple[Polygon, ...] = ()
        """Walls of the map around the robot at the last route, in the frame of the odometry; what
        connects the two frames is taken to be exact."""
        self.goal: Goal | None = None
        """The newest goal; None where there is none, or it was reached."""
        self._goal: tuple[str, Array] | None = None
        self._straight_goal: tuple[str, Array] | None = None
        self._map: KnownMap | None = None
        self._costs: tuple[KnownMap, Costmap] | None = None
        self._kept: KeptRoute | None = None
        self._route: Route | None = None
        self._placed_by: Array | None = None
        if self._over is not None and isinstance(self._over.map, KnownMap):
            self._map = self._over.map

    def receive(self, decoded: DecodedMessage) -> None:
        """Take a goal or a map."""
        if isinstance(decoded.content, Goal):
            self.goal = goal = decoded.content
            self._goal, self._there = (decoded.frame, np.array([*goal.place, goal.heading])), False
        elif isinstance(decoded.content, OccupancyGrid):
            self._map = KnownMap(decoded.content, decoded.frame or "map")

    def forget(self) -> None:
        """Forget the goal, and the route to it."""
        self.goal = self._goal = self._kept = self._route = None

    def request(self, own: OwnMotion) -> "RouteRequest | RouteResult | SpinGoal | None":
        """Return the request for a route, a straight route, a turn, or None if all stays.

        Where there was no route, the next one is returned even if it is the last one's.
        """
        if self._goal is None or own.newest is None:
            return None
        found = self._request(own, *self._goal)
        if isinstance(found, RouteResult) and not len(found.points):
            self._straight_goal = self._route = self._placed_by = None
        return found

    def _request(
        self, own: OwnMotion, frame: str, aim: Array
    ) -> "RouteRequest | RouteResult | SpinGoal | None":
        if self._over is None:
            return self._straight(own, frame, aim)
        if self._map is None:
            return RouteResult("", np.zeros((0, 2)), "waiting for a map")
        here, target = own.motion(self._map.frame, own.frame), own.motion(self._map.frame, frame)
        if here is None or target is None:
            missing = own.frame if here is None else frame
            reason = f"no motion connects {missing!r} with the map's frame {self._map.frame!r}"
            return RouteResult("", np.zeros((0, 2)), reason)
        pose = composed(here, own.poses(np.array([own.now]))[0])
        goal = composed(target, aim)
        self._last_request = RouteRequest(self._map, pose[:2], goal[:2], here)
        return self._arrived(pose, goal, own.stands) or self._last_request

    def _straight(self, own: OwnMotion, frame: str, aim: Array) -> RouteResult | SpinGoal | None:
        motion = own.motion(own.frame, frame)
        if motion is None:
            reason = f"no motion connects the goal's frame {frame!r} with odometry"
            return RouteResult("", np.zeros((0, 2)), reason)
        here, target = own.poses(np.array([own.now]))[0], composed(motion, aim)
        old, self._straight_goal = self._straight_goal, self._goal
        found = self._arrived(here, target, own.stands)
        if found is not None or old is self._goal:
            return found
        return RouteResult(own.frame, np.stack([here[:2], target[:2]]))

    def _arrived(self, here: Array, goal: Array, stands: bool) -> RouteResult | SpinGoal | None:
        """Forget a goal at which the robot stands; let it stand there, or refuse one out of reach.

        A robot that has begun to brake or turn at its goal stays there up to twice the tolerance.
        """
        if not (np.abs([here[:2], goal[:2]]) <= FARTHEST).all():
            reason = f"the goal or the robot is more than {FARTHEST:g} m away from the origin"
            return RouteResult("", np.zeros((0, 2)), reason)
        near = (1.0 + self._there) * self._near
        self._there = float(np.linalg.norm(goal[:2] - here[:2])) <= near
        if not self._there:
            return None
        assert self._goal is not None
        frame, aim = self._goal
        if abs(within_pi(float(goal[2] - here[2]))) > self._skew:  # never of a heading that is NaN
            return SpinGoal(frame, float(aim[2]))
        if not stands:  # its heading may be right for a moment alone
            return SpinGoal(frame, nan)
        self.forget()
        return RouteResult("", np.zeros((0, 2)))

    def warm_up(self) -> None:
        """Plan a route over a small invented map, so that all is imported and compiled."""
        if self._over is None:
            return
        cells = np.zeros((40, 40), np.int8)
        cells[:20, 20] = 100
        grid, ends = OccupancyGrid(cells, 0.2), np.array([[1.0, 1.0], [6.0, 1.0]])
        self._over.replanning.update(None, 0.0, self._inflated(grid), *ends)
        if self._over.outlines is not None and self._outlines_walls:
            self._over.outlines(grid)

    def _inflated(self, grid: OccupancyGrid) -> Costmap:
        """Return the costs of a map for the robot's radius."""
        assert self._over is not None
        inscribed = self._radius * cos(pi / 16)
        spread = Inflation(inscribed, self._radius + self._over.clearance)
        return spread.inflated(Costmap.from_grid(grid))

    def plan_route(self, request: "RouteRequest", time: float) -> RouteResult | None:
        """Plan a route; return it where it is new or has moved, None if all stays."""
        assert self._over is not None
        if self._costs is None or self._costs[0] is not request.map:
            self._costs = request.map, self._inflated(request.map.grid)
            self._kept = None
        self._outline(request)
        costmap = self._costs[1]
        kept = self._over.replanning.update(self._kept, time, costmap, request.here, request.goal)
        self._kept, route = kept, kept.route
        if route is self._route and not request.moved(self._placed_by):
            return None
        self._route, self._placed_by = route, request.motion
        if route.path is None:
            return RouteResult("", np.zeros((0, 2)), f"there is no route: {route.reason}")
        return RouteResult(request.map.frame, route.path.points, route.reason)

    def outline_walls(self) -> None:
        """Outline the walls around a robot that is at its goal and needs no route."""
        if self._last_request is not None:
            self._outline(self._last_request)

    def _outline(self, request: "RouteRequest") -> None:
        """Outline the walls of a map around the robot, where it has moved or the map is new.

        They stay the same polygons until they have to be placed anew: to make one takes long, and
        to cut it into its parts.
        """
        assert self._over is not None
        if self._over.outlines is None or not self._outlines_walls:
            return
        old = self._walls
        if (
            old is None
            or old[0] is not request.map
            or np.linalg.norm(request.here - old[1]) > AGAIN
        ):
            around = cropped(request.map.grid, request.here, NEAR)
            found = () if around is None else self._over.outlines(around)
            self._walls, self._placed = (request.map, request.here, found), None
        assert self._walls is not None
        if request.moved(self._placed):
            back = inverted(request.motion)
            self.walls = tuple(_moved(one, back) for one in self._walls[2])
            self._placed = request.motion


def cropped(grid: OccupancyGrid, centre: Array, reach: float) -> OccupancyGrid | None:
    """Return the part of a map within a square; None where the square is off the map.

    Parameters
    ----------
    grid : the map. centre : (2,), m. reach : m, half the side of the square.
    """
    low = np.maximum(np.floor((centre - reach - grid.origin) / grid.resolution), 0.0).astype(int)
    high = np.ceil((centre + reach - grid.origin) / grid.resolution).astype(int)
    cells = grid.cells[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]
    if not cells.size:
        return None
    x, y = grid.origin + grid.resolution * low
    return OccupancyGrid(cells, grid.resolution, (float(x), float(y)))


def _moved(polygon: Polygon, motion: Array) -> Polygon:
    """Return a polygon in the frame in which its own has this pose."""
    corners = np.column_stack([polygon.points, np.zeros(len(polygon.points))])
    return Polygon(tuple(map(tuple, composed(motion, corners)[:, :2].tolist())), polygon.name)


@final
@dataclass(frozen=True, eq=False)
class RouteRequest:
    """From where to where a route is wanted, and over which map.

    Attributes
    ----------
    map : over which it leads.
    here, goal : (2,), m, in the frame of the map.
    motion : (3,), pose of the odometry's frame in the map's.
    """

    map: KnownMap
    here: Array
    goal: Array
    motion: Array

    def moved(self, before: Array | None) -> bool:
        """Whether the map's frame has moved since its motion was another one; None if never."""
        if before is None:
            return True
        place = np.array([*self.here, 0.0])
        now, then = (composed(inverted(one), place) for one in (self.motion, before))
        apart = now - then
        apart[2] = within_pi(float(apart[2]))
        return bool((np.abs(apart) > [MOVED, MOVED, TURNED]).any())
