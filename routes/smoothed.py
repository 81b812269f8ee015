"""A route planner whose paths are smoothed."""

from dataclasses import dataclass, field
from typing import ClassVar, final

import numpy as np
from numpy.typing import ArrayLike

from ..framework.route_planner import Route, RoutePlanner
from ..framework.values.arrays import Array, BoolArray, positive
from ..framework.values.costmap import Costmap
from ..framework.values.path import Path
from .navfn import NavFn


@final
@dataclass(frozen=True)
class SmoothedRoutes(RoutePlanner):
    """Smooth the paths of another planner, as far as the costmap allows it.

    With points x_i at distances s_i apart and h_i = (s_i-1 + s_i) / 2 the path y minimises

        sum_i h_i |y_i - x_i|^2 + length^2 sum_i |y_i+1 - y_i|^2 / s_i,   ends fixed.

    In the limit of dense points y is x averaged over the weights exp(-|s| / length): a right
    angle is cut at a distance of length / sqrt(2). Where a step of the smoothed path would
    pass a cell of cost 253 or 254 or leave the map, its points and those around it keep
    their places, and the others are smoothed anew; at worst the path stays what it was.

    This is the fixed point of Nav2's simple smoother with weights in the ratio
    (length / s)^2; it is computed at once, and does not depend on how dense the points are.

    Attributes
    ----------
    base : the planner.
    length : m, over which paths are averaged.

    Raises
    ------
    WideberthError : a length that is not above 0.
    """

    base: RoutePlanner = field(default_factory=NavFn)
    length: float = 0.3

    reference: ClassVar[str] = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive("smoothed.length", self.length))

    def plan(self, costmap: Costmap, start: ArrayLike, goal: ArrayLike) -> Route:
        """Find a route, (2,) m to (2,) m; where there is none, the route says why."""
        route = self.base.plan(costmap, start, goal)
        if route.path is None:
            return route
        return Route(smoothed(route.path, costmap, self.length), route.reason)


def smoothed(path: Path, costmap: Costmap, length: float) -> Path:
    """Return a path that is averaged over a length (m) where the costmap allows it."""
    points = np.array(path.points)
    fixed = np.zeros(len(points), dtype=np.bool_)
    fixed[[0, -1]] = True
    reach = 0
    while True:
        found = _least(points, length, fixed)
        blocked = costmap.blocked_steps(found) & ~(fixed[:-1] & fixed[1:])
        if not blocked.any():
            break
        fixed |= _around(blocked, reach)
        reach = 2 * reach + 1
    still = (np.diff(found, axis=0) == 0.0).all(axis=1)
    return path if still.any() else Path(found)


def _least(points: Array, length: float, fixed: BoolArray) -> Array:
    """Return the points of least energy, (P, 2) m; fixed ones keep their places."""
    from scipy.linalg import solve_banded

    step = np.hypot(*np.diff(points, axis=0).T)
    pull = length**2 / step
    share = np.zeros(len(points))
    share[:-1] += 0.5 * step
    share[1:] += 0.5 * step
    bands = np.zeros((3, len(points)))
    bands[0, 1:], bands[2, :-1] = -pull, -pull
    bands[1] = share
    bands[1, :-1] += pull
    bands[1, 1:] += pull
    bands[0, 1:][fixed[:-1]] = 0.0
    bands[2, :-1][fixed[1:]] = 0.0
    bands[1, fixed] = 1.0
    wanted = np.where(fixed[:, None], points, share[:, None] * points)
    found = solve_banded((1, 1), bands, wanted)
    return np.where(fixed[:, None], points, found)


def _around(steps: BoolArray, reach: int) -> BoolArray:
    """Return the points at the ends of steps, and those at most ``reach`` points farther."""
    ends = np.zeros(len(steps) + 1, dtype=np.bool_)
    ends[:-1] |= steps
    ends[1:] |= steps
    near = np.convolve(ends, np.ones(2 * reach + 1), mode="full")[reach : reach + len(ends)]
    return np.asarray(near > 0.5)
