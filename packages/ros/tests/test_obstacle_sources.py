"""A node that sees by scans of a LiDAR, and finds its way to a goal by itself."""

import pathlib
import warnings
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth import Path, WideberthError
from wideberth.controllers import Planner
from wideberth.framework.route_planner import Route
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan
from wideberth.packages.ros.tests.test_node import EPOCH, ROBOT, Loop, Scripted
from wideberth.routes import NavFn
from wideberth.routes.inflation import Inflation
from wideberth.routes.polygons import convex_polygons
from wideberth.routes.replanning import Replanning
from wideberth.simulation.sensing.perceived import Sightings
from wideberth.tests.helpers import hall as the_hall
from wideberth.tests.helpers.bags import header, obstacles, odometry, quaternion, transform, vector
from wideberth.tests.helpers.network import Network
from wideberth.tests.helpers.rays import ranges
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.detection.over_time import OverTime
from wideberth_perception.detector import Detector
from wideberth_ros import path_sources
from wideberth_ros.cli.ros_node import read_node
from wideberth_ros.decoding import decode_message
from wideberth_ros.messages import messages
from wideberth_ros.node import PlannerNode
from wideberth_ros.obstacle_sources import ScanTopic
from wideberth_ros.own_motion import AHEAD, OwnMotion
from wideberth_ros.path_sources import GoalTopic, KnownMap, MapPlanner, MapTopic, cropped

EXAMPLE = pathlib.Path(__file__).parents[3] / "examples" / "node_scans.yaml"
ODOMETRY, SCAN = "nav_msgs/msg/Odometry", "sensor_msgs/msg/LaserScan"
MOUNT = (0.2, -0.1, 0.3)
"""m and rad, of the LiDAR on the robot."""
BEAMS = 360
TURN_TIME = 0.1
"""s, of a turn of the LiDAR."""
outlines = partial(convex_polygons, tolerance=0.0)


def arc(time: Any, speed: float, rate: float) -> Any:
    """Pose (..., 3) after a time on a circle that begins at the origin along x."""
    time = np.asarray(time, dtype=float)
    if rate == 0.0:
        return np.stack([speed * time, 0.0 * time, 0.0 * time], axis=-1)
    turn = rate * time
    return np.stack(
        [speed / rate * np.sin(turn), speed / rate * (1.0 - np.cos(turn)), turn], axis=-1
    )


@pytest.mark.parametrize(("speed", "rate"), [(0.7, 0.0), (0.7, 1.0), (0.0, -2.0)])
def test_poses_are_those_of_their_instants(speed: float, rate: float) -> None:
    own = OwnMotion("base_link")
    for k in range(51):
        time = 0.02 * k
        said = odometry(EPOCH + time, arc(time, speed, rate), (speed, 0.0, rate))
        own.take(decode_message(ODOMETRY, said), 7.0 + time)
    assert own.now == pytest.approx(1.0, abs=1e-9)
    asked = np.linspace(0.0, 1.0 + AHEAD, 500)
    chord = speed * abs(rate) * 0.02**2 / 8  # between two samples
    ahead = speed * rate**2 * AHEAD**3 / 24  # a chord of half the turn for the arc
    found = own.poses(asked)
    np.testing.assert_allclose(found, arc(asked, speed, rate), atol=chord + ahead + 1e-7)
    assert np.isnan(own.poses(np.array([-0.01, 1.01 + AHEAD]))).all()


def test_poses_across_a_hole_or_a_jump_are_unknown() -> None:
    own = OwnMotion("base_link")
    assert np.isnan(own.poses(np.zeros(2))).all()
    for time in (0.0, 0.1, 0.8, 0.9):
        own.take(decode_message(ODOMETRY, odometry(EPOCH + time, (time, 0, 0), (1, 0, 0))), time)
    found = own.poses(np.array([0.05, 0.5, 0.85]))[:, 0]
    np.testing.assert_allclose(found, [0.05, np.nan, 0.85], atol=1e-6)
    own.take(decode_message(ODOMETRY, odometry(EPOCH - 50.0, (1, 0, 0), (1, 0, 0))), 1.0)
    np.testing.assert_allclose(own.poses(np.array([-50.0, 0.85]))[:, 0], [1.0, np.nan])


def test_the_pose_of_the_newest_odometry_is_known_after_a_hole() -> None:
    own = OwnMotion("base_link")
    for time in (0.0, 0.7):
        own.take(decode_message(ODOMETRY, odometry(EPOCH + time, (time, 0, 0), (1, 0, 0))), time)
    found = own.poses(np.array([own.now - 0.1, own.now, own.now + 0.1]))[:, 0]
    np.testing.assert_allclose(found, [np.nan, 0.7, 0.8], atol=1e-6)


