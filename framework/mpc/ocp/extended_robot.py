"""A robot with further states behind its own, which a cost needs."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, TypeVar, cast

import numpy as np

from ...robot import Bounds, Quantity, Robot, SymbolicDrive
from ...values.arrays import Scalar
from ...values.footprint import Footprint
from ...values.motion import Pose, Twist
from .problem import Parameters
from .transcription import Guess


class ExtendedRobot(Robot):
    """A robot with further free states behind its own, and perhaps further free inputs.

    For problem, solver and re-check it is a robot like any other. Made by `extended`.

    Parameters
    ----------
    robot : the robot itself.
    """

    robot: Robot

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.radius: float = robot.radius
        self.footprint: Footprint | None = robot.footprint

    @abstractmethod
    def filled(self, guess: Guess, parameters: Parameters, dt: float) -> Guess:
        """Fill the further states and inputs into a trajectory, with or without some already.

        Parameters
        ----------
        guess : the trajectory. parameters : of the problem, whose first state has them.
        dt : s, of a step.
        """

    def state_bounds(self) -> Bounds:
        """Those of the robot; the further states are free."""
        return _and_free(self.robot.state_bounds(), len(self.states))

    def input_bounds(self) -> Bounds:
        """Those of the robot; further inputs are free."""
        return _and_free(self.robot.input_bounds(), len(self.inputs))

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
        """State of the robot; the further states are 0."""
        return (*self.robot.state_at(pose, twist), *self._zeros(self.states, self.robot.states))

    def drive(self, state: Sequence[Scalar], twist: Twist, duration: float) -> tuple[Scalar, ...]:
        """Input of the robot; further inputs are 0."""
        own = self.robot.drive(self._own(state), twist, duration)
        return (*own, *self._zeros(self.inputs, self.robot.inputs))

    def _own(self, state: Sequence[Scalar]) -> Sequence[Scalar]:
        return state[: len(self.robot.states)]

    def _given(self, control: Sequence[Scalar]) -> Sequence[Scalar]:
        return control[: len(self.robot.inputs)]

    @staticmethod
    def _zeros(every: Sequence[Quantity], own: Sequence[Quantity]) -> tuple[float, ...]:
        return (0.0,) * (len(every) - len(own))


Extended = TypeVar("Extended", bound=ExtendedRobot)


def extended(
    kind: type[Extended],
    robot: Robot,
    states: Sequence[Quantity],
    inputs: Sequence[Quantity] = (),
) -> type[Extended]:
    """Return the class of a robot with further states and inputs; it names those of both."""
    names = {
        "states": (*robot.states, *states),
        "inputs": (*robot.inputs, *inputs),
        "dimension": robot.dimension,
    }
    able = (SymbolicDrive,) if isinstance(robot, SymbolicDrive) else ()
    made: Any = type(kind.__name__, (kind, *able), names)
    return cast("type[Extended]", made)


def _and_free(bounds: Bounds, count: int) -> Bounds:
    """Return limits of ``count`` components, of which those behind the given ones are free."""
    free = (np.inf,) * (count - len(bounds.lower))
    return Bounds((*bounds.lower, *(-end for end in free)), (*bounds.upper, *free))
