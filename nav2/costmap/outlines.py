"""Costs under the edges of a footprint at many poses."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...framework.jit.late import late
from ...framework.values.arrays import Array
from ...framework.values.costmap import Costmap
from .footprint import line_cost, outline_cost


def outline_costs(
    costmap: Costmap, vertices: Array, poses: Array, back: bool = False
) -> NDArray[np.int64]:
    """Return the highest cost on the edges of a polygon at each pose, (P,).

    See `wideberth.nav2.costmap.footprint.RobotFootprint.cost`.

    Parameters
    ----------
    vertices : (V, 2), m, in the body's frame.
    poses : (P, 3), m and rad.
    back : draw the last edge from the last vertex to the first. The cells of a line depend on
        where it begins; the last edge of Nav2's own checks runs from the first to the last.
    """
    left, low = costmap.origin
    found = compiled()(costmap.cells, left, low, costmap.resolution, vertices, poses, back)
    return np.asarray(found)


def each_outline(
    cells: NDArray[np.uint8], left: float, low: float, resolution: float, vertices: Array,
    poses: Array, back: bool,
) -> NDArray[np.int64]:  # fmt: skip
    """Return the cost of every pose, see `outline_costs`."""
    found = np.empty(len(poses), np.int64)
    for k in range(len(poses)):
        x, y, yaw = poses[k]
        found[k] = outline_cost(cells, left, low, resolution, vertices, x, y, yaw, back)
    return found


@cache
def compiled() -> Callable[..., Any]:
    """Return `each_outline` as Numba compiles it."""
    return late([each_outline], [outline_cost, line_cost])[0]