class Seeing(Loop):
    """A loop among discs that walk, seen by a LiDAR; the robot drives on a circle."""

    def __init__(self, **settings: Any) -> None:
        settings.setdefault("sees", ScanTopic())
        super().__init__(**settings)
        self.begin = self.now
        self.start = np.array([[4.0, 1.5], [3.0, -2.5]])
        self.walk = np.array([[-0.5, 0.2], [0.3, 0.6]])
        self.late = 0.0
        """s, by which the LiDAR's clock is wrong."""
        self.come("/tf_static", transform(EPOCH, "base_link", "laser", MOUNT))

    def people(self, time: float) -> np.ndarray:
        return self.start + (time - self.begin) * self.walk

    def odom(self) -> None:
        pose = arc(self.now - self.begin, 0.4, 0.2)
        self.come("/odom", odometry(self.stamp(), pose, (0.4, 0.0, 0.2), child="base_link"))

    def scan(self, frame: str = "laser") -> None:
        """Send a turn that ends now: every beam from where the LiDAR was at its instant."""
        times = self.now - TURN_TIME + TURN_TIME / BEAMS * np.arange(1, BEAMS + 1)
        bearings = -np.pi + 2.0 * np.pi / BEAMS * np.arange(BEAMS)
        found = []
        for time, bearing in zip(times, bearings, strict=True):
            x, y, yaw = arc(time - self.begin, 0.4, 0.2)
            sine, cosine = np.sin(yaw), np.cos(yaw)
            origin = np.array([x + cosine * MOUNT[0] - sine * MOUNT[1],
                               y + sine * MOUNT[0] + cosine * MOUNT[1]])  # fmt: skip
            ray = np.array([yaw + MOUNT[2] + bearing])
            found.append(ranges(origin, ray, self.people(time), 0.3)[0])
        message = messages().make(
            SCAN, header=header(self.stamp() + self.late - self.now + float(times[0]), frame),
            angle_min=float(bearings[0]), angle_max=float(bearings[-1]),
            angle_increment=2.0 * np.pi / BEAMS, time_increment=TURN_TIME / BEAMS,
            range_max=12.0, ranges=np.asarray(found, np.float32),
        )  # fmt: skip
        self.come("/scan", message)

    def go_on(self, seconds: float, frame: str = "laser") -> None:
        """Odometry at 20 Hz, scans at 10 Hz."""
        for k in range(round(seconds / 0.05)):
            self.odom()
            if k % 2:
                self.scan(frame)
            self.turn(odom=False, people=False)


def check_people(loop: Seeing) -> None:
    """Check that the newest observation holds the two, where and as fast as they are."""
    seen = loop.controller.seen[-1].detections
    assert len(seen) == 2
    now = loop.now - 0.05  # of the last odometry
    truth = loop.people(now)
    for one in seen:
        who = int(np.argmin(np.linalg.norm(truth - one.position, axis=1)))
        np.testing.assert_allclose(one.position, truth[who], atol=0.05)
        assert one.velocity is not None
        np.testing.assert_allclose(one.velocity, loop.walk[who], atol=0.15)
        assert one.radius == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize("late", [0.0, 1e6])
def test_people_are_seen_in_scans(late: float) -> None:
    """Also where the LiDAR has a clock of its own: then it counts when scans come."""
    loop = Seeing(sees=ScanTopic(own_clock=late > 0.0))
    loop.late = late
    loop.turn(odom=False, people=False)
    assert loop.node.status == "waiting for odometry"
    loop.odom()
    loop.turn(odom=False, people=False)
    assert loop.node.status == "waiting for scans"
    loop.path()
    loop.go_on(3.0)
    assert loop.node.status == "driving" and loop.node.counts.refused == 0
    check_people(loop)
    names = {one.ident for seen in loop.controller.seen[-20:] for one in seen.detections}
    assert len(names) == 2  # nobody has changed identity
    assert loop.controller.seen[-1].scan is not None
    scan = loop.controller.seen[-1].scan
    assert scan is not None and scan.scan.mount.tolist() == list(MOUNT)


def test_measurements_are_handed_on_where_that_is_asked_for() -> None:
    loop = Seeing(sees=ScanTopic(handover="measured"))
    loop.path()
    loop.go_on(1.5)
    seen = [one for told in loop.controller.told for one in told.detections]
    assert seen and all(one.velocity is None for one in seen)


def test_a_clock_that_jumps_costs_the_tracks_alone() -> None:
    loop = Seeing()
    loop.path()
    loop.go_on(1.0)
    for shift in (1e5, -3e4):
        loop.shift = shift
        loop.go_on(1.5)
        assert loop.node.status == "driving"
        check_people(loop)


