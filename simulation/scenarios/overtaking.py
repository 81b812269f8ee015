"""A robot behind a slow walker in a corridor."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, ScriptedAgent
from .base import PHASE, Placement, Range, Scenario, checked_range, draw_value
from .placing import corridor_walls

PASSAGE = 0.05
"""m on either side of the robot that the wider way past the leader has at least."""
BEYOND = 8.0
"""m of corridor before the robot's start and behind its goal."""
LENGTH = 16.0
"""m, of the robot's way."""
GAP = (2.5, 4.0)
"""m, range of the distance of the centres at time 0, along the corridor."""
OFFSET = (-0.2, 0.2)
"""m, range of o, the robot's."""
LEADER_SPEED = (0.2, 0.4)
"""m/s, range of the leader's speed."""
LEADER_RADIUS = 0.3
"""m, of the leader."""
SPEED = 0.7
"""m/s, of the robot at time 0, and its reference speed."""


@final
@dataclass(frozen=True)
class Overtaking(Scenario):
    """A leader walks ahead in a corridor of width w about the x axis; the robot is faster.

    ::

        robot   from (0, o) to (length, o)
        leader  from (gap, y), at its own speed, straight on and out of the corridor

    Undisturbed they touch at the time (gap - r - r_d) / (speed - leader speed).

    Parameters
    ----------
    width : w, m.
    aside : m, range of y, the leader's distance from the middle.
    robot_radius : m, of the robot that there is room for.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; nowhere room to pass.

    Notes
    -----
    Width 2 to 4 m and a leader of 0.2 to 0.4 m/s are the benchmark's; the other ranges are ours.
    """

    width: float = 3.0
    aside: Range = (-0.2, 0.2)
    robot_radius: float = 0.25

    def __post_init__(self) -> None:
        positive("overtaking.width", self.width)
        most = GAP[0] - LEADER_RADIUS - PASSAGE
        positive("overtaking.robot_radius", self.robot_radius, most=most)
        beside = max(0.5 * self.width - LEADER_RADIUS, 0.0)
        checked_range("overtaking.aside", self.aside, -beside, beside)
        least = 2.0 * (self.robot_radius + LEADER_RADIUS + PASSAGE + self.robot_radius)
        if self.width < least:
            raise WideberthError(
                f"overtaking.width is {self.width:g} m; past a leader in the middle a robot of "
                f"radius {self.robot_radius:g} m needs {least:g} m: take a wider corridor or "
                "smaller bodies"
            )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offset and phase."""
        offset = draw_value(rng, OFFSET)
        way = Path(np.array([[0.0, offset], [LENGTH, offset]]))
        return (Placement("robot", way, SPEED, draw_value(rng, PHASE)),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw gap, place and speed of the leader, who does not stop at the robot's goal."""
        gap, aside, speed = (draw_value(rng, one) for one in (GAP, self.aside, LEADER_SPEED))
        way = Path(np.array([[gap, aside], [LENGTH + 100.0, aside]]))
        return (ScriptedAgent("leader", way, speed, LEADER_RADIUS),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls; the same for every seed."""
        return corridor_walls(self.width, -BEYOND, LENGTH + BEYOND)
