"""Inflation of a costmap: costs fall with the distance from the nearest obstacle, as in Nav2."""

from dataclasses import dataclass
from math import ceil
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..framework.values.arrays import positive, settle
from ..framework.values.costmap import (
    FREE_SPACE,
    INSCRIBED,
    LETHAL,
    MAX_NON_OBSTACLE,
    NO_INFORMATION,
    Costmap,
)
from ..framework.values.errors import WideberthError

_STEPS = 100
"""Distances are rounded to so many parts of a cell."""

Window = tuple[int, int, int, int]
"""Columns from the first to before the third, rows from the second to before the fourth."""


@final
@dataclass(frozen=True)
class Inflation:
    """Nav2's inflation layer.

    At the distance d (m) from the centre of the nearest lethal cell the cost is

        254                                                    d = 0
        253                                                    d <= inscribed_radius
        floor(252 exp(-cost_scaling_factor (d - inscribed_radius)))  otherwise

    up to ceil(inflation_radius / resolution) cells, and 0 beyond. The distance is exact
    (Felzenszwalb), then rounded to a hundredth of a cell. A cell keeps a higher cost that it has.
    One of unknown cost takes 253 and 254 alone.

    Attributes
    ----------
    inscribed_radius : m, of the largest circle within the robot. For a round robot Nav2 takes
        that of a polygon of 16 corners on its circle, radius cos(pi / 16).
    inflation_radius : m, beyond which obstacles cost nothing.
    cost_scaling_factor : 1/m, how fast costs fall.
    inflate_unknown : let unknown cells take every cost above 0.
    inflate_around_unknown : unknown cells count as obstacles.

    Raises
    ------
    WideberthError : a number that is negative or not finite.

    References
    ----------
    Nav2, nav2_costmap_2d, InflationLayer (ros-navigation/navigation2, BSD-3-Clause), of which this
    is an own implementation, equal in every cell. P. F. Felzenszwalb and D. P. Huttenlocher,
    Distance transforms of sampled functions, Theory of Computing 8 (2012).

    Examples
    --------
    >>> wall = Costmap([[254, 0, 0, 0, 0]], resolution=0.1)
    >>> Inflation(inscribed_radius=0.1, inflation_radius=0.3).inflated(wall).cells.tolist()
    [[254, 253, 92, 34, 0]]
    """

    inscribed_radius: float
    inflation_radius: float = 0.55
    cost_scaling_factor: float = 10.0
    inflate_unknown: bool = False
    inflate_around_unknown: bool = False

    def __post_init__(self) -> None:
        for name in ("inscribed_radius", "inflation_radius", "cost_scaling_factor"):
            value = positive(f"inflation.{name}", getattr(self, name), zero=True)
            settle(self, **{name: value})

    def cost_at(self, cells: float, resolution: float) -> int:
        """Cost at a distance in cells, which is not rounded.

        Parameters
        ----------
        cells : distance from the nearest lethal cell, in cells.
        resolution : m, side of a cell.
        """
        return int(self._costs(np.array([float(cells)]), resolution)[0])

    def inflated(self, costmap: Costmap, window: Window | None = None) -> Costmap:
        """Return the costmap with the costs around its obstacles.

        Parameters
        ----------
        costmap : with lethal cells and, if need be, unknown ones.
        window : columns and rows that are inflated; obstacles count that are at most the
            inflation radius away from it. None for the whole costmap.

        Raises
        ------
        WideberthError : a window that is not within the costmap.
        """
        x0, y0, x1, y1 = _within(costmap, window)
        reach = ceil(self.inflation_radius / costmap.resolution)
        reach = min(reach, costmap.width + costmap.height)  # farther apart are no two cells
        left, low = max(x0 - reach, 0), max(y0 - reach, 0)
        near = costmap.cells[low : y1 + reach, left : x1 + reach]
        inner = np.s_[y0 - low : y1 - low, x0 - left : x1 - left]
        found = self._around(near, inner, reach, costmap.resolution)
        cells = costmap.cells.copy()
        cells[y0:y1, x0:x1] = self._merged(near[inner], found)
        return Costmap(cells, costmap.resolution, costmap.origin)

    def _around(
        self, cells: NDArray[np.uint8], inner: tuple[slice, slice], reach: int, resolution: float
    ) -> NDArray[np.uint8]:
        """Return the costs that the obstacles among some cells give to the inner ones."""
        from scipy.ndimage import distance_transform_edt

        obstacle = cells == LETHAL
        if self.inflate_around_unknown:
            obstacle |= cells == NO_INFORMATION
        if not obstacle.any():
            return np.zeros_like(cells[inner])
        far = distance_transform_edt(~obstacle)[inner]
        squares = np.minimum(np.rint(far * far), (reach + 1) ** 2).astype(np.int64)
        return self._by_square(reach, resolution)[squares]

    def _by_square(self, reach: int, resolution: float) -> NDArray[np.uint8]:
        """Costs at the square roots of 0, 1, 2 ... (reach + 1)^2 cells."""
        distance = np.sqrt(np.arange((reach + 1) ** 2 + 1).astype(np.float32))
        table = self._costs(np.arange(_STEPS * reach + 2) / _STEPS, resolution)
        place = ((distance * np.float32(_STEPS)).astype(np.float64) + 0.5).astype(np.int64)
        costs = table[np.minimum(place, len(table) - 1)]
        return np.where(distance <= reach, costs, np.uint8(FREE_SPACE))

    def _costs(self, cells: NDArray[np.float64], resolution: float) -> NDArray[np.uint8]:
        """Costs at distances in cells, (...) -> (...)."""
        distance = cells * resolution
        outside = np.maximum(distance - self.inscribed_radius, 0.0)
        beyond = (MAX_NON_OBSTACLE * np.exp(-self.cost_scaling_factor * outside)).astype(np.int64)
        costs = np.where(distance <= self.inscribed_radius, INSCRIBED, beyond)
        return np.where(cells == 0.0, LETHAL, costs).astype(np.uint8)

    def _merged(self, old: NDArray[np.uint8], new: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the higher of both costs; unknown cells follow a rule of their own."""
        least = FREE_SPACE + 1 if self.inflate_unknown else INSCRIBED
        known = np.maximum(old, new)
        if not (old == NO_INFORMATION).any():
            return known
        unknown = np.where(new >= least, new, np.uint8(NO_INFORMATION))
        return np.where(old == NO_INFORMATION, unknown, known)


def _within(costmap: Costmap, window: Window | None) -> Window:
    """Return a window that lies within the costmap."""
    x0, y0, x1, y1 = window or (0, 0, costmap.width, costmap.height)
    if not (0 <= x0 < x1 <= costmap.width and 0 <= y0 < y1 <= costmap.height):
        raise WideberthError(
            f"inflation window is {window}; wanted (x0, y0, x1, y1) with 0 <= x0 < x1 <= "
            f"{costmap.width} and 0 <= y0 < y1 <= {costmap.height}"
        )
    return x0, y0, x1, y1