@pytest.mark.parametrize("driven", [0.0, 1.0])
@pytest.mark.parametrize(
    ("frame", "late", "reason"),
    [
        ("moon", 0.0, "no motion connects the scan's frame 'moon' with the robot"),
        ("laser", 0.5, "a scan is of a time at which the robot's own pose is not known"),
        ("laser", 0.9, "a scan is of a time at which the robot's own pose is not known"),
    ],
)
def test_it_brakes_where_scans_cannot_be_placed(
    driven: float, frame: str, late: float, reason: str
) -> None:
    """From the beginning, and after scans that could be placed; with good ones it goes on."""
    loop = Seeing()
    loop.path()
    loop.go_on(driven)
    before = loop.node.counts.refused
    loop.late = late
    loop.go_on(1.8, frame)
    assert loop.node.counts.refused == before + 18
    assert loop.node.status == f"scans cannot be placed: {reason}"
    assert loop.motion[0] == 0.0
    loop.late = 0.0
    loop.go_on(1.0)
    assert loop.node.status == "driving" and loop.motion[0] > 0.4
    check_people(loop)


def test_a_few_scans_that_cannot_be_placed_do_not_stop_it() -> None:
    loop = Seeing()
    loop.path()
    loop.go_on(1.0)
    before = loop.node.counts.refused
    loop.go_on(0.3, "moon")
    assert loop.node.status == "driving" and loop.node.counts.refused == before + 3


def test_it_does_not_drive_by_scans_without_beams() -> None:
    loop = Seeing()
    loop.path()
    for _ in range(20):
        loop.odom()
        loop.come("/scan", messages().make(SCAN, header=header(loop.stamp(), "laser"),
                                           range_max=9.0))  # fmt: skip
        loop.turn(odom=False, people=False)
    assert loop.node.status == "scans cannot be placed: a scan has no beams"
    assert not loop.motion.any()


def test_it_brakes_when_scans_fall_silent() -> None:
    loop = Seeing()
    loop.path()
    loop.go_on(1.0)
    for _ in range(40):
        loop.odom()
        sent = loop.turn(odom=False, people=False)
    assert sent[0] == 0.0 and loop.node.status.startswith("scans are silent for")


def test_a_scan_that_is_too_long_is_refused() -> None:
    loop = Seeing()
    loop.odom()
    long = messages().make(SCAN, ranges=np.ones(60_000, np.float32), range_max=9.0)
    loop.come("/scan", long)
    loop.turn(odom=False, people=False)
    assert loop.node.counts.refused == 1


def test_scans_goals_and_maps_full_of_nonsense_do_not_stop_it() -> None:
    rng = np.random.default_rng(3)
    known = messages()
    loop = Seeing(follows=over(MapTopic()))
    loop.come("/tf", transform(EPOCH, "map", "odom", (2.0, 1.0, 0.0)))
    loop.come("/map", map_message())
    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    loop.go_on(0.3)
    nasty = [np.nan, np.inf, -np.inf, 1e300, -1e-300, 0.0]
    ring = messages().make(
        SCAN, header=header(loop.stamp(), "laser"), angle_min=-3.0, angle_max=3.0,
        angle_increment=0.1, time_increment=1e-3, range_max=9.0, ranges=np.ones(60, np.float32),
    )  # fmt: skip
    wires = {"/scan": ring, "/goal_pose": goal(6.5, 1.0, "map"), "/map": map_message()}
    for k in range(300):
        topic = list(wires)[k % 3]
        data = bytearray(known.to_bytes(wires[topic]))
        for _ in range(int(rng.integers(1, 4))):
            place, size = int(rng.integers(4, 80)), int(rng.choice([4, 8]))
            kind = np.float32 if size == 4 else np.float64
            with np.errstate(over="ignore"):
                data[place : place + size] = kind(rng.choice(nasty)).tobytes()
        try:
            loop.come(topic, known.read(wires[topic].__msgtype__, bytes(data)))
        except WideberthError:
            continue
        loop.turn(odom=False, people=False)
        assert loop.node.counts.failures == 0
    loop.come("/map", map_message())
    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    loop.go_on(1.5)  # whatever was said, the right thing is done again
    assert loop.node.status == "driving"
    check_people(loop)


def goal(x: float, y: float, frame: str = "odom") -> Any:
    known = messages()
    pose = known.make(
        "geometry_msgs/msg/Pose", position=vector("Point", x, y), orientation=quaternion(0.0)
    )
    return known.make("geometry_msgs/msg/PoseStamped", header=header(EPOCH, frame), pose=pose)


def grid() -> OccupancyGrid:
    """A hall of 8 m by 5 m with a wall that leaves a door at the top."""
    cells = np.zeros((50, 80), np.int8)
    cells[:, :2] = cells[:, -2:] = cells[:2] = cells[-2:] = 100
    cells[:35, 40:43] = 100
    return OccupancyGrid(cells, 0.1)


