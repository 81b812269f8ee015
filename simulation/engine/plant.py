"""The plant: one robot, integrated at a finer step than its planner thinks in."""

from collections.abc import Sequence
from math import hypot

from ...framework.control.velocity_smoother import VelocitySmoother
from ...framework.numerics.integration import runge_kutta
from ...framework.robot import Robot
from ...framework.values.motion import Command, Twist


class Plant:
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
        self.robot = robot
        self.state = tuple(float(value) for value in state)
        self._smoother = VelocitySmoother.at_rest(twist)
        bounds = robot.input_bounds()
        self._limits = tuple(zip(bounds.lower, bounds.upper, strict=True))
        self.control = self._drive(twist, 1.0)

    def command(self, command: Command, time: float) -> None:
        """Take a command that arrives at ``time``, s."""
        self._smoother = self._smoother.aim(command, time)

    def advance(self, time: float, duration: float) -> None:
        """Move on by ``duration`` s, from ``time`` s."""
        self.control = self._drive(self._smoother.at(time + duration), duration)
        moved = runge_kutta(self.robot.derivative, self.state, self.control, duration)
        self.state = tuple(float(value) for value in moved)

    @property
    def position(self) -> tuple[float, ...]:
        """Where the robot is, (D,), m."""
        return self.robot.pose(self.state).position

    @property
    def speed(self) -> float:
        """Length of the linear velocity, m/s."""
        linear = self.robot.twist(self.state, self.control).linear
        return hypot(*linear)

    def _drive(self, twist: Twist, duration: float) -> tuple[float, ...]:
        wanted = self.robot.drive(self.state, twist, duration)
        return tuple(
            min(max(float(value), low), high)
            for value, (low, high) in zip(wanted, self._limits, strict=True)
        )
