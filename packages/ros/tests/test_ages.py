"""How old what a node sees may be, by the stamps, and what it does when it is older."""

from typing import Any

import numpy as np
import pytest

from wideberth.packages.ros.tests.test_forecast_node import Loop as ForecastLoop
from wideberth.packages.ros.tests.test_node import EPOCH, STEP, Loop, Scripted
from wideberth.tests.helpers.bags import header, obstacles, odometry, transform
from wideberth_ros.decoding import decode_message
from wideberth_ros.messages import messages
from wideberth_ros.obstacle_sources import ObstacleTopic, ScanTopic
from wideberth_ros.own_motion import AHEAD, OLDEST, OwnMotion
from wideberth_ros.room_to_stop import RoomToStop

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")


def late(loop: Loop, lag: float, count: int = 30) -> Any:
    """Drive with obstacles that are stamped so much earlier; return the last velocity."""
    sent = None
    for _ in range(count):
        loop.come("/obstacles", obstacles(loop.stamp() - lag, [(5.0, 1.0)], "odom"))
        sent = loop.turn(people=False)
    return sent


@pytest.mark.parametrize("lag", [0.0, 0.3, 0.9, -0.9])
def test_obstacles_have_the_age_of_their_stamps(lag: float) -> None:
    loop = Loop()
    loop.path()
    sent = late(loop, lag)
    assert sent[0] == pytest.approx(0.5) and loop.node.status == "driving"
    ages = [one.detections[0].age for one in loop.controller.seen]
    assert ages == pytest.approx([max(lag, 0.0)] * len(ages))


@pytest.mark.parametrize("driven", [0, 20])
@pytest.mark.parametrize("lag", [1.01, 1.5, 60.0, 1e6, -1.5, -60.0])
def test_obstacles_that_are_late_stop_the_robot_and_say_so(lag: float, driven: int) -> None:
    """From 1 s on their age counted as 0: the robot drove on, "driving"."""
    loop = Loop()
    loop.path()
    loop.drive(driven)
    sent = late(loop, lag)
    assert sent is None or sent[0] == 0.0
    side = "older" if lag > 0.0 else "newer"
    assert loop.node.status.startswith(f"obstacles cannot be placed: a message is {abs(lag):.3g}")
    assert side in loop.node.status and loop.node.counts.refused == 30
    loop.drive(20)
    assert loop.node.status == "driving"


def test_obstacles_that_were_placed_are_no_longer_once_they_are_late() -> None:
    """Their age grows past the limit while odometry goes on."""
    loop = Loop(patience=10.0)
    loop.path()
    late(loop, 0.8, 5)
    ages = []
    for _ in range(10):
        loop.turn(people=False)
        ages.append(loop.node.status == "driving")
    assert ages == [True] * 4 + [False] * 6 or ages == [True] * 3 + [False] * 7
    assert max(one.detections[0].age for one in loop.controller.seen) <= OLDEST


@pytest.mark.parametrize("sees", [ObstacleTopic(own_clock=True)])
def test_the_clock_of_a_sender_may_be_its_own_where_that_is_set(sees: ObstacleTopic) -> None:
    loop = Loop(sees=sees)
    loop.path()
    assert late(loop, 1e6)[0] == pytest.approx(0.5)
    assert {one.detections[0].age for one in loop.controller.seen} == {0.0}


def test_scans_that_are_late_are_not_used() -> None:
    loop = Loop(sees=ScanTopic())
    loop.path()
    loop.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.0, 0.0, 0.0)))
    for _ in range(60):
        loop.come("/scan", messages().make(
            "sensor_msgs/msg/LaserScan", header=header(loop.stamp() - 1.2, "laser"),
            angle_max=3.0, angle_increment=0.1, range_max=9.0,
            ranges=np.full(30, 5.0, np.float32),
        ))  # fmt: skip
        loop.turn(people=False)
    assert loop.node.status.startswith("scans cannot be placed: a message is 1.2 s older")
    assert not loop.controller.seen


