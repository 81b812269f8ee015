"""Robots on a circle that all change places with the one opposite."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from .base import PHASE, Placement, Scenario, draw_value

ANGLE = (-0.05, 0.05)
"""Range of a_i, rad; drawn for each robot."""
SPEED = 0.5
"""m/s, reference speed and speed at time 0."""


@final
@dataclass(frozen=True)
class AntipodalSwap(Scenario):
    """n robots on a circle of radius R; each drives through the middle to the opposite point.

    Robot i stands at the angle 2 pi i / n + a_i and its goal is its start mirrored at the centre.
    All robots have the controller that is examined, and meet in the middle at the same time,
    but for the small angles a_i and the phases.

    Parameters
    ----------
    robots : n, at least 2.
    robot_radius : m, of the robots that there is room for.

    Raises
    ------
    WideberthError : a number out of range; robots that overlap on the circle.

    Notes
    -----
    A usual test of reciprocal avoidance (van den Berg et al. 2011). R is that of this project's
    bar; the angles and phases are ours: without them every seed is the same situation.
    """

    robots: int = 4
    robot_radius: float = 0.3

    def __post_init__(self) -> None:
        whole("antipodal_swap.robots", self.robots, least=2)
        positive("antipodal_swap.robot_radius", self.robot_radius)
        nearest = 2.0 * np.pi / self.robots - (ANGLE[1] - ANGLE[0])
        if nearest <= 0.0 or 2.0 * self.radius * np.sin(0.5 * nearest) <= 2.0 * self.robot_radius:
            raise WideberthError(
                f"antipodal_swap: {self.robots} robots of radius {self.robot_radius:g} m overlap "
                f"on a circle of radius {self.radius:g} m; take fewer or smaller ones"
            )

    @property
    def radius(self) -> float:
        """R, m; from n = 7 on each robot has the same stretch of the circle."""
        return max(4.0, 0.6 * self.robots)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw angle and phase of each robot."""
        placed = []
        for i in range(self.robots):
            angle = 2.0 * np.pi * i / self.robots + draw_value(rng, ANGLE)
            start = self.radius * np.array([np.cos(angle), np.sin(angle)])
            path = Path(np.stack([start, -start]))
            placed.append(Placement(f"robot {i + 1}", path, SPEED, draw_value(rng, PHASE)))
        return tuple(placed)
