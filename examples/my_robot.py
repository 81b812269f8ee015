"""A robot of your own: a cart whose two inputs are its speed and its yaw rate."""
# ruff: noqa: D101, E731

from dataclasses import dataclass

import numpy as np

from wideberth.framework.robot import Bounds, Quantity, Robot
from wideberth.framework.testing import check_robot
from wideberth.framework.values.motion import Pose, Twist


@dataclass(frozen=True)
class Cart(Robot):
    states = Quantity("x", "m"), Quantity("y", "m"), Quantity("phi", "rad")
    inputs = Quantity("v", "m/s"), Quantity("omega", "rad/s")
    radius: float = 0.3
    derivative = lambda _, x, u: (u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[1])
    state_bounds = lambda _: Bounds((-np.inf,) * 3, (np.inf,) * 3)
    input_bounds = lambda _: Bounds((-1.0, -1.0), (1.0, 1.0))
    constraints = lambda *_: ()
    pose = lambda _, x: Pose((x[0], x[1]), x[2])
    twist = lambda _, x, u: Twist((u[0], 0.0), u[1])
    acceleration = lambda *_: Twist((0.0, 0.0), 0.0)
    state_at = lambda _, pose, twist: (*pose.position, pose.heading)
    drive = lambda _, x, to, dt: tuple(np.clip((to.linear[0], to.angular), -1, 1))

if __name__ == "__main__":
    check_robot(Cart())
    print("Cart keeps every law; name it in a config as  type: my_robot:Cart")
