"""The robot as a problem states it: with what its cost carries along among the states."""

from ..robot import Robot
from .costs.base import CommandCost, Cost, ProgressCost
from .ocp.command_robot import command_robot_of
from .ocp.extended_robot import ExtendedRobot
from .ocp.problem import Parameters
from .ocp.progress_robot import progress_robot_of
from .ocp.transcription import Guess


def robot_of_problem(robot: Robot, cost: Cost, dt: float) -> Robot:
    """Return the robot with the states that a cost adds.

    Parameters
    ----------
    robot : itself. cost : of each stage. dt : s, of a step.
    """
    if isinstance(cost, ProgressCost):
        return progress_robot_of(robot)
    return command_robot_of(robot, dt) if isinstance(cost, CommandCost) else robot


def with_carried(model: Robot, guess: Guess, parameters: Parameters, dt: float) -> Guess:
    """Fill the states that the cost adds into a trajectory of the robot.

    Parameters
    ----------
    model : see `robot_of_problem`. guess : with or without them.
    parameters : of the problem; its first state has them. dt : s, of a step.
    """
    return model.filled(guess, parameters, dt) if isinstance(model, ExtendedRobot) else guess
