"""When a goal counts as reached: Nav2's SimpleGoalChecker."""

from dataclasses import dataclass
from math import pi
from typing import final

from wideberth.framework.values.arrays import Array

from .parameters import NonNegative, check_parameters
from .poses import length, shortest_angle


@final
@dataclass(eq=False)
class GoalChecker:
    """Decides whether a robot is at its goal; the controllers ask it, too, and change its memory.

    The place is reached where the plan's rest is no longer than `path_length_tolerance` and

        (x - x_goal)^2 + (y - y_goal)^2 <= xy_goal_tolerance^2,

    and the goal where, besides, the heading is off by no more than `yaw_goal_tolerance`.

    Parameters
    ----------
    xy_goal_tolerance : m.
    yaw_goal_tolerance : rad.
    path_length_tolerance : m.
    stateful : a place once reached stays so while the robot turns.
    xy_goal_tolerance_buffer : m; farther off than both together a place is lost again; 0: never.
    symmetric_yaw_tolerance : a robot that faces backwards has reached its goal as well.

    Raises
    ------
    WideberthError : a number that is negative or not finite.
    """

    xy_goal_tolerance: NonNegative = 0.25
    yaw_goal_tolerance: NonNegative = 0.25
    path_length_tolerance: NonNegative = 1.0
    stateful: bool = True
    xy_goal_tolerance_buffer: NonNegative = 0.0
    symmetric_yaw_tolerance: bool = False

    def __post_init__(self) -> None:
        check_parameters(self, "goal_checker")
        self._latched = False

    def reset(self) -> None:
        """Forget that the place was reached."""
        self._latched = False

    def xy_reached(self, pose: Array, goal: Array, plan: Array) -> bool:
        """Return whether the place of the goal is reached, and remember it.

        Parameters
        ----------
        pose, goal : (3,).
        plan : (N, 3), its rest.
        """
        if length(plan) > self.path_length_tolerance:
            return False
        dx, dy = float(pose[0] - goal[0]), float(pose[1] - goal[1])
        square = dx * dx + dy * dy
        if not self._latched:
            reached = square <= self.xy_goal_tolerance**2
            self._latched = reached and self.stateful
            return reached
        buffer = self.xy_goal_tolerance_buffer
        if buffer > 0.0 and square > (self.xy_goal_tolerance + buffer) ** 2:
            self._latched = False
            return False
        return True

    def reached(self, pose: Array, goal: Array, plan: Array) -> bool:
        """Return whether the goal is reached; arguments as in `xy_reached`."""
        if not self.xy_reached(pose, goal, plan):
            return False
        off = abs(shortest_angle(float(goal[2]), float(pose[2])))
        if self.symmetric_yaw_tolerance:
            off = min(off, pi - off)
        return off <= self.yaw_goal_tolerance
