"""The loop in which conformal planners were compared: rows of a recording, and a unicycle."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from wideberth.framework.controller import Controller, DrivesRobot
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.predictors.data.recordings import Recording
from wideberth.robots.unicycle import Unicycle

PERSON = float(1.0 / np.sqrt(2.0))
"""m, radius of a person."""
NEAR = 0.6
"""m from the goal at which the robot has arrived."""
STANDING = 15
"""Rows at which the robot stands at first; nothing is counted then."""
MOST = 100
"""Rows of an episode."""
NEW = 2.0
"""s; who is hit sooner than this after the recording first has them, is a newcomer."""
STILL = 0.05
"""m/s; a robot slower than this has been run into."""
ROBOT = Unicycle(0.4, 0.8, 0.7, 1e3, 1e3)
"""The robot: its velocities may jump."""
REACH = ROBOT.radius + PERSON
"""m between the centres, below which a row counts as a hit."""


@dataclass(frozen=True, eq=False)
class RecordedCourse:
    """A recording with a start and a goal.

    Attributes
    ----------
    recording : one row is one decision.
    start : x, y, m, and heading, rad. goal : (2,), m.
    """

    recording: Recording
    start: tuple[float, float, float]
    goal: tuple[float, float]

    @cached_property
    def seen(self) -> BoolArray:
        """Who is seen at each row, (O, T): there now and one row before, as published."""
        here: BoolArray = np.asarray(np.isfinite(self.recording.positions).all(axis=2))
        return here & np.roll(here, 1, axis=1) & (np.arange(here.shape[1]) > 0)

    @cached_property
    def rows(self) -> tuple[int, ...]:
        """Rows at which someone is seen; the published loop leaves the others out."""
        return tuple(int(row) for row in np.flatnonzero(self.seen.any(axis=0)))

    def episode(self, first: int, most: int = MOST) -> tuple[int, ...]:
        """Return the rows of an episode from ``first`` on; fewer at the recording's end."""
        return tuple(row for row in self.rows if row >= first)[:most]

    def people(self, row: int) -> tuple[list[int], Array]:
        """Return who is seen at a row, and where, (K, 2), m."""
        who = [int(index) for index in np.flatnonzero(self.seen[:, row])]
        return who, self.recording.positions[who, row]

    def observation(
        self, robot: Robot, row: int, pose: Array, twist: Twist, radius: float = PERSON
    ) -> Observation:
        """Return what a robot sees at a row: everyone, at once and exactly, of that radius, m."""
        who, places = self.people(row)
        x, y, heading = (float(value) for value in pose)
        state = np.array(robot.state_at(Pose((x, y), heading), twist), dtype=np.float64)
        seen = tuple(
            Detection(self.recording.ids[one], place, np.zeros((2, 2)), radius)
            for one, place in zip(who, places, strict=True)
        )
        truth = self.recording.truth()
        return Observation(float(self.recording.times[row]), state, seen, truth=truth)


@dataclass(frozen=True, eq=False)
class Drive:
    """An episode.

    Attributes
    ----------
    rows : (T,), of the recording.
    standing : rows at first at which the robot stands and nothing is counted.
    poses : (T, 3), m and rad, at each row, before it moves. speeds : (T,), m/s, on the way there.
    nearest : (T,), m, from the nearest person's centre. who : (T,), the index of that one.
    failed : (T,), whether it stood there for want of a plan.
    left : (T,), m, to the goal.
    """

    rows: Array
    standing: int
    poses: Array
    speeds: Array
    nearest: Array
    who: Array
    failed: BoolArray
    left: Array

    def arrival(self, *, last: bool = False) -> int | None:
        """Return the place of the row at which the robot was first at the goal; None if never.

        With ``last`` that of the last row at which it was there, as one published loop has it.
        """
        there = np.flatnonzero(self.left[self.standing :] <= NEAR)
        return int(there[-1 if last else 0]) + self.standing if len(there) else None

    @property
    def judged(self) -> slice:
        """The rows that count: those after standing and before the arrival."""
        return slice(self.standing, self.arrival())

    @property
    def hits(self) -> BoolArray:
        """Whether someone is too near, at each row that counts."""
        return np.asarray(self.nearest[self.judged] < REACH)

    def kinds(self, course: RecordedCourse) -> dict[str, int]:
        """Count hits by kind: newcomers, those at which the robot stood, and its own."""
        hit = np.flatnonzero(self.nearest < REACH)
        chosen = range(*self.judged.indices(len(self.rows)))
        found = {"newcomers": 0, "standing": 0, "own": 0}
        for k in (int(one) for one in hit if one in chosen):
            track = np.isfinite(course.recording.positions[int(self.who[k])]).all(axis=1)
            age = (int(self.rows[k]) - int(np.argmax(track))) * course.recording.dt
            if age < NEW + 1e-9:
                found["newcomers"] += 1
            else:
                found["standing" if abs(self.speeds[k]) < STILL else "own"] += 1
        return found


