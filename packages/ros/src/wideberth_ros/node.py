"""A planner beside the messages of a robot: odometry and obstacles come, velocities go."""

import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, final

import numpy as np

from wideberth.framework.control.command_limits import attained, turns_on_the_spot, within_reach
from wideberth.framework.controller import Controller, avoids_polygons
from wideberth.framework.mpc.planner.standing import BLOCKED
from wideberth.framework.robot import Robot
from wideberth.framework.tracking.stand_ins import sound
from wideberth.framework.values.arrays import Array, checked_covariance
from wideberth.framework.values.errors import WideberthError, short
from wideberth.framework.values.motion import Command, Observation, Pose, Twist
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import separation
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import MotionEstimate
from wideberth_perception.observed_state import own_state

from .command_topic import CommandTopic
from .decoding import (
    DecodedMessage,
    Goal,
    OdometryMessage,
    PathMessage,
    Transforms,
    decode_message,
)
from .encoding import MessageEncoder
from .end_of_path import Approach, Arrival, Spin
from .in_time import VelocityInTime
from .link import Publisher, Transport
from .node_settings import NodeSettings
from .obstacle_sources import (
    LASERSCAN,
    ObstacleSource,
    ObstacleTopic,
    ScanSource,
    ScanView,
    TopicSource,
)
from .own_motion import OwnMotion, ReceivedMessage
from .path_sources import (
    FramedPath,
    GoalPlanner,
    GoalTopic,
    MapTopic,
    PathTopic,
    RouteRequest,
    RouteResult,
    SpinGoal,
)
from .room_to_stop import RoomToStop

MOST_BEAMS, MOST_CELLS = 50_000, 25_000_000
"""Of a scan and of a map that are looked at; larger ones are refused."""
LOOK = 0.5
"""s, after which it is looked anew who listens to the commands."""
PAUSE = 5.0
"""Periods; after a pause that is longer, commands begin at the robot's own velocity again."""
EXACT = 1e-8
"""m^2 and so on: covariance of odometry that states none."""
DRIVING, TURNING = "driving", "turning to the goal's heading"
ARRIVED = "standing at the end of the path"
"""Statuses of a node where all is well."""
NO_ROOM = "no room to turn: "
"""Begins the status of a robot that something is beside as it wants to turn."""
STANDING = 0.01
"""m/s; a slower robot stands, and may turn on the spot."""
TRAJECTORY = "nav_msgs/msg/Trajectory"
"""A type that ROS 2 has from Lyrical on."""
_LOG = logging.getLogger("wideberth")


@final
@dataclass
class Counts:
    """What a node has done so far.

    Attributes
    ----------
    sent, missed : commands, and periods in which none was sent in time.
    plans, failures : calls of the controller, and those that raised.
    refused : messages that were malformed, or of no use.
    latency : s, from the newest odometry to the command that follows from it, of the last plans.
    deciding : s, that the controller itself took, of the last plans.
    """

    sent: int = 0
    missed: int = 0
    plans: int = 0
    failures: int = 0
    refused: int = 0
    latency: list[float] = field(default_factory=list)
    deciding: list[float] = field(default_factory=list)


