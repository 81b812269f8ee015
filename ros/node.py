"""A planner on a network of ROS 2: it receives odometry and obstacles, and sends velocities."""

import logging
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, final

import numpy as np

from ..framework.control.command_limits import FAST, attained, turns_on_the_spot, within_reach
from ..framework.control.velocity_smoother import VelocitySmoother
from ..framework.controller import Controller, avoids_polygons
from ..framework.robot import Robot
from ..framework.values.arrays import Array
from ..framework.values.errors import WideberthError, short
from ..framework.values.motion import Command, Observation, Pose, Twist
from ..framework.values.occupancy_grid import OccupancyGrid
from ..framework.values.path import Path
from ..framework.values.plan import Plan
from ..framework.values.sensing import MotionEstimate, Scan
from ..perception.own_state import own_state
from .frames import composed
from .messages import Messages
from .node_settings import NodeSettings
from .own_motion import OwnMotion, ReceivedMessage
from .priority import urgent
from .readings import Goal, OdometryReading, PathReading, Transforms, reading_of
from .room import beside_robot
from .sight import LASERSCAN, ObstacleSight, ObstacleSource, ObstacleTopic, ScanSight, ScanView
from .ways import Arrival, Found, GoalPlanner, GoalTopic, MapTopic, PathTopic, Question, Turn
from .wording import MessageEncoder

LONGEST_PATH = 10_000
"""Points; a longer path is thinned out."""
MOST_BEAMS, MOST_CELLS = 50_000, 25_000_000
"""Of a scan and of a map that are looked at; larger ones are refused."""
PAUSE = 5.0
"""Periods; after a pause that is longer, commands begin at the robot's own velocity again."""
EXACT = 1e-8
"""m^2 and so on: covariance of odometry that states none."""
DRIVING, TURNING = "driving", "turning to the goal's heading"
ARRIVED = "standing at the end of the path"
"""What a node's status says where all is well."""
NO_ROOM = "no room to turn: "
"""Begins the status of a robot that something is beside as it wants to turn."""
STANDING = 0.01
"""m/s; a slower robot stands, and may turn on the spot."""
TRAJECTORY = "nav_msgs/msg/Trajectory"
"""A type that ROS 2 has from Lyrical on."""
_LOG = logging.getLogger("wideberth")


class Sends(Protocol):
    """Sends messages on a topic."""

    @property
    def has_subscribers(self) -> bool:
        """Whether the topic has a subscriber."""
        ...

    def send(self, message: Any) -> None:
        """Send a message."""
        ...


class Takes(Protocol):
    """Takes the messages of a topic."""

    kind: str
    refused: int

    def take(self) -> Iterable[Any]:
        """Return what has come."""
        ...


