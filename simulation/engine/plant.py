"""What moves in an episode and takes commands."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import hypot

import numpy as np

from ...framework.control.velocity_smoother import VelocitySmoother
from ...framework.numerics.integration import runge_kutta
from ...framework.robot import Robot, start_state
from ...framework.values.motion import Command, Twist
from .agents import RobotAgent


class Plant(ABC):
    """The body of a robot, which follows velocity commands as well as it can.

    Attributes
    ----------
    robot : the model that describes its state.
    state : (n,), where it truly is and how it moves.
    control : (m,), the input of the model that it has at present.
    """

    robot: Robot
    state: tuple[float, ...]
    control: tuple[float, ...]

    @abstractmethod
    def command(self, command: Command, time: float) -> None:
        """Take a command that arrives at ``time``, s."""

    @abstractmethod
    def advance(self, time: float, duration: float) -> None:
        """Move on by ``duration`` s, from ``time`` s."""

    @property
    def position(self) -> tuple[float, ...]:
        """Where the robot is, (D,), m."""
        return self.robot.pose(self.state).position

    @property
    def believed(self) -> tuple[float, ...]:
        """Where it takes itself to be, (D,), m: that decides whether it is at its goal."""
        return self.position

    @property
    def speed(self) -> float:
        """Length of the linear velocity, m/s."""
        linear = self.robot.twist(self.state, self.control).linear
        return hypot(*linear)


class KinematicPlant(Plant):
    """A robot that follows velocity commands through its smoother and low-level controller.

    Each step the velocity smoother says which twist the robot should have at the end of the
    step, `Robot.drive` turns that into an input, the input is clipped to its bounds and the
    dynamics are integrated (Runge-Kutta, order four). The plant is the planner's own model
    at a finer step: what it adds is the ramp and the limits, not a modelling error. The paper
    simulates skid-steered robots in Gazebo, which slip when they turn.

    Parameters
    ----------
    robot : the model.
    state : (n,) at the start.
    twist : velocity that counts as commanded before the first command.
    """

    def __init__(self, robot: Robot, state: Sequence[float], twist: Twist) -> None:
        self.robot: Robot = robot
        self.state: tuple[float, ...] = tuple(float(value) for value in state)
        self._smoother = VelocitySmoother.at_rest(twist)
        bounds = robot.input_bounds()
        self._limits = tuple(zip(bounds.lower, bounds.upper, strict=True))
        self.control: tuple[float, ...] = self._drive(twist, 1.0)

    @classmethod
    def at_start(cls, agent: RobotAgent) -> "KinematicPlant":
        """Return the plant of an agent at the start of its path, at its speed."""
        direction = agent.path.direction(np.zeros(1))[0]
        start = agent.path.points[0]
        return cls(agent.robot, *start_state(agent.robot, start, direction, agent.speed))

    def command(self, command: Command, time: float) -> None:
        """Take a command that arrives at ``time``, s."""
        self._smoother = self._smoother.aim(command, time)

    def advance(self, time: float, duration: float) -> None:
        """Move on by ``duration`` s, from ``time`` s."""
        self.control = self._drive(self._smoother.at(time + duration), duration)
        moved = runge_kutta(self.robot.derivative, self.state, self.control, duration)
        self.state = tuple(float(value) for value in moved)

    def _drive(self, twist: Twist, duration: float) -> tuple[float, ...]:
        wanted = self.robot.drive(self.state, twist, duration)
        return tuple(
            min(max(float(value), low), high)
            for value, (low, high) in zip(wanted, self._limits, strict=True)
        )
