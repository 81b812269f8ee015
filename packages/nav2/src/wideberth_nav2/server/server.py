"""Nav2's controller server: one path after another, tick by tick, with all that can go wrong."""

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from typing import final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Observation, Twist

from ..controllers.local_controller import NO_VALID_CONTROL, Answer, LocalController, Tick
from ..costmap.footprint import RobotFootprint
from ..goal_checker import GoalChecker
from ..parameters import NonNegative, Positive, check_parameters
from ..path_handler import PathHandler
from ..poses import distance

FOREVER = -1.0
"""Failure tolerance of a server that never gives up."""
_STILL = Twist((0.0, 0.0))


class ServerStatus(StrEnum):
    """How following a path stands; the names are those of Nav2's results.

    `NO_VALID_PATH` is the planner server's, where a route is planned anew.
    """

    RUNNING = "RUNNING"
    SUCCEEDED = "SUCCEEDED"
    CONTROLLER_TIMED_OUT = "CONTROLLER_TIMED_OUT"
    INVALID_PATH = "INVALID_PATH"
    FAILED_TO_MAKE_PROGRESS = "FAILED_TO_MAKE_PROGRESS"
    NO_VALID_CONTROL = "NO_VALID_CONTROL"
    PATIENCE_EXCEEDED = "PATIENCE_EXCEEDED"
    NO_VALID_PATH = "NO_VALID_PATH"
    UNKNOWN = "UNKNOWN"


_STATUS = {
    NO_VALID_CONTROL: ServerStatus.NO_VALID_CONTROL,
    "InvalidPath": ServerStatus.INVALID_PATH,
}


@final
@dataclass(frozen=True, eq=False)
class Step:
    """What one tick of the server commands, and why.

    Attributes
    ----------
    twist : to be published; None where a controller's command was not finite.
    status : neither `RUNNING` nor `SUCCEEDED` means that the path is given up.
    reason : in words, where something is wrong; else "".
    answer : of the controller; None where it was not asked.
    """

    twist: Twist | None
    status: ServerStatus
    reason: str = ""
    answer: Answer | None = None


@final
@dataclass(frozen=True, eq=False)
class ServerView:
    """What the server is given at one tick.

    Attributes
    ----------
    time : s.
    pose : (3,), x, y, m, and yaw, rad, in the frame of the costmap and the path.
    speed : (3,), measured vx, vy, m/s, and yaw rate, rad/s.
    costmap : the local one.
    updated : s, when that was made.
    footprint : of the robot, with its padding.
    track_unknown : whether a cell of unknown cost is free to go.
    observation : the whole of it; None where there is none.
    """

    time: float
    pose: Array
    speed: Array
    costmap: Costmap
    updated: float
    footprint: RobotFootprint
    track_unknown: bool = False
    observation: Observation | None = None


@final
@dataclass(eq=False)
class ProgressChecker:
    """Decides whether a robot has moved far enough in the time that it is allowed.

    Parameters
    ----------
    required_movement_radius : m.
    movement_time_allowance : s.

    Raises
    ------
    WideberthError : a number that is not above zero.
    """

    required_movement_radius: Positive = 0.5
    movement_time_allowance: Positive = 10.0

    def __post_init__(self) -> None:
        check_parameters(self, "progress_checker")
        self._base: tuple[Array, float] | None = None

    def reset(self) -> None:
        """Begin anew at the next call of `progressing`."""
        self._base = None

    def progressing(self, pose: Array, time: float) -> bool:
        """Return whether the robot, at a pose (3,) and a time (s), is not stuck."""
        moved = self._base is None or distance(pose, self._base[0]) > self.required_movement_radius
        if self._base is None or moved:
            self._base = (pose, time)
            return True
        return time - self._base[1] <= self.movement_time_allowance


