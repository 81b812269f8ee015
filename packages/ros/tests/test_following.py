"""Following a path to its end, with the results of Nav2's action FollowPath."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth import Path as WorldPath
from wideberth import WideberthError
from wideberth.experiments.cli.app import main
from wideberth.packages.ros.tests.test_node import Loop, Scripted
from wideberth.tests.helpers.bags import odometry
from wideberth_ros import relayed
from wideberth_ros.following import Following, PathFollower, ResultCode
from wideberth_ros.link import ros
from wideberth_ros.node import TURNING

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

WAY = np.array([[0.0, 0.0], [3.0, 0.0]])


def follower(loop: Loop, **settings: float) -> PathFollower:
    loop.turn()
    made = PathFollower(loop.node, Following(**settings), loop.now)
    assert made.begin("odom", WAY) is None
    return made


def until_it_ends(loop: Loop, one: PathFollower, most: float = 60.0, **how: bool) -> Any:
    """Drive along x by the commands until the path has ended; return how, and where."""
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
    made = PathFollower(loop.node, Following(), loop.now)
    assert made.begin("odom", WAY).code is ResultCode.TF_ERROR  # type: ignore[union-attr]
    loop.turn()
    for frame, points in (("moon", WAY), ("odom", WAY[:0]), ("odom", np.full((2, 2), np.nan))):
        assert made.begin(frame, points).code is ResultCode.INVALID_PATH  # type: ignore[union-attr]
    with pytest.raises(WideberthError, match=r"following\.tolerance"):
        Following(tolerance=0.0)


ROUND = WorldPath(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 0.0]]))
"""Passes its own end after 2 m."""


@pytest.mark.parametrize("heading", [np.nan, 1.0])
def test_a_path_that_passes_its_own_end_is_followed_to_its_end(heading: float) -> None:
    loop = Loop(follows=None)
    loop.turn()
    one = PathFollower(loop.node, Following(), loop.now)
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
    one = PathFollower(loop.node, Following(), loop.now)
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


def test_without_ros_one_line_says_what_to_do() -> None:
    with pytest.raises(WideberthError, match=r"rclpy of ROS 2 is not found.*setup\.bash"):
        ros("rclpy")


EXAMPLES = Path(__file__).parents[3] / "examples" / "nav2"


@pytest.mark.parametrize("does", ["import time; time.sleep(60)", "raise SystemExit(1)"])
def test_a_relay_that_does_not_begin_is_named(does: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relayed, "LONGEST_START", 0.5)
    with pytest.raises(WideberthError, match=r"did not begin.*needs rclpy"):
        relayed.RelayLink([sys.executable, "-c", does])


def test_the_command_needs_ros(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--ros-args", "-r", "/odom:=/robot/odom"]
    with pytest.raises(SystemExit) as stop:
        main(["node", str(EXAMPLES.parent / "node.yaml"), *words])
    assert stop.value.code == 2 and "rclpy of ROS 2 is not found" in capsys.readouterr().err
