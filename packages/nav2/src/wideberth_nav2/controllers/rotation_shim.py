"""Turn on the spot towards a new path before another controller follows it."""

from dataclasses import dataclass
from math import atan2
from typing import Annotated, final

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Twist

from ..costs import LETHAL
from ..parameters import Limited, NonNegative, Positive, check_parameters, check_work
from ..poses import distance, in_base_frame, rotation_rate, shortest_angle
from .local_controller import CONTROLLER_EXCEPTION, Answer, LocalController, Tick

_AHEAD = 10_000
"""Ticks over which a turn may be tested."""


@final
@dataclass(eq=False)
class RotationShim(LocalController):
    """Nav2's rotation shim around a primary controller.

    At the start of a path, the robot turns on the spot until the point that lies
    `forward_sampling_distance` ahead is no more than `angular_dist_threshold` off its heading
    (`angular_disengage_threshold` once it turns). Then the primary controller follows the path.

    To learn whether the robot is at the goal's place, Nav2 asks a checker of its own with the goal
    checker's tolerance; here the goal checker itself is asked.

    Parameters
    ----------
    primary : follows the path.
    angular_dist_threshold : rad, from which on it turns.
    angular_disengage_threshold : rad, until which it does.
    forward_sampling_distance : m, in a straight line from the start of the plan.
    rotate_to_heading_angular_vel : rad/s.
    max_angular_accel : rad/s^2.
    simulate_ahead_time : s, over which the turn is tested.
    rotate_to_goal_heading : turn at the goal, too.
    rotate_to_heading_once : not for a replanned path to the same goal.
    closed_loop : start from the measured yaw rate, not from the one commanded last.
    use_path_orientations : turn to the heading of that point, not towards it.
    controller_frequency : Hz, of ticks.

    Raises
    ------
    WideberthError : a number that must be above zero and is not, no number where one is wanted, or
        a turn that is tested over more than 10000 ticks.

    References
    ----------
    Nav2, nav2_rotation_shim_controller (Apache-2.0), of which this is an own implementation.
    """

    primary: LocalController
    angular_dist_threshold: Positive = 0.785
    angular_disengage_threshold: NonNegative = 0.3925
    forward_sampling_distance: Positive = 0.5
    rotate_to_heading_angular_vel: Annotated[Positive, Limited("yaw_rate")] = 1.8
    max_angular_accel: Annotated[Positive, Limited("yaw_acceleration")] = 3.2
    simulate_ahead_time: Positive = 1.0
    rotate_to_goal_heading: bool = False
    rotate_to_heading_once: bool = False
    closed_loop: bool = True
    use_path_orientations: bool = False
    controller_frequency: Positive = 20.0

    def __post_init__(self) -> None:
        check_parameters(self, "rotation_shim", ("primary",))
        steps = self.simulate_ahead_time * self.controller_frequency
        check_work("rotation_shim", "simulate_ahead_time and controller_frequency", steps, _AHEAD)
        self._fresh = self._turning = False
        self._goal: Array | None = None
        self._last: float | None = None

    def reset(self) -> None:
        """Forget the last yaw rate; reset the primary controller."""
        self._last, self._turning = None, False
        self.primary.reset()

    def new_path(self, path: Array) -> None:
        """Turn towards the path first, unless it is one to the same goal, see the class."""
        same = self._goal is not None and np.array_equal(self._goal, path[-1])
        self._fresh = not (self.rotate_to_heading_once and same)
        self._goal = path[-1].copy()
        self.primary.new_path(path)

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the primary controller's speed."""
        self.primary.limit_speed(value, percentage)

    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity of the turn or of the primary controller, or why there is none."""
        arrived = self.rotate_to_goal_heading and tick.checker.xy_reached(
            tick.pose, tick.goal, tick.plan
        )
        if arrived:
            return self._turned(tick, shortest_angle(float(tick.pose[2]), float(tick.goal[2])))
        if self._fresh:
            if len(tick.plan) < 2:
                reason = "the plan is too short to turn towards it"
                return Answer.refusal(reason, CONTROLLER_EXCEPTION)
            angle = self._off(tick)
            enough = self.angular_disengage_threshold if self._turning else None
            if abs(angle) > (self.angular_dist_threshold if enough is None else enough):
                self._turning = True
                return self._turned(tick, angle)
            self._fresh = False
        self._turning = False
        answer = self.primary.velocity(tick)
        if answer.twist is not None:
            self._last = float(answer.twist.angular)
        return answer

    def _off(self, tick: Tick) -> float:
        """Angle from the robot's heading to the point ahead, rad."""
        far = [distance(pose, tick.plan[0]) for pose in tick.plan]
        ahead = [i for i in range(1, len(far)) if far[i] >= self.forward_sampling_distance]
        point = tick.plan[ahead[0] if ahead else -1]
        seen = in_base_frame(point[None], tick.pose)[0]
        return float(seen[2]) if self.use_path_orientations else atan2(seen[1], seen[0])

    def _turned(self, tick: Tick, angle: float) -> Answer:
        """Return the yaw rate of a turn by an angle, unless it hits something."""
        measured = self.closed_loop or self._last is None
        now = float(tick.speed[2]) if measured else self._last or 0.0
        period = 1.0 / self.controller_frequency
        rate = rotation_rate(
            angle, now, self.rotate_to_heading_angular_vel, self.max_angular_accel, period
        )
        if self._hits(tick, rate, abs(angle) - self.angular_dist_threshold, period):
            return Answer.refusal("the turn towards the path hits an obstacle")
        self._last = rate
        return Answer(Twist((0.0, 0.0), rate))

    def _hits(self, tick: Tick, rate: float, rest: float, period: float) -> bool:
        """Return whether a turn meets an obstacle or an unknown cell before it is done."""
        x, y, yaw = tick.pose
        passed = 0.0
        while passed < self.simulate_ahead_time:
            passed += period
            if abs(rate * passed) >= rest:
                return False
            pose = np.array([x, y, yaw + rate * passed])
            if tick.footprint.cost(tick.costmap, pose) >= LETHAL:
                return True
        return False
