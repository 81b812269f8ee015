"""A robot that carries the arc length of its place on the path among its states."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...robot import Quantity, Robot
from ...values.arrays import Scalar
from ...values.plan import Plan
from .extended_robot import ExtendedRobot, extended
from .problem import Parameters
from .reference import Reference
from .transcription import Guess


class ProgressRobot(ExtendedRobot):
    """The robot with theta as its last state and the rate of theta as its last input.

    theta' = rate, both free: the cost alone ties them to the robot. Made by `progress_robot_of`.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as what made it: the class is made for the robot."""
        return progress_robot_of, (self.robot,)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return (*self.robot.derivative(self._own(state), self._given(control)), control[-1])

    def filled(self, guess: Guess, parameters: Parameters, dt: float) -> Guess:
        """Fill in theta and its rate, see `with_progress`."""
        return with_progress(self, guess, parameters, float(parameters.initial[-1]), dt)


def progress_robot_of(robot: Robot) -> ProgressRobot:
    """Return the robot that carries theta."""
    theta, rate = Quantity("theta", "m"), Quantity("rate", "m/s")
    return extended(ProgressRobot, robot, [theta], [rate])(robot)


def with_progress(
    robot: ProgressRobot, guess: Guess, reference: Reference | Parameters, arc: float, dt: float
) -> Guess:
    """Fill in theta and its rate, whether or not a trajectory has them already.

    theta starts at ``arc`` and moves by what each step covers in the direction of the reference
    there.
    """
    states = guess.states[:, : len(robot.robot.states)]
    places = np.stack(robot.pose(tuple(states.T)).position, axis=-1)
    theta, pace = np.full(len(places), arc), max(float(reference.speed.max()) * dt, 1e-9)
    for i, step in enumerate(np.diff(places, axis=0)):
        nearest = int(np.clip((theta[i] - arc) / pace, 0, len(reference.direction) - 1))
        theta[i + 1] = theta[i] + step @ reference.direction[nearest]
    inputs = guess.inputs[:, : len(robot.robot.inputs)]
    return replace(
        guess,
        states=np.column_stack([states, theta]),
        inputs=np.column_stack([inputs, np.diff(theta) / dt]),
    )


def without_progress(robot: Robot, plan: Plan) -> Plan:
    """Leave the plan with the states and inputs of the robot itself."""
    if plan.states.shape[1] == len(robot.states):
        return plan
    states, inputs = plan.states[:, : len(robot.states)], plan.inputs[:, : len(robot.inputs)]
    return replace(plan, states=states, inputs=inputs)
