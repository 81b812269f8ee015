"""Import and compile before the first decision, which has to be quick."""

from contextlib import suppress

import numpy as np

from ..controller import Controller
from ..motion import Detection, Observation
from ..path import Path
from ..robot import Robot, start_state


def warm_up(twin: Controller, robot: Robot, path: Path, speed: float, samples: int) -> None:
    """Let a planner that nobody needs decide with one obstacle far behind it.

    What goes wrong here goes wrong again in `command`, which turns it into a reason.

    Parameters
    ----------
    twin : shares its compiled problems with the planner that is to be warm.
    robot, path, speed : where it would start.
    samples : observations before the one decision: long enough for what fits a model.
    """
    with suppress(Exception):  # a plug-in that raises here is named by `command`
        direction = path.direction(np.zeros(1))[0]
        state = np.array(start_state(robot, path.points[0], direction, speed)[0], float)
        size, rng = robot.dimension, np.random.default_rng(0)
        for tick in range(samples + 2):
            away = 100.0 + 0.3 * twin.period * tick
            place = path.points[0] - away * direction + 0.01 * rng.standard_normal(size)
            far = Detection("warm-up", place, 1e-4 * np.eye(size), 0.5)
            seen = Observation(twin.period * tick, state, (far,))
            (twin.remember if tick < samples else twin.command)(seen)
