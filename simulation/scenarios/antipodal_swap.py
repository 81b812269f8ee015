"""Robots on a circle that all change places with the one opposite."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from .base import Placement, Range, Scenario, checked_range, draw


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
    circle : R, m; None for max(4, 0.6 n), which leaves the same stretch of the circle to each
        robot from n = 7 on.
    angle : range of a_i, rad; drawn for each robot.
    phase : range of the phase offsets, as shares of the control period, in [0, 1).
    speed : m/s, reference speed and speed at time 0.

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
    circle: float | None = None
    angle: Range = (-0.05, 0.05)
    phase: Range = (0.0, 0.99)
    speed: float = 0.5

    def __post_init__(self) -> None:
        whole("antipodal_swap.robots", self.robots, least=2)
        positive("antipodal_swap.robot_radius", self.robot_radius)
        positive("antipodal_swap.speed", self.speed)
        if self.circle is not None:
            positive("antipodal_swap.circle", self.circle)
        checked_range("antipodal_swap.angle", self.angle, -np.pi, np.pi)
        checked_range("antipodal_swap.phase", self.phase, 0.0, 1.0 - 1e-9)
        nearest = 2.0 * np.pi / self.robots - (self.angle[1] - self.angle[0])
        if nearest <= 0.0 or 2.0 * self.radius * np.sin(0.5 * nearest) <= 2.0 * self.robot_radius:
            raise WideberthError(
                f"antipodal_swap: {self.robots} robots of radius {self.robot_radius:g} m overlap "
                f"on a circle of radius {self.radius:g} m; take fewer robots, a larger circle or "
                "smaller angles"
            )

    @property
    def radius(self) -> float:
        """R, m."""
        return max(4.0, 0.6 * self.robots) if self.circle is None else self.circle

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw angle and phase of each robot."""
        placed = []
        for i in range(self.robots):
            angle = 2.0 * np.pi * i / self.robots + draw(rng, self.angle)
            start = self.radius * np.array([np.cos(angle), np.sin(angle)])
            path = Path(np.stack([start, -start]))
            placed.append(Placement(f"robot {i + 1}", path, self.speed, draw(rng, self.phase)))
        return tuple(placed)
