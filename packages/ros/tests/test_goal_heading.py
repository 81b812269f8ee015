"""A robot that has to face somewhere at its goal: it brakes, and turns on the spot."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth import Observation, Path
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.polygon import Polygon
from wideberth.packages.ros.tests import test_node
from wideberth.packages.ros.tests.test_node import STEP, Loop, Scripted, within_limits
from wideberth.robots import Bicycle, Unicycle
from wideberth.routes import NavFn
from wideberth.routes.replanning import Replanning
from wideberth.tests.helpers.bags import header, obstacles, odometry, quaternion, transform, vector
from wideberth_ros.decoding import decode_message, heading_of
from wideberth_ros.following import Following, PathFollower, ResultCode
from wideberth_ros.messages import messages
from wideberth_ros.node import NO_ROOM, TURNING
from wideberth_ros.path_sources import GoalTopic, KnownMap, MapPlanner

GOAL = np.array([2.0, 0.0])
PLACE, YAW = 0.25, 0.25
"""m and rad, Nav2's tolerances."""
FREE = OccupancyGrid(np.zeros((60, 60), np.int8), 0.1, (-3.0, -3.0))


class Arriving(Scripted):
    """Drives along x as fast as it can still stop at its goal."""

    def command(self, observation: Observation) -> Any:
        ahead = float(self.paths[-1].goal[0] - observation.state[0])
        self.speed = float(np.clip(0.6 * ahead, 0.0, 0.5))
        return super().command(observation)


class Drive(Loop):
    """A robot that moves exactly as it is told, on arcs."""

    pose = np.array([0.0, 0.0, 0.0])

    def move(self, people: bool = True) -> np.ndarray:
        """One period; return what was sent."""
        self.come("/odom", odometry(self.stamp(), self.pose, self.motion))
        sent = self.turn(odom=False, people=people) or (0.0, 0.0)
        way, turn = STEP * np.array(sent)
        middle = self.pose[2] + 0.5 * turn
        across = 1.0 if turn == 0.0 else np.sin(0.5 * turn) / (0.5 * turn)
        step = way * across * np.array([np.cos(middle), np.sin(middle)])
        self.pose = np.array([*(self.pose[:2] + step), self.pose[2] + turn])
        return np.array(sent)

    def off(self, heading: float) -> float:
        """Angle to a heading, in [0, pi]."""
        return float(np.arccos(np.cos(self.pose[2] - heading)))

    def ask(self, heading: float, frame: str = "odom", place: Any = GOAL) -> None:
        known, turn = messages(), quaternion(heading)
        if np.isnan(heading):
            turn = known.make("geometry_msgs/msg/Quaternion")
        pose = known.make("geometry_msgs/msg/Pose", position=vector("Point", *place),
                          orientation=turn)  # fmt: skip
        stamp = header(self.stamp(), frame)
        self.come(
            "/goal_pose", known.make("geometry_msgs/msg/PoseStamped", header=stamp, pose=pose)
        )

    def until(self, status: str, most: int = 600) -> np.ndarray:
        """Drive until the status is this one and the robot stands; return what was sent."""
        sent = []
        for _ in range(most):
            sent.append(self.move())
            if self.node.status == status and not np.abs(sent[-1]).max() > 1e-9 and len(sent) > 5:
                return np.array(sent)
        raise AssertionError(self.node.status)


@pytest.mark.parametrize("heading", [0.1, 1.5, -1.5, 3.1, -3.1, np.nan])
def test_at_the_goal_it_faces_as_it_was_asked_to(heading: float) -> None:
    loop = Drive(Arriving(), follows=GoalTopic())
    loop.ask(heading)
    sent = loop.until("waiting for a goal")
    within_limits(sent)
    assert np.linalg.norm(loop.pose[:2] - GOAL) <= PLACE
    if np.isnan(heading) or abs(heading) <= YAW:
        assert loop.pose[2] == 0.0
    else:
        assert loop.off(heading) <= YAW
        turned = sent[sent[:, 1] != 0.0]  # the shorter way round, never back, and on the spot
        assert (turned[:, 1] * heading > 0.0).all() and np.abs(turned[:, 0]).max() <= 0.05
        assert np.abs(loop.pose[2]) <= np.pi + YAW


@pytest.mark.parametrize("over", [None, MapPlanner(KnownMap(FREE, "odom"), Replanning(NavFn()))])
def test_a_goal_where_it_stands_is_a_turn_alone(over: Any) -> None:
    loop = Drive(Arriving(), follows=GoalTopic(over=over))
    loop.ask(2.0, place=(0.1, 0.0))
    within_limits(loop.until("waiting for a goal"))
    assert loop.off(2.0) <= YAW and loop.pose[:2].tolist() == [0.0, 0.0]
    assert loop.controller.paths == []