@final
class PlannerNode:
    """Runs a controller beside the messages of a robot.

    Messages come by the subscriptions that it makes; `publish` and `decide` are called at the rate
    of the commands and at the controller's, see `wideberth_ros.managed_node`. None of them raises.
    Commands start at the robot's own velocity, and each follows from the one before within the
    robot's limits. Where odometry, obstacles or the controller are silent for longer than
    `NodeSettings.patience`, or no path is there, the robot brakes to a stand.

    Parameters
    ----------
    controller : that drives. robot : its model, in the plane.
    settings : topics and rates.
    link : the network.
    clock : s, by which silence is judged. wall : ns, with which messages are stamped.
    """

    def __init__(
        self,
        controller: Controller,
        robot: Robot,
        settings: NodeSettings,
        link: Transport,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], int] = time.time_ns,
    ) -> None:
        if robot.dimension != 2:
            raise WideberthError("a node drives robots in the plane")
        self.controller: Controller = controller
        self.robot: Robot = robot
        self.settings: NodeSettings = settings
        self.counts: Counts = Counts()
        self.status: str = "waiting for odometry"
        """What it does now, or waits for."""
        self.active: bool = True
        """Whether it may drive; otherwise it brakes to a stand, and is silent then."""
        self._clock, self._wall = clock, wall
        self._known, self._link = link.known, link
        self._own = OwnMotion(settings.base_frame)
        self._course: FramedPath | None = None  # that is followed
        self._next_course: FramedPath | None = None  # takes its place once it can be laid
        self._reached: FramedPath | None = None  # to its end, the last one of a topic
        self._handed: Path | None = None  # to the controller, the last one
        self._fresh_path = self._anew = False
        self._ends = True  # whether a path ends by itself where the robot reaches its end
        self._wanted: VelocityInTime | None = None
        self._last: Array | None = None
        self._command: Array | None = None
        self._answered: ReceivedMessage | None = None
        self._decided = self._based = self._sent = self._looked = -np.inf
        self._limit = np.inf
        self._turn: SpinGoal | None = None
        self._room: SpinGoal | None = None  # the turn for which there was room at the last look
        self.turns_on_the_spot: bool = turns_on_the_spot(robot, np.zeros(len(robot.states)))
        """Whether the robot can turn while it stands."""
        self.odometry_came: threading.Event = threading.Event()
        """Set with each odometry."""
        self._lock = threading.RLock()
        self._covariance: Array | None = None  # the last one of odometry that was one, (3, 3)
        self._obstacles: ObstacleSource | None = None
        self._goals: GoalPlanner | None = None
        self._arrival: Arrival | None = None
        self._approach, self._spin = Approach(robot), Spin(robot, 1.0 / settings.rate)
        self._room_to_stop = RoomToStop(robot, settings.patience)
        self._no_route = ""
        self._open_topics(link)

    def _open_topics(self, link: Transport) -> None:
        """Open all topics."""
        s = self.settings
        tf = "tf2_msgs/msg/TFMessage"
        self._subscribe(link, "odometry", s.odometry, "nav_msgs/msg/Odometry")
        self._subscribe(link, "tf", "/tf", tf)
        self._subscribe(link, "tf_static", "/tf_static", tf, reliable=True, kept=True)
        self._open_obstacles(link)
        self._open_paths(link)
        markers = "visualization_msgs/msg/MarkerArray"
        self._commands = CommandTopic(link, s.commands, s.stamped)
        self._to: dict[str, Publisher] = {
            "plan": link.publisher("/wideberth/plan", "nav_msgs/msg/Path", kept=True),
            "forecast": link.publisher("/wideberth/forecast", markers, kept=True),
            "regions": link.publisher("/wideberth/regions", markers, kept=True),
            "diagnostics": link.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
        }
        if TRAJECTORY in link.known:
            self._to["trajectory"] = link.publisher("/wideberth/trajectory", TRAJECTORY, kept=True)

    def _subscribe(
        self, link: Transport, name: str, topic: str, kind: str, **quality: bool
    ) -> None:
        link.subscriber(topic, kind, partial(self._receive, name, kind), **quality)

    def _open_obstacles(self, link: Transport) -> None:
        """Open the topic of obstacles or scans."""
        sees = self.settings.sees
        if isinstance(sees, ObstacleTopic):
            self._subscribe(link, "obstacles", sees.topic, sees.kind)
            self._obstacles = TopicSource(sees, self._own, self._lock, self._refuse)
        elif sees is not None:
            self._subscribe(link, "scans", sees.topic, LASERSCAN)
            walls, gap = avoids_polygons(self.controller), 2.0 * self.robot.radius
            self._obstacles = ScanSource(sees, self._own, gap, walls, self._lock, self._refuse)

    def _open_paths(self, link: Transport) -> None:
        """Open the topics of paths, or of goals and of the map."""
        follows = self.settings.follows
        if isinstance(follows, PathTopic):
            self._subscribe(link, "path", follows.topic, "nav_msgs/msg/Path", reliable=True)
            self._arrival = Arrival(follows.tolerance)
        elif isinstance(follows, GoalTopic):
            pose, grid = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/OccupancyGrid"
            self._subscribe(link, "goal", follows.topic, pose, reliable=True)
            walls = avoids_polygons(self.controller) and not isinstance(
                self._obstacles, ScanSource
            )
            self._goals = GoalPlanner(follows, self.robot.radius, self.turns_on_the_spot, walls)
            if follows.over is not None and isinstance(follows.over.map, MapTopic):
                topic = follows.over.map.topic
                self._subscribe(link, "map", topic, grid, reliable=True, kept=True)

    def _receive(self, name: str, kind: str, message: Any) -> None:
        """Take a message of a topic."""
        try:
            self._take(decode_message(kind, message), self._clock())
            if self.settings.stepped:
                self._answer()
        except WideberthError as error:
            self._refuse(f"{name}: {error}")
        except Exception as error:  # whatever a message holds, the node goes on
            self._refuse(f"{name}: {type(error).__name__}: {error}")

    def _take(self, decoded: DecodedMessage, now: float) -> None:
        content = decoded.content
        if isinstance(content, Scan) and len(content.ranges) > MOST_BEAMS:
            raise WideberthError(f"a scan of {len(content.ranges)} beams is too long")
        if isinstance(content, OccupancyGrid) and content.cells.size > MOST_CELLS:
            raise WideberthError(f"a map of {content.cells.size} cells is too large")
        with self._lock:
            if isinstance(content, Transforms):
                self._own.take_frames(content)
            elif isinstance(content, OdometryMessage):
                self._own.take(decoded, now)
                self.odometry_came.set()
            elif isinstance(content, PathMessage):
                self._take_path(FramedPath(decoded.frame, content.points, content.heading))
                self._ends = True
            elif isinstance(content, Goal | OccupancyGrid) and self._goals is not None:
                self._goals.receive(decoded)
            elif self._obstacles is not None:
                self._obstacles.receive(decoded, now)

    def _answer(self) -> None:
        """Decide for the instant that was shown, and answer it; again if it is shown again."""
        own, seen = self._own.newest, None if self._obstacles is None else self._obstacles.newest
        if own is None or own is self._answered:
            return
        stamp = own.decoded.stamp
        if self._obstacles is not None and (seen is None or seen.decoded.stamp != stamp):
            return
        if self._answered is None or self._answered.decoded.stamp != stamp:
            self._last = self._planned_command()
        if self._last is not None:
            self._answered = own
            self._send(self._last, stamp)

    def _planned_command(self) -> Array | None:
        """Decide; return the controller's command, standing where it may not drive any more."""
        if self.decide():
            return self._command
        return None if self._last is None else np.zeros(3)

    def follow(self, frame: str, points: Array) -> bool:
        """Follow a path of points (P, 2) in m of a frame; return whether it can be followed.

        Its end is up to the caller, see `turn` and `halt`.
        """
        with self._lock:
            self._turn = self._reached = None
            self._anew = self._course is None
            self._take_path(FramedPath(frame, points))
            waiting, self._next_course, self._ends = self._next_course, None, False
            return waiting is None and self._course is not None

    def halt(self) -> None:
        """Forget the path and the goal: the robot brakes."""
        with self._lock:
            if self._goals is not None:
                self._goals.forget()
            self._take_path(None)

    def go(self, frame: str, goal: Goal) -> None:
        """Drive to a goal of a frame, as to one of a topic; `NodeSettings.follows` has goals."""
        with self._lock:
            assert self._goals is not None
            self._goals.receive(DecodedMessage(0, frame, goal))

    @property
    def goal(self) -> Goal | None:
        """The goal that the robot drives to; None where there is none, or it was reached."""
        return None if self._goals is None else self._goals.goal

    @property
    def turns(self) -> bool:
        """Whether the robot turns on the spot."""
        return self._turn is not None

    def turn(self, frame: str, heading: float) -> float:
        """Brake, and turn on the spot to a heading of a frame, rad, until another path comes.

        With a heading that is NaN the robot only brakes. Return how much is left of the turn,
        within pi, rad; NaN where that is not known.
        """
        with self._lock:
            self._turn = SpinGoal(frame, heading)
            return self._own.off(frame, heading)

    def drive_on(self) -> None:
        """End a turn on the spot: the robot follows its path again."""
        with self._lock:
            self._turn = None

    @property
    def now(self) -> float:
        """The time by which silence is judged, s."""
        return self._clock()

    def limit_speed(self, limit: float) -> None:
        """Drive at most so fast from now on, m/s; infinity takes the limit away."""
        self._limit = limit if limit >= 0.0 else 0.0

    @property
    def motion(self) -> tuple[Array, Array] | None:
        """Pose (3,) and twist (3,) of the newest odometry; None before the first."""
        received = self._own.newest
        if received is None or not isinstance(received.decoded.content, OdometryMessage):
            return None
        return received.decoded.content.pose, received.decoded.content.twist

    @property
    def path(self) -> Path | None:
        """The path that is followed, in the frame of the odometry."""
        return None if self._course is None else self._course.path

    def _take_path(self, new: FramedPath | None) -> None:
        """Follow a new path, as soon as it can be laid; None or an empty one stops the robot."""
        self._next_course = None
        if new is None or not len(new.points):
            self._course, self._turn, self._fresh_path = None, None, False
        elif self._course is not None and self._course.same(new):
            self._course.end = new.end
        else:
            before, self._reached = self._course or self._reached, None
            if before is not None:
                new.resume(before)
            self._next_course = new
            self._lay_path()
            if new.flaw:
                self._refuse(new.flaw)

    def _lay_path(self) -> None:
        """Lay a path that has come, or the one that is followed anew where its frame has moved."""
        new = self._next_course
        if new is not None and new.lay(self._own):
            self._course, self._next_course = new, None
            self._fresh_path, self._turn = True, None
        elif self._course is not None and self._course.lay(self._own):
            self._fresh_path = True

    def _refuse(self, why: str) -> None:
        self.counts.refused += 1
        if self.counts.refused in (1, 10, 100, 1000):
            _LOG.warning("node: refused %d messages; the last: %s", self.counts.refused, why)

    def waits_for(self) -> str:
        """Return why the robot may not drive now; "" where it may."""
        patience, own = self.settings.patience, self._own.newest
        if not self.active:
            return "inactive"
        if own is None:
            return self._own.unplaced or "waiting for odometry"
        if self._since(own.time) > patience:
            return f"odometry is silent for {self._since(own.time):.2g} s"
        if self._obstacles is not None:
            what = "scans" if isinstance(self._obstacles, ScanSource) else "obstacles"
            seen, placed, why = (
                self._obstacles.newest,
                self._obstacles.placed,
                self._obstacles.unplaced,
            )
            if seen is None or (placed is None and not why):
                return f"waiting for {what}"
            if self._since(seen.time) > patience:
                return f"{what} are silent for {self._since(seen.time):.2g} s"
            if why and (placed is None or self._since(placed.time) > patience):
                return f"{what} cannot be placed: {why}"
        if self._course is not None or self._turn is not None:
            return ""
        if self._next_course is not None:
            return self._next_course.flaw
        return self._no_route or f"waiting for a {'path' if self._goals is None else 'goal'}"

    def _since(self, time: float) -> float:
        """Return by how much a time differs from now, s; a clock may have been set back."""
        return abs(self._clock() - time)

    def plan(self) -> bool:
        """Find obstacles and path, call the controller if it may drive; return whether it did."""
        if self._obstacles is not None:
            self._obstacles.process()
        self._find_path()
        with self._lock:
            self._lay_path()
            waits, own = self.waits_for(), self._own.newest
            if waits or own is None:
                self.status = waits
                return False
            turn = self._turn
            sweeps = self.robot.footprint is not None
            if turn is not None and not (sweeps and np.isfinite(turn.heading)):
                self._stand_still(turn, "")
                return False
            observation, earlier = self._observation(own)
            begin, path, fresh = own.time, self.path, self._fresh_path
            self._fresh_path = fresh and turn is not None
        if turn is not None:
            self._check_spin(turn, [*earlier, observation])
            return False
        called = time.perf_counter()
        self._call_controller(observation, earlier, path if fresh else None)
        with self._lock:
            self.counts.deciding = [*self.counts.deciding[-999:], time.perf_counter() - called]
            self.counts.latency = [*self.counts.latency[-999:], self._decided - begin]
        return True

    def _call_controller(
        self, seen: Observation, earlier: list[Observation], new: Path | None
    ) -> None:
        """Call the controller, with a path that it has not been given before, if there is one."""
        self.counts.plans += 1
        pending = new is not None
        try:
            if new is not None:
                self._hand(new)
            pending = False
            for one in earlier:
                self.controller.remember(one)
            command = within_reach(self.robot, self.controller.command(seen))
        except Exception as error:  # the robot brakes, and the node goes on
            self.counts.failures += 1
            self.status = f"the controller failed: {short(str(error))}"
            if pending:
                self._fresh_path = True
            command = Command((0.0, 0.0))
        else:
            plan = self.controller.last_plan
            stands = plan is not None and plan.reason.startswith(BLOCKED)
            self.status = plan.reason if plan is not None and stands else DRIVING
        with self._lock:
            self._decided, self._based = self._clock(), seen.stamp
            self._command = np.array([*command.linear, command.omega], dtype=np.float64)
            if self._wanted is not None:
                self._wanted.aim(command, self._decided, self.controller.last_plan)

    def _hand(self, path: Path) -> None:
        """Hand a path to the controller, which begins anew where it is to drive it once more."""
        before, anew = self._handed, self._anew
        self._handed, self._anew = path, False
        if anew and before is not None and path.resembles(before):
            self.controller.reset()
        self.controller.set_path(path)

    def _check_spin(self, turn: SpinGoal, seen: list[Observation]) -> None:
        """Let a robot turn whose corners sweep over a disc, if nothing blocks that."""
        beside = spin_blocked_by(self.robot, seen[-1])
        try:
            for one in seen:
                self.controller.remember(one)
        except Exception:  # the turn does not depend on it
            self.counts.failures += 1
        with self._lock:
            self._stand_still(turn, beside)

    def _stand_still(self, turn: SpinGoal, beside: str) -> None:
        """Let the robot stand and turn, see `_aim`, unless something is beside it."""
        self.status = TURNING if np.isfinite(turn.heading) else ARRIVED
        self._decided = self._based = self._clock()
        self._room = None if beside else turn
        if beside:
            self.status = NO_ROOM + beside
        if self._wanted is not None:
            self._wanted.aim(Command((0.0, 0.0)), self._decided)

    def _find_path(self) -> None:
        """Find the path to the newest goal; a route over a map may take long."""
        if self._goals is None:
            return self._end_path()
        with self._lock:
            found = self._goals.request(self._own)
            self._turn = found if isinstance(found, SpinGoal) else None
        if isinstance(found, SpinGoal):
            self._goals.outline_walls()
        if isinstance(found, RouteRequest):
            found = self._goals.plan_route(found, self._clock())
        if isinstance(found, RouteResult):
            with self._lock:
                self._take_path(FramedPath(found.frame, found.points))
                self._no_route = found.reason
        return None

    def _end_path(self) -> None:
        """Forget a path of a topic whose end the robot has reached, and faces: it brakes."""
        follows = self.settings.follows
        with self._lock:
            course, path, motion = self._course, self.path, self.motion
            if not isinstance(follows, PathTopic) or not self._ends:
                return
            if course is None or path is None or motion is None:
                return
            assert self._arrival is not None
            self._turn = None
            if self._arrival.update(path, motion[0][:2]):
                off = abs(self._own.off(course.end.frame, course.end.heading))
                if self.turns_on_the_spot and off > follows.yaw_tolerance:
                    self._turn = course.end
                else:
                    self._take_path(None)
                    self._reached = course

    def _observation(self, received: ReceivedMessage) -> tuple[Observation, list[Observation]]:
        """Return the observation of now, and those that the controller remembers first."""
        decoded = received.decoded
        motion = decoded.content
        assert isinstance(motion, OdometryMessage)
        mean, stated = np.concatenate([motion.pose, motion.twist]), motion.covariance
        if stated is not None:
            try:
                stated = checked_covariance("odometry's covariance", stated, (3, 3))
            except WideberthError as error:
                stated = self._covariance
                self._refuse(f"{error}; the last good one stands in, or none")
        self._covariance = stated
        covariance = EXACT * np.eye(6)
        if stated is not None:
            covariance[:3, :3] = stated
        estimate = MotionEstimate(received.time, mean, covariance)
        state, known = own_state(self.robot, estimate, seen_from_here=True)
        spread = None if stated is None else known
        seen = ScanView() if self._obstacles is None else self._obstacles.view(self._own)
        walls = seen.polygons + (() if self._goals is None else self._goals.walls)
        instant = self._own.now if self.settings.stepped else received.time
        now = Observation(
            instant, state, seen.detections, spread, walls, scan=seen.scan
        )  # fmt: skip
        return now, [replace(now, detections=one) for one in seen.earlier]

    def publish(self) -> bool:
        """Publish a velocity; return whether one was published."""
        with self._lock:
            now = self._clock()
            idle = self._course is None and self._turn is None and self._last is None
            if self._own.newest is None or idle or (self.stands and not self.active):
                return False
            periods = self._since(self._sent) * self.settings.rate
            if self._last is None or periods > PAUSE:
                self._begin(now)
            else:
                self.counts.missed += max(round(periods) - 1, 0)
            self._sent = now
            aim = Twist((0.0, 0.0)) if self._old or self.waits_for() else self._aim(now)
            self._last = self._clear(self._next(self._slowed(aim)))
        self._send(self._last)
        return True

    @property
    def _old(self) -> bool:
        """Whether the last decision was made too long ago, or of odometry that is too old."""
        most = self.controller.period + self.settings.patience
        return self._since(self._decided) > most or self._since(self._based) > 2.0 * most

    @property
    def stands(self) -> bool:
        """Whether the last velocity was zero, or none was published."""
        return self._last is None or not self._last.any()

    def stop(self) -> None:
        """Publish a velocity of zero, if the last one was not."""
        with self._lock:
            if not self.stands:
                self._last = np.zeros(3)
                self._send(self._last)

    def _send(self, velocity: Array, stamp: int | None = None) -> None:
        """Send a velocity: forward, lateral in m/s, yaw rate in rad/s; stamped now if unstated."""
        if self._since(self._looked) > LOOK:
            self._commands.agree()
            self._looked = self._clock()
        (forward, aside), rate = self._turned(velocity[:2], -1.0), float(velocity[2])
        frame = self.settings.base_frame
        encoder = MessageEncoder(self._wall() if stamp is None else stamp, frame, self._known)
        self._commands.send(encoder.command(0.0, Command((forward, aside), rate), frame))
        self.counts.sent += 1

    @cached_property
    def _headed(self) -> bool:
        """Whether the robot's state has a heading; without one its velocities are the frame's."""
        return self.robot.pose((0.0,) * len(self.robot.states)).heading is not None

    def _turned(self, velocity: Array, way: float) -> tuple[float, float]:
        """Return a velocity (2,) of the base in the frame of the odometry (way 1), or back (-1).

        It stays as it is for a robot that has a heading, and drives by its own base.
        """
        x, y = velocity.tolist()
        if self._headed or self.motion is None:
            return x, y
        cosine, sine = np.cos(self.motion[0][2]), way * np.sin(self.motion[0][2])
        return float(cosine * x - sine * y), float(sine * x + cosine * y)

    def _aim(self, now: float) -> Twist:
        """Return what the controller wants, or the turn on the spot of a robot at its goal."""
        assert self._wanted is not None and self._last is not None
        if self._turn is None:
            aim = self._wanted.at(now)
            path = self.path
            if path is None or self.motion is None:
                return aim
            x, y, heading = self.motion[0].tolist()
            return self._approach.limited(path, Pose((x, y), heading), aim)
        off = self._own.off(self._turn.frame, self._turn.heading)
        moving = np.hypot(*self._last[:2]) > STANDING
        if self._room != self._turn or moving or not np.isfinite(off):
            return Twist((0.0, 0.0))
        return Twist((0.0, 0.0), self._spin.rate(off))

    def _begin(self, now: float) -> None:
        """Start at the velocity that the robot has."""
        assert self._own.newest is not None
        motion = self._own.newest.decoded.content
        assert isinstance(motion, OdometryMessage)
        still = np.zeros(len(self.robot.states))
        ahead, aside = self._turned(motion.twist[:2], 1.0)
        velocity = attained(self.robot, still, [Twist((ahead, aside), float(motion.twist[2]))])[0]
        self._last = velocity
        forward, aside, rate = velocity.tolist()
        self._wanted = VelocityInTime(self.robot, Twist((forward, aside), rate), now)

    def _slowed(self, aim: Twist) -> Twist:
        """Return a velocity within the limit that was asked for; the curve stays."""
        speed = float(np.hypot(*aim.linear))
        if speed <= self._limit:
            return aim
        share = self._limit / speed
        return Twist(tuple(share * one for one in aim.linear), share * aim.angular)

    def _next(self, aim: Twist) -> Array:
        """Return the velocity that the robot can have one period after the last command."""
        assert self._last is not None
        forward, aside, rate = self._last.tolist()
        pose = Pose((0.0, 0.0), 0.0)
        state = np.array(self.robot.state_at(pose, Twist((forward, aside), rate)), dtype=float)
        found = attained(self.robot, state, [aim], 1.0 / self.settings.rate)
        return np.asarray(found[0], dtype=np.float64)

    def _clear(self, velocity: Array) -> Array:
        """Return a velocity from which the robot can stop within what the newest scan shows."""
        scans, motion = self._obstacles, self.motion
        if not isinstance(scans, ScanSource) or motion is None or self._own.newest is None:
            return velocity
        x, y, heading = motion[0].tolist()
        forward, aside, rate = velocity.tolist()
        wanted = Twist((forward, aside), rate)
        points, instant = scans.points()
        age = self._own.now + self._since(self._own.newest.time) - instant
        pose = Pose((x, y), heading if self._headed else None)
        slowed = self._room_to_stop.allowed(wanted, pose, points, age)
        return velocity if slowed is wanted else self._next(slowed)

    def publish_plan(self) -> None:
        """Publish the last plan and what it keeps out of, where a topic has subscribers."""
        plan: Plan | None = self.controller.last_plan
        if plan is None or self._own.newest is None:
            return
        encoder = MessageEncoder(
            self._wall() - round(1e9 * plan.stamp), self._own.frame, self._known
        )
        for name, word in (
            ("plan", encoder.plan), ("forecast", encoder.forecast), ("regions", encoder.regions),
        ):  # fmt: skip
            if self._to[name].has_subscribers:
                self._to[name].send(word(plan))
        if "trajectory" in self._to and self._to["trajectory"].has_subscribers:
            self._to["trajectory"].send(encoder.trajectory(plan, self.robot))

    def publish_diagnostics(self) -> None:
        """Publish diagnostics."""
        counts = self.counts
        numbers = {name: str(getattr(counts, name)) for name in ("sent", "missed", "plans",
                                                               "failures", "refused")}  # fmt: skip
        if counts.latency:
            numbers["latency median, ms"] = f"{1e3 * float(np.median(counts.latency)):.1f}"
        self._commands.agree()
        problems = [self._commands.problem, *self._link.mismatches()]
        unnamed = 0 if self._obstacles is None else self._obstacles.unnamed
        if unnamed:
            numbers["without an identity"] = str(unnamed)
            problems.append(f"{unnamed} obstacles have no identity of their own: named by place")
        text = "; ".join(filter(None, (self.status, *problems)))
        well = text in (DRIVING, TURNING, ARRIVED)
        encoder = MessageEncoder(self._wall(), "", self._known)
        self._to["diagnostics"].send(
            encoder.diagnostics(0.0, "wideberth: planner", 0 if well else 1, text, numbers)
        )

    def warm_up(self) -> None:
        """Let all that plans import and compile before the first period, not within it."""
        helpers = [one.warm_up for one in (self._obstacles, self._goals) if one is not None]
        for warm_up in (self._warm_controller, *helpers):
            with suppress(Exception):  # it goes wrong again in `plan`, which says so
                warm_up()

    def _warm_controller(self) -> None:
        """Let the controller import and compile."""
        self.controller.set_path(Path(np.array([(0.0, 0.0), (1.0, 0.0)])))
        self.controller.reset()

    def decide(self) -> bool:
        """Plan, and publish the plan; return whether the controller was called.

        What goes wrong is counted, and said in `status`.
        """
        planned = False
        try:
            planned = self.plan()
            if planned:
                self.publish_plan()
        except Exception as error:  # the commands go on: they brake when plans grow old
            self.counts.failures += 1
            self.status = f"planning failed: {short(str(error))}"
            _LOG.warning("node: %s", self.status)
        return planned


def spin_blocked_by(robot: Robot, observation: Observation) -> str:
    """Say what reaches into the disc that a robot sweeps as it turns on the spot; "" if nothing.

    The disc has the robot's ``radius``, which holds its footprint in all headings. Obstacles are
    discs where they were seen, walls are exact.

    Parameters
    ----------
    robot : in the plane. observation : of the robot, and of what is around it.
    """
    place = np.array(robot.pose(tuple(observation.state)).position, dtype=np.float64)
    sighting = sound(observation, 2)
    if sighting.placeless:
        return f"{sighting.placeless[0]!r} is seen without a place"
    for one in sighting.detections:
        if np.linalg.norm(one.position - place) < robot.radius + one.radius:
            return f"{one.ident!r} is beside the robot"
    for wall in observation.polygons:
        away = np.maximum(wall.points.min(axis=0) - place, place - wall.points.max(axis=0))
        if (away < robot.radius).all():
            if any(separation(place[None], part)[0] < robot.radius for part in wall.parts):
                return f"{wall.name or 'a wall'} is beside the robot"
    return ""