def map_message(frame: str = "map", made: OccupancyGrid | None = None) -> Any:
    known, made = messages(), grid() if made is None else made
    info = known.make(
        "nav_msgs/msg/MapMetaData", resolution=0.1, width=made.width, height=made.height,
        origin=known.make("geometry_msgs/msg/Pose", orientation=quaternion(0.0)),
    )  # fmt: skip
    data = np.asarray(made.cells, np.int8).ravel()
    return known.make(
        "nav_msgs/msg/OccupancyGrid", header=header(EPOCH, frame), info=info, data=data
    )


def over(where: Any) -> GoalTopic:
    return GoalTopic(over=MapPlanner(where, Replanning(NavFn())))


def stands(loop: Loop, x: float = 0.0, y: float = 0.0) -> Any:
    """One period of a robot that stands at a place."""
    loop.come("/odom", odometry(loop.stamp(), (x, y, 0.0), (0, 0, 0)))
    return loop.turn(odom=False, people="/obstacles" in loop.network.wires)


def test_without_a_map_the_way_to_a_goal_is_straight() -> None:
    loop = Loop(follows=GoalTopic())
    stands(loop, 1.0, 2.0)
    assert loop.node.status == "waiting for a goal"
    loop.come("/goal_pose", goal(4.0, -2.0))
    for x in (1.0, 1.1, 1.2):
        stands(loop, x, 2.0)
    (path,) = loop.controller.paths  # the way stays while the robot drives
    np.testing.assert_array_equal(path.points, [(1.0, 2.0), (4.0, -2.0)])
    loop.come("/tf", transform(EPOCH, "map", "odom", (1.0, 0.0, np.pi / 2)))
    loop.come("/goal_pose", goal(1.0, 4.0, "map"))
    stands(loop)
    np.testing.assert_allclose(loop.controller.paths[-1].points, [(0, 0), (4, 0)], atol=1e-9)
    loop.come("/goal_pose", goal(1.0, 4.0, "moon"))
    stands(loop)
    assert "no motion connects the goal's frame 'moon'" in loop.node.status
    loop.come("/goal_pose", goal(0.2, 0.0))  # where it stands already
    stands(loop)
    assert loop.node.status == "waiting for a goal"


@pytest.mark.parametrize("over_map", [False, True])
def test_at_the_goal_it_brakes(over_map: bool) -> None:
    loop = Loop(follows=over(KnownMap(grid(), "odom")) if over_map else GoalTopic())
    loop.come("/goal_pose", goal(3.0, 1.0))
    sent = [stands(loop, 2.0, 1.0) for _ in range(20)]
    assert sent[-1][0] > 0.0 and loop.node.status == "driving"
    sent = [stands(loop, 2.8, 1.0) for _ in range(40)]
    assert sent[-1][0] == 0.0 and loop.node.status == "waiting for a goal"
    loop.come("/goal_pose", goal(2.0, 1.0))
    sent = [stands(loop, 2.8, 1.0) for _ in range(20)]
    assert sent[-1][0] > 0.0


@pytest.mark.parametrize("over_map", [False, True])
def test_a_gap_in_odometry_does_not_lose_the_goal(over_map: bool) -> None:
    """Over the map the goal is so near that the route is not planned anew."""
    loop = Loop(follows=over(KnownMap(grid(), "odom")) if over_map else GoalTopic())
    loop.come("/goal_pose", goal(3.0, 1.0))
    for _ in range(20):
        stands(loop, 1.0, 1.0)
    loop.now += 0.6
    loop.come("/obstacles", obstacles(loop.stamp(), [(5.0, 1.0)], "odom"))
    stands(loop, 1.0, 1.0)
    assert loop.node.status == "driving" and loop.node.path is not None


@pytest.mark.parametrize("over_map", [False, True])
def test_a_passing_reason_does_not_lose_the_goal(over_map: bool) -> None:
    loop = Loop(follows=over(KnownMap(grid(), "odom")) if over_map else GoalTopic())
    loop.come("/goal_pose", goal(3.0, 1.0))
    for _ in range(20):
        stands(loop, 1.0, 1.0)
    for _ in range(40):
        sent = stands(loop, 3e9, 1.0)  # odometry has gone astray
    assert sent[0] == 0.0 and "more than 1e+09 m away" in loop.node.status
    for _ in range(20):
        sent = stands(loop, 1.0, 1.0)
    assert sent[0] > 0.0 and loop.node.status == "driving"
    np.testing.assert_allclose(loop.controller.paths[-1].points[-1], (3.0, 1.0), atol=0.11)


