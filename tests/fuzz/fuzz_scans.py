"""Absurd scans, odometry and frames, for detectors with trackers and for nodes of ROS 2.

A case is a short run whose numbers all come from its seed, so that it can be repeated alone.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np
from fuzz_cases import (
    BATCH,
    DEADLINE,
    INSIDE,
    SECONDS,
    TICKS,
    Call,
    Rng,
    draw_stamp,
    magnitude,
    one_of,
    scaled,
    timed,
)

from wideberth.framework.control.command_limits import broken_limit
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.framework.values.sensing import Scan
from wideberth.routes import NavFn
from wideberth.routes.replanning import Replanning
from wideberth.tests.helpers.bags import odometry, quaternion, transform, vector
from wideberth.tests.helpers.network import Network
from wideberth.tests.helpers.rays import ranges
from wideberth_ros.decoding import OBSTACLES
from wideberth_ros.messages import messages
from wideberth_ros.node import PlannerNode
from wideberth_ros.node_settings import NodeSettings
from wideberth_ros.obstacle_sources import ObstacleTopic, ScanTopic
from wideberth_ros.path_sources import GoalTopic, MapPlanner, MapTopic

ROBOT = {"type": "unicycle", "radius": 0.3, "max_yaw_rate": 1.0, "max_yaw_acceleration": 1.0}
STEP = 0.05
"""s between two commands of a node."""
EPOCH = 1_700_000_000
"""s, of stamps in messages, as Unix counts them."""
HALL = np.array([(-4.0, -3.0), (12.0, -3.0), (12.0, 4.0), (-4.0, 4.0), (-4.0, -3.0)])
"""m, corners of the room that scans show."""
ABSURD = (np.nan, np.inf, -np.inf, 0.0, 1e9, -1e9, 1e17, 1e30, 1e154, 1e300, -1e308, 1.7e308,
          1e-300)  # fmt: skip
SCANNED = "sensor_msgs/msg/LaserScan"


@cache
def sensing() -> list[tuple[str, str, Any, str]]:
    """Return detectors with trackers: what they are, detector, its settings, tracker."""
    trackers = names("trackers")
    kinds: list[tuple[str, Any]] = [(name, {}) for name in names("detectors")]
    kinds += [("discs", {"shape": [0.3, 0.2], "others": [[0.2], [0.4]]})]
    return [
        (f"detector {name}{' ' * bool(given)}{' '.join(map(str, given.values()))}",
         name, given, trackers[(k + turn) % len(trackers)])
        for k, (name, given) in enumerate(kinds)
        for turn in range(2)
    ]  # fmt: skip


def looking(index: int) -> tuple[Any, Any]:
    """Build a detector and a tracker."""
    _, name, given, tracker = sensing()[index]
    return build("detectors", {"type": name} | given), build("trackers", tracker)


def around(beams: int) -> Array:
    """Return the bearings of a full turn, (B,), rad."""
    return np.asarray(-np.pi + 2.0 * np.pi / max(beams, 1) * np.arange(beams))


def single(values: Any) -> Any:
    """Return numbers as a message of ROS 2 holds them, in single precision."""
    with np.errstate(all="ignore"):
        return np.asarray(values, np.float32)


def draw_ranges(rng: Rng, pose: Array, beams: int) -> Array:
    """Draw ranges, (B,), m; some are absurd."""
    walls = np.stack([HALL[:-1], HALL[1:]], axis=1)
    people = rng.uniform((-3.0, -2.0), (9.0, 3.0), (int(rng.integers(6)), 2))
    found = ranges(pose[:2], around(beams) + pose[2], people, 0.3, walls)
    found = found + 0.01 * rng.standard_normal(beams)
    if rng.random() < 0.3:
        some = rng.random(beams) < one_of(rng, 0.02, 0.3, 1.0)
        absurd = [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e9, 1e20, 1e154, 1e300, 1.7e308]
        found[some] = rng.choice(absurd, int(some.sum()))
    return found


def draw_scan(rng: Rng, stamp: float, pose: Array, beams: int = 180) -> Callable[[], Scan]:
    """Draw a turn of a LiDAR in a hall among people; some of its numbers are absurd.

    Some of these are refused where the scan is made.
    """
    bearings, found = around(beams), draw_ranges(rng, pose, beams)
    times = stamp + np.linspace(-0.1, 0.0, beams)
    if rng.random() < 0.1:
        times = scaled(times, magnitude(rng, 0.0))
    if rng.random() < 0.1:
        bearings = scaled(bearings, magnitude(rng, 0.0))
    longest = 15.0 if rng.random() < 0.9 else one_of(rng, 1e-300, 1e9, 1e20, 1e154, 1e300, 1.7e308)
    mount = np.array([0.2, 0.0, 0.1])
    if rng.random() < 0.1:
        mount = scaled(mount, magnitude(rng, 0.0))
    return lambda: Scan("lidar", times, bearings, found, longest=longest, mount=mount)


def draw_poses(rng: Rng, pose: Array, beams: int) -> Array:
    """Draw the pose of each beam; some are absurd."""
    poses = pose + np.linspace(-0.05, 0.0, beams)[:, None] * np.array([1.0, 0.0, 0.3])
    if rng.random() < 0.4:
        some = rng.random(beams) < one_of(rng, 0.02, 0.3, 1.0, 1.0)
        axis = int(rng.integers(3))
        poses[some, axis] = scaled(poses[some, axis] + 1.0, magnitude(rng, 0.0))
    if rng.random() < 0.1:
        poses[rng.integers(beams) :, rng.integers(3)] = one_of(rng, np.nan, np.inf, -np.inf)
    return poses


def detector_case(index: int, seed: int) -> Iterator[Call]:
    """Show `BATCH` scans to a detector, and what it finds to a tracker."""
    rng = np.random.default_rng([4, index, seed])
    detector, tracker = looking(index)
    what, pose, stamp = sensing()[index][0], np.zeros(3), 0.0
    for _ in range(BATCH):
        stamp = draw_stamp(rng, stamp, 0.1)
        pose = pose + np.array([0.05, 0.0, 0.02])
        scan, poses = draw_scan(rng, stamp, pose), draw_poses(rng, pose, 180)
        given = (detector, tracker, scan, poses)
        yield timed(what, lambda given=given: seen_well(*given), SECONDS / 2)


def seen_well(
    detector: Any, tracker: Any, made: Callable[[], Scan], poses: Array
) -> tuple[str, str]:
    """Detect and track, as a node does, and say what is wrong with it."""
    try:
        scan = made()
    except WideberthError:
        return "", ""
    found = detector.detect(scan, poses)
    if np.isfinite(found.time):
        tracker.update(found)
    for one in tracker.at(scan.stamp):
        if not np.isfinite(one.state).all() or not np.isfinite(one.covariance).all():
            return "nan", f"{one.ident}: {one.state}"
    return "", ""


@cache
def nodes() -> list[tuple[str, dict[str, Any], Callable[[], Any], Callable[[], Any]]]:
    """Return nodes: what they are, the controller, what they see and what they follow."""
    planner = {"type": "mpc", "region": "mahalanobis_ellipse", "predictor": "imm",
               "level": "fixed", "penalty": 1e4, "horizon": 10, "period": 0.2, "dt": 0.25,
               "track_dt": 0.25, "deadline": DEADLINE, "static_region": "separating_line",
               "most_obstacles": 5, "solver": "riccati"}  # fmt: skip
    rivals = [{"type": name} for name in ("nav2", "dynamic_window", "orca", "social_force")]
    made: list[Any] = []
    for index, (what, *_) in enumerate(sensing()):
        drives = planner if index % 2 == 0 else rivals[index // 2 % len(rivals)]
        handover = ("measured", "filtered")[index // 2 % 2]

        def scans(index: int = index, handover: Any = handover) -> ScanTopic:
            return ScanTopic("/scan", *looking(index), handover)

        made.append((f"node, {drives['type']}, {what}", drives, scans, _way(index)))
    for index, kind in enumerate(sorted(OBSTACLES)):
        drives = (planner, rivals[index % len(rivals)])[index % 2]
        sees = partial(ObstacleTopic, "/obstacles", kind)
        made.append((f"node, {drives['type']}, {kind}", drives, sees, _way(index)))
    return made


def _way(index: int) -> Callable[[], Any]:
    """Return what a node follows: by turns a goal over a map, and a straight way to one."""
    if index % 3:
        return lambda: GoalTopic(over=MapPlanner(MapTopic(), Replanning(NavFn())))
    return GoalTopic


@cache
def node_controller(index: int) -> Controller:
    """Build a node's controller and compile what it needs; kept for later cases."""
    made: Controller = build("controllers", nodes()[index][1] | {"robot": ROBOT})
    made.set_path(Path(np.array([(-1.0, 0.0), (1.0, 0.0)])))
    return made


