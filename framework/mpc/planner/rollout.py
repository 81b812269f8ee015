"""Trajectories that the robot can drive, without solving anything."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np

from ...control.velocity_smoother import VelocitySmoother
from ...numerics.symbolic import Mapped, ca
from ...robot import Robot, SymbolicDrive, step
from ...values.arrays import Array
from ...values.motion import Twist

SWEEPS = ("coast", "left", "right", "wait", "back-left", "back-right")
"""Names of the twists that can be held, see `sweep`."""


class RobotMotion:
    """A robot's trajectories of N steps, compiled: `follow` in one call.

    Parameters
    ----------
    robot : whose inputs are integrated.
    steps, dt : N and s.
    """

    def __init__(self, robot: Robot, steps: int, dt: float) -> None:
        self.robot: Robot = robot
        self.steps: int = steps
        self.dt: float = dt
        x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
        following = ca.vertcat(*step(robot, ca.vertsplit(x), ca.vertsplit(u), dt))
        self._all = Mapped(ca.Function("following", [x, u], [following]).mapaccum(steps))

    def follow(self, start: Array, inputs: Array) -> Array:
        """Integrate the inputs (N, m) from the start: states (N + 1, n)."""
        return np.concatenate([np.asarray(start)[None], *self._all([start, inputs])])


def follow(robot: Robot, start: Array, inputs: Array, dt: float) -> Array:
    """Integrate the inputs (N, m) from the start: states (N + 1, n)."""
    if isinstance(robot, SymbolicDrive) and len(inputs):
        return _motion(robot, len(inputs), dt).follow(start, inputs)
    states = [tuple(float(value) for value in start)]
    for control in inputs:
        states.append(step(robot, states[-1], tuple(float(u) for u in control), dt))
    return np.array(states, dtype=np.float64)


def clip(robot: Robot, inputs: Array) -> Array:
    """Bring inputs (N, m) into the robot's bounds."""
    limits = robot.input_bounds()
    return np.clip(inputs, np.asarray(limits.lower), np.asarray(limits.upper))


def brake(robot: Robot, start: Array, steps: int, dt: float) -> tuple[Array, Array]:
    """Stop as fast as the limits allow: states (N + 1, n) and inputs (N, m)."""
    return steer(robot, start, Twist((0.0,) * robot.dimension, 0.0), steps, dt)


def steer(robot: Robot, start: Array, twist: Twist, steps: int, dt: float) -> tuple[Array, Array]:
    """Drive towards one twist and keep it: states (N + 1, n) and inputs (N, m)."""
    return steer_each(robot, start, [[(twist, steps)]], dt)[0]


Held: TypeAlias = Sequence[tuple[Twist, int]]
"""Twists, and for how many steps each is held."""


def steer_each(
    robot: Robot, start: Array, manoeuvres: Sequence[Held], dt: float
) -> list[tuple[Array, Array]]:
    """Drive from one start along several sequences of held twists, of N steps in all each.

    Returns
    -------
    States (N + 1, n) and inputs (N, m) of each.
    """
    steps = sum(count for _, count in manoeuvres[0]) if manoeuvres else 0
    if isinstance(robot, SymbolicDrive) and steps:
        return _steering(robot, steps, dt, len(manoeuvres))(start, manoeuvres)
    return [_steer(robot, start, held, dt) for held in manoeuvres]


def _steer(robot: Robot, start: Array, held: Held, dt: float) -> tuple[Array, Array]:
    states = [tuple(float(value) for value in start)]
    inputs = []
    for twist, count in held:
        for _ in range(count):
            control = robot.drive(states[-1], twist, dt)
            inputs.append(control)
            states.append(step(robot, states[-1], control, dt))
    found = np.array(inputs, dtype=np.float64).reshape(len(inputs), len(robot.inputs))
    return np.array(states, dtype=np.float64), found


class _Steering:
    """`steer_each` of S sequences of N steps, compiled."""

    def __init__(self, robot: SymbolicDrive, steps: int, dt: float, count: int) -> None:
        x, w, control = _driven(robot, dt)
        following = step(robot, tuple(ca.vertsplit(x)), tuple(ca.vertsplit(control)), dt)
        pieces = [ca.densify(ca.vertcat(*following)), control]
        driven = ca.Function("driven", [x, w], pieces).mapaccum(steps)
        self._all = Mapped(driven.map(count))
        self._shape = count, steps

    def __call__(self, start: Array, manoeuvres: Sequence[Held]) -> list[tuple[Array, Array]]:
        """Drive along each sequence."""
        held = [one for manoeuvre in manoeuvres for one in manoeuvre]
        twists = np.array([(*twist.linear, twist.angular) for twist, _ in held])
        flat = np.repeat(twists, [count for _, count in held], axis=0)
        after, inputs = (rows.reshape(*self._shape, -1) for rows in self._all([start, flat]))
        count, steps = self._shape
        states = np.empty((count, steps + 1, after.shape[2]))
        states[:, 0], states[:, 1:] = start, after
        return list(zip(states, inputs, strict=True))