@pytest.mark.parametrize("where", [MapTopic(), KnownMap(grid())])
def test_over_a_map_the_way_leads_through_the_door(where: Any) -> None:
    loop = Loop(follows=over(where))
    shift = (2.0, 1.0, 0.3)  # pose of the odometry's frame in the map
    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    stands(loop)
    if isinstance(where, MapTopic):
        assert loop.node.status == "waiting for a map"
        loop.come("/map", map_message())
        stands(loop)
    assert "no motion connects 'odom' with the map's frame 'map'" in loop.node.status
    loop.come("/tf", transform(EPOCH, "map", "odom", shift))
    stands(loop)
    assert loop.node.status == "driving"

    def on_map(points: np.ndarray, x: float, y: float, yaw: float) -> np.ndarray:
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.asarray((x, y) + points @ turn.T)

    points = on_map(loop.controller.paths[-1].points, *shift)
    np.testing.assert_allclose(points[[0, -1]], [(2.0, 1.0), (6.5, 1.0)], atol=0.11)
    costs = Inflation(ROBOT.radius * np.cos(np.pi / 16)).inflated(Costmap.from_grid(grid()))
    assert not costs.blocked_steps(points).any()
    assert points[:, 1].max() > 3.5  # the door
    before = len(loop.controller.paths)
    stands(loop)
    assert len(loop.controller.paths) == before
    moved = (2.1, 1.05, 0.3)  # it was localised anew
    loop.come("/tf", transform(EPOCH, "map", "odom", moved))
    stands(loop)
    assert len(loop.controller.paths) == before + 1
    np.testing.assert_allclose(
        on_map(loop.controller.paths[-1].points, *moved)[-1], points[-1], atol=1e-9
    )


def test_without_a_route_it_stands_and_says_why() -> None:
    loop = Loop(follows=over(KnownMap(grid(), "odom")))
    loop.come("/goal_pose", goal(6.5, 1.0))
    sent = [stands(loop, 2.0, 1.0) for _ in range(20)]
    assert sent[-1][0] > 0.0
    loop.come("/goal_pose", goal(60.0, 1.0))
    sent = [stands(loop, 2.0, 1.0) for _ in range(40)]
    assert sent[-1][0] == 0.0 and loop.node.status.startswith("there is no route: ")
    loop.come("/goal_pose", goal(6.5, 1.0))
    stands(loop, 2.0, 1.0)
    assert loop.node.status == "driving"


class Hall:
    """The shipped example in the hall of the other process' robot, in simulated time."""

    def __init__(self) -> None:
        planner, settings = read_node(EXAMPLE, [])
        self.now, self.pose, self.twist = 5.0, np.zeros(3), np.zeros(3)
        self.network = Network()
        assert isinstance(planner, Planner)
        self.node = PlannerNode(planner, planner.robot, settings, self.network, lambda: self.now)
        self.nearest = np.inf
        self.come("/tf_static", transform(EPOCH, "map", "odom", (*the_hall.START, 0.0)))
        self.come("/tf_static", transform(EPOCH, "base_link", "laser", (the_hall.MOUNT, 0, 0)))
        cells = np.zeros((50, 120), np.int8)
        cells[:, [0, -1]] = cells[[0, -1]] = 100
        cells[:26, 50] = 100
        self.come("/map", map_message(made=OccupancyGrid(cells, 0.1)))
        self.come("/goal_pose", goal(*the_hall.GOAL, "map"))

    def come(self, topic: str, message: Any) -> None:
        self.network.wires[topic].come.append(message)

    @property
    def place(self) -> np.ndarray:
        return np.asarray(self.pose[:2] + the_hall.START)

    def scan(self, time: float) -> None:
        step = 2.0 * np.pi / the_hall.BEAMS
        turn = -np.pi + step * np.arange(the_hall.BEAMS)
        yaw = self.pose[2]
        origin = self.place + the_hall.MOUNT * np.array([np.cos(yaw), np.sin(yaw)])
        walkers, walls = the_hall.walkers(time), the_hall.walls()
        found = ranges(origin, yaw + turn, walkers, the_hall.WIDE, walls)
        found += 0.01 * np.random.default_rng(round(100 * time)).standard_normal(len(found))
        message = messages().make(
            SCAN, header=header(EPOCH + self.now, "laser"), angle_min=-np.pi,
            angle_max=float(turn[-1]), angle_increment=step, range_max=the_hall.LONGEST,
            ranges=np.asarray(found, np.float32),
        )  # fmt: skip
        self.come("/scan", message)

    def show(self, time: float) -> None:
        """Send odometry, and note how near the walkers are."""
        away = np.linalg.norm(the_hall.walkers(time) - self.place, axis=1).min()
        self.nearest = min(self.nearest, float(away) - 2 * the_hall.WIDE)
        self.come("/odom", odometry(EPOCH + self.now, self.pose, self.twist, child="base_link"))

    def move(self, k: int) -> None:
        """Drive for 0.02 s, with a new command each second time."""
        if k % 2 == 0 and self.node.publish():
            sent = self.network.wires["/cmd_vel"].gone[-1].twist
            self.twist = np.array([sent.linear.x, 0.0, sent.angular.z])
        middle = self.pose[2] + 0.01 * self.twist[2]
        along = np.array([np.cos(middle), np.sin(middle), 0.0])
        self.pose = self.pose + 0.02 * (self.twist[0] * along + [0.0, 0.0, self.twist[2]])
        self.now += 0.02

    def drive(self, seconds: float) -> None:
        """Odometry at 50 Hz, scans at 10 Hz, commands at 25 Hz, plans at 5 Hz."""
        begin = self.now
        for k in range(round(seconds / 0.02)):
            time = self.now - begin
            self.show(time)
            if k % 5 == 0:
                self.scan(time)
            self.network.deliver()
            if k % 10 == 0:
                self.node.plan()
            self.move(k)
            if self.node.status == "waiting for a goal" and not self.twist.any():
                break


