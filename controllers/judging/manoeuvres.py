"""Manoeuvres: a twist that is held for a moment, and then towards the path at some speed."""

from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from ...framework.control.command_limits import CRAWL, FAST, attained, turns_on_the_spot
from ...framework.numerics.clipping import between
from ...framework.numerics.symbolic import Mapped, ca
from ...framework.robot import Robot, SymbolicDrive, step
from ...framework.values.arrays import Array, Scalar
from ...framework.values.motion import Pose, Twist

HELD = (0.4, 1.2)
"""s for which the first twist is held."""
SPEEDS = (-0.6, 0.0, 0.5, 1.0)
"""Of the first twist, as shares of `FASTER` times the reference speed, or of the largest."""
FASTER = 2.0
"""Largest speed of the first twist over the reference speed: to avoid people, not to gain time."""
TURNS = (-1.0, -0.5, 0.0, 0.5, 1.0)
"""Yaw rates of the first twist, as shares of the robot's largest one; without a heading the
directions in which it moves, as shares of half a turn."""
AFTERWARDS = (0.0, 0.5, 1.0)
"""Speeds towards the path afterwards, as shares of the reference speed; 0 stops."""
SLOWING = 0.8
"""s from the target, from where on the speed falls in proportion."""
GAIN = 2.0
"""1/s, yaw rate towards the path per rad."""


def driven(
    robot: Robot, start: Array, target: Array, speed: float, steps: int, dt: float
) -> tuple[Array, Array]:
    """Drive all manoeuvres from a state.

    Parameters
    ----------
    robot, start : who drives, and its state (n,).
    target : (D,), m, that is headed for after the first twist.
    speed : m/s, the reference speed.
    steps, dt : N and s.

    Returns
    -------
    states : (C, N + 1, n). inputs : (C, N, m).
    """
    twists, held, later = _family(robot, start, target, speed)
    count, first = len(twists), np.arange(steps) * dt
    still = (first[None] < held[:, None] - 1e-9)[..., None]
    pieces = [
        np.broadcast_to(still, (count, steps, 1)),
        np.broadcast_to(twists[:, None], (count, steps, twists.shape[1])),
        np.broadcast_to(later[:, None, None], (count, steps, 1)),
        np.broadcast_to(_abilities(robot, start, speed, dt), (count, steps, 2)),
        np.broadcast_to(target, (count, steps, len(target))),
    ]
    given = np.concatenate(pieces, axis=2).astype(np.float64)
    if isinstance(robot, SymbolicDrive):
        after, inputs = _compiled(robot, steps, dt, count)(
            [start, given.reshape(-1, given.shape[2])]
        )
        states = np.empty((count, steps + 1, len(start)))
        states[:, 0], states[:, 1:] = start, after.reshape(count, steps, -1)
        return states, inputs.reshape(count, steps, -1)
    return _one_by_one(robot, start, given, dt)


def _family(robot: Robot, start: Array, target: Array, speed: float) -> tuple[Array, Array, Array]:
    """First twists (C, D + 1), for how long they are held (C,), s, and speeds afterwards (C,)."""
    aside = (0.0,) * (robot.dimension - 1)
    pose = robot.pose(tuple(start))
    if pose.heading is None:
        way = np.asarray(target) - np.array(pose.position)
        first = [(*_turned(way, np.pi * turn, share * speed), 0.0)
                 for share, turn in product(SPEEDS, TURNS)]  # fmt: skip
    else:
        fast = [Twist((FAST, *aside)), Twist((FAST, *aside), FAST), Twist((0.0, *aside), FAST)]
        reached = attained(robot, start, fast)
        ahead, yaw = min(reached[0, 0], FASTER * speed), np.abs(reached[:, -1]).max()
        first = [(share * ahead, *aside, turn * yaw)
                 for share, turn in product(SPEEDS, TURNS)]  # fmt: skip
    all_three = list(product(first, HELD, (share * speed for share in AFTERWARDS)))
    twists, held, later = zip(*all_three, strict=True)
    return np.array(twists), np.array(held), np.array(later)


