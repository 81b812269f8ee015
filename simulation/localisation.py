"""How well a robot knows where it is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ..framework.arrays import Array, positive
from ..framework.integration import slopes
from ..framework.motion import Pose
from ..framework.robot import Robot


@final
@dataclass(frozen=True)
class Localisation:
    """Noise of a robot's own pose, Gaussian and independent from one decision to the next.

    The paper's robots know their state exactly, the default. With noise, observations also
    carry its covariance, which the planner adds to that of the obstacles.

    Parameters
    ----------
    position : m, standard deviation of each coordinate.
    heading : rad, standard deviation.

    Raises
    ------
    WideberthError : a deviation below 0.
    """

    position: float = 0.0
    heading: float = 0.0

    def __post_init__(self) -> None:
        positive("localisation.position", self.position, zero=True)
        positive("localisation.heading", self.heading, zero=True)

    def measure(
        self,
        robot: Robot,
        state: Sequence[float] | Array,
        control: Sequence[float],
        rng: np.random.Generator,
    ) -> tuple[Array, Array | None]:
        """Return what the robot thinks its state is, and that estimate's covariance.

        The twist is known. Where the pose is, is the robot model's affair: the covariance is
        carried from the pose to the state by the derivative of `Robot.state_at`.
        """
        exact = np.array(state, dtype=np.float64)
        if not self.position and not self.heading:
            return exact, None
        pose, twist = robot.pose(tuple(state)), robot.twist(tuple(state), tuple(control))
        entries = [float(value) for value in pose.position]
        deviations = [self.position] * len(entries)
        headed = pose.heading is not None
        if pose.heading is not None:
            entries.append(float(pose.heading))
            deviations.append(self.heading)

        def place(values: Array) -> Array:
            numbers = tuple(float(value) for value in values)
            moved = Pose(numbers[:-1], numbers[-1]) if headed else Pose(numbers)
            return np.array(robot.state_at(moved, twist), dtype=np.float64)

        spread = np.array(deviations)
        slope = slopes(place, entries)
        noisy = place(np.array(entries) + spread * rng.standard_normal(len(entries)))
        covariance = (slope * spread**2) @ slope.T
        return noisy, 0.5 * (covariance + covariance.T)
