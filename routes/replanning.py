"""When a route is planned anew: at a rate, and at once where it is blocked."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from ..framework.route_planner import Route, RoutePlanner
from ..framework.values.arrays import Array, checked, positive
from ..framework.values.costmap import Costmap
from ..framework.values.path import Path

NEAR_GOAL = 4.0
"""m to the goal; closer to it a free route is kept, as by Nav2's default behaviour tree."""


@final
@dataclass(frozen=True, eq=False)
class KeptRoute:
    """The route that a robot follows.

    Attributes
    ----------
    route : newest one.
    goal : (2,), m, that it was planned for.
    stamp : s, when it was planned or last tried.
    """

    route: Route
    goal: Array
    stamp: float


@final
@dataclass(frozen=True)
class Replanning:
    """Keep a route until it is blocked or its time has come.

    A route is planned anew where there is none yet, the goal is another one, the rest of its
    path is blocked, the clock has jumped back, or ``period`` has passed. Closer to the goal than
    `NEAR_GOAL`, along the path, the passing of time is no reason. These are the rules of Nav2's
    default behaviour tree, except that a blocked path does not wait for the period. If no new
    route is found, the old one is kept while it is free. Where there is none, the next attempt
    follows after the period.

    Attributes
    ----------
    planner : finds the routes.
    period : s, between two routes.

    Raises
    ------
    WideberthError : a number that is negative or not finite.
    """

    planner: RoutePlanner
    period: float = 1.0

    def __post_init__(self) -> None:
        period = positive("replanning.period", self.period, zero=True)
        object.__setattr__(self, "period", period)

    def update(
        self, kept: KeptRoute | None, time: float, costmap: Costmap, position: ArrayLike,
        goal: ArrayLike,
    ) -> KeptRoute:  # fmt: skip
        """Return the route to follow from now on.

        Parameters
        ----------
        kept : what the last call returned; None at first.
        time : s.
        costmap : newest one.
        position : (2,), m, of the robot.
        goal : (2,), m.
        """
        here = checked("position", position, (2,), finite=False)
        target = checked("goal", goal, (2,), finite=False)
        old = kept if kept is not None and np.array_equal(kept.goal, target) else None
        path = old.route.path if old is not None else None
        free = path is not None and not is_blocked(path, costmap, here)
        if old is not None and not self._due(old, time, here, free):
            return old
        route = self.planner.plan(costmap, here, target)
        if route.path is None and free:
            route = Route(path, f"the former route is kept: {route.reason}")
        return KeptRoute(route, target, time)

    def _due(self, kept: KeptRoute, time: float, position: Array, free: bool) -> bool:
        """Tell whether a new route is wanted for the same goal."""
        path = kept.route.path
        if time < kept.stamp or (path is not None and not free):
            return True
        if time - kept.stamp < self.period:
            return False
        return path is None or path.length - path.project(position) >= NEAR_GOAL


def is_blocked(path: Path, costmap: Costmap, position: ArrayLike) -> bool:
    """Tell whether the rest of a path, from the point nearest to the robot, is blocked.

    Parameters
    ----------
    path : in the plane.
    costmap : see `wideberth.framework.values.costmap.Costmap.blocked_steps`.
    position : (2,), m, of the robot.
    """
    here = checked("position", position, (2,), finite=False)
    if not np.isfinite(here).all():
        return False
    return bool(costmap.blocked_steps(rest_of(path, here)).any())


def rest_of(path: Path, position: Array) -> Array:
    """Return the points of a path from the one nearest to a position, (2,) m, on: (P, 2), m."""
    begin = path.project(position)
    return np.concatenate([path.at(np.array([begin])), path.points[path.arc > begin]])
