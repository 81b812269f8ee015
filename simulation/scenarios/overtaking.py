"""A robot behind a slow walker in a corridor."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import Bystander, ScriptedAgent
from .base import Placement, Range, Scenario, checked_range, draw
from .placing import corridor_walls

PASSAGE = 0.05
"""m on either side of the robot that the wider way past the leader has at least."""
BEYOND = 8.0
"""m of corridor before the robot's start and behind its goal."""


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
    length : m, of the robot's way.
    gap : m, range of the distance of the centres at time 0, along the corridor.
    aside : m, range of y, the leader's distance from the middle.
    offset : m, range of o, the robot's.
    leader_speed : m/s, range.
    leader_radius : m.
    robot_radius : m, of the robot that there is room for.
    phase : range of the phase offset, as a share of the control period, in [0, 1).
    speed : m/s, of the robot at time 0, and its reference speed.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; nowhere room to pass.

    Notes
    -----
    Width 2 to 4 m and a leader of 0.2 to 0.4 m/s are the benchmark's; the other ranges are ours.
    """

    width: float = 3.0
    length: float = 16.0
    gap: Range = (2.5, 4.0)
    aside: Range = (-0.2, 0.2)
    offset: Range = (-0.2, 0.2)
    leader_speed: Range = (0.2, 0.4)
    leader_radius: float = 0.3
    robot_radius: float = 0.25
    phase: Range = (0.0, 0.99)
    speed: float = 0.7

    def __post_init__(self) -> None:
        for name in ("width", "length", "leader_radius", "robot_radius", "speed"):
            positive(f"overtaking.{name}", getattr(self, name))
        checked_range("overtaking.leader_speed", self.leader_speed, 0.0, 0.99 * self.speed)
        checked_range("overtaking.phase", self.phase, 0.0, 1.0 - 1e-9)
        bodies = self.leader_radius + self.robot_radius
        checked_range("overtaking.gap", self.gap, bodies + PASSAGE)
        for name, radius in (("aside", self.leader_radius), ("offset", self.robot_radius)):
            most = max(0.5 * self.width - radius, 0.0)
            checked_range(f"overtaking.{name}", getattr(self, name), -most, most)
        least = 2.0 * (self.robot_radius + self.leader_radius + PASSAGE + self.robot_radius)
        if self.width < least:
            raise WideberthError(
                f"overtaking.width is {self.width:g} m; past a leader in the middle a robot of "
                f"radius {self.robot_radius:g} m needs {least:g} m: take a wider corridor or "
                "smaller bodies"
            )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offset and phase."""
        offset = draw(rng, self.offset)
        way = Path(np.array([[0.0, offset], [self.length, offset]]))
        return (Placement("robot", way, self.speed, draw(rng, self.phase)),)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw gap, place and speed of the leader, who does not stop at the robot's goal."""
        gap, aside, speed = (draw(rng, one) for one in (self.gap, self.aside, self.leader_speed))
        way = Path(np.array([[gap, aside], [self.length + 100.0, aside]]))
        return (ScriptedAgent("leader", way, speed, self.leader_radius),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls; the same for every seed."""
        return corridor_walls(self.width, -BEYOND, self.length + BEYOND)
