"""Nav2's action FollowPath, served on a fake of rclpy: no ROS was at hand."""

import runpy
import sys
import threading
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from wideberth import Path as WorldPath
from wideberth import WideberthError
from wideberth.experiments.cli.app import main
from wideberth.experiments.cli.ros_node import read_node
from wideberth.ros.following import Follower, Following, ResultCode
from wideberth.ros.messages import messages
from wideberth.ros.node import TURNING, PlannerNode
from wideberth.ros.node_settings import NodeSettings
from wideberth.ros.rclpy_server import FollowPathServer, RclpyLink, needs_ros
from wideberth.tests.helpers import fake_rclpy
from wideberth.tests.helpers.bags import obstacles, odometry
from wideberth.tests.ros.test_node import ROBOT, Loop, Scripted

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

WAY = np.array([[0.0, 0.0], [3.0, 0.0]])


def follower(loop: Loop, **settings: float) -> Follower:
    loop.turn()
    made = Follower(loop.node, Following(**settings), loop.now)
    assert made.begin("odom", WAY) is None
    return made


def until_it_ends(loop: Loop, one: Follower, most: float = 60.0, **how: bool) -> Any:
    """Drive along x as told until the path has ended; return how, and where."""
    x, begin = 0.0, loop.now
    while loop.now - begin < most:
        loop.come("/odom", odometry(loop.stamp(), (x, 0, 0), loop.motion))
        loop.turn(odom=False, **how)
        x += 0.05 * loop.motion[0]
        end = one.step(loop.now)
        if end is not None:
            return end, x
    return None, x


class Arriving(Scripted):
    """Drives as fast as it can still stop at x = 3 m."""

    def command(self, observation: Any) -> Any:
        ahead = max(3.0 - float(observation.state[0]), 0.0)
        self.speed = min(0.5, 0.6 * ahead)
        return super().command(observation)


def test_a_path_is_followed_to_its_end() -> None:
    loop = Loop(Arriving(), follows=None)
    end, x = until_it_ends(loop, follower(loop))
    assert end.code is ResultCode.NONE and 2.75 <= x <= 3.0


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"speed": 0.0}, ResultCode.FAILED_TO_MAKE_PROGRESS),
        ({"raises": True}, ResultCode.NO_VALID_CONTROL),
    ],
)
def test_a_path_is_given_up(change: dict[str, Any], code: ResultCode) -> None:
    loop = Loop(Scripted(**change), follows=None)
    begin = loop.now
    end, _ = until_it_ends(loop, follower(loop))
    assert end.code is code
    assert loop.now - begin < 10.6 if code is ResultCode.FAILED_TO_MAKE_PROGRESS else 2.6


def test_silence_is_a_time_out() -> None:
    for how in ({"people": False}, {"decide": False}):
        loop = Loop(follows=None)
        begin = loop.now
        end, _ = until_it_ends(loop, follower(loop), **how)
        assert end.code is ResultCode.CONTROLLER_TIMED_OUT and loop.now - begin < 3.2, how


def test_paths_that_cannot_be_followed_are_refused() -> None:
    loop = Loop(follows=None)
    made = Follower(loop.node, Following(), loop.now)
    assert made.begin("odom", WAY).code is ResultCode.TF_ERROR  # type: ignore[union-attr]
    loop.turn()
    for frame, points in (("moon", WAY), ("odom", WAY[:1]), ("odom", np.full((2, 2), np.nan))):
        assert made.begin(frame, points).code is ResultCode.INVALID_PATH  # type: ignore[union-attr]
    with pytest.raises(WideberthError, match=r"following\.tolerance"):
        Following(tolerance=0.0)


ROUND = WorldPath(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 0.0]]))
"""Passes its own end after 2 m."""


@pytest.mark.parametrize("heading", [np.nan, 1.0])
def test_a_path_that_passes_its_own_end_is_followed_to_its_end(heading: float) -> None:
    loop = Loop(follows=None)
    loop.turn()
    one = Follower(loop.node, Following(), loop.now)
    assert one.begin("odom", ROUND.points, heading) is None
    arcs = np.arange(0.0, ROUND.length, 0.025)
    for arc in arcs:
        stands = 41 if min(abs(arc - 2.0), abs(arc - 4.0)) < 1e-9 else 1
        for _ in range(stands):
            speed = 0.5 if stands == 1 else 0.0
            place = ROUND.at(np.array(arc))
            odom = odometry(loop.stamp(), (*place, 0.0), (speed, 0.0, 0.0))
            loop.come("/odom", odom)
            loop.turn(odom=False)
            end = one.step(loop.now)
            assert end is None and (loop.node.status == "driving" or arc > ROUND.length - 0.3), arc
    for _ in range(2):
        loop.come("/odom", odometry(loop.stamp(), (2.0, 0.1, 1.0), (0.0, 0.0, 0.0)))
        loop.turn(odom=False)
        end = one.step(loop.now)
    assert end is not None and end.code is ResultCode.NONE


