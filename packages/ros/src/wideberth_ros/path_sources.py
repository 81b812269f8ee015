"""Where a node gets its path from: a topic of paths, or goals to which it plans a route."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, inf, nan, pi, sin
from typing import final

import numpy as np

from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.route_planner import Route
from wideberth.framework.values.arrays import FARTHEST, Array, positive
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.path import SAME, Path
from wideberth.framework.values.path_progress import PathProgress
from wideberth.framework.values.polygon import Polygon
from wideberth.routes.inflation import Inflation
from wideberth.routes.replanning import KeptRoute, Replanning

from .decoding import DecodedMessage, Goal, distinct
from .frames import composed, inverted
from .obstacle_sources import check_topic
from .own_motion import OwnMotion

NEAR, AGAIN = 10.0, 3.0
"""m from the robot, to which walls of a map are outlined; m, after which that is done anew."""
MOVED, TURNED = 0.02, 0.005
"""m and rad; routes and walls are placed anew when the map's frame has moved so far against the
odometry's, where the robot is. A wall 10 m away is then up to 0.08 m off."""

LONGEST_PATH = 10_000
"""Points; a longer path is thinned out, but for its end."""
SHORT = 1e-3
"""m; a path of one point is at least as long."""


@final
@dataclass(frozen=True)
class PathTopic:
    """A topic of `nav_msgs/msg/Path`, which is followed as it comes.

    Parameters
    ----------
    topic : of the paths.
    tolerance : m from the path's end, see `wideberth_ros.end_of_path.Arrival`.
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
            self._straight_goal = self._route = None
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
        return RouteResult(frame, np.stack([composed(inverted(motion), here)[:2], aim[:2]]))

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
        if abs(wrapped(float(goal[2] - here[2]))) > self._skew:  # never of a heading that is NaN
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
        """Plan a route; return it where it is new, None if all stays."""
        assert self._over is not None
        if self._costs is None or self._costs[0] is not request.map:
            self._costs = request.map, self._inflated(request.map.grid)
            self._kept = None
        self._outline(request)
        costmap = self._costs[1]
        kept = self._over.replanning.update(self._kept, time, costmap, request.here, request.goal)
        self._kept, route = kept, kept.route
        if route is self._route:
            return None
        self._route = route
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


def _points_in(points: Array, motion: Array) -> Array:
    """Return points (P, 2) in the frame in which their own has this pose."""
    poses = np.column_stack([points, np.zeros(len(points))])
    with np.errstate(over="ignore", invalid="ignore"):  # a path refuses what is absurd
        return np.asarray(composed(motion, poses)[:, :2])


def _moved(polygon: Polygon, motion: Array) -> Polygon:
    """Return a polygon in the frame in which its own has this pose."""
    return Polygon(tuple(map(tuple, _points_in(polygon.points, motion).tolist())), polygon.name)


@final
class FramedPath:
    """A path of a frame, laid in that of the odometry; anew where the two have moved.

    A path of one point leads there straight from where the robot is when it is laid. A path of a
    frame that the robot carries is laid once.

    Parameters
    ----------
    frame : of the points. points : (P, 2), m; at least one.
    heading : rad, of the frame, wanted at its end; NaN for any.
    """

    def __init__(self, frame: str, points: Array, heading: float = nan) -> None:
        self.end: SpinGoal = SpinGoal(frame, heading)
        """The heading at its end."""
        self.path: Path | None = None
        """What is left of the path, in the frame of the odometry; None before it is laid."""
        self.flaw: str = ""
        """Why it was not laid at the last try; "" where it was, or nothing hinders it."""
        self.points: Array = points
        """As they came."""
        self._points = points = distinct(points)
        if len(points) > LONGEST_PATH:
            self._points = np.concatenate(
                [points[: -1 : 1 + len(points) // LONGEST_PATH], points[-1:]]
            )
        self._motion: Array | None = None
        self._progress: PathProgress | None = None

    def same(self, other: "FramedPath") -> bool:
        """Whether another path has the same points, in the same frame."""
        return self.end.frame == other.end.frame and np.array_equal(self.points, other.points)

    def resume(self, before: "FramedPath") -> None:
        """Go on from where the robot was along a path of which this one is the same, moved."""
        old, new = before._points, self._points
        if self.end.frame != before.end.frame or old.shape != new.shape:
            return
        if before._motion is not None and np.abs(new - old).max() <= SAME:
            self._progress, self._motion = before._progress, before._motion

    def lay(self, own: OwnMotion) -> bool:
        """Lay the path where that is due; return whether `path` is a new one."""
        if own.newest is None:
            return False
        frame, here = self.end.frame, own.pose
        if not (np.abs(here) <= FARTHEST).all():  # odometry has gone astray: it says nothing
            return False
        motion = own.motion(own.frame, frame)
        if motion is None:
            words = f"no motion connects the path's frame {frame!r} with odometry"
            self.flaw = own.flaw(frame) or words
            return False
        where = composed(inverted(motion), here)
        if self._motion is not None and self.path is not None:
            assert self._progress is not None
            self._progress, _ = self._progress.advanced(here[:2])
            if own.carries(frame) or not has_moved(self._motion, motion, where):
                return False
        return self._laid(motion, where, here)

    def _laid(self, motion: Array, where: Array, here: Array) -> bool:
        """Lay it by a motion for a robot at a pose of its frame, and of the odometry's."""
        if len(self._points) == 1:
            self._points = _straight(where, self._points[0])
        try:
            path = Path(_points_in(self._points, motion))
        except WideberthError as error:
            self.flaw = f"path: {error}"
            return False
        if self._progress is None or self._motion is None or self._progress.last is None:
            self._progress = PathProgress(path)
        else:  # the search for the robot begins where it was on the path before
            arc, place = self._progress.last
            before = _points_in(_points_in(place[None], inverted(self._motion)), motion)[0]
            self._progress = replace(self._progress, path=path, last=(arc, before))
        self._progress, _ = self._progress.advanced(here[:2])
        self.path = path if self._motion is None else self._progress.rest
        self._motion, self.flaw = motion, ""
        return True


def _straight(pose: Array, point: Array) -> Array:
    """Return a line from a robot with a pose (3,) to a point; from behind it where it is there."""
    begin = pose[:2]
    if np.linalg.norm(point - begin) < SHORT:
        begin = point - SHORT * np.array([cos(pose[2]), sin(pose[2])])
    return np.stack([begin, point])


def has_moved(before: Array, now: Array, place: Array) -> bool:
    """Whether a frame with two poses (3,) has moved where a pose of its own, (3,), is."""
    apart = composed(now, place) - composed(before, place)
    apart[2] = wrapped(float(apart[2]))
    return bool((np.abs(apart) > [MOVED, MOVED, TURNED]).any())


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
        return has_moved(inverted(before), inverted(self.motion), place)
