"""Ways to come to a stop that need no solver: at once, while turning, or after getting away."""

from collections.abc import Iterator

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.motion import Twist
from .rollout import Held, brake, steer_each

FAST = 10.0
"""m/s and rad/s, asked of `Robot.drive`, which stays within the limits."""


def stops(
    robot: Robot, start: Array, steps: int, dt: float, fastest: float = FAST
) -> Iterator[tuple[str, Array, Array]]:
    """Yield manoeuvres that all end at a stop: name, states (N + 1, n) and inputs (N, m).

    First ``straight``: brake as hard as the limits allow. Then ways to get out of the way first,
    for a sixth, a third and half of the horizon: with a heading, brake and turn, swerve at
    the present speed, drive on or back; without one, go off along an axis of the motion.

    Parameters
    ----------
    robot : its `drive` keeps every limit.
    start : (n,), the first state.
    steps, dt : N and s per step.
    fastest : m/s, of those that get out of the way.
    """
    yield ("straight", *brake(robot, start, steps, dt))
    halt = Twist((0.0,) * robot.dimension)
    ways: list[str] = []
    manoeuvres: list[Held] = []
    for name, twist in _ways_out(robot, start, fastest):
        for share in (6, 3, 2):
            away = min(max(round(steps / share), 1), steps)
            ways.append(f"{name} for {away * dt:g} s")
            manoeuvres.append([(twist, away), (halt, steps - away)])
    for name, found in zip(ways, steer_each(robot, start, manoeuvres, dt), strict=True):
        yield (name, *found)


def _ways_out(robot: Robot, start: Array, fastest: float) -> list[tuple[str, Twist]]:
    """Twists to hold before the stop."""
    now = robot.twist(tuple(start), tuple(0.0 for _ in robot.inputs)).linear
    sides = (("left", 1.0), ("right", -1.0))
    if robot.pose(tuple(start)).heading is not None:
        speed = float(now[0])
        turning = [(f"turning {side}", Twist((0.0, 0.0), sign * FAST)) for side, sign in sides]
        swerving = [(f"swerving {side}", Twist((speed, 0.0), sign)) for side, sign in sides]
        straight = [("ahead", Twist((fastest, 0.0))), ("back", Twist((-fastest, 0.0)))]
        return [*turning, *swerving, *straight]
    names = (("ahead", "back"), ("left", "right"), ("up", "down"))
    return [
        (name, Twist(tuple(float(sign * fastest * part) for part in axis)))
        for pair, axis in zip(names, _axes(np.array(now, dtype=np.float64)), strict=False)
        for name, sign in zip(pair, (1.0, -1.0), strict=True)
    ]


def _axes(velocity: Array) -> Array:
    """Return unit vectors ahead, to the left and, in space, up; the world's at a standstill."""
    size = len(velocity)
    flat = float(np.hypot(velocity[0], velocity[1]))
    ahead = velocity[:2] / flat if flat > 1e-6 else np.array([1.0, 0.0])
    axes = np.eye(size)
    axes[0, :2] = ahead
    axes[1, :2] = -ahead[1], ahead[0]
    return axes
