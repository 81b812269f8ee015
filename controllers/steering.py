"""From a wanted velocity to a command that a robot can follow, and where to want to go."""

import numpy as np

from ..framework.control.command_limits import CRAWL as CRAWL
from ..framework.control.command_limits import FAST as FAST
from ..framework.control.command_limits import attained, turns_on_the_spot
from ..framework.control.command_limits import top_speed as top_speed
from ..framework.numerics.geometry import wrapped
from ..framework.robot import Robot
from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Twist
from ..framework.values.path import Path
from ..framework.values.path_progress import PathProgress

SLOWING = 1.0
"""s; nearer to the goal than this at the present speed, a controller slows down in proportion to
the distance. CrowdNav does the same: its wanted velocity is the way to the goal, at most 1 m/s."""
TURN_GAIN = 2.0
"""1/s, yaw rate per angle between heading and wanted velocity."""


def velocity_of(robot: Robot, state: Array) -> Array | None:
    """Velocity in the world frame, (2,), m/s; None where it is the input, not a state."""
    now = tuple(float(value) for value in state)
    still, other = (robot.twist(now, (value,) * len(robot.inputs)) for value in (0.0, 1.0))
    if still.linear != other.linear:
        return None
    heading = robot.pose(now).heading
    linear = np.array(still.linear, dtype=np.float64)
    if heading is None:
        return linear
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array([cosine * linear[0] - sine * linear[1], sine * linear[0] + cosine * linear[1]])


def steer(robot: Robot, state: Array, velocity: Array, turn_gain: float = TURN_GAIN) -> Command:
    """Command that follows a wanted velocity of a point, in the plane, as well as the robot can.

    A robot without heading takes the velocity as it is. One with heading gets

        v = |v*| max(cos e, 0),    omega = sign(e) min(k |e|, sqrt(2 alpha |e|))

    with e the angle from its heading to v* and k the ``turn_gain``: it turns towards v*, and
    drives no faster than v* in its own direction. The root is the yaw rate from which it can
    still stop turning in time, alpha its largest yaw acceleration; without it, robots that turn
    slowly would swing to and fro about v*. One that cannot turn on the spot has v = |v*| cos e,
    backwards too if it may, and at least `CRAWL` |v*| either way, since it turns only as it
    drives. Either is brought into the limits of speed and yaw rate by ``robot.drive``; the
    acceleration is limited by the robot itself (``ramp`` is 0).

    Parameters
    ----------
    robot, state : who is to move, and its state now, (n,).
    velocity : v*, (2,), m/s, in the world frame.
    turn_gain : k, 1/s.
    """
    heading = robot.pose(tuple(state)).heading
    if heading is None:
        return limited(robot, state, Twist((float(velocity[0]), float(velocity[1]))))
    speed = float(np.hypot(*velocity))
    if not speed:
        return limited(robot, state, Twist((0.0, 0.0)))
    error = wrapped(float(np.arctan2(velocity[1], velocity[0])) - float(heading))
    return limited(robot, state, _turned(robot, state, speed, error, turn_gain))


def _turned(robot: Robot, state: Array, speed: float, error: float, gain: float) -> Twist:
    ahead = float(np.cos(error))
    if turns_on_the_spot(robot, state):
        ahead = max(ahead, 0.0)
    elif attained(robot, state, [Twist((-FAST, 0.0))])[0, 0] < 0.0:
        ahead = float(np.copysign(max(abs(ahead), CRAWL), ahead))
    else:
        ahead = max(ahead, CRAWL)
    return Twist((speed * ahead, 0.0), yaw_rate(robot, state, error, gain))


def yaw_rate(robot: Robot, state: Array, error: float, gain: float = TURN_GAIN) -> float:
    """Yaw rate that turns a robot by ``error`` rad, see `steer`, rad/s."""
    if not error:
        return 0.0
    alpha = yaw_acceleration(robot, state)
    rate = min(gain * abs(error), float(np.sqrt(2.0 * alpha * abs(error))))
    return float(np.copysign(rate, error))


def limited(robot: Robot, state: Array, wanted: Twist) -> Command:
    """Command of the nearest twist that the robot can ever have."""
    reached = attained(robot, state, [wanted])[0]
    return Command((float(reached[0]), float(reached[1])), float(reached[2]))


def yaw_acceleration(robot: Robot, state: Array) -> float:
    """Largest yaw acceleration of a robot with a heading, rad/s^2, at its present speed.

    Infinite for one that turns by its steering angle: how fast that changes its yaw rate
    depends on its speed.
    """
    if not turns_on_the_spot(robot, state):
        return np.inf
    soon = 1e-3
    now = robot.twist(tuple(state), tuple(np.zeros(len(robot.inputs))))
    turning = Twist(now.linear, -np.copysign(FAST, now.angular))
    after = attained(robot, state, [turning], soon)[0, 2]
    return float(abs(after - now.angular) / soon)


class PathGuide:
    """Knows the path and how far along it the robot is, and says where to go."""

    def __init__(self) -> None:
        self._progress: PathProgress | None = None

    @property
    def path(self) -> Path | None:
        """Return the path; None before `follow`."""
        return None if self._progress is None else self._progress.path

    def follow(self, path: Path) -> None:
        """Take this path from now on; go on along one that has only moved a little."""
        self._progress = (self._progress or PathProgress(path)).on(path)

    def reset(self) -> None:
        """Forget the progress; the path stays."""
        if self._progress is not None:
            self._progress = PathProgress(self._progress.path)

    def ahead(self, place: Array, look_ahead: float) -> tuple[Array, float] | None:
        """Return the carrot and the way still to go, m; None without a path.

        Parameters
        ----------
        place : (D,), m, where the robot is.
        look_ahead : m along the path from its nearest point to the carrot, which stops at the
            goal; infinite for the goal itself, straight there.

        Returns
        -------
        carrot : (D,), m.
        way : m, straight to the carrot and along the path from there.
        """
        if self._progress is None:
            return None
        path = self._progress.path
        if look_ahead == np.inf:  # the progress does not matter
            return path.goal, float(np.linalg.norm(path.goal - place))
        self._progress, here = self._progress.advanced(place, look_ahead)
        arc = min(here + look_ahead, path.length)
        carrot = path.at(np.array(arc))
        return carrot, float(np.linalg.norm(carrot - place)) + path.length - arc

    def velocity(self, place: Array, look_ahead: float, speed: float) -> Array:
        """Velocity towards the carrot, (D,), m/s; zero without a path.

        Its length is min(speed, way / `SLOWING`), so that the robot stops at the goal.
        """
        found = self.ahead(place, look_ahead)
        if found is None:
            return np.zeros_like(place)
        carrot, way = found
        apart = carrot - place
        length = float(np.linalg.norm(apart))
        if not length:
            return np.zeros_like(place)
        return np.asarray(min(speed, way / SLOWING) / length * apart)
