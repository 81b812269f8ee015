"""Two robots meet at the corner of a corridor that a pedestrian comes through as well."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, ScriptedAgent
from .base import Placement, Range, Scenario, checked_range, draw


@final
@dataclass(frozen=True)
class BlindCorner(Scenario):
    """A corridor of width w that turns left by a right angle, with walls, a crate and a pillar.

    The corridor's middle runs along the x axis from (-a, 0) to the corner in the origin and
    on to (0, a). Its outer wall is an L, so not convex; its inner wall is a block; a crate stands
    in the way of ``outward``, and a pillar stands in front of the corner's outer wall. The robot
    ``inward`` drives along the middle, shifted to its right by an offset drawn from a range;
    ``outward`` comes the other way, shifted to its own right; the lag decides where they meet.
    A pedestrian walks along the outer wall, against ``inward``.

    Parameters
    ----------
    width : m, of the corridor.
    arm : m, a.
    offset : m, range of the robots' distance to the right of the middle; drawn for each.
    lag : s, range of the time by which ``outward`` starts later (it starts farther back).
    phase : range of the robots' phase offsets, as shares of the control period, in [0, 1).
    speed : m/s, reference speed and speed at time 0.
    pedestrian_speed : m/s, range.
    pedestrian_radius : m.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds.
    """

    width: float = 4.4
    arm: float = 9.0
    offset: Range = (0.2, 0.8)
    lag: Range = (-3.0, 3.0)
    phase: Range = (0.0, 0.99)
    speed: float = 0.5
    pedestrian_speed: Range = (0.4, 0.8)
    pedestrian_radius: float = 0.25

    def __post_init__(self) -> None:
        for name in ("width", "speed", "pedestrian_radius"):
            positive(f"blind_corner.{name}", getattr(self, name))
        positive("blind_corner.arm", self.arm - self.width)
        most = self.arm / self.speed
        checked_range("blind_corner.offset", self.offset, -0.4 * self.width, 0.4 * self.width)
        checked_range("blind_corner.lag", self.lag, -most, most)
        checked_range("blind_corner.phase", self.phase, 0.0, 1.0 - 1e-9)
        checked_range("blind_corner.pedestrian_speed", self.pedestrian_speed, 0.0)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offsets, lag and phases."""
        first, second = draw(rng, self.offset), draw(rng, self.offset)
        later = self.speed * draw(rng, self.lag)
        phases = draw(rng, self.phase), draw(rng, self.phase)
        inward = self._lane(-first, self.arm - max(-later, 0.0), self.arm)
        outward = self._lane(second, self.arm, self.arm + max(later, 0.0))[::-1]
        return (
            Placement("inward", Path(inward), self.speed, phases[0]),
            Placement("outward", Path(outward), self.speed, phases[1]),
        )

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """One pedestrian, who walks on beyond the corridor: no one stands at a robot's goal."""
        way = self._lane(-0.3 * self.width, self.arm + 60.0, self.arm + 2.0)[::-1]
        speed = draw(rng, self.pedestrian_speed)
        return (ScriptedAgent("pedestrian", Path(way), speed, self.pedestrian_radius),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Walls, crate and pillar; they stand at the same places for every seed."""
        half, thick, end = 0.5 * self.width, 0.4, self.arm + 2.5
        out = half + thick
        wall = (
            (-end, -out), (out, -out), (out, end), (half, end), (half, -half), (-end, -half),
        )  # fmt: skip
        block = ((-end, half), (-half, half), (-half, end), (-end, end))
        crate = _regular(4, 0.7, np.array([-0.55 * self.arm, half - 0.6]), 0.3)
        pillar = _regular(6, 0.3, np.array([half - 0.6, -half + 0.6]), 0.0)
        return (
            Polygon(wall, "wall"),
            Polygon(block, "block"),
            Polygon(crate, "crate"),
            Polygon(pillar, "pillar"),
        )

    def _lane(self, left: float, before: float, after: float) -> Array:
        """Way around the corner, ``left`` m to the left of the middle, (3, 2), m."""
        return np.array([[-before, left], [-left, left], [-left, after]])


def _regular(
    corners: int, radius: float, centre: Array, turn: float
) -> tuple[tuple[float, float], ...]:
    """Corners of a regular polygon, m."""
    angle = turn + 2.0 * np.pi * np.arange(corners) / corners
    points = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return tuple((float(x), float(y)) for x, y in points)
