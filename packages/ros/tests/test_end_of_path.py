"""A node with paths of a topic, and `follow_path`: at the end of the path the robot stands."""

import pathlib
from typing import Any

import numpy as np
import pytest

from wideberth import recommended
from wideberth.controllers import Planner
from wideberth.framework.plugins.config import build
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.path import Path
from wideberth.packages.ros.tests import test_node
from wideberth.packages.ros.tests.test_goal_heading import Drive
from wideberth.packages.ros.tests.test_node import Scripted, within_limits
from wideberth.robots import Bicycle, Unicycle
from wideberth.tests.helpers.bags import header, quaternion, transform, vector
from wideberth_ros.cli.ros_node import read_node
from wideberth_ros.end_of_path import Arrival
from wideberth_ros.following import Following, PathFollower, ResultCode
from wideberth_ros.messages import messages
from wideberth_ros.node import ARRIVED
from wideberth_ros.path_sources import PathTopic

EXAMPLE = pathlib.Path(__file__).parents[3] / "examples" / "node.yaml"
NEAR = 0.25
WAY = ((0.0, 0.0), (3.0, 0.0))
STEP = test_node.STEP
CORNERS = ((0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2))


class Lagging(Drive):
    """A robot whose base follows commands as a low-pass of the first order, and plans at 5 Hz."""

    lag = 0.0
    count = 0

    def turn(self, **how: bool) -> Any:
        before, self.count = self.motion, self.count + 1
        how["decide"] = self.count % 4 == 0
        sent = super().turn(**how)
        share = 1.0 - np.exp(-STEP / self.lag) if self.lag else 1.0
        self.motion = before + share * (self.motion - before)
        self.motion[np.abs(self.motion) < 1e-3] = 0.0
        return sent and (self.motion[0], self.motion[2])


def test_a_controller_that_never_brakes_stands_at_the_end() -> None:
    loop = Drive(Scripted(), follows=PathTopic())
    loop.path(points=WAY)
    sent = loop.until("waiting for a path")
    assert sent[:, 0].max() == pytest.approx(0.5) and (sent[-1] == 0.0).all()
    assert np.linalg.norm(loop.pose[:2] - WAY[-1]) <= NEAR
    loop.path(points=((3.0, 0.0), (9.0, 0.0)))
    for _ in range(30):
        loop.move()
    assert loop.node.status == "driving" and loop.pose[0] > 3.3


def test_the_same_path_once_more_does_not_wake_a_robot_that_is_there() -> None:
    loop = Drive(Scripted(), follows=PathTopic())
    for k in range(200):
        if k % 20 == 0:
            loop.path(points=WAY)
        loop.move()
    assert np.linalg.norm(loop.pose[:2] - WAY[-1]) <= NEAR and not loop.motion.any()


LOOP = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)])


def pursuing() -> Drive:
    controller = build("controllers", {"type": "pure_pursuit", "robot": "unicycle",
                                       "look_ahead": 0.5, "period": STEP})  # fmt: skip
    return Drive(controller, follows=PathTopic())