class Joins(Protocol):
    """Makes publishers and subscribers, as `wideberth.ros.dds.Link` does."""

    known: Messages

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> Sends:
        """Return a publisher."""
        ...

    def subscriber(
        self, topic: str, kind: str, *, reliable: bool = False, kept: bool = False
    ) -> Takes:
        """Return a subscriber."""
        ...


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
    """

    sent: int = 0
    missed: int = 0
    plans: int = 0
    failures: int = 0
    refused: int = 0
    latency: list[float] = field(default_factory=list)


@final
class PlannerNode:
    """Runs a controller beside the messages of a robot.

    `listen`, `decide` and `speak` are one step each of what `run` does at its own rates; none of
    them raises. Commands start at the robot's own velocity, and each follows from the one before
    within the robot's limits. Where odometry, obstacles or the controller are silent for longer
    than `NodeSettings.patience`, or no path is there, the robot brakes to a stand.

    Parameters
    ----------
    controller : that drives. robot : its model, in the plane.
    settings : topics and rates.
    link : the network.
    clock : s, monotonic.
    """

    def __init__(
        self,
        controller: Controller,
        robot: Robot,
        settings: NodeSettings,
        link: Joins,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if robot.dimension != 2:
            raise WideberthError("a node drives robots in the plane")
        self.controller: Controller = controller
        self.robot: Robot = robot
        self.settings: NodeSettings = settings
        self.counts: Counts = Counts()
        self.status: str = "waiting for odometry"
        """What it does now, or waits for."""
        self._clock = clock
        self._known = link.known
        self._own = OwnMotion(settings.base_frame)
        self._path: Path | None = None
        self._fresh_path = False
        self._smoother: VelocitySmoother | None = None
        self._last: Array | None = None
        self._decided = self._sent = -np.inf
        self._limit = np.inf
        self._turn: Turn | None = None
        self._room: Turn | None = None
        """The turn for which there was room at the last look."""
        still = np.zeros(len(robot.states))
        self.turns_on_the_spot: bool = turns_on_the_spot(robot, still)
        """Whether the robot can turn while it stands."""
        fast = attained(robot, still, [Twist((0.0, 0.0), FAST)], 1.0 / settings.rate)[0, 2]
        self._gain: float = settings.rate * float(fast)
        """rad/s^2, by which the robot can turn faster on the spot; 0 where it cannot."""
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._sight: ObstacleSource | None = None
        self._guide: GoalPlanner | None = None
        self._arrival: Arrival | None = None
        self._no_way = ""
        self._join(link)

    def _join(self, link: Joins) -> None:
        """Open all topics."""
        s = self.settings
        tf = "tf2_msgs/msg/TFMessage"
        self._from: dict[str, Takes] = {
            "odometry": link.subscriber(s.odometry, "nav_msgs/msg/Odometry"),
            "tf": link.subscriber("/tf", tf),
            "tf_static": link.subscriber("/tf_static", tf, reliable=True, kept=True),
        }
        self._see(link)
        self._find(link)
        kind = "TwistStamped" if s.stamped else "Twist"
        markers = "visualization_msgs/msg/MarkerArray"
        self._to: dict[str, Sends] = {
            "commands": link.publisher(s.commands, f"geometry_msgs/msg/{kind}"),
            "plan": link.publisher("/wideberth/plan", "nav_msgs/msg/Path", kept=True),
            "forecast": link.publisher("/wideberth/forecast", markers, kept=True),
            "regions": link.publisher("/wideberth/regions", markers, kept=True),
            "diagnostics": link.publisher("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray"),
        }

        if TRAJECTORY in link.known:
            self._to["trajectory"] = link.publisher("/wideberth/trajectory", TRAJECTORY, kept=True)

    def _see(self, link: Joins) -> None:
        """Open the topic of what is seen."""
        sees = self.settings.sees
        if isinstance(sees, ObstacleTopic):
            self._from["obstacles"] = link.subscriber(sees.topic, sees.kind)
            self._sight = ObstacleSight(sees, self._own, self._lock, self._refuse)
        elif sees is not None:
            self._from["scans"] = link.subscriber(sees.topic, LASERSCAN)
            walls, gap = avoids_polygons(self.controller), 2.0 * self.robot.radius
            self._sight = ScanSight(sees, self._own, gap, walls, self._lock, self._refuse)

    def _find(self, link: Joins) -> None:
        """Open the topics of paths, or of goals and of the map."""
        follows = self.settings.follows
        if isinstance(follows, PathTopic):
            self._from["path"] = link.subscriber(follows.topic, "nav_msgs/msg/Path", reliable=True)
            self._arrival = Arrival(follows.tolerance)
        elif isinstance(follows, GoalTopic):
            pose, grid = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/OccupancyGrid"
            self._from["goal"] = link.subscriber(follows.topic, pose, reliable=True)
            walls = avoids_polygons(self.controller) and not isinstance(self._sight, ScanSight)
            self._guide = GoalPlanner(follows, self.robot.radius, self.turns_on_the_spot, walls)
            if follows.over is not None and isinstance(follows.over.map, MapTopic):
                topic = follows.over.map.topic
                self._from["map"] = link.subscriber(topic, grid, reliable=True, kept=True)

    def listen(self) -> None:
        """Take what has come."""
        now = self._clock()
        for name, source in self._from.items():
            try:
                for message in source.take():
                    self._on_message(name, source.kind, message, now)
            except Exception as error:  # whatever a message holds, the loop goes on
                self._refuse(f"{name}: {error}")

    def _on_message(self, name: str, kind: str, message: Any, now: float) -> None:
        try:
            reading = reading_of(kind, message)
        except WideberthError as error:
            return self._refuse(f"{name}: {error}")
        content = reading.content
        with self._lock:
            if isinstance(content, Transforms):
                self._own.take_frames(content)
            elif isinstance(content, OdometryReading):
                try:
                    self._own.take(reading, now)
                except WideberthError as error:
                    return self._refuse(str(error))
            elif isinstance(content, PathReading):
                self._take_path(reading.frame, content.points)
            elif isinstance(content, Scan) and len(content.ranges) > MOST_BEAMS:
                return self._refuse(f"a scan of {len(content.ranges)} beams is too long")
            elif isinstance(content, OccupancyGrid) and content.cells.size > MOST_CELLS:
                return self._refuse(f"a map of {content.cells.size} cells is too large")
            elif isinstance(content, Goal | OccupancyGrid) and self._guide is not None:
                self._guide.receive(reading)
            elif self._sight is not None:
                self._sight.receive(reading, now)
        return None

    def follow(self, frame: str, points: Array) -> bool:
        """Follow a path of points (P, 2) in m of a frame; return whether it can be followed."""
        with self._lock:
            refused, self._turn = self.counts.refused, None
            self._take_path(frame, points)
            return self._path is not None and self.counts.refused == refused

    def halt(self) -> None:
        """Forget the path: the robot brakes."""
        with self._lock:
            self._take_path("", np.zeros((0, 2)))

    def turn(self, frame: str, heading: float) -> float:
        """Brake, and turn on the spot to a heading of a frame, rad, until another path comes.

        With a heading that is NaN the robot only brakes. Return how much is left of the turn,
        within pi, rad; NaN where that is not known.
        """
        with self._lock:
            self._turn = Turn(frame, heading)
            return self._own.off(frame, heading)

    def drive_on(self) -> None:
        """End a turn on the spot: the robot follows its path again."""
        with self._lock:
            self._turn = None

    def limit_speed(self, limit: float) -> None:
        """Drive at most so fast from now on, m/s; infinity takes the limit away."""
        self._limit = limit if limit >= 0.0 else 0.0

    @property
    def motion(self) -> tuple[Array, Array] | None:
        """Pose (3,) and twist (3,) of the newest odometry; None before the first."""
        received = self._own.newest
        if received is None or not isinstance(received.reading.content, OdometryReading):
            return None
        return received.reading.content.pose, received.reading.content.twist

    @property
    def path(self) -> Path | None:
        """The path that is followed, in the frame of the odometry."""
        return self._path

    def _take_path(self, frame: str, points: Array) -> None:
        """Follow a new path; an empty one stops the robot."""
        if self._own.newest is not None and len(points) >= 2:
            motion = self._own.motion(self._own.frame, frame)
            if motion is None:
                return self._refuse(f"no motion connects the path's frame {frame!r} with odometry")
            places = np.column_stack([points, np.zeros(len(points))])
            points = composed(motion, places)[:, :2]
        try:
            path = Path(points[:: 1 + len(points) // LONGEST_PATH]) if len(points) >= 2 else None
        except WideberthError as error:
            return self._refuse(f"path: {error}")
        same = path is not None and self._path is not None
        if same and np.array_equal(path.points, self._path.points):  # type: ignore[union-attr]
            return None
        self._path, self._fresh_path, self._turn = path, True, None
        return None

    def _refuse(self, why: str) -> None:
        self.counts.refused += 1
        if self.counts.refused in (1, 10, 100, 1000):
            _LOG.warning("node: refused %d messages; the last: %s", self.counts.refused, why)

    def waits_for(self) -> str:
        """Return why the robot may not drive now; "" where it may."""
        now, patience, own = self._clock(), self.settings.patience, self._own.newest
        if own is None:
            return "waiting for odometry"
        if now - own.time > patience:
            return f"odometry is silent for {now - own.time:.2g} s"
        if self._sight is not None:
            what = "obstacles" if "obstacles" in self._from else "scans"
            seen, placed, why = self._sight.newest, self._sight.placed, self._sight.unplaced
            if seen is None or (placed is None and not why):
                return f"waiting for {what}"
            if now - seen.time > patience:
                return f"{what} are silent for {now - seen.time:.2g} s"
            if why and (placed is None or now - placed.time > patience):
                return f"{what} cannot be placed: {why}"
        if self._path is not None or self._turn is not None:
            return ""
        return self._no_way or f"waiting for a {'path' if self._guide is None else 'goal'}"

    def decide(self) -> bool:
        """Look, find the way, and call the controller if it may drive; return whether it did."""
        if self._sight is not None:
            self._sight.look()
        self._find_way()
        with self._lock:
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
            begin, path, fresh = own.time, self._path, self._fresh_path
            self._fresh_path = fresh and turn is not None
        if turn is not None:
            self._look_beside(turn, [*earlier, observation])
            return False
        self._plan(observation, earlier, path if fresh else None)
        with self._lock:
            self.counts.latency = [*self.counts.latency[-999:], self._decided - begin]
        return True

    def _plan(self, seen: Observation, earlier: list[Observation], new: Path | None) -> None:
        """Call the controller, with a path that it has not been given before, if there is one."""
        self.counts.plans += 1
        pending = new is not None
        try:
            if new is not None:
                self.controller.set_path(new)
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
            self.status = DRIVING
        with self._lock:
            self._decided = self._clock()
            if self._smoother is not None:
                self._smoother = self._smoother.aim(command, self._decided)

    def _look_beside(self, turn: Turn, seen: list[Observation]) -> None:
        """Decide that a robot turns whose corners sweep over a disc, if there is room for that."""
        beside = beside_robot(self.robot, seen[-1])
        try:
            for one in seen:
                self.controller.remember(one)
        except Exception:  # the turn does not depend on it
            self.counts.failures += 1
        with self._lock:
            self._stand_still(turn, beside)

    def _stand_still(self, turn: Turn, beside: str) -> None:
        """Decide that the robot stands and turns, see `_aim`, unless something is beside it."""
        self.status = TURNING if np.isfinite(turn.heading) else ARRIVED
        self._decided = self._clock()
        self._room = None if beside else turn
        if beside:
            self.status = NO_ROOM + beside
        if self._smoother is not None:
            self._smoother = self._smoother.aim(Command((0.0, 0.0)), self._decided)

    def _find_way(self) -> None:
        """Find the way to the newest goal; a route over a map may take long."""
        if self._guide is None:
            return self._end_way()
        with self._lock:
            found = self._guide.ask(self._own)
            self._turn = found if isinstance(found, Turn) else None
        if isinstance(found, Turn):
            self._guide.look()
        if isinstance(found, Question):
            found = self._guide.answer(found, self._clock())
        if isinstance(found, Found):
            with self._lock:
                self._take_path(found.frame, found.points)
                self._no_way = found.reason
        return None

    def _end_way(self) -> None:
        """Forget a path of a topic whose end the robot has reached: it brakes."""
        with self._lock:
            path, motion = self._path, self.motion
            if self._arrival is None or path is None or motion is None:
                return
            if self._arrival.look(path, motion[0][:2]):
                self._take_path("", np.zeros((0, 2)))

    def _observation(self, received: ReceivedMessage) -> tuple[Observation, list[Observation]]:
        """Put together what the controller sees, and what it should remember first."""
        reading = received.reading
        motion = reading.content
        assert isinstance(motion, OdometryReading)
        covariance = EXACT * np.eye(6)
        if motion.covariance is not None and np.isfinite(motion.covariance).all():
            covariance[:3, :3] = motion.covariance
        mean = np.concatenate([motion.pose, motion.twist])
        try:
            estimate = MotionEstimate(received.time, mean, covariance)
        except WideberthError:  # no covariance at all
            estimate = MotionEstimate(received.time, mean, EXACT * np.eye(6))
        state, spread = own_state(self.robot, estimate, seen_from_here=True)
        seen = ScanView() if self._sight is None else self._sight.view(self._own)
        walls = seen.polygons + (() if self._guide is None else self._guide.walls)
        now = Observation(
            received.time, state, seen.detections, spread, walls, scan=seen.scan
        )  # fmt: skip
        return now, [replace(now, detections=one) for one in seen.earlier]

    def speak(self) -> bool:
        """Send a velocity; return whether one was sent."""
        with self._lock:
            now = self._clock()
            idle = self._path is None and self._turn is None and self._last is None
            if self._own.newest is None or idle:
                return False
            if self._last is None or now - self._sent > PAUSE / self.settings.rate:
                self._begin(now)
            self._sent = now
            old = now - self._decided > self.controller.period + self.settings.patience
            aim = Twist((0.0, 0.0)) if old or self.waits_for() else self._aim(now)
            sent = self._next(self._slowed(aim))
            self._last = sent
            forward, aside, rate = sent.tolist()
            frame = self.settings.base_frame
        wording = MessageEncoder(0, frame, self._known)
        message = wording.command(time.time(), Command((forward, aside), rate), frame)
        self._to["commands"].send(message if self.settings.stamped else message.twist)
        self.counts.sent += 1
        return True

    def _aim(self, now: float) -> Twist:
        """Return what the controller wants, or the turn on the spot of a robot at its goal.

        The rate w of a turn that is off by e brakes in time at half of what the robot can do, and
        dies out in a few periods P::

            w = sign(e) min(sqrt(a |e|), |e| / (4 P))
        """
        assert self._smoother is not None and self._last is not None
        if self._turn is None:
            return self._smoother.at(now)
        off = self._own.off(self._turn.frame, self._turn.heading)
        moving = np.hypot(*self._last[:2]) > STANDING
        if self._room != self._turn or moving or not np.isfinite(off):
            return Twist((0.0, 0.0))
        rate = min(np.sqrt(self._gain * abs(off)), 0.25 * self.settings.rate * abs(off))
        return Twist((0.0, 0.0), float(np.copysign(rate, off)))

    def _begin(self, now: float) -> None:
        """Start at the velocity that the robot has."""
        assert self._own.newest is not None
        motion = self._own.newest.reading.content
        assert isinstance(motion, OdometryReading)
        still = np.zeros(len(self.robot.states))
        own = Twist((float(motion.twist[0]), float(motion.twist[1])), float(motion.twist[2]))
        velocity = attained(self.robot, still, [own])[0]
        self._last = velocity
        forward, aside, rate = velocity.tolist()
        self._smoother = VelocitySmoother.at_rest(Twist((forward, aside), rate), now)

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

    def show(self) -> None:
        """Send the last plan and what it keeps out of, to those who listen."""
        plan: Plan | None = self.controller.plan
        if plan is None or self._own.newest is None:
            return
        wording = MessageEncoder(
            time.time_ns() - round(1e9 * plan.stamp), self._own.frame, self._known
        )
        for name, word in (
            ("plan", wording.plan), ("forecast", wording.forecast), ("regions", wording.regions),
        ):  # fmt: skip
            if self._to[name].has_subscribers:
                self._to[name].send(word(plan))
        if "trajectory" in self._to and self._to["trajectory"].has_subscribers:
            self._to["trajectory"].send(wording.trajectory(plan, self.robot))

    def report(self) -> None:
        """Send diagnostics."""
        counts = self.counts
        numbers = {name: str(getattr(counts, name)) for name in ("sent", "missed", "plans",
                                                               "failures", "refused")}  # fmt: skip
        if counts.latency:
            numbers["latency median, ms"] = f"{1e3 * float(np.median(counts.latency)):.1f}"
        well = self.status in (DRIVING, TURNING, ARRIVED)
        self._to["diagnostics"].send(
            MessageEncoder(0, "", self._known).diagnostics(
                time.time(), "wideberth: planner", 0 if well else 1, self.status, numbers
            )
        )

    def run(self, seconds: float = np.inf) -> None:
        """Listen and send at the rate of the commands; decide beside it, at the controller's rate.

        The controller and those who see and find the way import and compile first, which may
        take long.

        Parameters
        ----------
        seconds : after which it returns; endless by default, until `stop`.
        """
        self._warm_up()
        planner = threading.Thread(target=self._plan_forever, name="planner", daemon=True)
        planner.start()
        priority = self.settings.priority
        if priority and (reason := urgent(priority)):
            _LOG.warning("node: no real-time priority (%s); commands may be late", reason)
        period, begin = 1.0 / self.settings.rate, time.monotonic()
        due, reported = begin, begin
        try:
            while not self._stop.is_set() and time.monotonic() - begin < seconds:
                now = time.monotonic()
                if now >= due:  # before anything else: to listen may take long
                    self.speak()
                    late = int((now - due) / period)
                    self.counts.missed += late
                    due += (late + 1) * period
                self.listen()
                if now - reported >= 1.0:
                    self.report()
                    reported = now
                self._stop.wait(max(min(due - time.monotonic(), 0.005), 0.0))
        finally:
            self._stop.set()
            planner.join(timeout=10.0)
            if priority:
                urgent(0)

    def stop(self) -> None:
        """Let `run` return."""
        self._stop.set()

    def _warm_up(self) -> None:
        """Let all that decides import and compile before the first period, not within it."""
        for warm_up in (self._warm_controller, *self._helpers()):
            with suppress(Exception):  # it goes wrong again in `decide`, which says so
                warm_up()

    def _warm_controller(self) -> None:
        """Let the controller import and compile."""
        self.controller.set_path(Path(np.array([(0.0, 0.0), (1.0, 0.0)])))
        self.controller.reset()

    def _helpers(self) -> list[Callable[[], None]]:
        """Return what warms up those who see and find the way."""
        return [one.warm_up for one in (self._sight, self._guide) if one is not None]

    def _plan_forever(self) -> None:
        """Decide at the controller's rate, as often as it can."""
        if self.settings.priority:
            # A planner that waits for the processor while it holds Python's lock would let the
            # commands wait, whatever their own priority.
            # Its solver's calls are as urgent as it is; commands go before both.
            urgent(max(self.settings.priority - 1, 1))
        due = time.monotonic()
        while not self._stop.is_set():
            try:
                if self.decide():
                    self.show()
            except Exception as error:  # the commands go on: they brake when plans grow old
                self.counts.failures += 1
                self.status = f"deciding failed: {short(str(error))}"
                _LOG.warning("node: %s", self.status)
            due = max(due + self.controller.period, time.monotonic())
            self._stop.wait(max(due - time.monotonic(), 0.001))