def _abilities(robot: Robot, start: Array, speed: float, dt: float) -> tuple[float, float]:
    """Return how fast a robot's yaw rate can fall, rad/s^2, and the share of speed that it keeps.

    A robot that cannot turn on the spot drives on where it faces away from the target.
    """
    still, kept = (0.0,) * robot.dimension, 0.0
    if robot.pose(tuple(start)).heading is not None and not turns_on_the_spot(robot, start):
        kept = CRAWL
        slow = Twist((kept * speed, *still[1:]))
        start = np.array(robot.state_at(robot.pose(tuple(start)), slow), dtype=np.float64)
    fast = attained(robot, start, [Twist(still, FAST), Twist(still, -FAST)], dt)[:, -1]
    return max(float(np.ptp(fast)) / (2.0 * dt), 1e-3), kept


def _turned(way: Array, angle: float, speed: float) -> tuple[float, ...]:
    """Return a velocity in the direction of ``way`` turned in the plane, m/s."""
    length = float(np.linalg.norm(way))
    ahead = way / length if length > 0.0 else np.eye(len(way))[0]
    cosine, sine = np.cos(angle), np.sin(angle)
    first = cosine * ahead[0] - sine * ahead[1], sine * ahead[0] + cosine * ahead[1]
    return tuple(float(speed * one) for one in (*first, *ahead[2:]))


def _wanted(robot: Robot, state: tuple[Scalar, ...], given: tuple[Scalar, ...]) -> Twist:
    """Return the twist of one step: the first one while it is held, then towards the target."""
    size = robot.dimension
    still, twist, target = given[0], given[1 : size + 2], given[size + 5 :]
    later = _towards(robot.pose(state), target, *given[size + 2 : size + 5])
    parts = (*later.linear, later.angular)
    mixed = [still * one + (1.0 - still) * other for one, other in zip(twist, parts, strict=True)]
    return Twist(tuple(mixed[:size]), mixed[size])


def _towards(
    pose: Pose, target: tuple[Scalar, ...], speed: Scalar, slowing: Scalar, kept: Scalar
) -> Twist:
    """Return the twist at a speed towards a target; without speed the robot stops."""
    way = [end - here for end, here in zip(target, pose.position, strict=True)]
    length = np.sqrt(sum(one * one for one in way) + 1e-12)
    slower = between(length / SLOWING, 0.0, 1e3)
    slower = np.fmin(slower, speed)
    if pose.heading is None:
        return Twist(tuple(slower * one / length for one in way), 0.0)
    ahead = np.cos(pose.heading) * way[0] + np.sin(pose.heading) * way[1]
    aside = np.cos(pose.heading) * way[1] - np.sin(pose.heading) * way[0]
    angle = np.arctan2(aside, ahead)
    pace = slower * np.fmin(np.fmax(np.cos(angle), kept), 1.0)
    moving = speed / (speed + 1e-9)
    off = np.sqrt(angle * angle + 1e-12)
    rate = np.fmin(GAIN * off, np.sqrt(2.0 * slowing * off)) * angle / off
    return Twist((pace, *(0.0 * one for one in way[1:])), moving * rate)


@lru_cache(maxsize=16)
def _compiled(robot: SymbolicDrive, steps: int, dt: float, count: int) -> Mapped:
    """Return the drive of ``count`` manoeuvres, the same for the same numbers."""
    size = robot.dimension
    x, given = ca.SX.sym("x", len(robot.states)), ca.SX.sym("given", 2 * size + 5)
    state = tuple(ca.vertsplit(x))
    control = robot.drive(state, _wanted(robot, state, tuple(ca.vertsplit(given))), dt)
    following = step(robot, state, control, dt)
    pieces: list[Any] = [ca.densify(ca.vertcat(*following)), ca.densify(ca.vertcat(*control))]
    one = ca.Function("manoeuvre", [x, given], pieces).mapaccum(steps)
    return Mapped(one.map(count))


def _one_by_one(robot: Robot, start: Array, given: Array, dt: float) -> tuple[Array, Array]:
    """Drive the manoeuvres of a robot whose motion cannot be compiled."""
    count, steps = given.shape[:2]
    states = np.empty((count, steps + 1, len(start)))
    inputs = np.empty((count, steps, len(robot.inputs)))
    for c in range(count):
        now = tuple(float(value) for value in start)
        states[c, 0] = now
        for n in range(steps):
            inputs[c, n] = robot.drive(now, _wanted(robot, now, tuple(given[c, n].tolist())), dt)
            now = step(robot, now, tuple(inputs[c, n].tolist()), dt)
            states[c, n + 1] = now
    return states, inputs
