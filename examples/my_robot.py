"""A robot of your own: a cart whose two inputs are its speed and its yaw rate.

The script checks the laws of a robot, plans around a person who stands in the way, and draws the
plan into ``my_robot.png``. A config names the robot by its path, ``robot: my_robot:Cart``, if this
file lies in the folder where the command is given.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from wideberth import Detection, Observation, Path, Pose, Robot, Twist, build, register
from wideberth.framework import Bounds, Quantity, Scalar, check_robot


@register("robots", "cart")
@final
@dataclass(frozen=True)
class Cart(Robot):
    """A cart that takes on a speed and a yaw rate at once.

    State (x, y, phi), input (v, omega)::

        x' = v cos(phi)    y' = v sin(phi)    phi' = omega

    Use NumPy's functions in the equations: they also serve CasADi's expressions.

    Parameters
    ----------
    radius : m, of the disc that encloses the cart.
    max_speed : m/s, |v|.
    max_yaw_rate : rad/s, |omega|.
    """

    states: ClassVar = (Quantity("x", "m"), Quantity("y", "m"), Quantity("phi", "rad"))
    inputs: ClassVar = (Quantity("v", "m/s"), Quantity("omega", "rad/s"))

    radius: float = 0.3
    max_speed: float = 1.0
    max_yaw_rate: float = 1.0

    def derivative(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Time derivative of the state."""
        _, _, phi = state
        v, omega = control
        return v * np.cos(phi), v * np.sin(phi), omega

    def state_bounds(self) -> Bounds:
        """Leave position and heading free."""
        return Bounds.symmetric(np.inf, np.inf, np.inf)

    def input_bounds(self) -> Bounds:
        """Limits of speed and yaw rate."""
        return Bounds.symmetric(self.max_speed, self.max_yaw_rate)

    def pose(self, state: Sequence[Scalar]) -> Pose:
        """Position and heading are the state."""
        return Pose((state[0], state[1]), state[2])

    def twist(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Forward speed and yaw rate are the input; the cart does not slip sideways."""
        return Twist((control[0], 0.0), control[1])

    def acceleration(self, state: Sequence[Scalar], control: Sequence[Scalar]) -> Twist:
        """Zero: within a step the input, and with it the twist, is constant."""
        return Twist((0.0, 0.0), 0.0)

    def state_at(self, pose: Pose, twist: Twist) -> tuple[Scalar, ...]:
        """State at this pose; the twist is no part of it."""
        return (*pose.position, pose.heading)

    def drive(self, state: Sequence[float], twist: Twist, duration: float) -> tuple[float, ...]:
        """Return the wanted twist within the limits."""
        v = np.clip(twist.linear[0], -self.max_speed, self.max_speed)
        omega = np.clip(twist.angular, -self.max_yaw_rate, self.max_yaw_rate)
        return float(v), float(omega)


def draw(file: str) -> None:
    """Plan around a person who stands in the way, and draw path, plan and person."""
    robot = Cart()
    settings = {
        "type": "mpc",
        "robot": robot,
        "region": "mahalanobis_ellipse",
        "predictor": {"type": "static", "spread_rate": 0.05},  # m/s per axis
        "level": "fixed",
        "solver": "riccati",
    }
    planner = build("controllers", settings)
    planner.set_path(Path([(0.0, 0.0), (8.0, 0.0)]))
    noise = 1e-4 * np.eye(2)  # m^2, of a measured position
    place = (2.5, -0.1)  # m
    person = Detection("person", place, noise, radius=0.3)
    planner.command(Observation(stamp=0.0, state=(0.0, 0.0, 0.0), detections=(person,)))

    figure, axes = plt.subplots(figsize=(7, 3))
    axes.plot([0.0, 5.0], [0.0, 0.0], "k:", label="path")
    axes.plot(*planner.plan.positions.T, "ko-", markersize=3, label="plan")
    axes.add_patch(Circle(place, person.radius, color="0.6", label="person"))
    for centre in planner.plan.positions[::3]:
        axes.add_patch(Circle(centre, robot.radius, fill=False, color="0.6"))
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal", ylim=(-1.0, 1.5))
    axes.legend(loc="upper left")
    figure.savefig(file, dpi=150, bbox_inches="tight")
    print("The plan is", planner.plan.rung)


if __name__ == "__main__":
    check_robot(Cart())
    print("Cart keeps every law of a robot")
    draw("my_robot.png")
