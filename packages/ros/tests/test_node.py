"""A planner on the network: what it does when others fall silent, lie, or come again."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from wideberth import Command, Observation, Path, WideberthError
from wideberth.framework.controller import Controller
from wideberth.framework.values.errors import WideberthError as Refused
from wideberth.robots import HolonomicVelocity, Unicycle
from wideberth.tests.helpers.bags import header, obstacles, odometry, transform, vector
from wideberth.tests.helpers.network import Network
from wideberth_ros.messages import messages
from wideberth_ros.node import PlannerNode
from wideberth_ros.node_settings import NodeSettings
from wideberth_ros.obstacle_sources import ObstacleTopic, ScanTopic
from wideberth_ros.path_sources import GoalTopic, MapTopic, PathTopic

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

ROBOT = Unicycle(radius=0.3, max_yaw_rate=1.0, max_yaw_acceleration=1.0)
STEP = 0.05
"""s between two commands."""
EPOCH = 1000.0


@dataclass
class Scripted(Controller):
    """A controller that wants one speed and notes what it sees."""

    speed: float = 0.5
    rate: float = 0.0
    period: float = 0.2
    raises: bool = False
    seen: list[Observation] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    told: list[Observation] = field(default_factory=list)
    """What it was to remember."""
    last_plan = None

    def reset(self) -> None: ...

    def set_path(self, path: Path) -> None:
        self.paths.append(path)

    def remember(self, observation: Observation) -> None:
        self.told.append(observation)

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        if self.raises:
            raise RuntimeError("no")
        return Command((self.speed, 0.0), self.rate)


class Loop:
    """A node with a clock of its own, and a robot that does as it is told."""

    def __init__(
        self,
        controller: Scripted | None = None,
        listened: frozenset[str] = Network.listened,
        **settings: Any,
    ) -> None:
        self.now = 5.0
        self.network = Network(listened)
        self.controller = controller or Scripted()
        self.node = self.make(settings)
        self.settings = settings
        self.shift = 0.0
        """s, by which the robot's clock is wrong."""
        self.motion = np.zeros(3)

    def make(self, settings: Any) -> PlannerNode:
        return PlannerNode(
            self.controller, ROBOT, NodeSettings(**settings), self.network, lambda: self.now
        )

    def come(self, topic: str, message: Any) -> None:
        self.network.wires[topic].come.append(message)

    def stamp(self) -> float:
        return EPOCH + self.now + self.shift

    def path(self, frame: str = "odom", points: Any = ((0, 0), (9, 0))) -> None:
        known = messages()
        poses = [
            known.make(
                "geometry_msgs/msg/PoseStamped",
                pose=known.make("geometry_msgs/msg/Pose", position=vector("Point", *place)),
            )
            for place in points
        ]
        stamp = header(self.stamp(), frame)
        self.come("/plan", known.make("nav_msgs/msg/Path", header=stamp, poses=poses))

    def turn(
        self, *, odom: bool = True, people: bool = True, decide: bool = True, quiet: bool = False
    ) -> Any:
        """One period; return what was sent, (m/s, rad/s), or None."""
        if odom:
            self.come("/odom", odometry(self.stamp(), (0, 0, 0), self.motion))
        if people:
            self.come("/obstacles", obstacles(self.stamp(), [(5.0, 1.0)], "odom"))
        self.network.deliver()
        if decide:
            self.node.plan()
        if quiet:
            self.node.publish()
            self.now += STEP
            return None
        gone = self.network.wires["/cmd_vel"].gone
        before = len(gone)
        self.node.publish()
        self.now += STEP
        if len(gone) == before:
            return None
        twist = gone[-1].twist if hasattr(gone[-1], "twist") else gone[-1]
        self.motion = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        return twist.linear.x, twist.angular.z

    def drive(self, count: int, **how: bool) -> np.ndarray:
        return np.array([self.turn(**how) for _ in range(count)], dtype=float)


def within_limits(sent: np.ndarray, first: tuple[float, float] = (0.0, 0.0)) -> None:
    """Check speeds, and the steps between them."""
    assert (np.abs(sent) <= [ROBOT.max_speed + 1e-9, ROBOT.max_yaw_rate + 1e-9]).all()
    step = np.abs(np.diff(np.vstack([first, sent]), axis=0)) / STEP
    assert (step <= [ROBOT.max_acceleration + 1e-6, ROBOT.max_yaw_acceleration + 1e-6]).all()