@pytest.mark.parametrize("heading", [1.0, 1.3, 1.6, 1.9])
def test_a_robot_that_turns_as_it_arrives_still_stands_as_asked(heading: float) -> None:
    """It has arrived where it stands, not where its heading is right for a moment."""
    loop = Drive(Scripted(0.5, 0.8), follows=GoalTopic())  # on a circle
    loop.ask(heading, place=(0.7, 0.6))
    within_limits(loop.until("waiting for a goal"))
    assert loop.off(heading) <= YAW
    assert np.linalg.norm(loop.pose[:2] - (0.7, 0.6)) <= 2 * PLACE


def test_a_heading_of_another_frame_is_turned_with_it() -> None:
    loop = Drive(Arriving(), follows=GoalTopic(yaw_tolerance=0.02))
    loop.come("/tf", transform(test_node.EPOCH, "map", "odom", (1.0, 0.0, np.pi / 2)))
    loop.ask(np.pi, "map", (1.0, 2.0))  # straight ahead of the robot, facing odom's +y
    loop.until("waiting for a goal")
    assert np.linalg.norm(loop.pose[:2] - GOAL) <= PLACE
    assert loop.off(np.pi / 2) <= 0.02


def test_a_new_goal_ends_the_turn_and_a_new_heading_changes_it() -> None:
    loop = Drive(Arriving(), follows=GoalTopic())
    loop.ask(3.0)
    while loop.node.status != TURNING:
        loop.move()
    for _ in range(20):
        loop.move()
    assert loop.pose[2] > 0.0
    before = tuple(loop.motion[[0, 2]])
    loop.ask(-0.5)
    within_limits(loop.until("waiting for a goal"), before)
    assert loop.off(-0.5) <= YAW
    loop.pose = np.zeros(3)
    loop.ask(2.0)
    while loop.node.status != TURNING:
        loop.move()
    loop.ask(np.nan, place=(5.0, 0.0))
    loop.move()
    assert loop.node.status == "driving"


def test_a_robot_that_is_pushed_away_drives_back_and_then_turns() -> None:
    loop = Drive(Arriving(), follows=GoalTopic())
    loop.ask(1.0)
    while loop.node.status != TURNING:
        loop.move()
    loop.pose = np.array([0.5, 0.0, 0.0])
    loop.move()
    loop.move()
    assert loop.node.status == "driving"
    loop.until("waiting for a goal")
    assert loop.off(1.0) <= YAW and np.linalg.norm(loop.pose[:2] - GOAL) <= PLACE


def test_it_stops_turning_when_odometry_falls_silent() -> None:
    loop = Drive(Arriving(), follows=GoalTopic())
    loop.ask(3.0)
    while loop.node.status != TURNING or abs(loop.motion[2]) < 0.3:
        loop.move()
    sent = loop.drive(40, odom=False)
    assert sent[-1].tolist() == [0.0, 0.0] and "odometry is silent" in loop.node.status


def test_a_car_passes_the_heading_over(monkeypatch: Any) -> None:
    monkeypatch.setattr(test_node, "ROBOT", Bicycle(radius=0.3))
    loop = Drive(Arriving(), follows=GoalTopic())
    assert not loop.node.turns_on_the_spot
    loop.ask(2.0)
    loop.until("waiting for a goal")
    assert np.linalg.norm(loop.pose[:2] - GOAL) <= PLACE and abs(loop.pose[2]) < 1e-6


def followed(heading: float, robot: Any = None, **settings: float) -> tuple[Any, Drive]:
    """Follow a path to a heading; return how it ended."""
    loop = Drive(Arriving(), follows=None)
    loop.move()
    one = PathFollower(loop.node, Following(**settings), loop.now)
    assert one.begin("odom", np.stack([np.zeros(2), GOAL]), heading) is None
    for _ in range(1000):
        loop.move()
        if robot is not None:
            loop.pose = robot(loop.pose)
        if (end := one.step(loop.now)) is not None:
            return end, loop
    raise AssertionError(loop.node.status)


@pytest.mark.parametrize("heading", [2.5, -2.5, np.nan])
def test_a_path_is_followed_to_the_heading_of_its_last_pose(heading: float) -> None:
    end, loop = followed(heading)
    assert end.code is ResultCode.NONE
    assert np.linalg.norm(loop.pose[:2] - GOAL) <= PLACE
    assert loop.pose[2] == 0.0 if np.isnan(heading) else loop.off(heading) <= YAW


def test_any_heading_will_do_where_the_tolerance_is_a_half_turn() -> None:
    end, loop = followed(2.5, yaw_tolerance=np.pi)
    assert end.code is ResultCode.NONE and loop.pose[2] == 0.0


