"""A robot that drives only as fast as it can stop within what it saw last touches nothing."""

from math import cos, pi, sin, sqrt
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.framework.control.command_limits import attained
from wideberth.framework.robot import Robot
from wideberth.framework.values.footprint import Discs, Outline
from wideberth.framework.values.motion import Pose, Twist
from wideberth.robots import Bicycle, Unicycle
from wideberth.tests.helpers.hall import BEAMS, LONGEST, WIDE, walls
from wideberth.tests.helpers.rays import ranges
from wideberth_ros.room_to_stop import (
    CLOSING,
    DISTANCE,
    REACTION,
    STEPS,
    RoomToStop,
)

ROBOT = Unicycle(radius=0.3, max_yaw_rate=1.0, max_yaw_acceleration=1.0)
CORNERS = ((0.45, 0.2), (-0.45, 0.2), (-0.45, -0.2), (0.45, -0.2))
BOX = Unicycle(radius=0.5, max_yaw_rate=1.0, max_yaw_acceleration=1.0, footprint=Outline(CORNERS))
TWO = Unicycle(
    radius=0.5, max_yaw_rate=1.0, max_yaw_acceleration=1.0,
    footprint=Discs(((0.25, 0.0), (-0.25, 0.0)), 0.25),
)  # fmt: skip
HERE = Pose((1.0, 2.0), 0.4)
OLDEST, TICK = 0.5, 0.05


def line(ahead: float, heading: float = 0.0) -> np.ndarray:
    """Points of a wall across the way of a robot at `HERE`, (N, 2), m."""
    turn = 0.4 + heading
    aside = np.linspace(-3.0, 3.0, 601)[:, None] * [-sin(turn), cos(turn)]
    return np.array([1.0, 2.0]) + ahead * np.array([cos(turn), sin(turn)]) + aside


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("age", [0.0, 0.2])
@pytest.mark.parametrize("free", [0.05, 0.1, 0.2, 0.3, 0.6])
def test_before_a_wall_it_keeps_the_speed_from_which_it_can_stop(
    free: float, age: float, sign: float
) -> None:
    """To within the way of one of the instants that are looked at."""
    speed, brakes = 0.5, ROBOT.max_acceleration
    wall = line(sign * (0.3 + DISTANCE + CLOSING * age + free))
    found = RoomToStop(ROBOT, OLDEST).allowed(Twist((sign * speed, 0.0)), HERE, wall, age)
    touches = free / (speed + CLOSING)
    stops = REACTION + 0.5 * speed / brakes
    low, high = (
        min(
            sqrt((brakes * REACTION) ** 2 + 2.0 * brakes * speed * time) - brakes * REACTION, speed
        )
        for time in (max(touches - stops / STEPS, 0.0), touches)
    )
    assert low - 1e-9 <= sign * float(found.linear[0]) <= high + 1e-9


def test_the_curve_stays() -> None:
    twist = Twist((0.5, 0.0), 0.7)
    found = RoomToStop(ROBOT).allowed(twist, HERE, line(0.45), 0.1)
    assert 0.0 < found.linear[0] < 0.5
    assert found.angular / found.linear[0] == pytest.approx(0.7 / 0.5)


def test_what_is_far_or_behind_changes_nothing() -> None:
    room, twist = RoomToStop(ROBOT), Twist((0.5, 0.0), -0.3)
    for points in (np.zeros((0, 2)), line(5.0), line(-0.31), line(0.34, pi / 2)):
        assert room.allowed(twist, HERE, points, 0.1) is twist


def test_who_is_too_near_already_is_left() -> None:
    room, away, closer = RoomToStop(ROBOT), Twist((-0.5, 0.0)), Twist((0.1, 0.0))
    assert room.allowed(away, HERE, line(0.25), 0.1) is away
    assert room.allowed(closer, HERE, line(0.25), 0.1).linear == (0.0, 0.0)


@pytest.mark.parametrize("age", [OLDEST + 0.01, np.inf, np.nan])
def test_by_old_points_it_stands(age: float) -> None:
    found = RoomToStop(ROBOT, OLDEST).allowed(Twist((0.5, 0.0), 0.3), HERE, np.zeros((0, 2)), age)
    assert found.linear == (0.0, 0.0) and found.angular == 0.0


def test_a_robot_that_is_nowhere_stands() -> None:
    for place in ((np.nan, 0.0), (1e300, 0.0)):
        found = RoomToStop(ROBOT).allowed(Twist((0.5, 0.0)), Pose(place, 0.0), line(5.0), 0.0)
        assert found.linear == (0.0, 0.0)


def test_an_age_of_zero_is_refused() -> None:
    with pytest.raises(WideberthError, match="room_to_stop"):
        RoomToStop(ROBOT, 0.0)


@pytest.mark.parametrize(("robot", "turns"), [(ROBOT, True), (BOX, False), (TWO, False)])
def test_beside_a_wall_only_a_disc_turns_freely(robot: Robot, turns: bool) -> None:
    spin = Twist((0.0, 0.0), 1.0)
    found = RoomToStop(robot).allowed(spin, HERE, line(0.34, pi / 2), 0.0)
    assert (found is spin) == turns and (turns or 0.0 < found.angular < 1.0)


