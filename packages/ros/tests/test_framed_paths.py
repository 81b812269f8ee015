"""Paths of other frames, of one pose, and odometry of another frame than the robot's."""

from typing import Any

import numpy as np
import pytest

from wideberth import Path
from wideberth.packages.ros.tests.test_node import EPOCH, Loop
from wideberth.packages.ros.tests.test_obstacle_sources import goal
from wideberth.tests.helpers.bags import header, odometry, transform
from wideberth_ros.decoding import OdometryMessage, decode_message
from wideberth_ros.following import Following, PathFollower
from wideberth_ros.frames import composed
from wideberth_ros.messages import messages
from wideberth_ros.obstacle_sources import ScanTopic
from wideberth_ros.own_motion import OwnMotion
from wideberth_ros.path_sources import FramedPath, GoalTopic

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

ODOMETRY = "nav_msgs/msg/Odometry"


def stand(loop: Loop, x: float, y: float = 0.0, yaw: float = 0.0) -> Any:
    """One period of a robot at a pose."""
    loop.come("/odom", odometry(loop.stamp(), (x, y, yaw), (0, 0, 0)))
    return loop.turn(odom=False)


def map_to_odom(loop: Loop, pose: Any) -> None:
    loop.come("/tf", transform(loop.stamp(), "map", "odom", pose))


def test_a_path_that_comes_before_odometry_is_laid_when_it_comes() -> None:
    """It was followed as if its frame were the odometry's."""
    loop = Loop()
    map_to_odom(loop, (1.0, 0.0, np.pi / 2))
    loop.path("map", ((1.0, 0.0), (1.0, 4.0)))
    loop.turn(odom=False)
    assert loop.node.status == "waiting for odometry"
    loop.drive(3)
    assert loop.node.status == "driving"
    np.testing.assert_allclose(loop.controller.paths[0].points, [(0, 0), (4, 0)], atol=1e-9)


def test_a_path_that_comes_before_its_frame_waits_for_it() -> None:
    loop = Loop()
    loop.turn()
    loop.path("map", ((1.0, 0.0), (1.0, 4.0)))
    loop.turn()
    assert loop.node.status == "no motion connects the path's frame 'map' with odometry"
    assert loop.node.counts.refused == 1
    map_to_odom(loop, (1.0, 0.0, np.pi / 2))
    loop.drive(3)
    np.testing.assert_allclose(loop.controller.paths[0].points, [(0, 0), (4, 0)], atol=1e-9)


@pytest.mark.parametrize("by_goal", [False, True])
def test_a_path_is_laid_anew_where_its_frame_has_moved(by_goal: bool) -> None:
    """It was laid once: after a correction by 1 m the robot ended 1 m beside the goal."""
    loop = Loop(follows=GoalTopic()) if by_goal else Loop()
    map_to_odom(loop, (0.0, 0.0, 0.0))
    stand(loop, 0.0)
    if by_goal:
        loop.come("/goal_pose", goal(8.0, 0.0, "map"))
    else:
        loop.path("map", ((0, 0), (8, 0)))
    for x in (0.0, 1.0, 2.0):
        stand(loop, x)
    assert len(loop.controller.paths) == 1
    map_to_odom(loop, (0.0, 0.01, 0.0))
    stand(loop, 2.0)
    assert len(loop.controller.paths) == 1  # by a little nothing is laid anew
    map_to_odom(loop, (0.0, 1.0, 0.0))
    stand(loop, 2.0)
    stand(loop, 2.0)
    assert len(loop.controller.paths) == 2 and loop.node.status == "driving"
    np.testing.assert_allclose(loop.controller.paths[1].points, [(2, -1), (8, -1)], atol=1e-9)


def test_a_path_that_is_laid_anew_does_not_begin_again() -> None:
    """There and back, with the robot on the way back: the way there is behind it."""
    loop = Loop()
    map_to_odom(loop, (0.0, 0.0, 0.0))
    stand(loop, 0.0)
    loop.path("map", ((0, 0), (8, 0), (8, 0.1), (-2, 0.1)))
    for x in np.arange(0.0, 8.1, 0.5):
        stand(loop, float(x))
    for x in np.arange(8.0, 3.9, -0.5):
        stand(loop, float(x), 0.1)
    for shift in (0.2, 0.5, 1.0):
        map_to_odom(loop, (0.0, shift, 0.0))
        stand(loop, 4.0, 0.1 - shift)
        rest = loop.controller.paths[-1]
        np.testing.assert_allclose(rest.points, [(4, 0.1 - shift), (-2, 0.1 - shift)], atol=1e-6)


