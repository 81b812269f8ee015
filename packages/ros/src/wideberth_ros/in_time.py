"""Velocities of decisions that come late: a plan is followed in its own time."""

from typing import final

from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.mpc.planner.emergency import command_of_plan
from wideberth.framework.robot import Robot
from wideberth.framework.values.motion import Command, Twist
from wideberth.framework.values.plan import Plan


@final
class VelocityInTime:
    """The velocity that a robot should have at any time after its controller's last decision.

    A decision that took long finds the robot where its plan wanted it by then, not where the plan
    begins. So of a plan of stamp t_0 and step dt the twist of step i + 1 is aimed at from
    t_0 + i dt on, whenever the plan came, and where the next one is late its steps go on until it
    ends at a stop. A command that is not that of the plan's first step is held instead: a wrapper
    has decided otherwise.

    Parameters
    ----------
    robot : that is driven. twist : that it has. time : s, now, on the clock of the plans' stamps.
    """

    def __init__(self, robot: Robot, twist: Twist, time: float) -> None:
        self._robot = robot
        self._smoother = VelocitySmoother.at_rest(twist, time)
        self._plan: Plan | None = None
        self._step = 0

    def aim(self, command: Command, time: float, plan: Plan | None = None) -> None:
        """Take a decision that is there at ``time``, s, and the plan behind it."""
        follows = plan is not None and command == command_of_plan(self._robot, plan)
        self._plan, self._step = plan if follows else None, 0
        self._smoother = self._smoother.aim(command, time)

    def at(self, time: float) -> Twist:
        """Return the velocity at ``time``, s; times of calls do not fall."""
        plan = self._plan
        if plan is not None and (step := int((time - plan.stamp) / plan.dt + 1e-6)) > self._step:
            self._step = step
            self._smoother = self._smoother.aim(command_of_plan(self._robot, plan, step), time)
        return self._smoother.at(time)
