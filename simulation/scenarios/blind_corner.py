"""Two robots meet at the corner of a corridor that a pedestrian comes through as well."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, ScriptedAgent
from .base import PHASE, Placement, Scenario, draw_value

ARM = 9.0
"""m, the length a of both arms."""
OFFSET = (0.2, 0.8)
"""m, range of the robots' distance to the right of the middle; drawn for each."""
LAG = (-3.0, 3.0)
"""s, range of the time by which ``outward`` starts later (it starts farther back)."""
PEDESTRIAN_SPEED = (0.4, 0.8)
"""m/s, range of the pedestrian's speed."""
PEDESTRIAN_RADIUS = 0.25
"""m, of the pedestrian."""
SPEED = 0.5
"""m/s, reference speed and speed at time 0."""


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

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds.
    """

    width: float = 4.4

    def __post_init__(self) -> None:
        positive("blind_corner.width", self.width, most=ARM)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offsets, lag and phases."""
        first, second = draw_value(rng, OFFSET), draw_value(rng, OFFSET)
        later = SPEED * draw_value(rng, LAG)
        phases = draw_value(rng, PHASE), draw_value(rng, PHASE)
        inward = self._lane(-first, ARM - max(-later, 0.0), ARM)
        outward = self._lane(second, ARM, ARM + max(later, 0.0))[::-1]
        return (
            Placement("inward", Path(inward), SPEED, phases[0]),
            Placement("outward", Path(outward), SPEED, phases[1]),
        )

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """One pedestrian, who walks on beyond the corridor: no one stands at a robot's goal."""
        way = self._lane(-0.3 * self.width, ARM + 60.0, ARM + 2.0)[::-1]
        speed = draw_value(rng, PEDESTRIAN_SPEED)
        return (ScriptedAgent("pedestrian", Path(way), speed, PEDESTRIAN_RADIUS),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Walls, crate and pillar; they stand at the same places for every seed."""
        half, thick, end = 0.5 * self.width, 0.4, ARM + 2.5
        out = half + thick
        wall = (
            (-end, -out), (out, -out), (out, end), (half, end), (half, -half), (-end, -half),
        )  # fmt: skip
        block = ((-end, half), (-half, half), (-half, end), (-end, end))
        crate = _regular(4, 0.7, np.array([-0.55 * ARM, half - 0.6]), 0.3)
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