@dataclass(eq=False)
class _Log:
    """What an episode has been so far; see `Drive`."""

    rows: list[int] = field(default_factory=list)
    poses: list[Array] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    nearest: list[float] = field(default_factory=list)
    who: list[int] = field(default_factory=list)
    failed: list[bool] = field(default_factory=list)
    left: list[float] = field(default_factory=list)

    def add(self, course: RecordedCourse, row: int, pose: Array, speed: float) -> None:
        who, places = course.people(row)
        away = np.sqrt(np.sum((places - pose[:2]) ** 2, axis=1))
        nearest = int(np.argmin(away)) if len(away) else -1
        self.rows.append(row)
        self.poses.append(pose)
        self.speeds.append(speed)
        self.nearest.append(float(away[nearest]) if len(away) else np.inf)
        self.who.append(who[nearest] if len(away) else -1)
        self.failed.append(False)
        self.left.append(float(np.sqrt(np.sum((pose[:2] - course.goal) ** 2))))

    def closed(self, standing: int) -> Drive:
        return Drive(
            np.array(self.rows),
            standing,
            np.array(self.poses).reshape(-1, 3),
            np.array(self.speeds),
            np.array(self.nearest),
            np.array(self.who),
            np.array(self.failed, dtype=np.bool_),
            np.array(self.left),
        )


def drive(
    controller: Controller,
    course: RecordedCourse,
    rows: Sequence[int],
    *,
    standing: int = STANDING,
    to_the_end: bool = False,
    radius: float = PERSON,
) -> Drive:
    """Play an episode: at each row the robot sees, decides, and drives on by Euler's rule.

        p <- p + dt v (cos th, sin th),    th <- th + dt w

    with the velocities of the command, at once: those of the robot jump. People are replayed.

    Parameters
    ----------
    controller : it is reset.
    course : where it drives, and among whom.
    rows : of the recording, see `RecordedCourse.episode`.
    standing : rows at first at which the robot sees without deciding.
    to_the_end : whether it goes on after it has arrived.
    radius : m, of the people, as the controller is given it.
    """
    robot = controller.robot if isinstance(controller, DrivesRobot) else ROBOT
    dt, log = course.recording.dt, _Log()
    pose, twist = np.array(course.start, dtype=np.float64), Twist((0.0, 0.0))
    controller.reset()
    controller.set_path(Path(np.array([course.start[:2], course.goal])))
    for k, row in enumerate(rows):
        log.add(course, row, pose, float(twist.linear[0]))
        if k >= standing and log.left[-1] <= NEAR and not to_the_end:
            break
        seen = course.observation(robot, row, pose, twist, radius)
        if k < standing:
            controller.remember(seen)
            continue
        command = controller.command(seen)
        log.failed[-1] = stood_still(controller)
        twist = Twist((command.linear[0], 0.0), command.omega)
        way = dt * command.linear[0] * np.array([np.cos(pose[2]), np.sin(pose[2])])
        pose = pose + np.array([*way, dt * command.omega])
    return log.closed(standing)


@runtime_checkable
class GivesReason(Protocol):
    """A controller without a plan that says why it stands still."""

    @property
    @abstractmethod
    def reason(self) -> str:
        """Why the last command was to stand still instead of a decision; empty if it was one."""


def stood_still(controller: Controller) -> bool:
    """Whether the last command was not that of a new plan."""
    if controller.last_plan is not None:
        return controller.last_plan.rung not in ("optimal", "feasible iterate")
    return isinstance(controller, GivesReason) and bool(controller.reason)
