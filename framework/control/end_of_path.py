"""The end of a path: how fast a robot approaches it, when it is there, and how it turns there."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import copysign, sqrt
from typing import final

import numpy as np

from ..robot import Robot
from ..values.arrays import Array
from ..values.motion import Detection, Pose, Twist
from .command_limits import FAST, FOREVER, attained, deceleration

LEFT = 1.0
"""m of the path; with more of it ahead, a robot beside the path's end only passes by."""
SHIFT = 0.02
"""m; a path that comes once more, whose end has moved no further, has the same end."""
SHARE = 0.8
"""Of the robot's deceleration and yaw rate, that an approach counts on."""
NEAR, STEP = 0.25, 1.0
"""m and s, see `EndLimits.turning`."""
SOON = 1e-3
"""s, in which the acceleration of the yaw rate is measured."""
CREEP = 0.1
"""m/s, at which the turning circle is measured."""
RUN_UP = 1.0
"""m that a car backs off beyond the place from which its circle leads to the end: to steer."""


@final
@dataclass(frozen=True)
class EndLimits:
    """What a robot can do near the end of its path; the exported planner has the same numbers.

    Parameters
    ----------
    braking : m/s^2. yaw_rate : rad/s, on the spot; 0 for a robot that cannot turn there.
    yaw_acceleration : rad/s^2, from a standstill.
    circle : m, radius of the smallest turning circle; 0 for a robot that needs none.
    reverses : whether it drives backwards.
    """

    braking: float
    yaw_rate: float
    yaw_acceleration: float
    circle: float
    reverses: bool

    @classmethod
    def of(cls, robot: Robot) -> "EndLimits":
        """Return the limits of a robot in the plane."""
        still, turn = np.zeros(len(robot.states)), [Twist((0.0, 0.0), FAST)]
        rate, soon = (float(attained(robot, still, turn, time)[0, 2]) for time in (FOREVER, SOON))
        circle, reverses = 0.0, float(attained(robot, still, [Twist((-FAST, 0.0))])[0, 0]) < 0.0
        if robot.pose(tuple(still)).heading is not None and not rate:
            slow = np.array(robot.state_at(Pose((0.0, 0.0), 0.0), Twist((CREEP, 0.0))), np.float64)
            circle = CREEP / float(attained(robot, slow, [Twist((CREEP, 0.0), FAST)])[0, 2])
        return cls(deceleration(robot), rate, soon / SOON, circle, reverses)

    def backing(self, ahead: float, aside: float) -> float:
        """Return how far a car has to back off, straight, before it can drive to a place, m.

        With the place d ahead of it and e beside it, and R the radius of its turning circle, it
        reaches the place on that circle from b behind, and needs `RUN_UP` to steer::

            b = sqrt(2 R e - e^2) - d + `RUN_UP`      e <= R

        Parameters
        ----------
        ahead : d, m; negative behind the car. aside : e, m, to either side.
        """
        aside = min(abs(aside), self.circle)
        return max(sqrt(aside * (2.0 * self.circle - aside)) - ahead, 0.0) + RUN_UP

    def turning(self, away: float, speed: float, rate: float) -> float:
        """Return a yaw rate, rad/s, that a robot near the end of its path still has a reason for.

        A robot that stands at the end is asked for no heading, and a planner that prices yaw
        accelerations alone would let it go on turning. With d the distance to the end, v the
        speed, w the yaw rate on the spot and T = `STEP`::

            |omega| <= w max(d, v T) / `NEAR`

        It stays as it is for a robot that cannot turn on the spot.

        Parameters
        ----------
        away : m. speed : m/s. rate : rad/s, that is wanted.
        """
        most = self.yaw_rate * max(away, STEP * speed) / NEAR
        return copysign(min(abs(rate), most), rate) if self.yaw_rate else rate


def goal_taken(goal: Array, detections: Iterable[Detection], room: float) -> bool:
    """Return whether a detected body leaves no room at a goal, (D,), m.

    Parameters
    ----------
    room : m, radius of the robot and margin.
    """
    return any(
        float(np.linalg.norm(body.position - goal)) < room + body.radius for body in detections
    )