def test_a_robot_that_cannot_turn_makes_no_progress() -> None:
    end, _ = followed(2.5, robot=lambda pose: np.array([*pose[:2], 0.0]), allowance=3.0)
    assert end.code is ResultCode.FAILED_TO_MAKE_PROGRESS


def test_a_slow_turn_is_progress(monkeypatch: Any) -> None:
    slow = replace(test_node.ROBOT, max_yaw_rate=0.3, max_yaw_acceleration=0.1)
    assert isinstance(slow, Unicycle)
    monkeypatch.setattr(test_node, "ROBOT", slow)
    end, loop = followed(3.1, allowance=6.0)
    assert end.code is ResultCode.NONE and loop.off(3.1) <= YAW


def test_a_quaternion_that_is_none_states_no_heading() -> None:
    known = messages()
    for parts in ((0, 0, 0, 0), (np.nan, 0, 0, 1), (0, 0, 0, np.inf), (0, 0, 9, 9)):
        turn = known.make("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", parts, strict=True)))
        pose = known.make("geometry_msgs/msg/Pose", orientation=turn)
        assert np.isnan(heading_of(pose))
        message = known.make("geometry_msgs/msg/PoseStamped", pose=pose)
        assert np.isnan(decode_message("geometry_msgs/msg/PoseStamped", message).content.heading)
    nearly = known.make("geometry_msgs/msg/Quaternion", z=0.7, w=0.7)
    pose = known.make("geometry_msgs/msg/Pose", orientation=nearly)
    assert heading_of(pose) == pytest.approx(np.pi / 2, abs=1e-12)


def test_paths_stay_as_they_were_asked_for() -> None:
    """The controller is given the place alone; the turn is the node's."""
    loop = Drive(Arriving(), follows=GoalTopic())
    loop.ask(1.0)
    loop.until("waiting for a goal")
    (path,) = loop.controller.paths
    np.testing.assert_allclose(path.points, Path(np.stack([np.zeros(2), GOAL])).points)


LONG = Outline(((0.5, 0.2), (-0.5, 0.2), (-0.5, -0.2), (0.5, -0.2)))
"""Sweeps out to 0.54 m as it turns."""


@pytest.mark.parametrize("action", [False, True])
def test_corners_are_not_swept_over_somebody_beside_the_robot(
    monkeypatch: Any, action: bool
) -> None:
    robot = replace(test_node.ROBOT, radius=0.55, footprint=LONG)
    monkeypatch.setattr(test_node, "ROBOT", robot)
    loop = Drive(Arriving(), follows=None if action else GoalTopic())
    one = None
    loop.move()
    if action:
        one = PathFollower(loop.node, Following(), loop.now)
        assert one.begin("odom", np.stack([np.zeros(2), GOAL]), 2.0) is None
    else:
        loop.ask(2.0)
    while loop.node.status != TURNING or loop.off(2.0) > 1.4:
        loop.move()
        if one is not None:
            one.step(loop.now)
    for _ in range(40):
        loop.come("/obstacles", obstacles(loop.stamp(), [(loop.pose[0], 0.7)], "odom"))
        sent = loop.move(people=False)
        if one is not None:
            assert one.step(loop.now) is None
    assert loop.node.status.startswith(NO_ROOM) and sent.tolist() == [0.0, 0.0]
    assert 0.3 < loop.off(2.0)
    for _ in range(100):
        loop.come("/obstacles", obstacles(loop.stamp(), [(loop.pose[0], 5.0)], "odom"))
        loop.move(people=False)
        if one is not None and one.step(loop.now) is not None:
            break
    assert loop.off(2.0) <= YAW


@pytest.mark.parametrize(("away", "free"), [(0.5, False), (0.6, True)])
def test_corners_are_not_swept_over_a_wall_of_the_map(
    monkeypatch: Any, away: float, free: bool
) -> None:
    robot = replace(test_node.ROBOT, radius=0.55, footprint=LONG)
    monkeypatch.setattr(test_node, "ROBOT", robot)
    wall = Polygon(((-3.0, away), (3.0, away), (3.0, away + 1.0), (-3.0, away + 1.0)))
    over = MapPlanner(KnownMap(FREE, "odom"), Replanning(NavFn()), outlines=lambda _: (wall,))
    controller = Arriving()
    controller.static_region = "any"  # type: ignore[attr-defined]
    loop = Drive(controller, follows=GoalTopic(over=over))
    loop.ask(2.0, place=(0.1, 0.0))
    for _ in range(150):
        loop.move()
    assert (loop.off(2.0) <= YAW) == free
    assert free or (loop.pose[2] == 0.0 and loop.node.status.startswith(NO_ROOM))
