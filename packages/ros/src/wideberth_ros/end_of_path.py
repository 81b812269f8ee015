"""How a robot of ROS approaches the end of its path, when it is there, and how it turns there."""

from math import atan2, copysign, cos, hypot, inf, sin, sqrt
from typing import final

import numpy as np

from wideberth.framework.control.end_of_path import LEFT, SHARE, SHIFT, EndLimits
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import FARTHEST, Array
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.path_progress import PathProgress


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
