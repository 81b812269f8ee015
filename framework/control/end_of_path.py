"""The end of a path: how fast a robot approaches it, when it is there, and how it turns there."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, inf, sin, sqrt
from typing import final

import numpy as np

from ..robot import Robot
from ..values.arrays import FARTHEST, Array
from ..values.motion import Detection, Pose, Twist
from ..values.path import Path
from ..values.path_progress import PathProgress
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


@final
class Approach:
    """Slows a robot near the end of its path, so that it neither passes the end nor circles it.

    With d the distance to the end, s the larger of d and what is left of the path, beta the angle
    from the direction of motion to that of the end, the robot's deceleration a and yaw rate w::

        v <= sqrt(2 a s)    v <= w d / (2 |sin beta|) with at most `LEFT` m of the path ahead

    each with `SHARE` of a and w. d / (2 |sin beta|) is the radius of the circle through the end
    to which the motion is tangent: a robot that is faster than it can turn on it has the end
    within its own circle, and a planner for which to brake costs more than to turn keeps it there
    for half a minute. The yaw rate is limited by `EndLimits.turning`. The second limit is none for
    a robot that cannot turn on the spot: a car's circle does not shrink with its speed.

    Parameters
    ----------
    robot : in the plane.
    """

    def __init__(self, robot: Robot) -> None:
        self._limits = limits = EndLimits.of(robot)
        self._braking, self._turning = SHARE * limits.braking, SHARE * limits.yaw_rate
        self._headed = robot.pose((0.0,) * len(robot.states)).heading is not None
        self._progress: PathProgress | None = None

    def limited(self, path: Path, pose: Pose, twist: Twist) -> Twist:
        """Return a twist within the limits; the same one where it keeps them.

        Parameters
        ----------
        path : that is followed. pose : of the robot. twist : that is wanted, see `Robot.twist`.
        """
        place, speed = np.array(pose.position, dtype=np.float64), hypot(*twist.linear)
        if not (np.abs(place) <= FARTHEST).all():
            return twist
        before = self._progress or PathProgress(path)
        self._progress, arc = before.on(path).advanced(place)
        away, left = path.goal - place, path.length - arc
        apart = hypot(*away)
        most = sqrt(2.0 * self._braking * max(apart, left))
        if left <= LEFT and self._turning:
            way = atan2(twist.linear[1], twist.linear[0])
            way += float(pose.heading) if self._headed else 0.0  # type: ignore[arg-type]
            across = abs(cos(way) * away[1] - sin(way) * away[0])  # d |sin beta|
            most = min(most, 0.5 * self._turning * apart**2 / across if across else inf)
        share, rate = min(1.0, most / speed) if speed else 1.0, float(twist.angular)
        if left <= LEFT:
            rate = self._limits.turning(apart, share * speed, rate)
        if share == 1.0 and rate == twist.angular:
            return twist
        return Twist(tuple(share * one for one in twist.linear), rate)


@final
class Arrival:
    """Decides whether a robot is at the end of its path.

    A robot that is there stays there up to twice the tolerance, until a path with another goal
    comes.

    Parameters
    ----------
    tolerance : m from the last point, within which the robot is there, if at most `LEFT` m of
        the path are ahead.
    """

    def __init__(self, tolerance: float) -> None:
        self.there: bool = False
        """Whether it was there at the last update."""
        self._tolerance = tolerance
        self._progress: PathProgress | None = None

    def update(self, path: Path, place: Array) -> bool:
        """Return whether a robot at a place, (2,) in m, is at the end of its path."""
        if not (np.abs(place) <= FARTHEST).all():
            self.there = False
            return False
        before = self._progress or PathProgress(path)
        self.there = self.there and float(np.linalg.norm(path.goal - before.path.goal)) <= SHIFT
        self._progress, arc = before.on(path).advanced(place)
        distance = float(np.linalg.norm(path.goal - place))
        near = distance <= (1.0 + self.there) * self._tolerance
        self.there = near and path.length - arc <= LEFT
        return self.there


@final
class Spin:
    """Turns a standing robot on the spot to a heading.

    The yaw rate w of a robot whose heading is off by e brakes in time at half of its deceleration
    a, and dies out in a few periods P::

        w = sign(e) min(sqrt(a |e|), |e| / (4 P))

    Parameters
    ----------
    robot : in the plane. period : s between two commands.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        limits = EndLimits.of(robot)
        self._period = period
        self._acceleration = min(limits.yaw_acceleration, limits.yaw_rate / period)

    def rate(self, off: float) -> float:
        """Return the yaw rate, rad/s, of a robot that has to turn by an angle, rad."""
        size = abs(off)
        return copysign(min(sqrt(self._acceleration * size), 0.25 * size / self._period), off)
