"""Limits on commands, and the nearest command within them."""

from collections.abc import Iterable
from math import isfinite, nan

import numpy as np

from ..robot import Bounds, Robot
from ..values.arrays import Array
from ..values.motion import Command, Pose, Twist

ALLOWANCE = 1e-3
"""By how much a command may be beyond a limit, in the limit's own unit: ten times the tolerance
to which plans are checked."""

FAST = 1e3
"""m/s and rad/s, asked of `Robot.drive`, which stays within the limits."""

CRAWL = 0.3
"""Share of the wanted speed that a robot keeps which cannot turn on the spot."""

FOREVER = 1024.0
"""s, long enough for every robot to have any twist that it can have; a power of two, so that
dividing by it and multiplying with it changes no digit."""


def attained(
    robot: Robot, state: Array, twists: Iterable[Twist], duration: float = FOREVER
) -> Array:
    """Twists of the robot ``duration`` s after commands of others, (S, D + 1).

    Asked of the robot itself: x + duration f(x, u) with u = ``robot.drive(x, twist, duration)``.
    That is exact for the velocities of a robot whose inputs are their rates, or the velocities
    themselves; positions are not looked at.

    Parameters
    ----------
    robot : its `drive` keeps every limit.
    state : (n,), now.
    twists : S of them.
    duration : s; without one, the nearest that the robot can ever have.

    Returns
    -------
    twists : (S, D + 1), linear components, m/s, and yaw rate, rad/s.
    """
    now = tuple(float(value) for value in state)
    inputs = np.array([robot.drive(now, twist, duration) for twist in twists], dtype=np.float64)
    control = tuple(inputs.T)
    rates = robot.derivative(now, control)
    later = tuple(x + duration * rate for x, rate in zip(now, rates, strict=True))
    twist = robot.twist(later, control)
    columns = np.broadcast_arrays(*twist.linear, twist.angular, np.zeros(len(inputs)))
    return np.stack(columns[:-1], axis=-1).astype(np.float64)


def top_speed(robot: Robot, state: Array) -> float:
    """Highest speed of the robot straight ahead, m/s."""
    ahead = Twist((FAST, *np.zeros(robot.dimension - 1)))
    return float(attained(robot, state, [ahead])[0, 0])


def deceleration(robot: Robot) -> float:
    """Return how fast a robot that drives slowly along its first axis can brake, m/s^2."""
    slow, soon = 0.1, 1e-3
    aside = (0.0,) * (robot.dimension - 1)
    pose = Pose((0.0,) * robot.dimension, 0.0)
    state = np.array(robot.state_at(pose, Twist((slow, *aside))), dtype=np.float64)
    found = attained(robot, state, [Twist((0.0, *aside))], soon)[0, 0]
    return (slow - float(found)) / soon


def turns_on_the_spot(robot: Robot, state: Array) -> bool:
    """Whether a robot can turn without going anywhere; False for one without a heading."""
    return bool(abs(attained(robot, state, [Twist((0.0,) * robot.dimension, FAST)])[0, -1]) > 0.0)


def slower_backwards(robot: Robot, state: Array) -> bool:
    """Whether a robot with a heading may not drive backwards as fast as ahead, or never."""
    if robot.pose(tuple(state)).heading is None:
        return False
    aside = (0.0,) * (robot.dimension - 1)
    ends = [Twist((sign * FAST, *aside)) for sign in (1.0, -1.0)]
    ahead, back = attained(robot, state, ends)[:, 0]
    return bool(-back < ahead)


def broken_limit(robot: Robot, command: object) -> str:
    """Say which promise of `Controller` about commands this one breaks; "" where it keeps all.

    A command is finite, has D linear components and a ramp of at least 0 s, and its velocity is
    one that the robot can have: some state within the robot's bounds and constraints has it, and
    an input within its limits keeps it, to within `ALLOWANCE`. That holds from every state, from
    one beyond the limits too.

    Parameters
    ----------
    robot : whom the command is for.
    command : what a controller returned.
    """
    if not isinstance(command, Command):
        return f"it is a {type(command).__name__}; wanted a Command"
    if len(command.linear) != robot.dimension:
        return f"it has {len(command.linear)} linear components; wanted {robot.dimension}"
    try:
        numbers = [float(value) for value in (*command.linear, command.omega, command.ramp)]
    except (TypeError, ValueError):
        numbers = [nan]
    if not all(map(isfinite, numbers)) or numbers[-1] < 0.0:
        return f"it is {command}; wanted finite numbers and a ramp of at least 0 s"
    pose = robot.pose((0.0,) * len(robot.states))  # limits do not depend on the place
    twist = command.twist
    state = tuple(map(float, robot.state_at(pose, twist)))
    control = tuple(map(float, robot.drive(state, twist, 1.0)))
    found = robot.twist(state, control)
    pairs = zip((*found.linear, found.angular), numbers, strict=False)
    beyond = [abs(float(one) - other) for one, other in pairs]
    beyond += _beyond(state, robot.state_bounds()) + _beyond(control, robot.input_bounds())
    beyond += [-float(value) for value in robot.constraints(state, control)]
    if not all(value <= ALLOWANCE for value in beyond):
        return f"it is {command}, beyond what the robot can do by {max(beyond):.3g}"
    return ""


def within_reach(robot: Robot, command: Command) -> Command:
    """Return the nearest command within the limits; the same one where it keeps them.

    Nearest as the robot's own ``drive`` sees it. What is not finite becomes standing still.
    """
    if not broken_limit(robot, command):
        return command
    still = Command((0.0,) * robot.dimension)
    numbers = np.array([*command.linear, command.omega, command.ramp], dtype=np.float64)
    if len(numbers) != robot.dimension + 2 or not np.isfinite(numbers).all():
        return still
    pose = robot.pose((0.0,) * len(robot.states))
    rest = np.array(robot.state_at(pose, still.twist), dtype=np.float64)
    *linear, omega = (float(value) for value in attained(robot, rest, [command.twist])[0])
    nearest = Command(tuple(linear), omega, max(command.ramp, 0.0))
    return still if broken_limit(robot, nearest) else nearest


def within_bounds(robot: Robot, state: Array) -> Array:
    """Return a state on the robot's bounds where noise or a push took it beyond them.

    Otherwise no plan would be feasible, and the robot would stop for it. The paper starts at the
    state as it is.
    """
    bounds = robot.state_bounds()
    limited = zip(state.tolist(), bounds.lower, bounds.upper, strict=True)
    return np.array([min(max(value, lower), upper) for value, lower, upper in limited])


def _beyond(values: tuple[float, ...], bounds: Bounds) -> list[float]:
    """How far numbers are beyond their limits, negative where they are within."""
    limits = zip(values, bounds.lower, bounds.upper, strict=True)
    return [v - upper if v - upper > lower - v else lower - v for v, lower, upper in limits]
