"""A door as wide as one body, with oncoming traffic."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, final

import numpy as np

from ...framework.values.arrays import Array, checked_choice, positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ...routes.walls import box
from ..engine.agents import Bystander, ScriptedAgent
from .base import PHASE, Placement, Scenario, draw_value

Oncoming: TypeAlias = Literal["walker", "robot"]

WALL = 6.0
"""m of wall on either side of the door."""
THICKNESS = 0.2
"""m, of the wall."""
GONE = 60.0
"""m behind the door where a walker stops: no one stands at the robot's goal."""
REACH = 5.0
"""m, from the door to the robot's start and goal, along x."""
ASIDE = (-1.0, 1.0)
"""m, range of y1 and y2, and of the same numbers of the other one; each drawn."""
LAG = (-2.0, 2.0)
"""s, range of l; negative where the other one is first."""
WALKER_RADIUS = 0.3
"""m, of the walker."""
WALKER_SPEED = (0.4, 0.7)
"""m/s, range of the walker's speed."""
SPEED = 0.5
"""m/s, of robots at time 0, and their reference speed."""


@final
@dataclass(frozen=True)
class Doorway(Scenario):
    """A wall along the y axis with a door in the origin, as wide as 1.2 robots.

    ``robot`` drives from (-reach, y1) through the middle of the door to (reach, y2).
    A walker or a second robot comes through it the other way, so far away at time 0 that
    undisturbed it is in the door l seconds after the robot: only one of them fits in.

    Parameters
    ----------
    opening : width of the door over 2 r, above 1.
    robot_radius : r, m, of the robot that there is room for.
    oncoming : "walker", who makes way for no one, or "robot", which has the same controller.

    Raises
    ------
    WideberthError : a range that is not ordered or out of bounds; a door too narrow for those
        who come through it.

    Notes
    -----
    Opening and lag are the benchmark's; reach, speeds and the bends of the ways are ours.
    """

    opening: float = 1.2
    robot_radius: float = 0.3
    oncoming: Oncoming = "walker"

    def __post_init__(self) -> None:
        checked_choice("doorway.oncoming", self.oncoming, Oncoming)
        positive("doorway.robot_radius", self.robot_radius)
        body = max(self.robot_radius, WALKER_RADIUS)
        if not 0.5 * self.width > body:
            raise WideberthError(
                f"doorway: the door is {self.width:g} m wide (opening {self.opening:g} times "
                f"2 r), and a body of radius {body:g} m does not fit through it; take a wider "
                "opening or a smaller body"
            )

    @property
    def width(self) -> float:
        """Width of the door, m."""
        return self.opening * 2.0 * self.robot_radius

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the way and the phase; of the other robot as well, where there is one."""
        way, phase = self._way(rng, REACH), draw_value(rng, PHASE)
        robot = Placement("robot", Path(way), SPEED, phase)
        if self.oncoming == "walker":
            return (robot,)
        other = self._oncoming(rng, robot.path, SPEED, REACH)
        return robot, Placement("oncoming", other, SPEED, draw_value(rng, PHASE))

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the walker, where the other one is none of the robots."""
        if self.oncoming == "robot":
            return ()
        speed = draw_value(rng, WALKER_SPEED)
        way = self._oncoming(rng, placements[0].path, speed, GONE)
        return (ScriptedAgent("walker", way, speed, WALKER_RADIUS),)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Both parts of the wall; the same for every seed."""
        x, y = 0.5 * THICKNESS, 0.5 * self.width
        return (
            box((-x, y), (x, y + WALL), "wall left"),
            box((-x, -y - WALL), (x, -y), "wall right"),
        )

    def _oncoming(self, rng: np.random.Generator, path: Path, speed: float, end: float) -> Path:
        """Way of the other one, which reaches the door l s after the robot."""
        way = -self._way(rng, REACH)
        way[2] *= end / REACH
        arrival = path.arc[1] / SPEED + draw_value(rng, LAG)
        way[0] *= speed * arrival / np.hypot(*way[0])
        return Path(way)

    def _way(self, rng: np.random.Generator, reach: float) -> Array:
        """Way through the door from the left, (3, 2), m."""
        first, second = draw_value(rng, ASIDE), draw_value(rng, ASIDE)
        return np.array([[-reach, first], [0.0, 0.0], [reach, second]])
