"""A corridor with oncoming people."""

from dataclasses import dataclass, field
from functools import partial
from typing import final

import numpy as np

from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ..engine.agents import RobotAgent
from .base import Placement, Range, Scenario, checked_range, draw
from .crowd_mix import CrowdMix, mix_of
from .placing import apart, corridor_walls, draw_place

SPACE = 0.1
"""m that bodies leave to each other and to the walls at time 0."""
BEYOND = 8.0
"""m of corridor before the robot's start and behind the last person."""


@final
@dataclass(frozen=True, eq=False)
class Corridor(Scenario):
    """A robot drives along a corridor of width w about the x axis; people come the other way.

    ::

        robot   from (0, o) to (length, o)
        person  from (x, y) to (x - 2 length, y) at a speed of their own

    Places and speeds are drawn one person after the other; who would stand on another one is
    drawn again.

    Parameters
    ----------
    width : w, m.
    length : m, of the robot's way.
    persons : number of people who come the other way.
    start : range of x as a share of the length.
    offset : m, range of o.
    person_speed : m/s, range.
    person_radius : m, range.
    robot_radius : m, of the robot that there is room for.
    crowd : who the people are.
    phase : range of the phase offset, as a share of the control period, in [0, 1).
    speed : m/s, of the robot at time 0, and its reference speed.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; a corridor in which a robot
        and a person cannot pass each other; when drawing, too many people.

    Notes
    -----
    Width 2 to 4 m is the benchmark's; the other ranges are ours.
    """

    width: float = 3.0
    length: float = 14.0
    persons: int = 3
    start: Range = (0.4, 1.3)
    offset: Range = (-0.2, 0.2)
    person_speed: Range = (0.5, 1.0)
    person_radius: Range = (0.2, 0.3)
    robot_radius: float = 0.3
    crowd: CrowdMix = field(default_factory=partial(mix_of, {"moussaid_force": {}}))
    phase: Range = (0.0, 0.99)
    speed: float = 0.7

    def __post_init__(self) -> None:
        for name in ("width", "length", "robot_radius", "speed"):
            positive(f"corridor.{name}", getattr(self, name))
        whole("corridor.persons", self.persons, least=0)
        checked_range("corridor.person_speed", self.person_speed, 1e-3)
        checked_range("corridor.person_radius", self.person_radius, 1e-3)
        checked_range("corridor.phase", self.phase, 0.0, 1.0 - 1e-9)
        largest = self.person_radius[1]
        least = 2.0 * (self.robot_radius + largest) + SPACE
        if self.width < least:
            raise WideberthError(
                f"corridor.width is {self.width:g} m; a robot of radius {self.robot_radius:g} m "
                f"and a person of {largest:g} m pass each other in {least:g} m: take a wider "
                "corridor or smaller bodies"
            )
        most = 0.5 * self.width - self.robot_radius - SPACE
        checked_range("corridor.offset", self.offset, -most, most)
        first = (self.robot_radius + largest + SPACE) / self.length
        checked_range("corridor.start", self.start, first)

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offset and phase."""
        offset = draw(rng, self.offset)
        way = Path(np.array([[0.0, offset], [self.length, offset]]))
        return (Placement("robot", way, self.speed, draw(rng, self.phase)),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the oncoming people."""
        taken = [(placements[0].path.points[0], self.robot_radius)]
        found = []
        for k in range(1, self.persons + 1):
            radius, speed = draw(rng, self.person_radius), draw(rng, self.person_speed)
            place = self._free_place(rng, radius, taken, k)
            taken.append((place, radius))
            way = Path(np.stack([place, place - np.array([2.0 * self.length, 0.0])]))
            found.append(self.crowd.person(rng, f"person {k}", way, speed, radius))
        return tuple(found)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls; the same for every seed."""
        end = self.length * max(self.start[1], 1.0) + BEYOND
        return corridor_walls(self.width, -2.0 * self.length - BEYOND, end)

    def _free_place(
        self, rng: np.random.Generator, radius: float, taken: list[tuple[Array, float]], k: int
    ) -> Array:
        """Draw a place in the corridor that no one occupies."""
        side = 0.5 * self.width - radius - SPACE

        def place() -> Array:
            return np.array([self.length * draw(rng, self.start), draw(rng, (-side, side))])

        return draw_place(
            place,
            lambda drawn: apart(drawn, radius, taken, SPACE),
            f"person {k} of {self.persons}: take fewer, a wider corridor or a longer range of "
            "corridor.start",
        )