def test_a_forecast_takes_no_people_who_are_late() -> None:
    loop = ForecastLoop()
    loop.walk(1.0, late=1.2)
    assert loop.node.publish() and "a message is 1.2 s older" in loop.node.status
    assert loop.node.counts.seen == 0


def test_odometry_whose_stamp_stands_still_counts_as_silent() -> None:
    loop = Loop()
    loop.path()
    loop.drive(20)
    frozen = loop.stamp()
    for _ in range(40):
        loop.come("/odom", odometry(frozen, (0, 0, 0), (0.5, 0, 0)))
        loop.come("/obstacles", obstacles(frozen, [(5.0, 1.0)], "odom"))
        sent = loop.turn(odom=False, people=False)
    assert sent[0] == 0.0 and loop.node.status.startswith("odometry is silent for")


@pytest.mark.parametrize("deciding", [True, False])
def test_a_robot_brakes_where_decisions_or_their_odometry_are_old(deciding: bool) -> None:
    """Decisions after period + patience; where they come, odometry after twice that."""
    loop = Loop(Scripted(period=0.2), patience=0.5)
    loop.path()
    loop.drive(40)
    last = loop.now - STEP  # of the last decision
    sent = []
    while loop.now < last + 2.0:
        if deciding:
            loop.node._decided = loop.now
        now = loop.now
        value = loop.turn(decide=False)
        sent.append((now - last, value[0]))
    began = min(since for since, speed in sent if speed < 0.5 - 1e-9)
    wanted = 1.4 if deciding else 0.7
    assert wanted - 1e-9 < began <= wanted + 2.0 * STEP


def test_points_of_a_scan_are_as_old_as_their_stamps_say(monkeypatch: pytest.MonkeyPatch) -> None:
    ages: list[float] = []
    allowed = RoomToStop.allowed

    def noting(self: Any, twist: Any, pose: Any, points: Any, age: float) -> Any:
        ages.append(age)
        return allowed(self, twist, pose, points, age)

    monkeypatch.setattr(RoomToStop, "allowed", noting)
    loop = Loop(sees=ScanTopic())
    loop.path()
    loop.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.0, 0.0, 0.0)))
    for k in range(20):
        if k in (8, 12):
            loop.come("/scan", messages().make(
                "sensor_msgs/msg/LaserScan", header=header(loop.stamp() - 0.1, "laser"),
                angle_max=3.0, angle_increment=0.1, range_max=9.0,
                ranges=np.full(30, 5.0, np.float32),
            ))  # fmt: skip
        loop.turn(people=False)
    loop.turn(odom=False, people=False)  # the odometry is a period old by now
    wanted = [0.1 + STEP * (k - 12) for k in range(12, 21)]
    assert ages[-9:] == pytest.approx(wanted)


def test_own_poses_go_on_for_a_while_and_no_longer() -> None:
    own = OwnMotion("base_link")
    for time in (0.0, 0.1):
        said = odometry(EPOCH + time, (2.0 * time, 0, 0), (2.0, 0.5, 1.0))
        own.take(decode_message("nav_msgs/msg/Odometry", said), time)
    ahead = 0.99 * AHEAD
    x, y, yaw = own.poses(np.array([0.1 + ahead]))[0]
    chord = ahead * np.sinc(0.5 * ahead / np.pi)
    cosine, sine = np.cos(0.5 * ahead), np.sin(0.5 * ahead)
    assert yaw == pytest.approx(ahead)
    assert x == pytest.approx(0.2 + chord * (2.0 * cosine - 0.5 * sine), abs=2e-3)
    assert y == pytest.approx(chord * (2.0 * sine + 0.5 * cosine), abs=2e-3)
    assert np.isnan(own.poses(np.array([0.1 + 1.01 * AHEAD]))).all()