def test_it_waits_until_it_knows_enough() -> None:
    loop = Loop()
    assert loop.turn(odom=False, people=False) is None
    assert loop.node.status == "waiting for odometry"
    assert loop.turn(people=False) is None and loop.node.status == "waiting for obstacles"
    assert loop.turn() is None and loop.node.status == "waiting for a path"
    loop.path()
    sent = loop.drive(30)
    assert loop.node.status == "driving" and sent[-1, 0] == pytest.approx(0.5)
    within_limits(sent)


def test_commands_never_pass_the_limits_whatever_is_wanted() -> None:
    rng = np.random.default_rng(1)
    loop = Loop()
    loop.path()
    sent = []
    for _ in range(400):
        loop.controller.speed, loop.controller.rate = rng.normal(0.0, 100.0, 2)
        if rng.random() < 0.05:
            loop.controller.speed = np.nan
        sent.append(loop.turn(decide=rng.random() < 0.5))
    found = np.array(sent, dtype=float)
    assert np.isfinite(found).all()
    within_limits(found)


@pytest.mark.parametrize("silent", ["odom", "people", "decide"])
def test_it_brakes_when_somebody_falls_silent_and_goes_on_after(silent: str) -> None:
    loop = Loop()
    loop.path()
    before = loop.drive(40)
    quiet = loop.drive(50, **{silent: False})
    after = loop.drive(40)
    assert before[-1, 0] == pytest.approx(0.5) == after[-1, 0]
    assert quiet[5, 0] == pytest.approx(0.5) and quiet[-1, 0] == 0.0
    within_limits(np.vstack([before, quiet, after]))


def test_an_empty_path_stops_and_a_new_one_starts() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    loop.path(points=())
    assert loop.drive(40)[-1, 0] == 0.0 and loop.node.status == "waiting for a path"
    loop.path(points=((0, 0), (0, 5)))
    assert loop.drive(40)[-1, 0] == pytest.approx(0.5)
    assert [one.points.tolist() for one in loop.controller.paths] == [
        [[0, 0], [9, 0]], [[0, 0], [0, 5]]
    ]  # fmt: skip


def test_the_same_path_again_changes_nothing() -> None:
    loop = Loop()
    for _ in range(5):
        loop.path()
        loop.drive(3)
    assert len(loop.controller.paths) == 1


def test_a_controller_that_raises_brakes_the_robot() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    loop.controller.raises = True
    sent = loop.drive(40)
    assert sent[-1, 0] == 0.0 and "the controller failed: 'no'" in loop.node.status
    assert loop.node.counts.failures == 40


def test_a_path_that_the_controller_did_not_take_is_handed_to_it_again() -> None:
    class Refusing(Scripted):
        def set_path(self, path: Path) -> None:
            super().set_path(path)
            if len(self.paths) in (2, 3):
                raise RuntimeError("not now")

    loop = Loop(Refusing())
    loop.path()
    loop.drive(3)
    loop.path(points=((0, 0), (0, 5)))
    for _ in range(2):
        loop.turn()
        assert loop.node.status == "the controller failed: 'not now'"
    loop.drive(3)
    assert loop.node.status == "driving"
    ends = [one.points[-1].tolist() for one in loop.controller.paths]
    assert ends == [[9, 0], [0, 5], [0, 5], [0, 5]]


def test_a_node_that_starts_again_goes_on_at_the_speed_of_the_robot() -> None:
    loop = Loop()
    loop.path()
    before = loop.drive(40)
    loop.network.wires["/cmd_vel"].gone.clear()
    loop.node = loop.make(loop.settings)
    loop.path()
    after = loop.drive(40)
    within_limits(np.vstack([before, after]))
    assert after[-1, 0] == pytest.approx(0.5)


def test_after_a_pause_it_goes_on_at_the_speed_of_the_robot() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    loop.now += 1.0  # the computer was busy, and the robot braked by itself
    loop.motion = np.array([0.1, 0.0, 0.0])
    within_limits(loop.drive(40), (0.1, 0.0))


def test_a_clock_that_jumps_changes_nothing() -> None:
    loop = Loop()
    loop.path()
    loop.drive(20)
    for shift in (1e6, -1e3, 0.0):
        loop.shift = shift
        sent = loop.drive(20)
        assert sent[-1, 0] == pytest.approx(0.5)
    stamps = [one.stamp for one in loop.controller.seen]
    np.testing.assert_allclose(np.diff(stamps), STEP, atol=1e-9)
    assert max(one.age for seen in loop.controller.seen for one in seen.detections) < 0.01


