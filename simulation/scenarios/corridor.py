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
from .base import PHASE, Placement, Scenario, draw_value
from .crowd_mix import CrowdMix, mix_of
from .placing import apart, corridor_walls, draw_place

SPACE = 0.1
"""m that bodies leave to each other and to the walls at time 0."""
BEYOND = 8.0
"""m of corridor before the robot's start and behind the last person."""
LENGTH = 14.0
"""m, of the robot's way."""
START = (0.4, 1.3)
"""Range of x as a share of the length."""
OFFSET = (-0.2, 0.2)
"""m, range of o."""
PERSON_SPEED = (0.5, 1.0)
"""m/s, range of the people's speeds."""
PERSON_RADIUS = (0.2, 0.3)
"""m, range of the people's radii."""
SPEED = 0.7
"""m/s, of the robot at time 0, and its reference speed."""


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
    persons : number of people who come the other way.
    robot_radius : m, of the robot that there is room for.
    crowd : who the people are.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; a corridor in which a robot
        and a person cannot pass each other; when drawing, too many people.

    Notes
    -----
    Width 2 to 4 m is the benchmark's; the other ranges are ours.
    """

    width: float = 3.0
    persons: int = 3
    robot_radius: float = 0.3
    crowd: CrowdMix = field(default_factory=partial(mix_of, {"moussaid_force": {}}))

    def __post_init__(self) -> None:
        largest = PERSON_RADIUS[1]
        positive("corridor.width", self.width)
        nearest = START[0] * LENGTH - largest - SPACE
        positive("corridor.robot_radius", self.robot_radius, most=nearest)
        whole("corridor.persons", self.persons, least=0)
        least = 2.0 * (self.robot_radius + largest) + SPACE
        if self.width < least:
            raise WideberthError(
                f"corridor.width is {self.width:g} m; a robot of radius {self.robot_radius:g} m "
                f"and a person of {largest:g} m pass each other in {least:g} m: take a wider "
                "corridor or smaller bodies"
            )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw offset and phase."""
        offset = draw_value(rng, OFFSET)
        way = Path(np.array([[0.0, offset], [LENGTH, offset]]))
        return (Placement("robot", way, SPEED, draw_value(rng, PHASE)),)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the oncoming people."""
        taken = [(placements[0].path.points[0], self.robot_radius)]
        found = []
        for k in range(1, self.persons + 1):
            radius, speed = draw_value(rng, PERSON_RADIUS), draw_value(rng, PERSON_SPEED)
            place = self._free_place(rng, radius, taken, k)
            taken.append((place, radius))
            way = Path(np.stack([place, place - np.array([2.0 * LENGTH, 0.0])]))
            found.append(self.crowd.person(rng, f"person {k}", way, speed, radius))
        return tuple(found)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both walls; the same for every seed."""
        end = LENGTH * max(START[1], 1.0) + BEYOND
        return corridor_walls(self.width, -2.0 * LENGTH - BEYOND, end)

    def _free_place(
        self, rng: np.random.Generator, radius: float, taken: list[tuple[Array, float]], k: int
    ) -> Array:
        """Draw a place in the corridor that no one occupies."""
        side = 0.5 * self.width - radius - SPACE

        def place() -> Array:
            return np.array([LENGTH * draw_value(rng, START), draw_value(rng, (-side, side))])

        return draw_place(
            place,
            lambda drawn: apart(drawn, radius, taken, SPACE),
            f"person {k} of {self.persons}: take fewer, a wider corridor or a longer range of "
            "corridor.start",
        )
