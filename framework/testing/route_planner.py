"""The contract of a RoutePlanner, checked on small maps: a hall, a door, a maze, a closed room."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..route_planner import Route, RoutePlanner
from ..values.arrays import Array, BoolArray
from ..values.costmap import INSCRIBED, LETHAL, MAX_NON_OBSTACLE, Costmap
from .laws import Contract, Law, law, stated

_CELL = 0.0625
"""m; a power of two, so that a map can be moved without rounding."""
_SIZE = (60, 80)
"""Rows and columns of the maps."""
_MOVE = (32.0, -16.0)
"""m, by which maps are moved."""
_RADIUS, _REACH = 0.15, 0.4
"""m, from a wall: where no robot may be, and where the costs end."""


@Contract
def check_route_planner(planner: RoutePlanner) -> Iterator[Law]:
    """Check the laws of a route planner.

    On each map with a way it finds a path, finite, from the start to the goal to within a cell
    and a half, that touches no lethal cell; the same input gives the same route and leaves the
    costmap as it was; a map that is moved moves its route along. A start or a goal off the map or
    not finite, and a goal behind walls, give a reason and no exception.

    Parameters
    ----------
    planner : what to check.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    cases = [_Case(planner, *case) for case in _maps()]
    yield from stated(_Case, planner, lambda: cases)
    yield Law("no way, a reason", lambda: _check_reasons(planner))


@dataclass(frozen=True, eq=False)
class _Case:
    """A map with a way from a start to a goal."""

    planner: RoutePlanner
    name: str
    costmap: Costmap
    start: tuple[float, float]
    goal: tuple[float, float]

    @cached_property
    def route(self) -> Route:
        return self.planner.plan(self.costmap, self.start, self.goal)

    @cached_property
    def points(self) -> Array:
        return np.empty((0, 2)) if self.route.path is None else self.route.path.points

    @law("finds the way")
    def check_found(self) -> None:
        self._demand(self.route.path is not None, f"there is a way, but: {self.route.reason}")

    @law("leads from start to goal")
    def check_ends(self) -> None:
        for name, point, wanted in (("start", 0, self.start), ("goal", -1, self.goal)):
            far = np.hypot(*(self.points[point] - wanted)) if len(self.points) else 0.0
            self._demand(far <= 1.5 * _CELL, f"the path is {far:.3g} m off the {name}")

    @law("touches no lethal cell")
    def check_clear(self) -> None:
        costs = self.costmap.at(self.points, outside=LETHAL)
        self._demand(not (costs == LETHAL).any(), "the path touches a lethal cell")

    @law("same input, same route")
    def check_repeats(self) -> None:
        before = self.costmap.cells.copy()
        same = np.array_equal(replace(self).points, self.points)
        self._demand(same, "the second route differs from the first")
        self._demand(np.array_equal(before, self.costmap.cells), "the costmap has changed")

    @law("a moved map moves the route")
    def check_moved(self) -> None:
        origin = (self.costmap.origin[0] + _MOVE[0], self.costmap.origin[1] + _MOVE[1])
        moved = replace(
            self, costmap=Costmap(self.costmap.cells, _CELL, origin),
            start=(self.start[0] + _MOVE[0], self.start[1] + _MOVE[1]),
            goal=(self.goal[0] + _MOVE[0], self.goal[1] + _MOVE[1]),
        )  # fmt: skip
        same = moved.points.shape == self.points.shape
        off = float(np.abs(moved.points - _MOVE - self.points).max(initial=0.0)) if same else 1.0
        self._demand(off < 1e-9, "the route has not moved with the map")

    def _demand(self, holds: bool, law: str) -> None:
        assert holds, f"{law} (map {self.name!r})"


def _costmap(occupied: BoolArray) -> Costmap:
    """Return the inflated costs of a map with walls all around."""
    costs = np.where(occupied, LETHAL, 0)
    costs[[0, -1]] = costs[:, [0, -1]] = LETHAL
    from scipy.ndimage import distance_transform_edt

    away = _CELL * distance_transform_edt(costs != LETHAL)
    falling = MAX_NON_OBSTACLE * np.exp(-10.0 * np.maximum(away - _RADIUS, 0.0))
    near = np.where(away <= _RADIUS, INSCRIBED, falling.astype(int))
    costs = np.where(costs == LETHAL, LETHAL, np.where(away <= _REACH, near, 0))
    return Costmap(costs, _CELL, (-1.0, 0.5))


def _maps() -> Iterator[tuple[str, Costmap, tuple[float, float], tuple[float, float]]]:
    """Yield maps with a way: name, costs, start, goal."""
    start, goal = (-0.53, 1.03), (3.41, 3.37)
    free = np.zeros(_SIZE, dtype=np.bool_)
    yield "hall", _costmap(free), start, goal
    door = free.copy()
    door[:, 40:43] = True
    door[34:46, 40:43] = False
    yield "door", _costmap(door), start, goal
    maze = free.copy()
    maze[:40, 26:28] = True
    maze[20:, 54:56] = True
    yield "maze", _costmap(maze), start, goal


def _check_reasons(planner: RoutePlanner) -> None:
    hall = _costmap(np.zeros(_SIZE, dtype=np.bool_))
    closed = np.zeros(_SIZE, dtype=np.bool_)
    closed[:, 38:42] = True
    inside, beyond, away = (-0.53, 1.03), (3.41, 1.03), (90.0, 1.0)
    asked: tuple[tuple[str, Costmap, ArrayLike, ArrayLike], ...] = (
        ("a start off the map", hall, away, inside),
        ("a goal off the map", hall, inside, away),
        ("a start that is not finite", hall, (np.nan, 1.0), inside),
        ("a goal that is not finite", hall, inside, (np.inf, 1.0)),
        ("a goal behind a wall", _costmap(closed), inside, beyond),
        ("a start behind a wall", _costmap(closed), beyond, inside),
    )
    for name, costmap, start, goal in asked:
        route = planner.plan(costmap, start, goal)
        assert route.path is None and route.reason, f"{name} needs a reason and no path"