@pytest.mark.parametrize("seconds", [2.0, pytest.param(40.0, marks=pytest.mark.slow)])
def test_the_shipped_example_drives_through_a_hall(seconds: float) -> None:
    hall = Hall()
    hall.drive(seconds)
    assert hall.nearest > 0.3 and hall.node.counts.failures == 0
    assert np.linalg.norm(hall.pose[:2]) > 0.05
    if seconds > 30.0:
        assert np.linalg.norm(hall.place - the_hall.GOAL) < 0.5
        assert hall.node.status == "waiting for a goal"


def corner_cells(polygons: Any, resolution: float = 0.1) -> float:
    """Return the area of all polygons, in cells."""
    return sum(shapely.Polygon(one.points).area for one in polygons) / resolution**2


@dataclass(kw_only=True)
class Walled(Scripted):
    """A controller that keeps clear of polygons where it has a region for them."""

    static_region: Any = "any"


def test_walls_of_a_map_are_told_in_the_frame_of_odometry() -> None:
    shift = (2.0, 1.0, 0.3)
    known = KnownMap(grid())
    follows = GoalTopic(over=MapPlanner(known, Replanning(NavFn()), outlines=outlines))
    loop = Loop(Walled(), follows=follows, sees=None)
    loop.come("/tf", transform(EPOCH, "map", "odom", shift))
    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    stands(loop)
    polygons = loop.controller.seen[-1].polygons
    together = shapely.union_all([shapely.Polygon(one.points) for one in polygons])
    cosine, sine = np.cos(shift[2]), np.sin(shift[2])
    rows, columns = np.nonzero(grid().cells)
    centres = grid().map_to_world(np.column_stack([columns, rows])) - shift[:2]
    centres = centres @ np.array([[cosine, -sine], [sine, cosine]])
    assert shapely.covers(together, shapely.points(centres)).all()
    assert corner_cells(polygons) == pytest.approx(len(rows), rel=0.02)


def test_walls_stay_the_same_until_the_map_has_moved(monkeypatch: Any) -> None:
    """They are made while commands go on, and not in each decision."""
    known = KnownMap(grid())
    follows = GoalTopic(over=MapPlanner(known, Replanning(NavFn()), outlines=outlines))
    loop = Loop(Walled(), follows=follows, sees=None)
    made, free = path_sources._moved, []

    def noting(*given: Any) -> Any:
        def take() -> None:
            free.append(loop.node._lock.acquire(blocking=False))
            if free[-1]:
                loop.node._lock.release()

        one = Thread(target=take)
        one.start()
        one.join()
        return made(*given)

    monkeypatch.setattr(path_sources, "_moved", noting)

    def seen(x: float, y: float, turn: float) -> Any:
        loop.come("/tf", transform(EPOCH, "map", "odom", (x, y, turn)))
        stands(loop, 2.0, 1.0)
        return loop.controller.seen[-1].polygons

    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    first = seen(0.0, 0.0, 0.0)
    assert first and len(free) == len(first) and all(free)
    for motion in ((0.019, 0.0, 0.0), (0.0, -0.019, 0.004), (0.0, 0.0, 2.0 * np.pi - 0.001)):
        assert all(one is other for one, other in zip(first, seen(*motion), strict=True))
    moved = seen(0.021, 0.0, 0.0)
    for one, other in zip(first, moved, strict=True):
        np.testing.assert_allclose(other.points, one.points - [0.021, 0.0], atol=1e-12)
    turned = seen(0.021, 0.0, 0.006)
    assert len(free) == 3 * len(first) and all(free)
    back = np.array([[np.cos(0.006), -np.sin(0.006)], [np.sin(0.006), np.cos(0.006)]])
    for one, other in zip(moved, turned, strict=True):
        np.testing.assert_allclose(other.points, one.points @ back, atol=1e-12)


