"""All that one decision has to look at, and the numbers that the problem takes of it."""

from dataclasses import dataclass
from math import hypot
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from ...region import Region
from ...robot import Robot
from ...static_region import StaticRegion
from ...values.arrays import Array
from ..instance.obstacles import CAPACITIES, Obstacles, fill
from ..instance.polygons import Walls, fill_walls
from ..levels.base import LevelPolicy
from ..ocp.bodies import bodies
from ..ocp.problem import Parameters
from ..ocp.reference import Reference

if TYPE_CHECKING:
    from .planner import Planner


@dataclass(frozen=True, eq=False)
class Situation:
    """Where the robot starts, where it should go and what stands or moves in its way.

    Attributes
    ----------
    start : (n,), the plan's first state.
    reference : along the path.
    obstacles, walls : Gaussian discs and convex polygons that the plan keeps clear of.
    own : (N, D, D), m^2, covariance of the robot's own position.
    """

    start: Array
    reference: Reference
    obstacles: Obstacles
    walls: Walls
    own: Array

    def parameters(
        self,
        robot: Robot,
        region: Region,
        level: LevelPolicy,
        margin: float,
        static_region: StaticRegion | None,
    ) -> Parameters:
        """Fill the parameters of the smallest problem that has room for all.

        Parameters
        ----------
        robot, region, level, static_region : the plug-ins.
        margin : m, added around the robot's bodies.
        """
        parameters = fill(
            self.start,
            self.reference,
            self.obstacles,
            region,
            level,
            bodies(robot, region)[0].radius + margin,
            next(size for size in CAPACITIES if size >= len(self.obstacles)),
            self.own,
        )
        if static_region is None:
            return parameters
        spread = _deviations(level) ** 2 * self.own
        radius = bodies(robot, static_region)[0].radius + margin
        return fill_walls(parameters, self.walls, static_region, radius, spread)


def nearness(planner: "Planner", own: Array) -> float:
    """How near a polygon has to be to the route to come into the problem, m.

    Body, margin and own uncertainty, and as much as a plan may turn aside: half of what the
    reference covers. A plan that goes farther is still held against all polygons.
    """
    aside = 0.5 * planner.reference_speed * planner.horizon * planner.dt
    return planner.robot.radius + planner.margin + aside + widest(own, planner.level)


def widest(own: Array, level: LevelPolicy) -> float:
    """How much a body is enlarged before a polygon by the robot's own uncertainty, at most, m."""
    return _deviations(level) * float(np.sqrt(np.linalg.eigvalsh(own)[:, -1].max(initial=0.0)))


def _deviations(level: LevelPolicy) -> float:
    """Return s: a line that separates body and polygon by s deviations keeps the risk at Phi(-s).

    Of an outline that holds for each corner: where the heading is uncertain as well, corners on
    either side of the robot's position come near for opposite errors, and the risk of the body
    is at most twice that.
    """
    return max(-float(special.ndtri(level.tail)), 0.0)


def reach_of_bodies(robot: Robot, *regions: Region | StaticRegion | None) -> float:
    """How far centres and corners of the bodies are from the robot's position, m."""
    places = [
        place
        for region in regions
        if region is not None
        for body in bodies(robot, region)
        for place in (body.centre, *body.outline)
    ]
    return max((hypot(*place) for place in places), default=0.0)