def test_a_robot_that_has_passed_the_end_is_not_there() -> None:
    loop = Loop(follows=None)
    loop.turn()
    one = Follower(loop.node, Following(), loop.now)
    assert one.begin("odom", WAY, 1.0) is None
    for x in (2.0, 2.5, 2.9, 3.4, 3.6, 5.0):
        speed = 0.5 if x < 5.0 else 0.0
        loop.come("/odom", odometry(loop.stamp(), (x, 0.0, 0.0), (speed, 0.0, 0.0)))
        loop.turn(odom=False)
        assert one.step(loop.now) is None
        loop.node.plan()
        assert (loop.node.status == TURNING) == (x in (2.9, 3.4)), x


def test_a_limit_of_speed_keeps_the_curve() -> None:
    loop = Loop(Scripted(speed=0.5, rate=0.4), follows=None)
    follower(loop)
    assert loop.drive(60)[-1] == pytest.approx((0.5, 0.4))
    loop.node.limit_speed(0.25)
    assert loop.drive(60)[-1] == pytest.approx((0.25, 0.2))
    loop.node.limit_speed(float("inf"))
    assert loop.drive(60)[-1] == pytest.approx((0.5, 0.4))


def until(done: Any) -> None:
    """Wait until something holds."""
    end = time.monotonic() + 15.0
    while not done():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.01)


class Served:
    """A server with a robot in the same process, in real time."""

    def __init__(self, monkeypatch: Any, distribution: str, controller: Scripted) -> None:
        fake_rclpy.install(monkeypatch, distribution)
        fake_rclpy.ActionServer.made.clear()
        self.node = fake_rclpy.Node()
        known = messages("jazzy")
        self.planner = PlannerNode(
            controller, ROBOT, NodeSettings(follows=None), RclpyLink(self.node, known)
        )
        self.server = FollowPathServer(self.node, self.planner, Following(tolerance=0.1))
        self.x, self.stop = 0.0, threading.Event()
        self.threads = [
            threading.Thread(target=self.planner.run), threading.Thread(target=self.robot)
        ]  # fmt: skip
        for one in self.threads:
            one.start()
        until(lambda: self.planner.motion is not None)

    def robot(self) -> None:
        known = messages("jazzy")
        sent = self.node.publishers["/cmd_vel"].sent
        while not self.stop.wait(0.02):
            told = known.read("geometry_msgs/msg/TwistStamped", sent[-1]) if sent else None
            speed = told.twist.linear.x if told else 0.0
            self.x += 0.02 * speed
            now = time.time()
            for topic, message in (
                ("/odom", odometry(now, (self.x, 0, 0), (speed, 0, 0))),
                ("/obstacles", obstacles(now, [(5.0, 5.0)], "odom")),
            ):
                self.node.calls[topic](known.to_bytes(message))

    def goal(self, end: float) -> fake_rclpy.Handle:
        turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)  # any heading will do
        place = [SimpleNamespace(pose=SimpleNamespace(position=SimpleNamespace(x=x, y=0.0),
                                                      orientation=turn))
                 for x in (0.0, end)]  # fmt: skip
        header = SimpleNamespace(frame_id="odom")
        path = SimpleNamespace(header=header, poses=place)
        return fake_rclpy.Handle(SimpleNamespace(path=path))

    def close(self) -> None:
        self.stop.set()
        self.planner.stop()
        for one in self.threads:
            one.join()


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Any:
    made: list[Served] = []

    def make(distribution: str, controller: Scripted) -> Served:
        made.append(Served(monkeypatch, distribution, controller))
        return made[-1]

    yield make
    for one in made:
        one.close()


class Near(Scripted):
    """Drives as fast as it can still stop at x = 0.4 m."""

    def command(self, observation: Any) -> Any:
        ahead = max(0.4 - float(observation.state[0]), 0.0)
        self.speed = min(0.5, 1.2 * ahead)
        return super().command(observation)


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted", "lyrical"])
def test_a_goal_is_driven_to(served: Any, distribution: str) -> None:
    one = served(distribution, Near(period=0.05))
    handle = one.goal(0.4)
    result = one.server.execute(handle)
    assert handle.state == "succeeded" and 0.3 <= one.x <= 0.6
    assert getattr(result, "error_code", 0) == 0
    first = handle.feedback[0]
    first = first.tracking_feedback if distribution == "lyrical" else first
    assert first.distance_to_goal == pytest.approx(0.4, abs=0.1)
    assert one.node.raw["/odom"] and not one.node.raw["speed_limit"]
    (server,) = fake_rclpy.ActionServer.made
    assert server.name == "follow_path"


