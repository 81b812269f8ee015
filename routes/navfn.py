"""Nav2's global planner NavFn: a wave over the costmap, and the way down its slope."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..framework.route_planner import Route, RoutePlanner
from ..framework.values.arrays import Array, checked, positive, whole
from ..framework.values.costmap import FREE_SPACE, INSCRIBED, LETHAL, NO_INFORMATION, Costmap
from ..framework.values.errors import WideberthError
from ..framework.values.path import Path
from . import _wave

_COINCIDE = 1e-6
"""m^2. A goal that is nearer to the last point of a path takes its place."""
_CUT_SHORT = "NavFn's limit of cycles stopped the wave before (a larger map allows more)"


@dataclass(frozen=True, eq=False)
class Wave:
    """Potentials that spread from the robot's cell over a costmap.

    Attributes
    ----------
    costs : (height, width), what it costs to cross a cell: 50 to 253, and 254 for obstacles and
        the outermost cells.
    potential : (height, width), float32, least cost from the robot's cell; 1e10 where the
        wave has not come.
    start : column and row of the robot's cell.
    cut_short : whether the limit of cycles ended the wave.
    """

    costs: NDArray[np.uint8]
    potential: NDArray[np.float32]
    start: tuple[int, int]
    cut_short: bool

    def reached(self, cell: tuple[int, int]) -> bool:
        """Tell whether the wave has come to a cell, given by column and row."""
        return bool(self.potential[cell[1], cell[0]] < _wave.UNREACHED)

    def way_down(self, cell: tuple[int, int], most: int) -> tuple[NDArray[np.float32], bool]:
        """Return the way from a cell down to the robot's, and whether it arrives.

        Parameters
        ----------
        cell : column and row where it begins.
        most : points after which it is given up.

        Returns
        -------
        points : (K, 2), columns and rows with fractions, float32.
        arrived : whether the last one is the robot's cell.
        """
        wide = self.potential.shape[1]
        _, descend = _wave.compiled()
        robot, begin = (my * wide + mx for mx, my in (self.start, cell))
        points, arrived = descend(self.potential.ravel(), robot, begin, wide, most)
        return points, bool(arrived)


@final
@dataclass(frozen=True)
class NavFn(RoutePlanner):
    """NavFn of Nav2: a planar wave, and from the goal down its gradient in steps of half a cell.

    A wave spreads from the robot until it reaches the goal. A cell of translated cost h takes,
    from the lowest of its neighbours on each axis t_a <= t_b, the potential

        t_a + h                                               t_b - t_a >= h
        t_a + h (-0.2301 q^2 + 0.5307 q + 0.7040)   q = (t_b - t_a) / h

    where h = min(50 + 0.8 cost, 253) below 253, 253 for unknown cells if they are allowed, and
    an obstacle otherwise. Potentials and paths equal the original's bit by bit, with its
    peculiarities: points belong to the nearest corner of cells, not to the cell that holds
    them; the start's cell is taken for free; at most max(width height / 20, width + height)
    cycles run, which long mazes on small maps exceed; A* may run into a pit of its unfinished
    potential and find no way.

    Where the goal cannot be reached the route ends at the reachable point nearest to it.

    Attributes
    ----------
    tolerance : m, half the side of the square about the goal that is searched for such a point.
    use_astar : order the wave by the distance from the goal, so that it covers fewer cells.
    allow_unknown : let routes pass unknown cells, at the highest cost.
    max_cycles_factor : a path has at most so many points per cell of the longer side.

    Raises
    ------
    WideberthError : a tolerance that is negative, a factor that is no whole number above 0.

    References
    ----------
    K. Konolige, A gradient method for realtime robot control, IROS 2000, for the method; Nav2,
    nav2_navfn_planner (ros-navigation/navigation2, BSD-3-Clause), of which this is an own
    implementation.

    Examples
    --------
    >>> room = Costmap(np.zeros((40, 40)), resolution=0.05)
    >>> route = NavFn().plan(room, (0.3, 0.3), (1.5, 1.2))
    >>> round(route.path.length, 2), route.path.goal.tolist()
    (1.5, [1.5, 1.2])
    >>> NavFn().plan(room, (0.3, 0.3), (3.0, 1.2)).reason
    'the goal (3, 1.2) lies outside the costmap, which covers x from 0 to 2 m, y from 0 to 2 m'
    """

    reference: ClassVar[str] = "konolige2000gradient"

    tolerance: float = 0.5
    use_astar: bool = False
    allow_unknown: bool = True
    max_cycles_factor: int = 4

    def __post_init__(self) -> None:
        tolerance = positive("navfn.tolerance", self.tolerance, zero=True)
        factor = whole("navfn.max_cycles_factor", self.max_cycles_factor)
        object.__setattr__(self, "tolerance", tolerance)
        object.__setattr__(self, "max_cycles_factor", factor)

    def plan(self, costmap: Costmap, start: ArrayLike, goal: ArrayLike) -> Route:
        """Find a route, (2,) m to (2,) m; where there is none, the route says why."""
        begin = checked("start", start, (2,), finite=False)
        target = checked("goal", goal, (2,), finite=False)
        for name, point in (("start", begin), ("goal", target)):
            if not costmap.inside(point) or nearest_cell(costmap, point) is None:
                return Route(None, _outside(name, point, costmap))
        if np.array_equal(begin, target):
            return Route(None, f"start and goal are the same point {_named(begin)}")
        if self.tolerance == 0.0 and costmap.at(target, LETHAL) == LETHAL:
            return Route(None, f"the goal {_named(target)} lies in an obstacle")
        wave = self.wave(costmap, begin, target)
        end = self._end(costmap, wave, target)
        if end is None:
            return Route(None, self._unreachable(costmap, wave, begin, target))
        longest = self.max_cycles_factor * max(costmap.width, costmap.height)
        cells, arrived = wave.way_down(_known_cell(costmap, end), longest)
        if not arrived:
            what = f"the way down from {_named(end)} does not arrive within {longest} points"
            return Route(None, f"{what}{'; A* alone leaves such pits' * self.use_astar}")
        points = costmap.origin + cells[::-1].astype(np.float64) * costmap.resolution
        return _route(_with_end(points, end), target, wave.cut_short)

    def wave(self, costmap: Costmap, start: ArrayLike, goal: ArrayLike) -> Wave:
        """Let the wave spread from the start until it reaches the goal.

        Parameters
        ----------
        costmap : where.
        start, goal : (2,), m, on the costmap.

        Raises
        ------
        WideberthError : a start or goal that is not on the costmap.
        """
        robot = _known_cell(costmap, checked("start", start, (2,)))
        target = _known_cell(costmap, checked("goal", goal, (2,)))
        costs = self._translated(costmap, robot)
        spread, _ = _wave.compiled()
        wide = costmap.width
        flat, left = spread(
            costs.ravel(), robot[1] * wide + robot[0], target[1] * wide + target[0], wide,
            bool(self.use_astar),
        )  # fmt: skip
        return Wave(costs, flat.reshape(costs.shape), robot, left == 0)

    def _translated(self, costmap: Costmap, robot: tuple[int, int]) -> NDArray[np.uint8]:
        """Return what it costs to cross each cell."""
        found = costmap.cells.astype(np.float64)
        found[robot[1], robot[0]] = FREE_SPACE
        crossing = np.minimum(_wave.NEUTRAL + 0.8 * found, _wave.OBSTACLE - 1)
        unknown = _wave.OBSTACLE - 1 if self.allow_unknown else _wave.OBSTACLE
        costs = np.where(found < INSCRIBED, crossing, _wave.OBSTACLE)
        costs = np.where(found == NO_INFORMATION, unknown, costs).astype(np.uint8)
        costs[[0, -1]] = costs[:, [0, -1]] = _wave.OBSTACLE
        return costs

    def _end(self, costmap: Costmap, wave: Wave, goal: Array) -> Array | None:
        """Return the goal, or the reachable point nearest to it within the tolerance."""
        if wave.reached(_known_cell(costmap, goal)):
            return goal
        best, found = np.inf, None
        for y in _steps(float(goal[1]), self.tolerance, costmap.resolution):
            for x in _steps(float(goal[0]), self.tolerance, costmap.resolution):
                point = np.array([x, y])
                cell = nearest_cell(costmap, point)
                far = (x - goal[0]) ** 2 + (y - goal[1]) ** 2
                if cell is not None and far < best and wave.reached(cell):
                    best, found = far, point
        return found

    def _unreachable(self, costmap: Costmap, wave: Wave, start: Array, goal: Array) -> str:
        """Say why the wave did not come near the goal."""
        if wave.cut_short:
            return f"the goal {_named(goal)} was not reached: {_CUT_SHORT}"
        if int(costmap.at(start, LETHAL)) in (INSCRIBED, LETHAL):
            return f"the start {_named(start)} lies in an obstacle, and no way leads to the goal"
        place = " lies in an obstacle and" if costmap.at(goal, LETHAL) == LETHAL else ""
        return (
            f"the goal {_named(goal)}{place} cannot be reached, nor can a point within the "
            f"tolerance of {self.tolerance:g} m"
        )


def _route(points: Array, goal: Array, cut_short: bool) -> Route:
    """Return the route along points, without those that repeat the one before."""
    moved = np.r_[True, (np.diff(points, axis=0) != 0.0).any(axis=1)]
    points = points[moved]
    if len(points) < 2:
        return Route(None, f"the robot stands at {_named(points[0])}, where the route ends")
    gap = float(np.hypot(*(points[-1] - goal)))
    why = f"was not reached: {_CUT_SHORT}" if cut_short else "cannot be reached"
    note = f"the goal {_named(goal)} {why}; the route ends {gap:.3g} m from it"
    return Route(Path(points), note if gap > 0.0 else "")


def nearest_cell(costmap: Costmap, point: Array) -> tuple[int, int] | None:
    """Return NavFn's cell of a point: the one whose lower left corner is nearest, or None."""
    if not np.isfinite(point).all() or (point < costmap.origin).any():
        return None
    cells = (point - costmap.origin) / costmap.resolution
    whole_cells = np.floor(cells)
    rounded = whole_cells + (cells - whole_cells >= 0.5)
    if (rounded >= (costmap.width, costmap.height)).any():
        return None
    return int(rounded[0]), int(rounded[1])