class Wild:
    """A robot that is driven at random in a hall, and sees it by scans that come late."""

    def __init__(self, robot: Robot, seed: int, guarded: bool) -> None:
        self.robot, self.rng = robot, np.random.default_rng(seed)
        self.room = RoomToStop(robot, OLDEST) if guarded else None
        self.pose, self.last = np.array([1.0, 1.0, 0.0]), np.zeros(3)
        self.seen: tuple[float, np.ndarray] = (-np.inf, np.zeros((0, 2)))
        self.coming: list[tuple[float, float, np.ndarray]] = []
        self.gap, self.way = np.inf, 0.0

    def scan(self, now: float) -> None:
        """Cast a scan that comes up to 1 s later, if at all."""
        if self.rng.random() < 0.3:
            return
        bearings = self.pose[2] + 2.0 * pi / BEAMS * np.arange(BEAMS)
        found = ranges(self.pose[:2], bearings, np.zeros((0, 2)), WIDE, walls())
        found += 0.01 * self.rng.standard_normal(BEAMS)
        ends = self.pose[:2] + found[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], -1)
        due = now + self.rng.choice([0.0, self.rng.uniform(0.0, 1.0)], p=[0.7, 0.3])
        self.coming.append((due, now, ends[found <= LONGEST]))

    def next(self, aim: Twist) -> np.ndarray:
        """Return the velocity that it can have one period later."""
        forward, aside, rate = self.last.tolist()
        state = self.robot.state_at(Pose((0.0, 0.0), 0.0), Twist((forward, aside), rate))
        return np.asarray(attained(self.robot, np.array(state, float), [aim], TICK)[0])

    def move(self, now: float, aim: Twist) -> None:
        """Send a velocity and drive on an arc for a period."""
        for one in [one for one in self.coming if one[0] <= now]:
            self.coming.remove(one)
            self.seen = max(self.seen, one[1:], key=lambda row: row[0])
        sent = self.next(aim)
        if self.room is not None:
            forward, aside, rate = sent.tolist()
            wanted, (x, y, heading) = Twist((forward, aside), rate), self.pose.tolist()
            stamp, points = self.seen
            ok = self.room.allowed(wanted, Pose((x, y), heading), points, now - stamp)
            sent = sent if ok is wanted else self.next(ok)
        turn, way = TICK * sent[2], TICK * sent[0]
        middle, chord = self.pose[2] + 0.5 * turn, way * np.sinc(0.5 * turn / pi)
        self.pose += [chord * cos(middle), chord * sin(middle), turn]
        self.way += abs(way)
        self.gap = min(self.gap, self.clear())
        self.last = sent

    def clear(self) -> float:
        """Gap between its body and the walls, m."""
        corners: Any = ((0.0, 0.0),)
        body, radius = self.robot.footprint, self.robot.radius
        if isinstance(body, Discs):
            corners, radius = body.centres, body.radius
        elif isinstance(body, Outline):
            corners, radius = [np.array(body.vertices)[i] * 0.999 for i in range(4)], 0.0
        cosine, sine = cos(self.pose[2]), sin(self.pose[2])
        gaps = []
        for x, y in corners:
            shift = np.array([cosine * x - sine * y, sine * x + cosine * y])
            place = self.pose[:2] + shift
            begin, edge = walls()[:, 0], np.diff(walls(), axis=1)[:, 0]
            share = ((place - begin) * edge).sum(axis=1) / (edge**2).sum(axis=1)
            foot = begin + np.clip(share, 0.0, 1.0)[:, None] * edge
            gaps.append(np.hypot(*(foot - place).T).min() - radius)
        return float(min(gaps))


def wild(robot: Robot, seed: int, guarded: bool, seconds: float = 20.0) -> Wild:
    """Drive with any velocity, each for up to 2 s, that a mad controller may want."""
    drive, until, aim = Wild(robot, seed, guarded), 0.0, Twist((0.0, 0.0))
    for k in range(round(seconds / TICK)):
        if k % 2 == 0:
            drive.scan(k * TICK)
        if k * TICK >= until:
            until += drive.rng.uniform(0.1, 2.0)
            speed = drive.rng.choice([0.7, 0.4, -0.4])
            aim = Twist((speed, 0.0), drive.rng.normal(0.0, 0.5))
        drive.move(k * TICK, aim)
    return drive


@pytest.mark.parametrize("robot", [ROBOT, TWO, Bicycle(radius=0.3)], ids=["disc", "two", "car"])
def test_whatever_a_controller_wants_no_wall_is_touched(robot: Robot) -> None:
    """By scans of which a third is lost, and as many come up to 1 s late."""
    guarded = [wild(robot, seed, True) for seed in range(20)]
    assert min(one.gap for one in guarded) > 0.0
    assert np.mean([one.way for one in guarded]) > 1.5
    assert sum(wild(robot, seed, False).gap < 0.0 for seed in range(10)) >= 6
