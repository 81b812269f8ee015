"""A robot that carries its last input among its states."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...robot import Bounds, Quantity, Robot, SymbolicDrive
from ...values.arrays import Array, Scalar
from ...values.footprint import Footprint
from ...values.motion import Pose, Twist
from .transcription import Guess


class CommandRobot(Robot):
    """The robot with the input of the step before as its last states.

    A robot whose velocity is its input has no acceleration within a step. Between two steps its
    twist jumps, and with the last input as a state that is an acceleration too::

        x_{i+1} = f(x_i, u_i)    l_{i+1} = u_i
        a_i = a(x_i, u_i) + (v(x_i, u_i) - v(x_i, l_i)) / dt

    For problem, solver and re-check it is a robot like any other, but that a step of it always
    takes dt. Made by `command_robot_of`.

    Parameters
    ----------
    robot : the robot itself.
    dt : s, of a step.
    """

    robot: Robot
    dt: float

    def __init__(self, robot: Robot, dt: float) -> None:
        self.robot, self.dt = robot, dt
        self.radius: float = robot.radius
        self.footprint: Footprint | None = robot.footprint

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as what made it: the class is made for the robot."""
        return command_robot_of, (self.robot, self.dt)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state within a step, over which the input is constant."""
        still = tuple(0.0 * value for value in control)
        return (*self.robot.derivative(self._own(state), control), *still)

    def after(
        self, state: Sequence[Scalar], control: Sequence[Scalar], dt: Scalar, substeps: int = 1
    ) -> tuple[Scalar, ...]:
        """State of the robot after a step, and the input of that step."""
        return (*self.robot.after(self._own(state), control, dt, substeps), *control)

    def state_bounds(self) -> Bounds:
        """Those of the robot; the last input is free."""
        own, free = self.robot.state_bounds(), (np.inf,) * len(self.inputs)
        return Bounds((*own.lower, *(-limit for limit in free)), (*own.upper, *free))

    def input_bounds(self) -> Bounds:
        """Those of the robot."""
        return self.robot.input_bounds()

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Those of the robot."""
        return self.robot.constraints(self._own(state), control)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Pose of the robot."""
        return self.robot.pose(self._own(state))

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Twist of the robot."""
        return self.robot.twist(self._own(state), control)

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Acceleration of the robot, and the jump of its twist before the step over dt."""
        own, last = self._own(state), state[len(self.robot.states) :]
        within = self.robot.acceleration(own, control)
        now, before = self.robot.twist(own, control), self.robot.twist(own, last)
        parts = zip(within.linear, now.linear, before.linear, strict=True)
        return Twist(
            tuple(a + (v - w) / self.dt for a, v, w in parts),
            within.angular + (now.angular - before.angular) / self.dt,
        )

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State of the robot, before the first input."""
        return (*self.robot.state_at(pose, twist), *(0.0,) * len(self.inputs))

    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Input of the robot."""
        return self.robot.drive(self._own(state), twist, duration)

    def _own(self, state: Sequence[Scalar]) -> Sequence[Scalar]:
        return state[: len(self.robot.states)]


def command_robot_of(robot: Robot, dt: float) -> CommandRobot:
    """Return the robot that carries its last input; its class names the states of both."""
    names = {
        "states": (*robot.states, *(Quantity(f"last {q.name}", q.unit) for q in robot.inputs)),
        "inputs": robot.inputs,
        "dimension": robot.dimension,
    }
    able = (SymbolicDrive,) if isinstance(robot, SymbolicDrive) else ()
    made: type[CommandRobot] = type("CommandRobot", (CommandRobot, *able), names)
    return made(robot, dt)


def with_command(robot: CommandRobot, guess: Guess, last: Array) -> Guess:
    """Fill in the input before each state; ``last`` is that before the first one, (m,)."""
    states = guess.states[:, : len(robot.robot.states)]
    inputs = np.concatenate([last[None], guess.inputs])
    return replace(guess, states=np.column_stack([states, inputs]))
