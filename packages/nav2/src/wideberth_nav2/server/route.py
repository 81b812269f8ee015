"""When Nav2's default behaviour tree plans a new route, and over which costmap."""

from dataclasses import replace
from typing import final

import numpy as np

from wideberth.framework.route_planner import RoutePlanner
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.path import Path

from ..costmap.footprint import RobotFootprint
from ..costmap.local_costmap import CostmapSurroundings, CostmapView, LayeredCostmap
from ..costs import INSCRIBED, LETHAL
from ..poses import length

PERIOD, NEAR_GOAL, SEARCH, MARGIN = 1.0, 4.0, 1.5, 4.0
"""s between two looks; m to the goal, along the path, within which a path that is free is kept;
m of the path over which the robot's place on it is sought; m by which the costmap reaches beyond
the path."""


@final
class GlobalRoute:
    """The route to one goal: planned anew each second, or only when blocked near the goal.

    Parameters
    ----------
    planner : finds routes.
    costmap : the global one.
    footprint : of the robot, with its padding.
    path : (N, 3), the first route.
    """

    def __init__(
        self,
        planner: RoutePlanner,
        costmap: LayeredCostmap,
        footprint: RobotFootprint,
        path: Array,
    ) -> None:
        self._planner, self._costmap, self._footprint = planner, costmap, footprint
        self._left, self._goal = path, path[-1]
        self._looked = -np.inf

    @classmethod
    def around(
        cls, planner: RoutePlanner, view: CostmapView, footprint: RobotFootprint, path: Array
    ) -> "GlobalRoute":
        """Return the route to the end of a path (N, 3), over a costmap about it.

        Parameters
        ----------
        view : of the local costmap; this one stays in its place, and is updated each second.
        """
        low = path[:, :2].min(axis=0) - MARGIN
        size = path[:, :2].max(axis=0) + MARGIN - low
        wide = replace(
            view, rolling_window=False, origin_x=float(low[0]), origin_y=float(low[1]),
            width=float(size[0]), height=float(size[1]), update_frequency=1.0 / PERIOD,
        )  # fmt: skip
        return cls(planner, LayeredCostmap(wide, footprint), footprint, path)

    def clear(self) -> None:
        """Clear the global costmap."""
        self._costmap.clear()

    def due(self, time: float) -> bool:
        """Return whether it is time, s, to look whether a new route is wanted."""
        return not self._looked <= time < self._looked + PERIOD

    def update(
        self, time: float, pose: Array, seen: CostmapSurroundings
    ) -> tuple[Path | None, str]:
        """Return a new path, if one is wanted and there is one, or why there is none.

        Parameters
        ----------
        time : s.
        pose : (3,), of the robot.
        seen : what is around it.
        """
        self._looked = time
        costmap = self._costmap.update(time, pose, seen)
        self._pass(pose)
        if length(self._left) < NEAR_GOAL and not blocked(costmap, self._footprint, self._left):
            return None, ""
        route = self._planner.plan(costmap, pose[:2], self._goal[:2])
        if route.path is None:
            self._costmap.clear()
            costmap = self._costmap.update(time, pose, seen)
            route = self._planner.plan(costmap, pose[:2], self._goal[:2])
        if route.path is None:
            return None, f"no route: {route.reason}"
        points = route.path.points
        step = np.diff(points, axis=0, append=points[-1:])
        self._left = np.column_stack([points, np.arctan2(step[:, 1], step[:, 0])])
        return route.path, ""

    def _pass(self, pose: Array) -> None:
        """Forget what the robot has passed."""
        steps = np.hypot(*np.diff(self._left[:, :2], axis=0).T)
        near = np.r_[0.0, np.cumsum(steps)] <= SEARCH
        apart = np.hypot(*(self._left[near, :2] - pose[:2]).T)
        self._left = self._left[int(np.argmin(apart)) :]


def blocked(costmap: Costmap, footprint: RobotFootprint, path: Array) -> bool:
    """Return whether the robot could not stand at a pose of a path (N, 3).

    A round robot cannot where its centre costs 253 or 254, or off the map; another one where its
    outline costs 254 or more.
    """
    if footprint.use_radius:
        costs = costmap.at(path[:, :2], outside=LETHAL)
        return bool(((costs == INSCRIBED) | (costs == LETHAL)).any())
    return any(footprint.cost(costmap, pose) >= LETHAL for pose in path)