def test_a_path_of_a_frame_that_the_robot_carries_is_laid_once() -> None:
    loop = Loop()
    loop.come("/tf", transform(loop.stamp(), "odom", "base_link", (1.0, 0.0, 0.0)))
    stand(loop, 1.0)
    loop.path("base_link", ((0, 0), (5, 0)))
    for x in (1.0, 2.0, 3.0):
        loop.come("/tf", transform(loop.stamp(), "odom", "base_link", (x, 0.0, 0.0)))
        stand(loop, x)
    (path,) = loop.controller.paths
    np.testing.assert_allclose(path.points, [(1, 0), (6, 0)], atol=1e-9)


def test_a_path_that_is_very_long_keeps_its_end() -> None:
    own = OwnMotion("base_link")
    own.take(decode_message(ODOMETRY, odometry(EPOCH, (0, 0, 0), (0, 0, 0))), 0.0)
    points = np.column_stack([0.01 * np.arange(25_001.0), np.zeros(25_001)])
    path = FramedPath("odom", points)
    assert path.lay(own) and isinstance(path.path, Path)
    assert len(path.path.points) <= 10_000 and path.path.goal.tolist() == [250.0, 0.0]


@pytest.mark.parametrize("points", [[[0.1, 0.0]], [[0.0, 0.0], [0.0, 0.0]], [[0.0, 0.0]]])
def test_a_path_of_one_pose_at_the_robot_ends_after_its_turn(points: Any) -> None:
    """As NavFn sends it where start and goal share a cell; it was an INVALID_PATH."""
    loop = Loop(follows=None)
    loop.turn()
    follower = PathFollower(loop.node, Following(), loop.now)
    end, heading = follower.begin("odom", np.array(points), 1.57), 0.0
    while end is None and loop.now < 60.0:
        loop.come("/odom", odometry(loop.stamp(), (0, 0, heading), loop.motion))
        loop.turn(odom=False)
        heading += 0.05 * loop.motion[2]
        end = follower.step(loop.now)
    assert end is not None and end.code.name == "NONE"
    assert heading == pytest.approx(1.57, abs=0.25)


def test_a_path_of_one_pose_elsewhere_leads_there_straight() -> None:
    loop = Loop()
    stand(loop, 1.0, 2.0)
    for _ in range(3):  # the same one, again and again
        loop.path(points=((4.0, -1.0), (4.0, -1.0)))
        stand(loop, 1.0, 2.0)
    (path,) = loop.controller.paths
    np.testing.assert_allclose(path.points, [(1.0, 2.0), (4.0, -1.0)], atol=1e-9)
    assert loop.node.status == "driving"


@pytest.mark.parametrize("base", [(-0.5, 0.0, 0.0), (0.2, -0.3, 1.1)])
def test_odometry_of_another_frame_is_taken_to_the_base(base: Any) -> None:
    """Driven on a circle by the base, as a unit on it measures it."""
    own = OwnMotion("base_link")
    mount = composed(np.zeros(3), np.array(base))
    back = -np.array([np.cos(base[2]) * base[0] + np.sin(base[2]) * base[1],
                      np.cos(base[2]) * base[1] - np.sin(base[2]) * base[0], base[2]])  # fmt: skip
    tf = transform(EPOCH, "imu_link", "base_link", mount)
    own.take_frames(decode_message("tf2_msgs/msg/TFMessage", tf).content)  # type: ignore[arg-type]
    speed, rate, step = 0.7, 0.8, 1e-6

    def imu(time: float) -> np.ndarray:
        turn = rate * time
        pose = [speed / rate * np.sin(turn), speed / rate * (1.0 - np.cos(turn)), turn]
        return composed(np.array(pose), back)

    here, soon = imu(1.0), imu(1.0 + step)
    world = (soon - here)[:2] / step
    cosine, sine = np.cos(here[2]), np.sin(here[2])
    twist = [*(np.array([[cosine, sine], [-sine, cosine]]) @ world), rate]
    message = odometry(EPOCH, here, twist, child="imu_link")
    message.pose.covariance[[0, 7, 35]] = [0.01, 0.02, 0.04]
    own.take(decode_message(ODOMETRY, message), 0.0)
    assert own.newest is not None
    found = own.newest.decoded.content
    assert isinstance(found, OdometryMessage) and found.covariance is not None
    wanted = [speed / rate * np.sin(0.8), speed / rate * (1.0 - np.cos(0.8)), 0.8]
    np.testing.assert_allclose(found.pose, wanted, atol=1e-9)
    np.testing.assert_allclose(found.twist, [speed, 0.0, rate], atol=1e-5)
    rng = np.random.default_rng(0)
    drawn = rng.multivariate_normal(here, np.diag([0.01, 0.02, 0.04]) * 1e-4, 20_000)
    spread = 1e4 * np.cov(composed(drawn, mount[None]).T)
    np.testing.assert_allclose(found.covariance, spread, atol=2e-3)