def _known_cell(costmap: Costmap, point: Array) -> tuple[int, int]:
    """Return NavFn's cell of a point that has one."""
    cell = nearest_cell(costmap, point)
    if cell is None:
        raise WideberthError(_outside("point", point, costmap))
    return cell


def _steps(middle: float, reach: float, step: float) -> Iterator[float]:
    """Yield numbers from middle - reach to middle + reach, each the last one plus a step."""
    value = middle - reach
    while value <= middle + reach:
        yield value
        value += step


def _with_end(points: Array, end: Array) -> Array:
    """Let a path end where it should: instead of its last point, or behind it."""
    last = points[-1]
    overshoots = len(points) > 1 and _square(last, points[-2]) > _square(end, points[-2])
    if overshoots or _square(end, last) < _COINCIDE:
        return np.concatenate([points[:-1], end[None]])
    return np.concatenate([points, end[None]])


def _square(first: Array, second: Array) -> float:
    return float((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2)


def _named(point: Array) -> str:
    return f"({point[0]:.4g}, {point[1]:.4g})"


def _outside(name: str, point: Array, costmap: Costmap) -> str:
    """Say that a point is off the map."""
    (x, y), step = costmap.origin, costmap.resolution
    return (
        f"the {name} {_named(point)} lies outside the costmap, which covers x from {x:g} to "
        f"{x + step * costmap.width:g} m, y from {y:g} to {y + step * costmap.height:g} m"
    )