def test_goals_are_cancelled_replaced_and_refused(served: Any) -> None:
    one = served("kilted", Scripted(speed=0.3, period=0.05))
    first, second = one.goal(50.0), one.goal(60.0)
    answers: dict[str, Any] = {}
    threads = []
    for name, handle in (("first", first), ("second", second)):
        threads.append(
            threading.Thread(
                target=lambda name=name, handle=handle: answers.update(
                    {name: one.server.execute(handle)}
                )
            )
        )
        threads[-1].start()
        until(lambda handle=handle: handle.feedback)
    until(lambda: "first" in answers)
    assert first.state == "aborted" and answers["first"].error_msg == "a new goal took its place"
    assert second.state == "executing" and one.planner.path.goal[0] == 60.0
    second.is_cancel_requested = True
    for thread in threads:
        thread.join()
    assert second.state == "canceled" and one.planner.path is None
    refused = one.goal(1.0)
    refused.request.path.poses = []
    result = one.server.execute(refused)
    assert (refused.state, result.error_code) == ("aborted", 103)
    assert "the path has 0 poses" in result.error_msg


def test_a_goal_that_is_replaced_leaves_no_turn_behind(served: Any, monkeypatch: Any) -> None:
    """The new goal comes while the old one is looked at, before that turns the robot."""
    one = served("kilted", Scripted(speed=0.3, period=0.05))
    first, second = one.goal(50.0), one.goal(60.0)
    follow, step = Follower.begin, Follower.step
    coming, begun, late = threading.Event(), threading.Event(), threading.Event()

    def begin(self: Follower, *given: Any) -> Any:
        found = follow(self, *given)
        if coming.is_set():
            begun.set()
        return found

    def turning(self: Follower, now: float) -> Any:
        if not coming.is_set():
            coming.set()
            begun.wait(0.5)
            self.node.turn("odom", 3.0)
            late.set()
        return step(self, now)

    monkeypatch.setattr(Follower, "begin", begin)
    monkeypatch.setattr(Follower, "step", turning)
    threads = [threading.Thread(target=one.server.execute, args=(first,))]
    threads[0].start()
    coming.wait(5.0)
    threads.append(threading.Thread(target=one.server.execute, args=(second,)))
    threads[1].start()
    late.wait(5.0)
    until(lambda: first.state == "aborted" and second.feedback)
    until(lambda: one.planner.status == "driving" and one.x > 0.2)
    second.is_cancel_requested = True
    for thread in threads:
        thread.join()
    assert second.state == "canceled"


def test_limits_of_speed_come_as_nav2_sends_them(served: Any) -> None:
    one = served("jazzy", Scripted())
    for given, percent, wanted in ((0.3, False, 0.3), (50.0, True, 0.35), (0.0, True, np.inf)):
        one.node.calls["speed_limit"](SimpleNamespace(speed_limit=given, percentage=percent))
        assert one.planner._limit == pytest.approx(wanted)


def test_without_ros_one_line_says_what_to_do() -> None:
    with pytest.raises(WideberthError, match=r"needs rclpy of ROS 2.*wideberth node"):
        needs_ros("rclpy")


EXAMPLES = Path(__file__).parents[2] / "examples" / "nav2"


def test_the_launch_file_starts_our_node_in_the_place_of_nav2s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def made(**given: Any) -> Any:
        return SimpleNamespace(**given)

    for name, content in (
        ("launch", {"LaunchDescription": lambda entries: entries}),
        ("launch.actions", {"DeclareLaunchArgument": lambda name, **given: made(**given),
                            "ExecuteProcess": made}),
        ("launch.substitutions", {"LaunchConfiguration": lambda name: f"<{name}>"}),
        ("launch_ros.actions", {"Node": made}),
    ):  # fmt: skip
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    found = runpy.run_path(str(EXAMPLES / "follow_path.launch.py"))[
        "generate_launch_description"
    ]()
    commands = [one.cmd for one in found if hasattr(one, "cmd")]
    assert commands == [["wideberth", "node", "<config>", "--follow-path"]]
    nodes = {one.executable for one in found if hasattr(one, "executable")}
    assert "controller_server" not in nodes and "bt_navigator" in nodes
    params = yaml.safe_load((EXAMPLES / "nav2_params.yaml").read_text())
    configured = set(params) - {"global_costmap"}
    assert configured <= nodes
    costmap = params["global_costmap"]["global_costmap"]["ros__parameters"]
    planner, _ = read_node(EXAMPLES.parent / "node.yaml", [])
    assert costmap["robot_radius"] == planner.robot.radius  # type: ignore[attr-defined]


def test_the_command_needs_ros(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, cause in (
        (["--follow-path"], "needs rclpy of ROS 2"),
        (["--follow-path", "--seconds", "3"], "leave --seconds out"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["node", str(EXAMPLES.parent / "node.yaml"), *words])
        assert stop.value.code == 2 and cause in capsys.readouterr().err
