"""The planning problem that several tests solve."""

from dataclasses import replace

import numpy as np

from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.fallback.rollout import steer
from wideberth.framework.mpc.instance.obstacles import Obstacles, fill
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.ocp.bodies import with_auxiliaries
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path

STEPS, DT = 15, 0.5


def set_up(
    robot: Robot,
    region: Region,
    level: LevelPolicy,
    capacity: int,
    penalty: float | None = None,
    y: float = 0.4,
) -> tuple[Problem, Parameters, Guess]:
    """One obstacle stands near the robot's straight path."""
    start = np.array(robot.state_at(Pose((0.0, 0.0), 0.0), Twist((0.4, 0.0))), dtype=float)
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    reference = lay_reference(path, 0.0, 0.5, STEPS, DT)
    mean = np.tile([4.0, y], (STEPS, 1, 1))
    covariance = np.tile([[0.04, 0.01], [0.01, 0.02]], (STEPS, 1, 1, 1))
    obstacles = Obstacles(mean, covariance, np.array([0.4]), ("a",))
    parameters = fill(start, reference, obstacles, region, level, robot.radius, capacity)
    problem = assemble(
        robot, region, level, horizon=STEPS, dt=DT, capacity=capacity, penalty=penalty
    )
    states, inputs = steer(robot, start, Twist((0.4, 0.0), -0.05), STEPS, DT)
    scale = region.level(level.tail) if isinstance(level, SharedLevel) else float("nan")
    guess = Guess.bare(states, inputs, scale)
    guess = with_auxiliaries(robot, region, parameters, guess)
    return problem, replace(parameters, auxiliaries=guess.auxiliaries), guess
