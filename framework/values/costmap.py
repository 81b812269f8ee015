"""Costmaps: what it costs a robot's centre to be in a cell, as in Nav2."""

from dataclasses import dataclass
from math import ceil
from typing import Any, ClassVar, final

import numpy as np

from .arrays import Array, BoolArray, whole
from .occupancy_grid import OCCUPIED_CELL, UNKNOWN_CELL, CellGrid, OccupancyGrid

COSTS = 0, 252, 253, 254, 255
FREE_SPACE, MAX_NON_OBSTACLE, INSCRIBED, LETHAL, NO_INFORMATION = COSTS
"""Costs as in Nav2: nothing near; the largest where a robot may be; an obstacle within the
robot's inscribed circle; an obstacle in the cell itself; not observed."""


@final
@dataclass(frozen=True, eq=False, repr=False, init=False)
class Costmap(CellGrid):
    """Costs from 0 to 255 on square cells, as in Nav2.

    Its fields and methods are those of `wideberth.framework.values.occupancy_grid.CellGrid`; each
    cell holds a cost, `FREE_SPACE` to `NO_INFORMATION`.
    """

    _label: ClassVar[str] = "costmap"
    _range: ClassVar[tuple[int, int]] = (FREE_SPACE, NO_INFORMATION)
    _type: ClassVar[Any] = np.uint8

    @classmethod
    def from_grid(
        cls,
        grid: OccupancyGrid,
        track_unknown: bool = True,
        lethal_threshold: int = OCCUPIED_CELL,
        trinary: bool = True,
    ) -> "Costmap":
        """Return the costs of a map before inflation, as Nav2's static layer does.

        A cell of at least ``lethal_threshold`` percent is lethal. Every other known cell is free,
        or, where the map is not ``trinary``, costs its share of the threshold.

        Parameters
        ----------
        grid : the map.
        track_unknown : keep unknown cells unknown; otherwise they are free.
        lethal_threshold : percent, from 1 to 100.
        trinary : cells are lethal, free or unknown alone.

        Examples
        --------
        >>> Costmap.from_grid(OccupancyGrid([[0, 65, 100, -1]], 0.1)).cells.tolist()
        [[0, 0, 254, 255]]
        """
        least = whole("lethal_threshold", lethal_threshold)
        unknown = NO_INFORMATION if track_unknown else FREE_SPACE
        below = FREE_SPACE if trinary else grid.cells.astype(np.int64) * LETHAL // least
        costs = np.where(grid.cells >= least, LETHAL, below)
        costs = np.where(grid.cells == UNKNOWN_CELL, unknown, costs)
        return cls(costs.astype(np.uint8), grid.resolution, grid.origin)

    def blocked_steps(self, points: Array) -> BoolArray:
        """Tell which straight steps between neighbouring points pass where a robot may not be.

        That is a cell of cost 253 or 254, or off the map; unknown cells are no hindrance, as in
        Nav2's test of a path. A step is sampled at a quarter of a cell or denser.

        Parameters
        ----------
        points : (P, 2), m.

        Returns
        -------
        blocked : (P - 1,).
        """
        begin, step = points[:-1], np.diff(points, axis=0)
        if not len(step):
            return np.zeros(0, dtype=np.bool_)
        longest = float(np.hypot(step[:, 0], step[:, 1]).max())
        share = np.linspace(0.0, 1.0, 2 + ceil(4.0 * longest / self.resolution))
        costs = self.at(begin[:, None] + share[:, None] * step[:, None], outside=LETHAL)
        return np.asarray(((costs == LETHAL) | (costs == INSCRIBED)).any(axis=1))
