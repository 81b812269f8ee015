"""A robot that carries its last input among its states."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...robot import Quantity, Robot
from ...values.arrays import Scalar
from ...values.motion import Twist
from .extended_robot import ExtendedRobot, extended
from .problem import Parameters
from .transcription import Guess


class CommandRobot(ExtendedRobot):
    """The robot with the input of the step before as its last states.

    A robot whose velocity is its input has no acceleration within a step. Between two steps its
    twist jumps, and with the last input as a state that is an acceleration too::

        x_{i+1} = f(x_i, u_i)    l_{i+1} = u_i
        a_i = a(x_i, u_i) + (v(x_i, u_i) - v(x_i, l_i)) / dt

    A step of it always takes dt. Made by `command_robot_of`.

    Parameters
    ----------
    robot : the robot itself.
    dt : s, of a step.
    """

    dt: float

    def __init__(self, robot: Robot, dt: float) -> None:
        super().__init__(robot)
        self.dt = dt

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

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Acceleration of the robot, and the jump of its twist before the step over dt."""
        within = super().acceleration(state, control)
        now, before = (
            self.twist(state, control),
            self.twist(state, state[len(self.robot.states) :]),
        )
        parts = zip(within.linear, now.linear, before.linear, strict=True)
        return Twist(
            tuple(a + (v - w) / self.dt for a, v, w in parts),
            within.angular + (now.angular - before.angular) / self.dt,
        )

    def filled(self, guess: Guess, parameters: Parameters, dt: float) -> Guess:
        """Fill in the input before each state, see `ExtendedRobot.filled`."""
        size = len(self.robot.states)
        inputs = np.concatenate([parameters.initial[None, size:], guess.inputs])
        return replace(guess, states=np.column_stack([guess.states[:, :size], inputs]))


def command_robot_of(robot: Robot, dt: float) -> CommandRobot:
    """Return the robot that carries its last input."""
    last = [Quantity(f"last {entry.name}", entry.unit) for entry in robot.inputs]
    return extended(CommandRobot, robot, last)(robot, dt)
