"""Following one path, or driving to one goal, with the results that Nav2's servers have."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import final

import numpy as np

from wideberth.framework.mpc.planner.standing import BLOCKED
from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.values.arrays import Array, positive

from .decoding import Goal
from .end_of_path import Arrival
from .node import PlannerNode

NO_ODOMETRY = "where the robot is is not known: there is no odometry"


class ResultCode(IntEnum):
    """Results of Nav2's action FollowPath, by its numbers."""

    NONE = 0
    UNKNOWN = 100
    TF_ERROR = 102
    INVALID_PATH = 103
    FAILED_TO_MAKE_PROGRESS = 105
    NO_VALID_CONTROL = 106
    CONTROLLER_TIMED_OUT = 107


@final
@dataclass(frozen=True)
class End:
    """How following a path has ended: by success where the code is `ResultCode.NONE`."""

    code: ResultCode
    reason: str = ""


@final
@dataclass(frozen=True)
class Following:
    """When a path counts as followed, and when it is given up; the defaults are Nav2's.

    Parameters
    ----------
    tolerance : m from the last point, within which the robot is there and brakes, see
        `wideberth_ros.end_of_path.Arrival`.
    yaw_tolerance : rad, by which its heading may be off that of the last pose; it turns on the
        spot. From pi on any heading will do.
    slow : m/s, below which it stands.
    progress : m, by which it has to move in ``allowance`` s.
    progress_angle : rad, by which it has to turn in that time where it is there already.
    allowance : s.
    patience : s, for which the controller may fail, or messages be missing.

    Raises
    ------
    WideberthError : a number that is not above zero.
    """

    tolerance: float = 0.25
    yaw_tolerance: float = 0.25
    slow: float = 0.1
    progress: float = 0.5
    progress_angle: float = 0.5
    allowance: float = 10.0
    patience: float = 2.0

    def __post_init__(self) -> None:
        for one in fields(self):
            positive(f"following.{one.name}", getattr(self, one.name))


class Follower(ABC):
    """Follows one goal of an action with a node; `step` returns how that has ended.

    Parameters
    ----------
    node : that drives. settings : when it ends. now : s, on the clock of all steps.
    """

    def __init__(self, node: PlannerNode, settings: Following, now: float) -> None:
        self.node: PlannerNode = node
        self.settings: Following = settings
        self.speed: float = 0.0
        """m/s, of the robot."""
        self._place: Array | None = None
        self._moved = self._well = now
        self._failures, self._plans = node.counts.failures, node.counts.plans

    @property
    @abstractmethod
    def there(self) -> bool:
        """Whether the robot is where it was asked to be, and turns or stands."""

    @abstractmethod
    def _ended(self, pose: Array) -> End | None:
        """Return how following has ended for a robot at a pose (3,); None while it goes on."""

    @property
    def distance(self) -> float:
        """Distance from the robot to the end of its path, straight, m."""
        path, motion = self.node.path, self.node.motion
        if path is None or motion is None:
            return 0.0
        return float(np.linalg.norm(path.goal - motion[0][:2]))

    def step(self, now: float) -> End | None:
        """Follow on; return how following has ended, or None while it goes on."""
        motion, wanted = self.node.motion, self.settings
        if motion is None:
            return End(ResultCode.TF_ERROR, NO_ODOMETRY)
        self.speed = float(np.hypot(*motion[1][:2]))
        end = self._ended(motion[0])
        if end is not None:
            return end
        self._note_progress(motion[0], now)
        waits, counts = self.node.waits_for(), self.node.counts
        planned = counts.plans > self._plans or self.there
        if planned and counts.failures == self._failures and not waits:
            self._well = now
        failed = counts.failures > self._failures
        self._failures, self._plans = counts.failures, counts.plans
        if now - self._well > wanted.patience:
            if waits:
                return End(ResultCode.CONTROLLER_TIMED_OUT, waits)
            if failed or "failed" in self.node.status:
                return End(ResultCode.NO_VALID_CONTROL, self.node.status)
            return End(ResultCode.CONTROLLER_TIMED_OUT, "the planner does not answer")
        if now - self._moved > wanted.allowance:
            reason = f"it moved less than {wanted.progress:g} m in {wanted.allowance:g} s"
            if self.node.status.startswith(BLOCKED):
                reason = f"{reason}; {self.node.status}"
            return End(ResultCode.FAILED_TO_MAKE_PROGRESS, reason)
        return None

    def _note_progress(self, pose: Array, now: float) -> None:
        """Note when the robot has moved, or turned at the end of its path, far enough."""
        old, wanted = self._place, self.settings
        moved = old is None or bool(np.linalg.norm(pose[:2] - old[:2]) >= wanted.progress)
        if self.there and old is not None:
            moved = moved or abs(wrapped(float(pose[2] - old[2]))) >= wanted.progress_angle
        if moved:
            self._place, self._moved = pose, now


@final
class PathFollower(Follower):
    """Follows one path to its end; parameters as of `Follower`."""

    def __init__(self, node: PlannerNode, settings: Following, now: float) -> None:
        super().__init__(node, settings, now)
        self._frame, self._heading = "", float("nan")
        self._arrival = Arrival(settings.tolerance)

    def begin(self, frame: str, points: Array, heading: float = float("nan")) -> End | None:
        """Take the path; return why it cannot be followed.

        Parameters
        ----------
        frame : of the path. points : (P, 2), m; one leads there straight, as with Nav2.
        heading : rad, wanted at its end; NaN for any. It is passed over where the robot cannot
            turn on the spot.
        """
        if not len(points):
            return End(ResultCode.INVALID_PATH, "the path has no poses; wanted one at least")
        if self.node.motion is None:
            return End(ResultCode.TF_ERROR, NO_ODOMETRY)
        if not self.node.follow(frame, points):
            return End(ResultCode.INVALID_PATH, f"the path in {frame!r} cannot be followed")
        if self.node.turns_on_the_spot:
            self._frame, self._heading = frame, heading
        return None

    @property
    def there(self) -> bool:
        """Whether the robot is at the end of its path."""
        return self._arrival.there

    def _ended(self, pose: Array) -> End | None:
        path = self.node.path
        if path is None:
            return End(ResultCode.UNKNOWN, "the path was taken away")
        was = self.there
        self._arrival.update(path, pose[:2])
        if was and not self.there:
            self.node.drive_on()
        stands = self.speed <= self.settings.slow
        return End(ResultCode.NONE) if self.there and self._turned() and stands else None

    def _turned(self) -> bool:
        """Whether nothing is left to turn; a robot at the end of its path stands, and turns."""
        left = self.node.turn(self._frame, self._heading)
        return not np.isfinite(self._heading) or abs(left) <= self.settings.yaw_tolerance


@final
class GoalFollower(Follower):
    """Drives to one goal, to which the node finds the way; parameters as of `Follower`."""

    def begin(self, frame: str, goal: Goal) -> None:
        """Take the goal, of a frame."""
        self._goal = goal
        self.node.go(frame, goal)

    @property
    def there(self) -> bool:
        """Whether the robot turns at its goal."""
        return self.node.turns

    def _ended(self, pose: Array) -> End | None:
        if self.node.goal is self._goal:
            return None
        if self.node.goal is not None:
            return End(ResultCode.UNKNOWN, "another goal took its place")
        return End(ResultCode.NONE) if self.speed <= self.settings.slow else None
