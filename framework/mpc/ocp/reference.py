"""What the plan tracks: positions, directions and speeds laid along the path."""

from dataclasses import dataclass

import numpy as np

from ...values.arrays import Array
from ...values.path import Path


@dataclass(frozen=True, eq=False)
class Reference:
    """What the plan tracks, at steps 1..N.

    Attributes
    ----------
    position : (N, D), m.
    direction : (N, D), unit tangents.
    speed : (N,), m/s.
    curve : (N, C), numbers of the path that some costs need; C is 0 for the others.
    """

    position: Array
    direction: Array
    speed: Array
    curve: Array


def lay_reference(path: Path, start: float, speed: float, steps: int, dt: float) -> Reference:
    """Lay the reference along the path from arc length ``start`` at a constant speed.

    Position i is the path at start + i * speed * dt; at the end of the path it stays at the goal
    and the reference speed drops to what is left to go, so that the robot stops there. The paper
    gives "an ordered sequence of points" and a constant speed to the end; it does not say how
    the points are chosen at each call. We lay them anew from the path point nearest to the robot.
    """
    arcs = np.minimum(start + speed * dt * np.arange(steps + 1), path.length)
    begin, end = arcs[:-1], arcs[1:]
    direction = path.direction(0.5 * (end + begin))
    return Reference(path.at(end), direction, (end - begin) / dt, np.zeros((steps, 0)))
