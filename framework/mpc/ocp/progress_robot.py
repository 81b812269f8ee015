"""A robot that carries the arc length of its place on the path among its states."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...robot import Bounds, Quantity, Robot, SymbolicDrive
from ...values.arrays import Scalar
from ...values.footprint import Footprint
from ...values.motion import Pose, Twist
from ...values.plan import Plan
from .problem import Parameters
from .reference import Reference
from .transcription import Guess


class ProgressRobot(Robot):
    """The robot with theta as its last state and the rate of theta as its last input.

    theta' = rate, both free: the cost alone ties them to the robot. For problem, solver and
    re-check it is a robot like any other. Made by `progress_robot_of`.

    Parameters
    ----------
    robot : the robot itself.
    """

    robot: Robot

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.radius: float = robot.radius
        self.footprint: Footprint | None = robot.footprint

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as what made it: the class is made for the robot."""
        return progress_robot_of, (self.robot,)

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        return (*self.robot.derivative(self._own(state), self._given(control)), control[-1])

    def state_bounds(self) -> Bounds:
        """Those of the robot; theta is free."""
        return _and_free(self.robot.state_bounds())

    def input_bounds(self) -> Bounds:
        """Those of the robot; the rate is free."""
        return _and_free(self.robot.input_bounds())

    def constraints(
        self, state: Sequence[Scalar], control: Sequence[Scalar]
    ) -> tuple[Scalar, ...]:
        """Those of the robot."""
        return self.robot.constraints(self._own(state), self._given(control))

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Pose of the robot."""
        return self.robot.pose(self._own(state))

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Twist of the robot."""
        return self.robot.twist(self._own(state), self._given(control))

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Acceleration of the robot."""
        return self.robot.acceleration(self._own(state), self._given(control))

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State of the robot, at the start of the path."""
        return (*self.robot.state_at(pose, twist), 0.0)

    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Input of the robot; theta stands."""
        return (*self.robot.drive(self._own(state), twist, duration), 0.0)

    def _own(self, state: Sequence[Scalar]) -> Sequence[Scalar]:
        return state[: len(self.robot.states)]

    def _given(self, control: Sequence[Scalar]) -> Sequence[Scalar]:
        return control[: len(self.robot.inputs)]


def progress_robot_of(robot: Robot) -> ProgressRobot:
    """Return the robot that carries theta; its class names the states of both."""
    names = {
        "states": (*robot.states, Quantity("theta", "m")),
        "inputs": (*robot.inputs, Quantity("rate", "m/s")),
        "dimension": robot.dimension,
    }
    able = (SymbolicDrive,) if isinstance(robot, SymbolicDrive) else ()
    made: type[ProgressRobot] = type("ProgressRobot", (ProgressRobot, *able), names)
    return made(robot)


def _and_free(bounds: Bounds) -> Bounds:
    return Bounds((*bounds.lower, -np.inf), (*bounds.upper, np.inf))


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