@pytest.mark.parametrize("shift", [0.0, 0.001])
def test_a_loop_that_comes_again_and_again_ends(shift: float) -> None:
    loop, driven = pursuing(), 0.0
    for k in range(1200):
        if k % 20 == 0:
            loop.path(points=LOOP + shift * (k // 20))
        before = loop.pose
        loop.move()
        driven += float(np.linalg.norm(loop.pose[:2] - before[:2]))
    assert 6.5 < driven < 8.5 and not loop.motion.any()
    assert np.linalg.norm(loop.pose[:2] - LOOP[-1]) < 0.4


def planning() -> Lagging:
    planner = recommended(test_node.ROBOT, 0.5, quiet=True, predictor="kalman", dt=0.25,
                          period=4 * STEP)  # fmt: skip
    return Lagging(planner, follows=PathTopic())  # type: ignore[arg-type]


@pytest.mark.parametrize("frame", ["odom", "map"])
def test_the_planner_ends_a_loop_that_comes_again_and_again(frame: str) -> None:
    """Its points move by 1 mm each second, or the map does against odometry."""
    loop, driven = planning(), 0.0
    for k in range(700):
        if k % 20 == 0:
            moved = 0.001 * (k // 20)
            loop.come("/tf", transform(loop.stamp(), "map", "odom", (moved, 0.0, 0.0)))
            loop.path(frame, LOOP + np.array([moved if frame == "odom" else 0.0, 0.0]))
        before = loop.pose
        loop.move()
        driven += float(np.linalg.norm(loop.pose[:2] - before[:2]))
    assert 6.5 < driven < 8.5 and not loop.motion.any()
    assert np.linalg.norm(loop.pose[:2] - LOOP[-1]) < 0.4


def test_a_way_there_and_back_ends_while_its_map_moves() -> None:
    """The map moves by 2 cm each second, so that the path is laid anew all the time."""
    loop, moved = planning(), 0.0
    loop.path("map", ((0.0, 0.0), (3.0, 0.0), (0.0, 0.0)))
    for k in range(700):
        if k % 20 == 0:
            moved = 0.02 * (k // 20)
            loop.come("/tf", transform(loop.stamp(), "map", "odom", (moved, 0.0, 0.0)))
        loop.move()
        if k > 100 and loop.node.status == "waiting for a path":
            break
    assert loop.node.status == "waiting for a path"
    assert np.linalg.norm(loop.pose[:2] + np.array([moved, 0.0])) <= 2.0 * NEAR


def test_an_action_drives_the_same_loop_once_more() -> None:
    loop = pursuing()
    loop.turn(people=False)
    for _ in range(2):
        follower, driven, end = PathFollower(loop.node, Following(), loop.now), 0.0, None
        assert follower.begin("odom", LOOP) is None
        while end is None:
            before = loop.pose
            loop.move()
            driven += float(np.linalg.norm(loop.pose[:2] - before[:2]))
            end = follower.step(loop.now)
        assert end.code is ResultCode.NONE and 6.5 < driven < 8.5
        loop.node.halt()


def test_a_node_says_that_its_robot_is_blocked() -> None:
    """Its odometry says that it does not move."""
    planner = recommended("unicycle", quiet=True, predictor="kalman")
    loop = test_node.Loop(planner)  # type: ignore[arg-type]
    loop.path()
    loop.turn()
    loop.turn()
    assert loop.node.status == "driving"
    for k in range(round(6.0 / STEP)):
        loop.turn(decide=k % 10 == 0)
    assert loop.node.status.startswith("blocked: it has stood for")


def test_a_short_path_onward_is_driven_and_the_same_goal_wakes_no_robot() -> None:
    loop = Drive(Scripted(), follows=PathTopic())
    loop.path(points=WAY)
    loop.until("waiting for a path")
    here = loop.pose[0]
    loop.path(points=((here, 0.0), WAY[-1]))  # planned anew
    for _ in range(20):
        assert not loop.move().any()
    end = here + 0.45
    loop.path(points=((here, 0.0), (end, 0.0)))
    loop.until("waiting for a path")
    assert abs(end - loop.pose[0]) <= NEAR


def test_twice_the_tolerance_is_for_the_same_goal_alone() -> None:
    arrival, way = Arrival(NEAR), Path(np.array(WAY))
    for onward, there in ((0.0, True), (0.01, True), (0.45, False)):
        assert arrival.update(way, way.goal)
        new = Path(np.array([(1.0, 0.0), (3.0 + onward, 0.0)]))
        assert arrival.update(new, new.goal - np.array([1.8 * NEAR, 0.0])) is there


def test_a_path_that_passes_its_own_end_is_followed_to_the_end() -> None:
    """Round a square, and over its first side once more."""
    way = Path(np.array([(0, 0), (2, 0), (2, 2), (0, 2), (0, 0), (1, 0)], float))
    arrival = Arrival(NEAR)
    for arc in np.arange(0.0, way.length - NEAR - 0.01, 0.05):
        assert not arrival.update(way, way.at(np.array([arc]))[0])
    assert arrival.update(way, way.goal)
    beside = np.array([0.0, NEAR])
    assert arrival.update(way, way.goal + 1.9 * beside)
    assert not arrival.update(way, way.goal + 2.1 * beside)
    assert not arrival.update(way, np.array([1e300, np.nan]))


@pytest.mark.parametrize(
    "robot",
    [test_node.ROBOT, Bicycle(radius=0.3), Unicycle(radius=0.5, footprint=Outline(CORNERS))],
    ids=["disc", "car", "box"],
)  # fmt: skip
def test_a_path_without_a_heading_ends_with_a_robot_that_stands(
    robot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller never brakes; at the end the node does."""
    monkeypatch.setattr(test_node, "ROBOT", robot)
    loop = Drive(Scripted(), follows=None)
    loop.move()
    follower = PathFollower(loop.node, Following(), loop.now)
    assert follower.begin("odom", np.array(WAY)) is None
    end, said = None, set()
    for _ in range(400):
        loop.move()
        end = follower.step(loop.now)
        said.add(loop.node.status)
        if end is not None:
            break
    assert end is not None and end.code is ResultCode.NONE, end
    assert np.linalg.norm(loop.pose[:2] - WAY[-1]) <= 2.0 * NEAR and ARRIVED in said


def oriented(loop: Drive, points: Any, headings: Any) -> None:
    """Send a path whose poses have headings, rad; NaN leaves a quaternion as it begins."""
    known, stamp = messages(), header(loop.stamp(), "odom")
    poses = []
    for place, heading in zip(points, headings, strict=True):
        turn = quaternion(0.0 if np.isnan(heading) else heading)
        pose = known.make("geometry_msgs/msg/Pose", position=vector("Point", *place),
                          orientation=turn)  # fmt: skip
        poses.append(known.make("geometry_msgs/msg/PoseStamped", pose=pose))
    loop.come("/plan", known.make("nav_msgs/msg/Path", header=stamp, poses=poses))


@pytest.mark.parametrize("heading", [0.1, 1.57, -1.57, 3.1, -3.1])
@pytest.mark.parametrize("once", [True, False])
def test_at_the_end_of_a_path_it_faces_as_the_last_pose_does(heading: float, once: bool) -> None:
    """Also where the path comes again all the time."""
    loop = Drive(Scripted(), follows=PathTopic())
    sent = []
    for k in range(300):
        if k == 0 or (not once and k % 20 == 0):
            oriented(loop, WAY, (0.0, heading))
        sent.append(loop.move())
    within_limits(np.array(sent))
    assert not loop.motion.any() and np.linalg.norm(loop.pose[:2] - WAY[-1]) <= NEAR
    turned = np.array(sent)[:, 1]
    assert loop.off(heading) <= NEAR and (turned * heading >= 0.0).all()
    assert loop.node.status == "waiting for a path" or not once


@pytest.mark.parametrize("headings", [(np.nan, np.nan), (1.0, np.nan)])
def test_quaternions_as_they_begin_are_no_headings_where_all_are(headings: Any) -> None:
    """A sender who fills in none leaves all at w = 1."""
    loop = Drive(Scripted(), follows=PathTopic())
    loop.pose = np.array([0.0, 0.0, np.pi / 2])
    oriented(loop, ((0.0, 0.0), (0.0, 3.0)), headings)
    loop.until("waiting for a path")
    faces = np.pi / 2 if np.isnan(headings[0]) else 0.0
    assert loop.off(faces) <= NEAR


BENT = {
    "corner": [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0)],
    "hook": [(0.0, 0.0), (4.0, 0.0), (4.0, 0.5)],
}


@pytest.mark.parametrize("lag", [0.0, 0.3])
@pytest.mark.parametrize("name", BENT)
def test_the_shipped_example_does_not_circle_the_end_of_a_bent_path(
    name: str, lag: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A base that took 0.2 s to have its velocity made it miss the end, and go round once more."""
    planner, settings = read_node(EXAMPLE, ["node.sees=null"])
    monkeypatch.setattr(test_node, "ROBOT", planner.robot)  # type: ignore[attr-defined]
    loop = Lagging(planner, follows=settings.follows, sees=None)  # type: ignore[arg-type]
    loop.lag = lag
    loop.move(people=False)
    points = np.array(BENT[name])
    loop.path(points=points)
    found = []
    while len(found) < 600 and (loop.node.status != "waiting for a path" or loop.motion.any()):
        loop.move(people=False)
        found.append(loop.pose)
    poses = np.array(found)
    away = np.linalg.norm(poses[:, :2] - points[-1], axis=1)
    came = int(np.argmax(away <= NEAR))
    assert len(found) - came <= 3.0 / STEP and away[came:].max() <= NEAR
    bend = np.pi / 2
    assert np.abs(np.diff(poses[:, 2])).sum() <= bend + 1.0
    past = (poses[:, :2] - points[-1]) @ (points[-1] - points[-2])
    assert past.max() / np.linalg.norm(points[-1] - points[-2]) <= NEAR


def test_the_shipped_example_stands_at_the_end_of_its_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At once, and close to it; it used to run 0.6 m past the end and to circle it."""
    planner, settings = read_node(EXAMPLE, ["node.sees=null"])
    assert isinstance(planner, Planner)
    monkeypatch.setattr(test_node, "ROBOT", planner.robot)
    loop = Drive(planner, follows=settings.follows, sees=None)  # type: ignore[arg-type]
    loop.move(people=False)
    end = np.array([6.0, 0.0])
    loop.path(points=((0.0, 0.0), tuple(end)))
    near, past = np.inf, 0.0
    for k in range(500):
        sent = loop.move(people=False)
        past = max(past, float(loop.pose[0] - end[0]))
        near = min(near, k) if np.linalg.norm(loop.pose[:2] - end) <= NEAR else near
        if loop.node.status == "waiting for a path" and not sent.any():
            break
    assert near < k <= near + 3.0 / 0.05
    assert np.linalg.norm(loop.pose[:2] - end) <= NEAR and past <= 0.2
