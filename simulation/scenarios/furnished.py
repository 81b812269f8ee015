"""Another scenario with walls, walkers and routes around the walls."""

from dataclasses import dataclass, field, replace
from pathlib import Path as File
from typing import final

import numpy as np

from ...framework.route_planner import RoutePlanner
from ...framework.values.arrays import Array, positive
from ...framework.values.costmap import Costmap
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...framework.values.polygon import Polygon
from ...routes.inflation import Inflation
from ...routes.polygons import grid_of_polygons
from ..engine.agents import Bystander, RobotAgent, ScriptedAgent
from .base import Placement, Range, Scenario, checked_range, draw_value
from .crossing import Crossing

BEYOND = 2.0
"""m by which the map reaches beyond walls, starts and goals."""
SLOPE = 0.5
"""m beside ``room`` within which a route costs more."""


@final
@dataclass(frozen=True)
class Walker:
    """A person who walks along a way and gives way to no one.

    Parameters
    ----------
    way : corners, m; the walker stops at the last one.
    speed : m/s, range.
    start : s, range of the time at which the first corner is passed.
    radius : m.

    Raises
    ------
    WideberthError : fewer than two corners, a range out of order, a radius not above 0.
    """

    way: tuple[tuple[float, float], ...]
    speed: Range = (1.0, 1.0)
    start: Range = (0.0, 0.0)
    radius: float = 0.3

    def __post_init__(self) -> None:
        Path(np.array(self.way))
        checked_range("walker.speed", self.speed, 0.0)
        checked_range("walker.start", self.start, -np.inf)
        positive("walker.radius", self.radius)


@final
@dataclass(frozen=True)
class Furnished(Scenario):
    """The robots of another scenario, among walls and walkers of one's own.

    With a route planner the robots' paths lead around the walls: from the start of the other
    scenario's path to its end, over a map of cells in which the walls are lethal and inflated
    by ``room``.

    Parameters
    ----------
    scenario : draws the robots, and its own people, bystanders and polygons.
    walls : what stands still beside these.
    walkers : who walks there beside these; times and speeds are drawn for each.
    routes : finds the paths; None to keep those of the scenario.
    room : m, least distance of a route from the walls.
    resolution : m, of the cells.

    Raises
    ------
    WideberthError : a number not above 0; a scenario that draws its situation as a whole; when
        drawing, no route.
    """

    scenario: Scenario = field(default_factory=Crossing)
    walls: tuple[Polygon, ...] = ()
    walkers: tuple[Walker, ...] = ()
    routes: RoutePlanner | None = None
    room: float = 0.9
    resolution: float = 0.1

    def __post_init__(self) -> None:
        positive("furnished.room", self.room)
        positive("furnished.resolution", self.resolution)
        kind = type(self.scenario)
        if kind.cast is not Scenario.cast:
            raise WideberthError(
                f"furnished.scenario is a {kind.__name__}, which draws its situation as a whole, "
                "and walls and walkers need its parts; furnish another scenario"
            )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Draw the other scenario's robots, and lay their paths around the walls."""
        placements = self.scenario.build(rng)
        if self.routes is None:
            return placements
        ends = np.concatenate([one.path.points[[0, -1]] for one in placements])
        costmap = self.costmap(ends)
        return tuple(replace(one, path=self._route(one, costmap)) for one in placements)

    def people(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[RobotAgent, ...]:
        """Draw the other scenario's people."""
        return self.scenario.people(rng, placements)

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the other scenario's bystanders, then the walkers."""
        others = self.scenario.bystanders(rng, placements)
        own = [
            ScriptedAgent(
                f"walker {i}", Path(np.array(one.way)), draw_value(rng, one.speed), one.radius,
                draw_value(rng, one.start),
            )
            for i, one in enumerate(self.walkers, start=1)
        ]  # fmt: skip
        return (*others, *own)

    def polygons(self, rng: np.random.Generator) -> tuple[Polygon, ...]:
        """Return the other scenario's polygons and the walls.

        Raises
        ------
        WideberthError : there are polygons that routes would lead through.
        """
        others = self.scenario.polygons(rng)
        if others and self.routes is not None:
            raise WideberthError(
                "furnished: routes lead around its walls alone, and the scenario within has "
                f"{len(others)} polygons of its own; give these as walls of another scenario"
            )
        return (*others, *self.walls)

    def inputs(self) -> tuple[File, ...]:
        """Return the files of the other scenario."""
        return self.scenario.inputs()

    def costmap(self, places: Array) -> Costmap:
        """Return the inflated costs of the walls, over all walls and places (K, 2), m."""
        bare = Costmap.from_grid(grid_of_polygons(self.walls, places, BEYOND, self.resolution))
        return Inflation(self.room, self.room + SLOPE).inflated(bare)

    def _route(self, one: Placement, costmap: Costmap) -> Path:
        """Return the route of a robot.

        Raises
        ------
        WideberthError : there is none.
        """
        assert self.routes is not None, "build asks for routes only with a planner"
        start, goal = one.path.points[0], one.path.points[-1]
        route = self.routes.plan(costmap, start, goal)
        if route.path is None or route.reason:
            raise WideberthError(
                f"furnished: no route for {one.name} from {start} to {goal}: {route.reason}; move "
                "walls or robots, or take a smaller room"
            )
        return route.path