@pytest.mark.parametrize("case", ["scans", "no region", "no outlines"])
def test_walls_are_not_told_twice_nor_to_who_has_no_use_for_them(case: str) -> None:
    outlined = None if case == "no outlines" else outlines
    over_it = MapPlanner(KnownMap(grid(), "odom"), Replanning(NavFn()), outlines=outlined)
    controller = Walled(static_region=None if case == "no region" else "any")
    sees = ScanTopic() if case == "scans" else None
    loop = Loop(controller, follows=GoalTopic(over=over_it), sees=sees)
    loop.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.0, 0.0, 0.0)))
    loop.come("/goal_pose", goal(6.5, 1.0))
    if case == "scans":
        stands(loop, 2.0, 1.0)
        loop.come("/scan", messages().make(
            SCAN, header=header(loop.stamp(), "laser"), angle_max=1.0, angle_increment=0.01,
            range_max=12.0, ranges=np.full(101, np.inf, np.float32),
        ))  # fmt: skip
    stands(loop, 2.0, 1.0)
    assert loop.node.status == "driving" and loop.controller.seen[-1].polygons == ()


def test_walls_are_outlined_near_the_robot_and_again_where_it_has_moved() -> None:
    asked: list[OccupancyGrid] = []

    def noting(found: OccupancyGrid) -> Any:
        asked.append(found)
        return outlines(found)

    cells = np.zeros((30, 600), np.int8)
    cells[0] = cells[-1] = 100
    corridor = OccupancyGrid(cells, 0.1, (-1.0, -1.5))
    follows = GoalTopic(over=MapPlanner(MapTopic(), Replanning(NavFn()), outlines=noting))
    loop = Loop(Walled(), follows=follows, sees=None)
    loop.come("/map", map_message("odom", corridor))
    loop.come("/goal_pose", goal(50.0, 1.0))
    for x in (1.0, 3.9, 4.1, 9.0):
        stands(loop, x, 1.0)
        places = np.concatenate([one.points for one in loop.controller.seen[-1].polygons])
        assert places[:, 0].min() <= max(x - 7.0, 0.0) + 1e-9 and places[:, 0].max() >= x + 7.0
        assert np.abs(places[:, 0] - x).max() < 13.2
    assert len(asked) == 3  # not where it had moved by less than 3 m
    loop.come("/map", map_message("odom", corridor))
    stands(loop, 9.0, 1.0)
    assert len(asked) == 4


@pytest.mark.parametrize("centre", [(30.0, 1.0), (1.0, -30.0), (-30.0, -30.0)])
def test_off_the_map_there_are_no_walls(centre: Any) -> None:
    assert cropped(grid(), np.array(centre), 10.0) is None
    whole = cropped(grid(), np.array([4.0, 2.5]), 10.0)
    assert whole is not None and (whole.cells == grid().cells).all()
    part = cropped(grid(), np.array([7.04, 4.04]), 1.0)
    assert part is not None
    np.testing.assert_allclose(part.origin, (6.0, 3.0))
    assert (part.cells == grid().cells[30:, 60:]).all()


class Through:
    """Routes that lead straight through everything."""

    def update(self, kept: Any, time: float, costmap: Costmap, position: Any, goal: Any) -> Any:
        if kept is not None:
            return kept
        return SimpleNamespace(route=Route(Path(np.array([position, goal]))))


@pytest.mark.parametrize("told", [True, False])
def test_the_planner_itself_keeps_out_of_the_walls_of_a_map(told: bool) -> None:
    """The route leads through the wall: the robot stops before it, unless it is not told of it."""
    planner, settings = read_node(EXAMPLE, ["node.sees=null"])
    found = outlines if told else None
    over_it = MapPlanner(KnownMap(grid(), "odom"), Through(), outlines=found)
    node_settings = replace(settings, follows=GoalTopic(over=over_it))
    network, now = Network(), 5.0
    assert isinstance(planner, Planner)
    node = PlannerNode(planner, planner.robot, node_settings, network, lambda: now)
    pose, twist = np.array([2.2, 1.0, 0.0]), np.zeros(3)
    network.wires["/goal_pose"].come.append(goal(6.5, 1.0))
    for k in range(180):
        network.wires["/odom"].come.append(odometry(EPOCH + now, pose, twist))
        network.deliver()
        if k % 4 == 0:
            node.plan()
        if node.publish():
            said = network.wires["/cmd_vel"].gone[-1].twist
            twist = np.array([said.linear.x, 0.0, said.angular.z])
        yaw = pose[2] + 0.025 * twist[2]
        pose = pose + 0.05 * np.array(
            [*(twist[0] * np.array([np.cos(yaw), np.sin(yaw)])), twist[2]]
        )
        now += 0.05
        inside = abs(pose[0] - 4.15) < 0.15 + 0.28 and pose[1] < 3.5
        if inside:
            break
    assert inside != told and pose[0] > 2.8