def test_odometry_of_an_unknown_frame_is_refused_with_the_reason() -> None:
    loop = Loop()
    loop.path()
    for _ in range(3):
        loop.come("/odom", odometry(loop.stamp(), (0, 0, 0), (0, 0, 0), child="imu_link"))
        assert loop.turn(odom=False) is None
    words = "no motion connects the odometry's child frame 'imu_link' with 'base_link'"
    assert loop.node.status == words and loop.node.counts.refused == 3
    loop.come("/tf_static", transform(EPOCH, "base_link", "imu_link", (0.5, 0.0, 0.0)))
    loop.turn(odom=False)
    loop.come("/odom", odometry(loop.stamp(), (0.5, 0, 0), (0, 0, 0), child="imu_link"))
    loop.turn(odom=False)
    assert loop.node.status == "driving"
    assert loop.node.motion is not None
    np.testing.assert_allclose(loop.node.motion[0], np.zeros(3), atol=1e-12)


@pytest.mark.parametrize("roll", [0.0, np.pi, 0.5])
@pytest.mark.parametrize("from_above", [False, True])
def test_a_lidar_upside_down_sees_on_the_other_side(roll: float, from_above: bool) -> None:
    loop = Loop(sees=ScanTopic())
    loop.path()
    parent = "deck" if from_above else "base_link"
    if from_above:
        loop.come("/tf_static", transform(EPOCH, "base_link", "deck", (0.0, 0.0, 0.2)))
    loop.come("/tf_static", transform(EPOCH, parent, "laser", (0.0, 0.0, 0.3), roll))
    ranges = np.full(60, np.inf, np.float32)
    ranges[10] = 3.0
    for _ in range(12):
        loop.come("/scan", messages().make(
            "sensor_msgs/msg/LaserScan", header=header(loop.stamp(), "laser"), angle_max=2.95,
            angle_increment=0.05, range_max=9.0, ranges=ranges,
        ))  # fmt: skip
        loop.turn(people=False)
    if 0.1 < roll < 3.0:
        assert loop.node.status.startswith("scans cannot be placed: 'laser' tilts by 0.5 rad")
        return
    points, _ = loop.node._obstacles.points()  # type: ignore[union-attr]
    angle = 0.3 + 0.2 * from_above + (0.5 if roll == 0.0 else -0.5)
    np.testing.assert_allclose(points, [[3.0 * np.cos(angle), 3.0 * np.sin(angle)]], atol=1e-6)


def test_obstacles_of_a_frame_that_tilts_stop_the_robot_with_the_reason() -> None:
    from wideberth.tests.helpers.bags import obstacles

    for roll, words in ((np.pi, "'lidar' is upside down against 'base_link'"),
                        (1.57, "'lidar' tilts by 1.6 rad against 'base_link'")):  # fmt: skip
        loop = Loop()
        loop.path()
        loop.come("/tf_static", transform(EPOCH, "base_link", "lidar", (0.0, 0.0, 0.0), roll))
        for _ in range(5):
            loop.come("/obstacles", obstacles(loop.stamp(), [(3.0, 1.0)], "lidar"))
            loop.turn(people=False)
        assert loop.node.status.startswith(f"obstacles cannot be placed: {words}")


def test_a_beam_at_the_longest_range_met_nothing() -> None:
    """Drivers send it where nothing is there: it made a ring of points around the robot."""
    ranges = np.array([1.0, 8.1, 8.1, np.inf, 7.9], np.float32)
    scan = decode_message("sensor_msgs/msg/LaserScan", messages().make(
        "sensor_msgs/msg/LaserScan", header=header(1.0, "laser"), angle_max=0.4,
        angle_increment=0.1, range_max=8.1, ranges=ranges,
    )).content  # fmt: skip
    assert scan.met.tolist() == [True, False, False, False, True]  # type: ignore[union-attr]


@pytest.mark.parametrize("before", [False, True])
def test_a_covariance_of_odometry_that_is_none_is_said(before: bool) -> None:
    """It counted as exact; the last good one stands in, else it is as if none were stated."""
    loop = Loop()
    loop.path()
    loop.turn()
    good = odometry(loop.stamp(), (0, 0, 0), (0, 0, 0))
    good.pose.covariance[[0, 7, 35]] = [0.04, 0.09, 0.01]
    if before:
        loop.come("/odom", good)
        loop.turn(odom=False)
    bad = odometry(loop.stamp(), (0, 0, 0), (0, 0, 0))
    bad.pose.covariance[[0, 7, 35]] = [-1.0, 0.04, 0.04]
    loop.come("/odom", bad)
    loop.turn(odom=False)
    seen = loop.controller.seen[-1].covariance
    assert loop.node.counts.refused == 1
    assert (seen is None) == (not before)