@final
@dataclass(eq=False)
class ControllerServer:
    """Follows a path with a local controller, in the order of steps of Nav2's server.

    At each tick: see whether the costmap is fresh, prune the path, test the goal, test the
    progress, zero speeds below the thresholds, ask the controller. Where the controller finds no
    valid control, the server stops the robot and goes on for `failure_tolerance` seconds; whatever
    else is wrong ends the action at once, with zero velocity and a reset of the controller.

    Parameters
    ----------
    controller : decides.
    path_handler, goal_checker, progress_checker : see the classes.
    failure_tolerance : s; 0 gives up at once, -1 never.
    min_x_velocity_threshold, min_y_velocity_threshold : m/s, below which a speed is zero.
    min_theta_velocity_threshold : rad/s.
    costmap_update_timeout : s, that a costmap may be late.

    Raises
    ------
    WideberthError : a number that is negative, but for a tolerance of -1.
    """

    controller: LocalController
    path_handler: PathHandler
    goal_checker: GoalChecker
    progress_checker: ProgressChecker
    failure_tolerance: float = 0.0
    min_x_velocity_threshold: NonNegative = 1e-4
    min_y_velocity_threshold: NonNegative = 1e-4
    min_theta_velocity_threshold: NonNegative = 1e-4
    costmap_update_timeout: NonNegative = 0.30

    def __post_init__(self) -> None:
        parts = ("controller", "path_handler", "goal_checker", "progress_checker")
        check_parameters(self, "server", parts)
        if self.failure_tolerance < 0.0 and self.failure_tolerance != FOREVER:
            raise WideberthError(
                f"server.failure_tolerance is {self.failure_tolerance:g}; wanted seconds, 0 to "
                "give up at once, or -1 never to"
            )
        self._goal = np.zeros(3)
        self._valid = -np.inf

    def begin(self, path: Array, time: float) -> None:
        """Start a new action: follow a path (N, 3) from a time (s) on."""
        self.replan(path)
        self.progress_checker.reset()
        self._valid = time

    def replan(self, path: Array) -> None:
        """Follow another path (N, 3) in the same action; the progress counts on."""
        self.controller.new_path(path)
        self.path_handler.set_plan(path)
        self.goal_checker.reset()
        self._goal = path[-1].copy()

    def again(self, time: float) -> None:
        """Start a new action along what is left of the path, from a time (s) on."""
        self.begin(self.path_handler.rest, time)

    def tick(self, seen: ServerView, late: float) -> Step:
        """Return what to command now.

        Parameters
        ----------
        seen : see the class.
        late : s, age that a costmap has between two updates.
        """
        if seen.time - seen.updated > late + self.costmap_update_timeout:
            age = f"the costmap is {seen.time - seen.updated:.2f} s old"
            return self._abort(ServerStatus.CONTROLLER_TIMED_OUT, age)
        plan, reason = self.path_handler.local_plan(seen.costmap, seen.pose)
        if plan is None:
            return self._abort(ServerStatus.INVALID_PATH, reason)
        if self.goal_checker.reached(seen.pose, self._goal, plan):
            self.controller.reset()
            return Step(_STILL, ServerStatus.SUCCEEDED)
        if not self.progress_checker.progressing(seen.pose, seen.time):
            allowance = self.progress_checker.movement_time_allowance
            words = f"the robot has not moved on for {allowance:g} s"
            return self._abort(ServerStatus.FAILED_TO_MAKE_PROGRESS, words)
        answer = self.controller.velocity(
            Tick(
                seen.time, seen.pose, self._measured(seen.speed), plan, self._goal, seen.costmap,
                seen.footprint, seen.track_unknown, self.goal_checker, seen.observation,
            )
        )  # fmt: skip
        return self._judged(answer, seen.time)

    def _judged(self, answer: Answer, time: float) -> Step:
        """Return the controller's command, or what follows from there being none."""
        if answer.twist is not None:
            self._valid = time
            numbers = (*answer.twist.linear, answer.twist.angular)
            if all(isfinite(float(value)) for value in numbers):
                return Step(answer.twist, ServerStatus.RUNNING, "", answer)
            return Step(None, ServerStatus.RUNNING, f"the command {numbers} is not finite", answer)
        if answer.error != NO_VALID_CONTROL or self.failure_tolerance == 0.0:
            return self._abort(
                _STATUS.get(answer.error, ServerStatus.UNKNOWN), answer.reason, answer
            )
        waited = time - self._valid
        if self.failure_tolerance != FOREVER and waited > self.failure_tolerance:
            words = f"no valid control for {waited:.2f} s: {answer.reason}"
            return self._abort(ServerStatus.PATIENCE_EXCEEDED, words, answer)
        return Step(_STILL, ServerStatus.RUNNING, answer.reason, answer)

    def _abort(self, status: ServerStatus, reason: str, answer: Answer | None = None) -> Step:
        """Give the path up."""
        self.controller.reset()
        return Step(_STILL, status, reason, answer)

    def _measured(self, speed: Array) -> Array:
        """Return a measured speed (3,) without what is below the thresholds."""
        least = (
            self.min_x_velocity_threshold, self.min_y_velocity_threshold,
            self.min_theta_velocity_threshold,
        )  # fmt: skip
        return np.where(np.abs(speed) < least, 0.0, speed)