ABSURD = (2e9, 1e154, -1e300, 1.7e308)


@pytest.mark.parametrize("value", ABSURD)
@pytest.mark.parametrize("axis", [0, 1])
def test_no_pose_is_taken_of_absurd_odometry(axis: int, value: float) -> None:
    own = OwnMotion("base_link")
    own.take(decode_message(ODOMETRY, odometry(EPOCH, (1, 2, 0), (1, 0, 0))), 0.0)
    pose, twist = np.array([1.0, 2.0, 0.0]), np.array([1.0, 0.0, 0.0])
    for changed in (pose, twist):
        changed[axis] = value
        own.take(decode_message(ODOMETRY, odometry(EPOCH + 0.1, pose, twist)), 0.1)
    known = own.poses(np.array([0.0, 0.1, 0.1 + AHEAD]))
    np.testing.assert_allclose(known[:2], [[1.0, 2.0, 0.0], [1.1, 2.0, 0.0]], atol=1e-9)
    assert np.isnan(known[2]).all() and own.newest is not None


@pytest.mark.parametrize("value", [9e8, *ABSURD])
@pytest.mark.parametrize("what", ["/odom", "/tf", "/scan"])
def test_absurd_poses_do_not_end_a_decision(what: str, value: float) -> None:
    """They reached the sightings and the walls, which refused them while the node decided."""
    loop = Seeing(sees=ScanTopic(detector=OverTime()))
    loop.node._obstacles._walls = True  # type: ignore[union-attr]
    loop.path()
    loop.go_on(0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(3):
            if what == "/odom":
                message = odometry(loop.stamp(), (value, value, 0.0), (0, 0, 0))
            elif what == "/tf":
                message = transform(loop.stamp(), "base_link", "laser", (value, 0.0, 0.0))
            else:
                message = messages().make(
                    SCAN, header=header(loop.stamp(), "laser"), angle_increment=0.01,
                    range_max=3e38, ranges=np.full(BEAMS, min(abs(value), 3e38), np.float32),
                )  # fmt: skip
            if what != "/odom":
                loop.odom()
            loop.come(what, message)
            if what != "/scan":
                loop.scan()
            loop.turn(odom=False, people=False)
    assert loop.node.counts.failures == 0
    loop.come("/tf_static", transform(EPOCH, "base_link", "laser", MOUNT))
    loop.go_on(2.0)
    assert loop.node.status == "driving"


@pytest.mark.parametrize("share", [1.0, 3e38])
def test_a_turn_that_takes_for_ever_is_left_out(share: float) -> None:
    loop = Seeing()
    loop.path()
    loop.go_on(0.5)
    before = loop.node.counts.refused
    loop.odom()
    loop.come("/scan", messages().make(
        SCAN, header=header(loop.stamp() - 0.05, "laser"), angle_increment=0.1,
        time_increment=share, range_max=9.0, ranges=np.ones(60, np.float32),
    ))  # fmt: skip
    loop.turn(odom=False, people=False)
    assert loop.node.counts.refused > before and loop.node.counts.failures == 0
    loop.go_on(1.0)
    check_people(loop)


@dataclass(eq=False)
class Counting(Detector):
    """Counts its calls in all of its copies."""

    looks: list[int] = field(default_factory=list)

    def __deepcopy__(self, memo: Any) -> "Counting":
        return self

    def reset(self) -> None:
        self.looks.append(0)

    def detect(self, scan: Scan, poses: np.ndarray) -> Sightings:
        self.looks.append(1)
        return DiscDetector().detect(scan, poses)


def test_those_who_see_and_find_the_way_warm_up_before_the_first_period() -> None:
    """What they import and compile took the first decision a second of processor time."""
    detector = Counting()
    asked: list[Costmap] = []

    class Asked:
        def update(self, kept: Any, time: float, costmap: Costmap, *ends: Any) -> Any:
            asked.append(costmap)
            return Replanning(NavFn()).update(kept, time, costmap, *ends)

    follows = GoalTopic(over=MapPlanner(MapTopic(), Asked()))
    loop = Seeing(sees=ScanTopic(detector=detector), follows=follows)
    loop.node.warm_up()
    assert sum(detector.looks) == 3 and len(asked) == 1
    loop.come("/tf", transform(EPOCH, "map", "odom", (0.5, 2.0, 0.0)))
    loop.come("/map", map_message())
    loop.come("/goal_pose", goal(6.5, 1.0, "map"))
    loop.go_on(1.0)  # nothing is left of it
    assert loop.node.status == "driving"
    check_people(loop)
