"""Localisation: the error of a robot's own state estimate."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.numerics.integration import carried_covariance
from ...framework.robot import Robot
from ...framework.values.arrays import Array, positive
from ...framework.values.motion import Pose, Twist


@final
@dataclass(frozen=True)
class Localisation:
    """Noise of a robot's own pose and speed, independent from one decision to the next.

    The paper's robots estimate their state by an extended Kalman filter on wheel encoders, IMU
    and LiDAR; its planner takes the estimate as exact. Here there are neither sensors nor
    filter: a robot knows its state exactly (the default) or with this noise. With noise,
    observations also carry its covariance, which the planner adds to that of the obstacles.

    Parameters
    ----------
    position : m, standard deviation of each coordinate.
    heading : rad, standard deviation.
    speed : m/s, standard deviation of the forward speed, or, for a robot without heading, of
        each component of the velocity.

    Raises
    ------
    WideberthError : a deviation below 0.
    """

    position: float = 0.0
    heading: float = 0.0
    speed: float = 0.0

    def __post_init__(self) -> None:
        positive("localisation.position", self.position, zero=True)
        positive("localisation.heading", self.heading, zero=True)
        positive("localisation.speed", self.speed, zero=True)

    @property
    def exact(self) -> bool:
        """Whether there is no noise."""
        return not (self.position or self.heading or self.speed)

    def measure(
        self,
        robot: Robot,
        state: Sequence[float] | Array,
        control: Sequence[float],
        rng: np.random.Generator,
    ) -> tuple[Array, Array | None]:
        """Return an estimate of the robot's state and its covariance.

        Where pose and speed are in the state is the robot model's affair: the covariance is
        carried to it by the derivative of `Robot.state_at`.
        """
        exact = np.array(state, dtype=np.float64)
        if self.exact:
            return exact, None
        pose, twist = robot.pose(tuple(state)), robot.twist(tuple(state), tuple(control))
        places = [float(value) for value in pose.position]
        turns = [] if pose.heading is None else [float(pose.heading)]
        speeds = [float(value) for value in twist.linear[: 1 if turns else None]]
        known = twist.linear[len(speeds) :]
        cut = len(places), len(places) + len(turns)

        def assemble(values: Array) -> Array:
            place, turn, speed = (tuple(map(float, v)) for v in np.split(values, cut))
            moved = Twist((*speed, *known), twist.angular)
            return np.array(
                robot.state_at(Pose(place, turn[0] if turn else None), moved), dtype=np.float64
            )

        spread = np.repeat(
            (self.position, self.heading, self.speed), [len(places), len(turns), len(speeds)]
        )
        entries = np.array([*places, *turns, *speeds])
        noisy = assemble(entries + spread * rng.standard_normal(len(entries)))
        return noisy, carried_covariance(assemble, entries, np.diag(spread**2))