class Driven:
    """A node, and all that it hears; everything is drawn."""

    def __init__(self, index: int, seed: int) -> None:
        self.rng = np.random.default_rng([5, index, seed])
        self.what, _, sees, follows = nodes()[index]
        self.controller, self.now = node_controller(index), 5.0
        self.controller.reset()
        self.robot: Any = vars(self.controller)["robot"]
        self.network = Network()
        settings = NodeSettings(sees=sees(), follows=follows())
        self.node = PlannerNode(
            self.controller, self.robot, settings, self.network, lambda: self.now
        )
        self.node.warm_up()
        self.caught: list[str] = []
        take, self.pose = self.node._take, np.zeros(3)

        def noted(*given: Any) -> None:
            try:
                take(*given)
            except WideberthError:  # its way to refuse a message
                raise
            except Exception as error:  # the node itself goes on, and counts it as refused
                self.caught.append(f"{given[0]}: {type(error).__name__}: {error}")
                raise

        self.node._take = noted  # type: ignore[method-assign]
        self.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.2, 0.0, 0.1)))
        self.come("/tf", transform(EPOCH, "map", "odom", (0.5, 0.2, 0.1)))

    def come(self, topic: str, message: Any) -> None:
        """Send the node a message, if it listens."""
        if topic in self.network.wires:
            self.network.wires[topic].come.append(message)

    def number(self, usual: float, share: float = 0.02) -> float:
        """Return the usual number, or at times an absurd one."""
        if self.rng.random() >= share:
            return usual
        return float(one_of(self.rng, -usual, *ABSURD))

    def header(self, frame: str) -> Any:
        """Return a header whose stamp and frame are usually right."""
        known, rng, whole = messages(), self.rng, round(1e9 * self.now)
        sec = EPOCH + whole // 10**9
        if rng.random() < 0.05:
            sec = int(one_of(rng, 0, 1, -1, 2**31 - 1, -(2**31), sec + 1, sec - 1, sec + 10**6))
        stamp = known.make("builtin_interfaces/msg/Time", sec=sec, nanosec=whole % 10**9)
        if rng.random() < 0.03:
            frame = str(one_of(rng, "", "moon", "map", "odom", "base_link"))
        return known.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def odometry(self) -> Any:
        """Return where the robot is."""
        self.pose = self.pose + np.array([0.02, 0.0, 0.005])
        pose = [self.number(float(value)) for value in self.pose]
        twist = [self.number(value) for value in (0.4, 0.0, 0.1)]
        with np.errstate(all="ignore"):
            made = odometry(0.0, pose, twist, child="base_link")
        made.header = self.header("odom")
        if self.rng.random() < 0.3:
            spread = 1e-4 * np.eye(6)
            made.pose.covariance = np.array([self.number(one) for one in spread.ravel().tolist()])
        return made

    def scan(self) -> Any:
        """Return a turn of the LiDAR."""
        rng, beams = self.rng, int(one_of(self.rng, 180, 180, 180, 0, 1, 2, 60))
        usual = {"angle_min": -np.pi, "angle_max": np.pi, "range_min": 0.05, "range_max": 15.0,
                 "angle_increment": 2.0 * np.pi / max(beams, 1),
                 "time_increment": 0.1 / max(beams, 1)}  # fmt: skip
        measured = draw_ranges(rng, self.pose, beams)
        return messages().make(
            SCANNED, header=self.header("laser"), ranges=single(measured),
            **{name: float(single(self.number(value))) for name, value in usual.items()},
        )  # fmt: skip

    def obstacles(self, kind: str) -> Any:
        """Return some obstacles in a type of message."""
        known, rng = messages(), self.rng
        many = [self._obstacle(kind) for _ in range(int(one_of(rng, 0, 1, 3, 10, 700)))]
        name = "detections" if "vision" in kind else "obstacles"
        return known.make(kind, header=self.header("odom"), **{name: many})

    def _obstacle(self, kind: str) -> Any:
        known, rng = messages(), self.rng
        x, y = (self.number(float(value)) for value in rng.normal(scale=4.0, size=2))
        place, size = vector("Point", x, y), vector("Vector3", *(self.number(0.6) for _ in "xy"))
        speed = vector("Vector3", self.number(0.5), self.number(0.1))
        pose = known.make("geometry_msgs/msg/Pose", position=place, orientation=quaternion(0.1))
        if "nav2" in kind:
            uuid = rng.integers(0, 5, 16).astype(np.uint8)
            spread = 1e-2 * np.eye(3)
            wide = np.array([self.number(one) for one in spread.ravel().tolist()])
            return known.make(
                "nav2_dynamic_msgs/msg/Obstacle",
                uuid=known.make("unique_identifier_msgs/msg/UUID", uuid=uuid),
                position=place, velocity=speed, size=size, position_covariance=wide,
            )  # fmt: skip
        if "costmap" in kind:
            corners = [
                known.make("geometry_msgs/msg/Point32", x=x + i % 2, y=y + i // 2)
                for i in range(int(one_of(rng, 0, 1, 3)))
            ]
            return known.make(
                "costmap_converter_msgs/msg/ObstacleMsg", id=int(rng.integers(-1, 9)),
                polygon=known.make("geometry_msgs/msg/Polygon", points=corners),
                radius=self.number(0.3), orientation=quaternion(0.1),
            )  # fmt: skip
        if "vision" in kind:
            box = known.make("vision_msgs/msg/BoundingBox3D", center=pose, size=size)
            return known.make("vision_msgs/msg/Detection3D", id=str(rng.integers(9)), bbox=box)
        return known.make(
            "mpc_planner_msgs/msg/ObstacleGMM", id=int(rng.integers(-1, 9)), pose=pose
        )

    def goal(self) -> Any:
        """Return somewhere to go."""
        known = messages()
        place = vector("Point", self.number(8.0, 0.1), self.number(1.0, 0.1))
        turn = quaternion(self.number(0.0, 0.1))
        with np.errstate(all="ignore"):
            pose = known.make("geometry_msgs/msg/Pose", position=place, orientation=turn)
        return known.make("geometry_msgs/msg/PoseStamped", header=self.header("map"), pose=pose)

    def map(self) -> Any:
        """Return a map of the hall."""
        known, cells = messages(), np.zeros((80, 170), np.int8)
        cells[:3] = cells[-3:] = cells[:, :3] = cells[:, -3:] = 100
        place = vector("Point", self.number(-4.5, 0.1), self.number(-3.5, 0.1))
        origin = known.make("geometry_msgs/msg/Pose", position=place, orientation=quaternion(0.0))
        info = known.make(
            "nav_msgs/msg/MapMetaData", resolution=self.number(0.1, 0.1), width=170, height=80,
            origin=origin,
        )  # fmt: skip
        return known.make(
            "nav_msgs/msg/OccupancyGrid", header=self.header("map"), info=info, data=cells.ravel()
        )

    def draw(self, tick: int) -> None:
        """Let the messages of one period come."""
        rng = self.rng
        if rng.random() < 0.95:
            self.come("/odom", self.odometry())
        if tick % 2 == 0 and "/scan" in self.network.wires:
            self.come("/scan", self.scan())
        if "/obstacles" in self.network.wires and rng.random() < 0.9:
            self.come("/obstacles", self.obstacles(self.network.wires["/obstacles"].kind))
        if tick == 0 or rng.random() < 0.1:
            self.come("/map", self.map())
        if tick == 0 or rng.random() < 0.1:
            self.come("/goal_pose", self.goal())
        if rng.random() < 0.1:
            pose = [self.number(value, 0.2) for value in (0.5, 0.2, 0.1)]
            names_of = one_of(rng, ("map", "odom"), ("base_link", "laser"), ("odom", "base_link"))
            with np.errstate(all="ignore"):
                self.come("/tf", transform(float(EPOCH), *names_of, pose))

    def listen(self) -> tuple[str, str]:
        """Let the node listen; what it caught that is no refusal is a fault."""
        self.network.deliver()
        if self.caught:
            return "caught", self.caught.pop()
        return "", ""

    def decide(self) -> tuple[str, str]:
        """Let the node decide, and say what is wrong."""
        failed = self.node.counts.failures
        decided = self.node.plan()
        if self.node.counts.failures > failed:
            return "caught", self.node.status
        plan = self.controller.last_plan if decided else None
        reason = plan.reason if plan is not None else str(getattr(self.controller, "reason", ""))
        found = INSIDE.search(f"{reason}; {self.node.status}")
        return ("caught", reason[max(found.start() - 40, 0) :]) if found else ("", "")

    def speak(self) -> tuple[str, str]:
        """Let the node send a command and show its plan, and say what is wrong with them."""
        self.node.publish_plan()
        self.node.publish_diagnostics()
        wire = self.network.wires["/cmd_vel"]
        if not self.node.publish() or not wire.gone:
            return "", ""
        twist = wire.gone[0].twist
        sent = Command((twist.linear.x, twist.linear.y), twist.angular.z)
        wrong = broken_limit(self.robot, sent)
        return (("nan" if "finite" in wrong else "contract"), wrong) if wrong else ("", "")


def node_case(index: int, seed: int) -> Iterator[Call]:
    """Let a node live for `TICKS` periods."""
    driven = Driven(index, seed)
    limit = DEADLINE if nodes()[index][1].get("deadline") else SECONDS
    for tick in range(TICKS):
        driven.draw(tick)
        yield timed(f"{driven.what}: listen", driven.listen, DEADLINE)
        yield timed(driven.what, driven.decide, limit)
        yield timed(f"{driven.what}: speak", driven.speak, DEADLINE)
        driven.now += STEP if driven.rng.random() < 0.95 else float(one_of(driven.rng, 0.0, 1.0))


def cases(kind: str, index: int, seed: int) -> Iterator[Call]:
    """Return the calls of one case."""
    return node_case(index, seed) if kind == "node" else detector_case(index, seed)