def test_only_one_clock_of_two_jumps() -> None:
    loop = Loop()
    loop.path()
    loop.drive(3)
    loop.come("/odom", odometry(EPOCH - 500.0, (0, 0, 0), (0, 0, 0)))
    loop.come("/obstacles", obstacles(EPOCH + loop.now, [(5.0, 1.0)], "odom"))
    loop.network.deliver()
    loop.node.plan()
    assert loop.node.status.startswith("obstacles cannot be placed: a message is ")
    assert len(loop.controller.seen) == 3


def test_obstacles_come_into_the_frame_of_odometry() -> None:
    loop = Loop()
    loop.path()
    loop.turn()
    loop.come("/tf", transform(EPOCH, "odom", "base_link", (2.0, 1.0, np.pi / 2)))
    loop.come("/tf_static", transform(EPOCH, "base_link", "lidar", (0.5, 0.0, 0.0)))
    loop.come("/obstacles", obstacles(loop.stamp(), [(1.0, 0.0), (0.0, 1.0)], "lidar"))
    loop.turn(people=False)
    places = [one.position for one in loop.controller.seen[-1].detections]
    np.testing.assert_allclose(sorted(map(tuple, places)), [(1.0, 1.5), (2.0, 2.5)], atol=1e-9)


def test_without_tf_the_odometry_itself_places_what_the_robot_sees() -> None:
    loop = Loop()
    loop.path()
    loop.come("/tf_static", transform(EPOCH, "base_link", "lidar", (0.5, 0.0, 0.0)))
    loop.come("/odom", odometry(loop.stamp(), (2.0, 1.0, np.pi / 2), (0, 0, 0)))
    loop.come("/obstacles", obstacles(loop.stamp(), [(1.0, 0.0)], "lidar"))
    loop.network.deliver()
    loop.node.plan()
    np.testing.assert_allclose(
        loop.controller.seen[-1].detections[0].position, (2.0, 2.5), atol=1e-9
    )


@pytest.mark.parametrize("driven", [0, 20])
def test_it_brakes_where_obstacles_cannot_be_placed(driven: int) -> None:
    loop = Loop()
    loop.path()
    loop.drive(driven)
    for _ in range(40):
        loop.come("/obstacles", obstacles(loop.stamp(), [(5.0, 1.0)], "moon"))
        sent = loop.turn(people=False)
    assert sent is None or sent[0] == 0.0
    reason = "no motion connects 'moon' with odometry"
    assert loop.node.status == f"obstacles cannot be placed: {reason}"
    assert loop.node.counts.refused == 40
    assert all(len(one.detections) == 1 for one in loop.controller.seen)
    assert loop.drive(20)[-1, 0] == pytest.approx(0.5) and loop.node.status == "driving"


def test_a_path_comes_into_the_frame_of_odometry() -> None:
    loop = Loop()
    loop.come("/tf", transform(EPOCH, "map", "odom", (1.0, 0.0, np.pi / 2)))
    loop.turn()
    loop.path("map", ((1.0, 0.0), (1.0, 4.0)))
    loop.drive(3)
    np.testing.assert_allclose(loop.controller.paths[0].points, [(0, 0), (4, 0)], atol=1e-9)
    loop.path("moon")
    loop.drive(3)
    assert loop.node.counts.refused == 1 and len(loop.controller.paths) == 1


def test_messages_full_of_nonsense_do_not_stop_it() -> None:
    rng = np.random.default_rng(2)
    known = messages()
    loop = Loop()
    loop.path()
    loop.turn()
    nasty = [np.nan, np.inf, -np.inf, 1e300, -1e-300, 0.0]
    wires = {"/odom": odometry(0.0, (0, 0, 0), (0, 0, 0)), "/obstacles": obstacles(0.0, [(1, 1)]),
             "/tf": transform(0.0, "odom", "base_link", (0, 0, 0))}  # fmt: skip
    for k in range(600):
        topic = list(wires)[k % 3]
        data = bytearray(known.to_bytes(wires[topic]))
        for _ in range(int(rng.integers(1, 6))):
            place = int(rng.integers(4, len(data) - 8))
            data[place : place + 8] = np.float64(rng.choice(nasty)).tobytes()
        try:
            loop.come(topic, known.read(wires[topic].__msgtype__, bytes(data)))
        except WideberthError:
            continue
        loop.network.deliver()
        loop.node.plan()
        loop.node.publish()
    for _ in range(60):  # whatever was said, the right thing is done again
        loop.turn()
    within_limits(loop.drive(20), tuple(loop.motion[[0, 2]]))


