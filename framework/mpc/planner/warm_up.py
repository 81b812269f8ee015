"""Import and compile before the first decision, which has to be quick."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from ...controller import Controller
from ...robot import Robot, start_state
from ...values.motion import Detection, Observation
from ...values.path import Path


def warm_up(
    twin: Controller, robot: Robot, path: Path, speed: float, samples: int, crowds: Sequence[int]
) -> None:
    """Let a copy of the planner decide with obstacles far behind it.

    What goes wrong here goes wrong again in `command`, which turns it into a reason.

    Parameters
    ----------
    twin : shares its compiled problems with the planner that is to be warm.
    robot, path, speed : where it would start.
    samples : observations before the first decision: long enough for what fits a model.
    crowds : numbers of obstacles to decide among, each of them twice.
    """
    with suppress(Exception):  # a plug-in that raises here is named by `command`
        direction = path.direction(np.zeros(1))[0]
        state = np.array(start_state(robot, path.points[0], direction, speed)[0], float)
        size, rng = robot.dimension, np.random.default_rng(0)
        for tick in range(samples + 2 * len(crowds)):
            count = 1 if tick < samples else crowds[(tick - samples) // 2]
            far = []
            for index in range(count):
                away = 100.0 + 0.3 * twin.period * tick + 10.0 * index
                place = path.points[0] - away * direction + 0.01 * rng.standard_normal(size)
                far.append(Detection(f"warm-up {index}", place, 1e-4 * np.eye(size), 0.5))
            seen = Observation(twin.period * tick, state, tuple(far))
            (twin.remember if tick < samples else twin.command)(seen)
