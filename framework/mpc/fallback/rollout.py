"""Trajectories that the robot can drive, without solving anything."""

import numpy as np

from ...control.velocity_smoother import VelocitySmoother
from ...numerics.symbolic import Mapped, ca
from ...robot import Robot, step
from ...values.arrays import Array
from ...values.motion import Twist

SWEEPS = ("coast", "left", "right", "wait", "back-left", "back-right")
"""Names of the twists that can be held, see `sweep`."""


class Motion:
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
    states = [tuple(float(value) for value in start)]
    inputs = []
    for _ in range(steps):
        control = robot.drive(states[-1], twist, dt)
        inputs.append(control)
        states.append(step(robot, states[-1], control, dt))
    found = np.array(inputs, dtype=np.float64).reshape(steps, len(robot.inputs))
    return np.array(states, dtype=np.float64), found


def shift(inputs: Array, share: float) -> Array:
    """Return the inputs (N, m) as seen ``share`` steps later; what lies beyond the end is 0.

    A share that is no whole number averages the two inputs that each new step covers.
    """
    padded = np.concatenate([inputs, np.zeros_like(inputs), np.zeros_like(inputs[:1])])
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