def drive_each(robot: Robot, states: Array, twist: Twist, dt: float) -> Array:
    """Return the inputs that bring each of N states to a twist, of arrays (N,), in one step."""
    rows = np.empty((len(states), robot.dimension + 1))
    for column, values in enumerate((*twist.linear, twist.angular)):
        rows[:, column] = values
    if isinstance(robot, SymbolicDrive):
        return _driving(robot, len(states), dt)([states, rows])[0]
    pairs = zip(states.tolist(), rows.tolist(), strict=True)
    return np.array(
        [robot.drive(tuple(one), Twist(tuple(row[:-1]), row[-1]), dt) for one, row in pairs],
        dtype=np.float64,
    )


@lru_cache(maxsize=16)
def _driving(robot: SymbolicDrive, steps: int, dt: float) -> Mapped:
    """Return `drive_each`, compiled, the same for the same numbers."""
    x, w, control = _driven(robot, dt)
    return Mapped(ca.Function("driving", [x, w], [control]).map(steps))


def _driven(robot: SymbolicDrive, dt: float) -> tuple[Any, Any, Any]:
    """Symbols of a state and a twist, and the input that leads there."""
    size = robot.dimension
    x, w = ca.SX.sym("x", len(robot.states)), ca.SX.sym("w", size + 1)
    parts = tuple(ca.vertsplit(w))
    control = robot.drive(tuple(ca.vertsplit(x)), Twist(parts[:size], parts[size]), dt)
    return x, w, ca.densify(ca.vertcat(*control))


@lru_cache(maxsize=16)
def _motion(robot: SymbolicDrive, steps: int, dt: float) -> RobotMotion:
    """Return the compiled motion of a robot, the same for the same numbers."""
    return RobotMotion(robot, steps, dt)


@lru_cache(maxsize=64)
def _steering(robot: SymbolicDrive, steps: int, dt: float, count: int) -> _Steering:
    """Return the compiled steering of a robot, the same for the same numbers."""
    return _Steering(robot, steps, dt, count)


def shift(inputs: Array, share: float) -> Array:
    """Return the inputs (N, m) as seen ``share`` steps later; what lies beyond the end is 0.

    A share that is no whole number averages the two inputs that each new step covers.
    """
    padded = np.zeros((2 * len(inputs) + 1, inputs.shape[1]))
    padded[: len(inputs)] = inputs
    whole = max(min(int(share + 1e-9), len(inputs)), 0)
    part = min(max(share - whole, 0.0), 1.0)
    here = padded[whole : whole + len(inputs)]
    after = padded[whole + 1 : whole + 1 + len(inputs)]
    return np.asarray((1 - part) * here + part * after)


def stand(robot: Robot, start: Array, inputs: Array, share: float, dt: float) -> Array:
    """Replace what a shift of ``share`` steps put beyond a plan's end by inputs that stop.

    A plan that ends in a stop then goes on by standing, whatever the state it is driven from.
    """
    known = max(len(inputs) - int(np.ceil(share - 1e-9)), 0)
    last = follow(robot, start, inputs[:known], dt)[-1]
    return np.concatenate([inputs[:known], brake(robot, last, len(inputs) - known, dt)[1]])


def carry(
    robot: Robot, state: Array, smoother: VelocitySmoother | None, time: float, duration: float
) -> Array:
    """Return where the robot will be ``duration`` s after ``time``, on its way to the command.

    It follows the smoother's ramp in steps of at most 0.05 s; without one it keeps its twist.
    """
    steps = max(int(np.ceil(duration / 0.05 - 1e-9)), 1)
    held = sweep(robot, state, "coast", 0.0)
    moved = tuple(float(value) for value in state)
    for i in range(steps):
        then = time + (i + 1) * duration / steps
        twist = held if smoother is None else smoother.at(then)
        moved = step(robot, moved, robot.drive(moved, twist, duration / steps), duration / steps)
    return np.array(moved, dtype=np.float64)


def sweep(robot: Robot, start: Array, name: str, speed: float, now: Twist | None = None) -> Twist:
    """Return a named twist.

    ``coast`` holds the twist ``now``, by default that of the state; ``left`` and ``right`` turn
    as fast as the robot can, or, without a heading, go off to the side; ``back-left`` and
    ``back-right`` do so at ``speed``, m/s, backwards; ``wait`` stops.
    """
    if now is None:
        now = robot.twist(tuple(start), tuple(0.0 for _ in robot.inputs))
    if name == "wait":
        return Twist(tuple(0.0 for _ in now.linear), 0.0)
    if name == "coast":
        return now
    way, _, side = name.rpartition("-")
    sign = 1.0 if side == "left" else -1.0
    if robot.pose(tuple(start)).heading is not None:
        linear = (-speed, 0.0) if way else now.linear
        return Twist(linear, sign * speed)  # drive() keeps it within the limits
    forward = np.asarray(now.linear, dtype=np.float64)
    if way:
        length = float(np.linalg.norm(forward))
        forward = -forward * (speed / length if length else 0.0)
    turned = np.array([-forward[1], forward[0], *np.zeros(len(forward) - 2)])
    if not turned.any():  # straight up or down: one side is as good as another
        turned[1] = np.linalg.norm(forward)
    mixed = (forward + sign * turned * (-1.0 if way else 1.0)) / np.sqrt(2.0)
    return Twist(tuple(float(value) for value in mixed), 0.0)