def test_it_shows_plans_and_says_how_it_is() -> None:
    from wideberth import build
    from wideberth.framework.plugins.yamlfile import shared_settings

    planner = build("controllers", shared_settings("recommended") | {"robot": ROBOT})
    loop = Loop(planner, frozenset({PLAIN}))  # type: ignore[arg-type]
    loop.path()
    loop.drive(2)
    loop.node.publish_plan()
    loop.node.publish_diagnostics()
    (plan,) = loop.network.wires["/wideberth/plan"].gone
    assert len(plan.poses) == 16 and plan.header.frame_id == "odom"
    assert len(loop.network.wires["/wideberth/regions"].gone[0].markers) > 1
    assert len(loop.network.wires["/wideberth/forecast"].gone[0].markers) > 1
    (found,) = loop.network.wires["/diagnostics"].gone[0].status
    assert (found.level, found.message) == (0, "driving")
    assert loop.network.wires["/cmd_vel"].kind == "geometry_msgs/msg/Twist"


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        ({"rate": 0.0}, "node.rate"),
        ({"rate": 1e4}, "at most 200"),
        ({"odometry": "odom"}, "wanted a topic"),
    ],
)
def test_bad_settings_are_named(given: Any, cause: str) -> None:
    with pytest.raises(Refused, match=cause):
        NodeSettings(**given)


@pytest.mark.parametrize(
    ("kind", "given", "cause"),
    [
        (ObstacleTopic, {"kind": "vision_msgs/msg/Detection3D"}, "vision_msgs/msg/Detection3DArr"),
        (ObstacleTopic, {"topic": ""}, "wanted a topic"),
        (ObstacleTopic, {"radius": 0.0}, "node.sees.radius"),
        (ScanTopic, {"topic": "scan"}, "wanted a topic"),
        (ScanTopic, {"handover": "both"}, "wanted one of measured, filtered"),
        (ScanTopic, {"deviation": -1.0}, "node.sees.deviation"),
        (PathTopic, {"topic": "plan"}, "wanted a topic"),
        (GoalTopic, {"topic": "goal"}, "wanted a topic"),
        (MapTopic, {"topic": "map"}, "wanted a topic"),
    ],
)
def test_bad_topics_are_named(kind: Any, given: Any, cause: str) -> None:
    with pytest.raises(Refused, match=cause):
        kind(**given)


