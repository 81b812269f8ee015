"""Messages of a simulated robot, read back as a planner reads them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from wideberth.framework.values.motion import Detection
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan
from wideberth_ros import simulated_robot
from wideberth_ros.decoding import (
    Goal,
    ObstaclesMessage,
    OdometryMessage,
    PathMessage,
    Transforms,
    decode_message,
)
from wideberth_ros.messages import messages
from wideberth_ros.simulated_robot import Restart, SimulatedRobot

pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
KNOWN = messages("jazzy")
STAMPED, PLAIN = "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist"


class Sent:
    """A publisher that keeps what is sent."""

    has_subscribers = True

    def __init__(self) -> None:
        self.all: list[Any] = []

    def send(self, message: Any) -> None:
        self.all.append(message)


class Link:
    """Publishers and subscribers in memory."""

    made: "list[Link]"

    def __init__(self, node: Any) -> None:
        self.known, self.sent = KNOWN, dict[str, Sent]()
        self.takes: dict[str, Callable[[Any], None]] = {}
        Link.made.append(self)

    def publisher(self, topic: str, kind: str, *, kept: bool = False) -> Sent:
        assert kind in KNOWN
        return self.sent.setdefault(topic, Sent())

    def subscriber(self, topic: str, kind: str, take: Any, *, reliable: bool = False) -> None:
        self.takes[kind] = take

    def close(self) -> None:
        self.takes.clear()


class Node:
    """What is asked of a node of rclpy, and who sends velocities."""

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.services: dict[str, Callable[[Any, Any], Any]] = {}

    def resolve_topic_name(self, topic: str) -> str:
        return topic

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [type("Info", (), {"topic_type": kind}) for kind in self.kinds]

    def create_service(self, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        self.services[name] = answer


class Process:
    """Lets no time pass; ``then`` happens whenever it is waited."""

    def __init__(self) -> None:
        self.then: Callable[[], None] = lambda: None
        self.goes_on = True

    def spin(self, executor: Any, seconds: float, over: Callable[[], bool]) -> bool:
        self.then()
        return self.goes_on


class Executor:
    """Serves no one."""

    def add_node(self, node: Any) -> None: ...


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> tuple[SimulatedRobot, Node, Process]:
    Link.made = []
    executors = type("Executors", (), {"SingleThreadedExecutor": Executor})
    monkeypatch.setattr(simulated_robot, "RosLink", Link)
    monkeypatch.setattr(simulated_robot, "ros", lambda module: executors)
    monkeypatch.setattr(simulated_robot, "message_class", str)
    monkeypatch.setattr(simulated_robot, "LOOK", -1.0)
    node, process = Node(), Process()
    robot = SimulatedRobot(node, process)  # type: ignore[arg-type]
    robot.begin()
    return robot, node, process


def sent(topic: str, kind: str) -> list[Any]:
    """Return what was sent on a topic, decoded."""
    return [decode_message(kind, one) for one in Link.made[0].sent[topic].all]


def velocity(kind: str, forward: float, stamp: int = 0) -> None:
    """Let a velocity come."""
    twist = KNOWN.make(PLAIN, linear=KNOWN.make("geometry_msgs/msg/Vector3", x=forward))
    time = KNOWN.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = KNOWN.make("std_msgs/msg/Header", stamp=time)
    message = twist if kind == PLAIN else KNOWN.make(STAMPED, header=header, twist=twist)
    Link.made[1].takes[kind](message)


def test_the_robot_is_read_as_it_was_shown(network: Any) -> None:
    robot, _, _ = network
    pose, twist = np.array([1.5, -2.0, 0.7]), np.array([0.4, 0.1, -0.3])
    robot.show(0.25, pose, twist)
    (odometry,) = sent("/odom", "nav_msgs/msg/Odometry")
    assert (odometry.stamp, odometry.frame) == (1_250_000_000, "odom")
    assert isinstance(odometry.content, OdometryMessage)
    assert odometry.content.pose == pytest.approx(pose, abs=1e-15)
    assert odometry.content.twist == pytest.approx(twist, abs=1e-15)
    (frames,) = sent("/tf", "tf2_msgs/msg/TFMessage")
    assert isinstance(frames.content, Transforms)
    (clock,) = Link.made[0].sent["/clock"].all
    assert (clock.clock.sec, clock.clock.nanosec) == (1, 250_000_000)


def test_people_have_names_places_and_covariances(network: Any) -> None:
    robot, _, _ = network
    spread = np.array([[0.04, 0.01], [0.01, 0.09]])
    people = [Detection("eve", np.array([1.0, 2.0]), spread, 0.3),
              Detection("adam", np.array([-1.0, 0.5]), None, 0.4)]  # fmt: skip
    robot.show_people(1.0, people, np.array([[0.5, 0.0], [0.0, -1.0]]))
    robot.show_people(1.1, [], np.zeros((0, 2)))
    full, empty = sent("/obstacles", "nav2_dynamic_msgs/msg/ObstacleArray")
    assert isinstance(full.content, ObstaclesMessage) and empty.content.seen == ()
    eve, adam = full.content.seen
    assert (eve.ident, adam.ident, eve.radius) == ("eve", "adam", 0.3)
    assert eve.pose[:2].tolist() == [1.0, 2.0] and eve.velocity.tolist() == [0.5, 0.0]
    assert (eve.covariance == spread).all() and adam.covariance is None


def test_path_and_goal_are_sent_until_a_velocity_comes(network: Any) -> None:
    robot, _, _ = network
    grid = OccupancyGrid(np.array([[0, 100]]), 0.5, (-1.0, 2.0))
    points = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]])
    robot.place(points, grid, np.array([0.1, 0.0, 0.0]))
    robot.wait(0.0)
    robot.wait(0.0)
    goals = sent("/goal_pose", "geometry_msgs/msg/PoseStamped")
    assert len(goals) == 2 and isinstance(goals[0].content, Goal)
    assert goals[0].content.place.tolist() == [3.0, 2.0]
    assert goals[0].content.heading == pytest.approx(np.pi / 2)
    velocity(STAMPED, 0.5, 7)
    robot.wait(0.0)
    assert len(sent("/goal_pose", "geometry_msgs/msg/PoseStamped")) == 2
    path, again = sent("/reference", "nav_msgs/msg/Path")
    assert again.stamp == path.stamp == goals[1].stamp, "who knows them already can see that"
    assert isinstance(path.content, PathMessage) and (path.content.points == points).all()
    (shown,) = sent("/map", "nav_msgs/msg/OccupancyGrid")
    assert isinstance(shown.content, OccupancyGrid)
    assert (shown.content.cells == grid.cells).all() and shown.content.origin == grid.origin
    assert robot.newest is not None and robot.newest.stamp == 7


def test_velocities_are_taken_in_the_kind_that_is_sent(network: Any) -> None:
    robot, node, _ = network
    assert set(Link.made[1].takes) == {STAMPED}
    node.kinds = [PLAIN]
    robot.wait(0.0)
    assert set(Link.made[1].takes) == {PLAIN}
    velocity(PLAIN, 0.3)
    assert robot.newest.command.linear == (0.3, 0.0) and robot.newest.stamp is None
    velocity(PLAIN, float("nan"))
    assert robot.newest.command.linear == (0.3, 0.0)
    node.kinds = [PLAIN, STAMPED]
    robot.wait(0.0)
    assert set(Link.made[1].takes) == {PLAIN}, "it stays while that kind is sent"


def test_time_never_goes_back_and_a_new_episode_forgets_velocities(network: Any) -> None:
    robot, _, _ = network
    robot.show(5.0, np.zeros(3), np.zeros(3))
    robot.hold(0.5)
    before = robot.now
    velocity(STAMPED, 0.5)
    robot.begin()
    assert robot.newest is None and robot.now == before + 10**9


def test_services_answer_and_end_the_wait(network: Any) -> None:
    robot, node, process = network
    robot.outcome = lambda: {"time": np.float64(2.0), "worst": float("inf"), "success": True}
    answer = type("Response", (), {})
    robot._answer_outcome(None, answer)
    assert answer.message == (
        '{"time": 2.0, "worst": null, "success": true, "goal": {"x": 0.0, "y": 0.0, "yaw": 0.0}}'
    )
    process.then = lambda: node.services["~/reset"](None, answer)
    with pytest.raises(Restart):
        robot.wait(0.0)
    process.then, process.goes_on = (lambda: None), False
    robot.begin()
    with pytest.raises(KeyboardInterrupt):
        robot.wait(0.0)


def test_a_scan_is_read_as_it_was_shown(network: Any) -> None:
    robot, _, _ = network
    times = 0.3 + 0.01 * np.arange(4)
    ranges = np.array([1.0, np.inf, np.nan, 2.5])
    robot.show_scan(Scan("lidar", times, np.linspace(-1.0, 0.5, 4), ranges))
    (scan,) = sent("/scan", "sensor_msgs/msg/LaserScan")
    assert scan.frame == "laser" and isinstance(scan.content, Scan)
    np.testing.assert_allclose(scan.content.ranges, ranges)
    np.testing.assert_allclose(scan.content.bearings, np.linspace(-1.0, 0.5, 4), atol=1e-6)