class Noting(Scripted):
    """A controller that notes what happens to it."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[str] = []

    def reset(self) -> None:
        self.calls.append("reset")

    def set_path(self, path: Path) -> None:
        self.calls.append(f"path {path.length:g}")

    def command(self, observation: Observation) -> Command:
        self.calls.append("command")
        return super().command(observation)


def test_the_controller_compiles_before_the_first_period() -> None:
    controller = Noting()
    loop = Loop(controller)
    loop.node.warm_up()
    loop.path()
    loop.turn()
    assert controller.calls[:4] == ["path 1", "reset", "path 9", "command"]


PLAIN, STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"


@pytest.mark.parametrize(
    ("stamped", "listened", "sent", "problem"),
    [
        (None, {PLAIN}, PLAIN, ""),
        (None, {STAMPED}, STAMPED, ""),
        (None, {PLAIN, STAMPED}, STAMPED, ""),
        (True, {PLAIN}, STAMPED, "set stamped to false"),
        (False, {STAMPED}, PLAIN, "set stamped to true"),
        (False, set(), PLAIN, "/cmd_vel has no subscriber"),
        (None, set(), None, "/cmd_vel has no subscriber"),
    ],
)
def test_commands_are_of_the_kind_that_is_taken(
    stamped: bool | None, listened: set[str], sent: str | None, problem: str
) -> None:
    loop = Loop(listened=frozenset(listened), stamped=stamped)
    loop.path()
    loop.drive(3) if sent else loop.node.publish()
    loop.node.publish_diagnostics()
    assert ("/cmd_vel" in loop.network.wires) == (sent is not None)
    if sent:
        assert loop.network.wires["/cmd_vel"].kind == sent
    (found,) = loop.network.wires["/diagnostics"].gone[0].status
    assert problem in found.message and (found.level == 1 or not problem)


def test_a_robot_that_comes_while_the_node_waits_is_no_problem_any_more() -> None:
    loop = Loop(listened=frozenset())
    loop.network.listened = frozenset({STAMPED})
    loop.node.publish_diagnostics()
    (found,) = loop.network.wires["/diagnostics"].gone[0].status
    assert found.message == "waiting for odometry"


def test_a_robot_that_comes_later_is_sent_its_kind() -> None:
    loop = Loop(listened=frozenset())
    loop.path()
    for _ in range(3):
        loop.turn(quiet=True)
    loop.network.listened = frozenset({PLAIN})
    for _ in range(15):
        loop.turn(quiet=True)
    assert loop.network.wires["/cmd_vel"].kind == PLAIN
    assert loop.network.wires["/cmd_vel"].gone[-1].linear.x > 0.0


def test_a_robot_that_comes_again_and_takes_another_kind_is_sent_that() -> None:
    loop = Loop(listened=frozenset({PLAIN}))
    loop.path()
    for kind in (PLAIN, STAMPED, PLAIN):
        loop.network.listened = frozenset({kind})
        for _ in range(15):
            loop.turn(quiet=True)
        wire = loop.network.wires["/cmd_vel"]
        assert wire.kind == kind and wire.gone


def test_an_inactive_node_brakes_to_a_stand_and_is_silent_then() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    loop.node.active = False
    sent = [one for one in (loop.turn() for _ in range(60)) if one is not None]
    within_limits(np.array(sent), (0.5, 0.0))
    assert sent[-1] == (0.0, 0.0) and len(sent) < 50 and loop.node.stands
    loop.node.active = True
    assert loop.drive(40)[-1] == pytest.approx((0.5, 0.0))


def test_a_stop_is_zero_at_once_and_once() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    sent = loop.network.wires["/cmd_vel"].gone
    before = len(sent)
    loop.node.stop()
    loop.node.stop()
    assert len(sent) == before + 1 and sent[-1].twist.linear.x == 0.0


def test_time_that_is_set_back_stops_it_for_a_moment_alone() -> None:
    loop = Loop()
    loop.path()
    loop.drive(40)
    loop.now -= 3.0
    sent = loop.drive(60)
    assert sent[-1] == pytest.approx((0.5, 0.0)) and loop.node.status == "driving"


def test_periods_without_a_command_are_counted() -> None:
    loop = Loop()
    loop.path()
    loop.drive(10)
    loop.now += 2 * STEP
    loop.drive(10)
    assert loop.node.counts.missed == 2


def test_a_stepped_node_answers_each_instant_once_decided() -> None:
    loop = Loop(Scripted(speed=0.4, rate=0.3), stepped=True)
    loop.path()
    sent = []
    for k in range(4):
        for _ in range(2):  # shown twice
            loop.come("/obstacles", obstacles(loop.stamp(), [(5.0, 1.0), (2.0, 0.0)], "odom"))
            loop.network.deliver()
            loop.come("/odom", odometry(loop.stamp(), (0.1 * k, 0, 0), (0.0, 0, 0)))
            loop.network.deliver()
        loop.now += 0.25
        sent = loop.network.wires["/cmd_vel"].gone
    stamps = [one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in sent]
    assert stamps == pytest.approx(np.repeat(EPOCH + 5.0 + 0.25 * np.arange(4), 2))
    assert {(one.twist.linear.x, one.twist.angular.z) for one in sent} == {(0.4, 0.3)}
    assert [one.stamp for one in loop.controller.seen] == pytest.approx([0.0, 0.25, 0.5, 0.75])
    assert loop.controller.seen[0].detections[0].ident == "01" * 16


def test_a_stepped_node_waits_for_obstacles_of_the_same_instant() -> None:
    loop = Loop(stepped=True)
    loop.path()
    loop.come("/obstacles", obstacles(loop.stamp() - 0.25, [(5.0, 1.0)], "odom"))
    loop.come("/odom", odometry(loop.stamp(), (0, 0, 0), (0, 0, 0)))
    loop.network.deliver()
    assert not loop.network.wires["/cmd_vel"].gone
    loop.come("/obstacles", obstacles(loop.stamp(), [(5.0, 1.0)], "odom"))
    loop.network.deliver()
    assert len(loop.network.wires["/cmd_vel"].gone) == 1


def test_a_robot_without_a_heading_is_sent_velocities_of_its_base() -> None:
    class Sideways(Scripted):
        def command(self, observation: Observation) -> Command:
            super().command(observation)
            return Command((0.4, 0.1))

    loop = Loop(Sideways())
    loop.node = PlannerNode(
        loop.controller, HolonomicVelocity(radius=0.3), NodeSettings(), loop.network,
        lambda: loop.now,
    )  # fmt: skip
    loop.path()
    for _ in range(40):
        turned = (0.1, -0.4, 0.0)  # of a base that looks along y
        loop.come("/odom", odometry(loop.stamp(), (0, 0, np.pi / 2), turned))
        loop.turn(odom=False)
    twist = loop.network.wires["/cmd_vel"].gone[-1].twist
    assert (twist.linear.x, twist.linear.y) == pytest.approx((0.1, -0.4))
    np.testing.assert_allclose(loop.controller.seen[-1].state[:2], [0.0, 0.0])
